//! Kitchens and dining rooms.

use super::super::furniture::{decor, kitchen, seats, storage, tables};
use super::super::taste::WOOD;
use super::*;

impl Decorator<'_> {
    pub(super) fn kitchen(&mut self) {
        self.counter_run();
        let fridge = kitchen::fridge(self.taste);
        self.stand(&fridge, Wish::Corner, 0.6);
        let dining_elsewhere = self.house_has(RoomKind::DiningRoom);
        if !(dining_elsewhere && self.island()) {
            let chairs = 2 + 2 * self.rng.below(2);
            self.dining_set(chairs);
        }
        let cabinet = storage::sideboard(self.taste, 0.9, 0.4);
        self.stand(&cabinet, Wish::Anywhere, 0.6);
        let stool = seats::stool(self.taste, false);
        self.stand(&stool, Wish::Anywhere, 0.0);
        let bin = decor::bin(self.taste);
        self.stand(&bin, Wish::Corner, 0.0);
        if self.rng.chance(0.5) {
            self.floor_plant();
        }
        self.pictures(1);
        if self.rng.chance(0.7) {
            self.towels(1);
        }
    }

    /// Counters with a sink and a cooker between them, cabinets above.
    fn counter_run(&mut self) {
        for (left, right) in [(1.7, 1.0), (1.4, 0.7), (1.2, 0.5), (1.0, 0.0)] {
            if self.counters(left, right) {
                return;
            }
        }
    }

    fn counters(&mut self, left: f32, right: f32) -> bool {
        let total = left + 0.62 + right;
        let size = Vector3::new(total, kitchen::COUNTER_M, kitchen::COUNTER_DEPTH_M);
        let mut places = self.wall_places(total, Wish::Corner);
        places.sort_by(|a, b| a.2.total_cmp(&b.2));
        let found = places.into_iter().map(|(side, start, _)| {
            (side, start, self.claim_at_wall(side, [start, start + total], size, 0.8))
        });
        let Some((side, start, claim)) = found.into_iter().find(|(.., claim)| self.space.fits(claim)) else {
            return false;
        };
        self.space.take(&claim);
        self.run_of(side, start, [left, right]);
        true
    }

    fn run_of(&mut self, side: Side, start: f32, [left, right]: [f32; 2]) {
        let tint = self.taste.tint("counter", WOOD);
        let room = self.space.room;
        let band = |along: [f32; 2], depth: f32| side.band(&room, along, [GAP_M, GAP_M + depth]);
        let counter = kitchen::counter(self.taste, tint, left - 0.01, Some(0.0));
        let spot = self.set(&counter, side, &band([start, start + left - 0.01], counter.size().z), 0.0);
        let sink = kitchen::kitchen_sink(self.taste);
        self.lay(&sink, &spot, [0.0, kitchen::COUNTER_M, 0.0]);
        let cooker = kitchen::cooker(self.taste);
        self.set(&cooker, side, &band([start + left, start + left + 0.6], cooker.size().z), 0.0);
        if right > 0.0 {
            let from = start + left + 0.62;
            let counter = kitchen::counter(self.taste, tint, right - 0.01, None);
            let spot = self.set(&counter, side, &band([from, from + right - 0.01], counter.size().z), 0.0);
            let plant = decor::plant(self.taste, false);
            self.lay(&plant, &spot, [0.0, kitchen::COUNTER_M, -0.05]);
        }
        for (middle, width) in
            [(start + left / 2.0, left * 0.7), (start + left + 0.62 + right / 2.0, right * 0.9)]
        {
            if width > 0.4 {
                let cabinet = storage::wall_cabinet(self.taste, tint, width);
                self.hang_deep(&cabinet, 1.5, side, middle);
            }
        }
    }

    /// An island with stools before it; whether there was room.
    fn island(&mut self) -> bool {
        let width = self.taste.length_m(1.1, 1.5);
        let Some((side, center)) = self.place_for([width, 0.7 + 0.5]) else { return false };
        let island = kitchen::island(self.taste, width);
        let back = [0.0, -0.25];
        let Some(spot) = self.stand_at(&island, side, shifted(side, center, back)) else { return false };
        let stool = seats::stool(self.taste, true);
        for x in [-width * 0.27, width * 0.27] {
            self.stand_at(&stool, side, shifted(side, spot.center(), [x, 0.35 + 0.24]));
        }
        true
    }

    pub(super) fn dining_room(&mut self) {
        let chairs = 4 + 2 * self.rng.below(2);
        self.dining_set(chairs);
        let cabinet = storage::sideboard(self.taste, 1.4, 0.42);
        if let Some(cabinet) = self.stand(&cabinet, Wish::Middle, 0.6) {
            let vase = decor::vase(self.taste);
            let height = cabinet.height_m();
            self.lay(&vase, &cabinet, [0.3, height, 0.0]);
        }
        let chest = storage::chest_of_drawers(self.taste);
        self.stand(&chest, Wish::Anywhere, 0.6);
        let bench = seats::bench(self.taste, 0.4);
        self.stand(&bench, Wish::Anywhere, 0.4);
        self.floor_plant();
        self.pictures(2);
    }

    /// A table with chairs around it; smaller ones are tried where the wished one has no room.
    fn dining_set(&mut self, chairs: usize) {
        let round = self.rng.chance(0.35);
        for wanted in [6, 4, 2].into_iter().filter(|&wanted| wanted <= chairs) {
            let round = round && wanted <= 4;
            let table = match wanted {
                _ if round => [1.05, 1.05],
                6 => [1.7, 0.9],
                4 => [1.25, 0.8],
                _ => [0.8, 0.8],
            };
            if let Some((side, center)) = self.place_for([table[0] + 0.1, table[1] + 2.0 * 0.56]) {
                self.table_with_chairs(table, round, wanted, side, center);
                return;
            }
        }
        let table = tables::dining_table(self.taste, [0.8, 0.6], false);
        if let Some(table) = self.stand(&table, Wish::Anywhere, 0.9) {
            let chair = seats::chair(self.taste);
            let distance = chair.size().z / 2.0 + 0.04;
            self.stand_at(&chair, table.side.opposite(), table.before(distance));
        }
    }

    fn table_with_chairs(
        &mut self,
        size: [f32; 2],
        round: bool,
        chairs: usize,
        side: Side,
        center: [f32; 2],
    ) {
        let table = tables::dining_table(self.taste, size, round);
        let Some(table) = self.stand_at(&table, side, center) else { return };
        let chair = seats::chair(self.taste);
        let away = size[1] / 2.0 + chair.size().z / 2.0 + 0.03;
        let columns = (chairs / 2).max(1);
        for column in 0..columns {
            let x = (column as f32 + 0.5) / columns as f32 * size[0] - size[0] / 2.0;
            self.stand_at(&chair, side, shifted(side, center, [x, -away]));
            self.stand_at(&chair, side.opposite(), shifted(side, center, [x, away]));
        }
        let vase = decor::vase(self.taste);
        let height = table.height_m();
        self.lay(&vase, &table, [0.0, height, 0.0]);
    }

    /// An open place for something `width` by `depth` and the side to turn its back to; its width along the
    /// room's longer edge if possible.
    fn place_for(&self, [width, depth]: [f32; 2]) -> Option<(Side, [f32; 2])> {
        let room = self.space.room.size();
        let mut turns = [(Side::North, [width, depth]), (Side::West, [depth, width])];
        if room[0] < room[1] {
            turns.reverse();
        }
        turns.into_iter().find_map(|(side, size)| Some((side, self.open_floor(size)?)))
    }
}

/// A place moved by an offset in the frame of a piece with its back to `side`.
fn shifted(side: Side, center: [f32; 2], offset: [f32; 2]) -> [f32; 2] {
    let [x, z] = turned(side.quarter(), offset);
    [center[0] + x, center[1] + z]
}
