//! Kitchens and dining rooms.

use super::*;

/// A piece in a kitchen row.
#[derive(Clone, Copy, PartialEq)]
enum KitchenUnit {
    Counter(f32),
    Sink(f32),
    Cooker,
    Fridge,
    Washer,
}

impl Decorator<'_> {
    pub(super) fn kitchen(&mut self) {
        use KitchenUnit::*;
        let rows: [&[KitchenUnit]; 6] = [
            &[Fridge, Counter(0.8), Sink(1.2), Cooker, Counter(0.8)],
            &[Counter(0.6), Cooker, Sink(1.3), Washer, Fridge],
            &[Fridge, Sink(1.2), Cooker, Counter(0.7)],
            &[Fridge, Sink(1.0), Cooker],
            &[Sink(0.9), Cooker],
            &[Sink(0.8)],
        ];
        let first = self.rng.below(2);
        let look = kitchen::COUNTER.look(self.sampler);
        let row = rows[first..].iter().find(|row| self.row_of(row, &look));
        if row.is_none_or(|row| !row.contains(&Fridge)) {
            self.put(&kitchen::FRIDGE, Wish::Corner, 0.6);
        }
        if self.area_m2() > 10.0 && self.maybe(0.3) {
            let width = self.rng.range(0.9, 1.6);
            self.row_of(&[Counter(width)], &look);
        }
        let dining_elsewhere = self.house_has(RoomKind::DiningRoom);
        let island = (dining_elsewhere || self.area_m2() > 22.0) && self.island(&look);
        if !island || self.area_m2() > 26.0 {
            let chairs = 4 + 2 * self.rng.below(2);
            self.dining_set(chairs);
        }
    }

    /// Adds a row of counters and machines at a wall, with cabinets and a hood above; returns false without
    /// room.
    fn row_of(&mut self, units: &[KitchenUnit], look: &Look) -> bool {
        let pieces: Vec<Piece> = units.iter().map(|unit| self.unit(*unit, look)).collect();
        let total: f32 = pieces.iter().map(|piece| piece.size().x + GAP_M).sum();
        let size = Vector3::new(total, kitchen::COUNTER_M, kitchen::COUNTER_DEPTH_M);
        let mut places = self.wall_places(total, Wish::Corner);
        places.retain(|place| self.tall_ones_fit(units, &pieces, place.side, place.start_m));
        let Some((place, claim)) = self.first_fit(&places, size, 0.8) else { return false };
        self.space.take(&claim);
        self.set_row(units, &pieces, place.side, place.start_m, look);
        true
    }

    /// Returns true if no window is behind a refrigerator.
    fn tall_ones_fit(&self, units: &[KitchenUnit], pieces: &[Piece], side: Side, start: f32) -> bool {
        let mut at = start;
        units.iter().zip(pieces).all(|(unit, piece)| {
            let along = [at, at + piece.size().x];
            at = along[1] + GAP_M;
            *unit != KitchenUnit::Fridge
                || self.space.wall_is_free(side, &Patch { along, y: [0.0, piece.size().y] })
        })
    }

    fn unit(&mut self, unit: KitchenUnit, look: &Look) -> Piece {
        match unit {
            KitchenUnit::Counter(width) => kitchen::COUNTER.drawn(look, [width, 0.0, 0.0]),
            KitchenUnit::Sink(width) => kitchen::COUNTER.drawn(look, [width, 0.0, 1.0]),
            KitchenUnit::Cooker => kitchen::COOKER.any(self.sampler),
            KitchenUnit::Fridge => kitchen::FRIDGE.any(self.sampler),
            KitchenUnit::Washer => kitchen::WASHER.any(self.sampler),
        }
    }

    fn set_row(&mut self, units: &[KitchenUnit], pieces: &[Piece], side: Side, start: f32, look: &Look) {
        let room = self.space.room;
        let style = self.sampler.style(storage::WALL_CABINET.styles);
        let upper = self.maybe(0.8).then(|| Look { style, ..look.clone() });
        let mut at = start;
        for (unit, piece) in units.iter().zip(pieces) {
            let size = piece.size();
            let (along, middle) = ([at, at + size.x], at + size.x / 2.0);
            at = along[1] + GAP_M;
            let spot = self.set(piece, side, &side.band(&room, along, [GAP_M, GAP_M + size.z]), 0.0);
            match unit {
                KitchenUnit::Sink(_) => {
                    let sink = fixtures::KITCHEN_SINK.any(self.sampler);
                    self.lay(&sink, &spot, [0.0, kitchen::COUNTER_M, 0.0]);
                    self.above(upper.as_ref(), size.x, side, middle);
                }
                KitchenUnit::Counter(_) => {
                    self.on_counter(&spot);
                    self.above(upper.as_ref(), size.x, side, middle);
                }
                KitchenUnit::Cooker if self.maybe(0.25) => {
                    let hood = kitchen::HOOD.any(self.sampler);
                    self.hang_deep(&hood, 1.55, side, middle);
                }
                KitchenUnit::Fridge => {
                    let y = [0.0, size.y];
                    self.space.take_wall(side, Patch { along, y });
                }
                _ => {}
            }
        }
    }

    fn on_counter(&mut self, spot: &Spot) {
        if self.maybe(0.2) {
            self.on_top(&kitchen::SMALL, spot, [-0.6, -0.4]);
        }
        if self.maybe(0.5) {
            self.on_top(&decor::SMALL_PLANT, spot, [0.8, -0.6]);
        }
    }

    /// Adds a cabinet above a counter, if the kitchen has wall cabinets.
    fn above(&mut self, look: Option<&Look>, width: f32, side: Side, middle: f32) {
        if let Some(look) = look {
            let cabinet = storage::WALL_CABINET.drawn(look, [width * 0.95, 0.65, 0.33]);
            self.hang_deep(&cabinet, 1.5, side, middle);
        }
    }

    /// Adds an island with stools; returns false without room.
    fn island(&mut self, look: &Look) -> bool {
        let width = self.sampler.rng.range(1.1, 1.6);
        let Some((side, center)) = self.place_for([width, 0.7 + 0.5]) else { return false };
        let style = self.sampler.style(kitchen::ISLAND.styles);
        let island = kitchen::ISLAND.drawn(&Look { style, ..look.clone() }, [width, 0.0, 0.0]);
        let Some(spot) = self.stand_at(&island, side, shifted(side, center, [0.0, -0.25])) else {
            return false;
        };
        let stool = seats::BAR_STOOL.any(self.sampler);
        for x in [-width * 0.27, width * 0.27] {
            self.stand_at(&stool, side, shifted(side, spot.center(), [x, 0.35 + 0.24]));
        }
        self.clutter(&spot, 2);
        true
    }

    pub(super) fn dining_room(&mut self) {
        let chairs = [4, 6, 6, 8][self.rng.below(4)];
        self.dining_set(chairs);
        let kind = if self.maybe(0.7) { &storage::SIDEBOARD } else { &storage::TALL_CABINET };
        if let Some(cabinet) = self.put(kind, Wish::Middle, 0.6)
            && cabinet.height_m() < 1.1
        {
            self.clutter(&cabinet, 2);
            self.picture_sized([0.7, 0.5], Wish::Facing(cabinet.side, cabinet.along()), 1.6);
        }
        if self.maybe(0.4) {
            self.put(&storage::CHEST, Wish::Anywhere, 0.6);
        }
        if self.maybe(0.3) {
            self.put(&seats::SEATING, Wish::Anywhere, 0.4);
        }
    }
}

impl Decorator<'_> {
    /// Adds a table with chairs; tries smaller tables if necessary.
    pub(super) fn dining_set(&mut self, chairs: usize) {
        let round = self.maybe(0.3);
        for wanted in [8, 6, 4, 2].into_iter().filter(|&wanted| wanted <= chairs) {
            let table = match wanted {
                _ if round && wanted <= 4 => [1.05, 1.05],
                8 => [2.2, 0.95],
                6 => [1.7, 0.9],
                4 => [1.25, 0.8],
                _ => [0.8, 0.8],
            };
            let ends = if wanted == 6 && self.maybe(0.4) { 1 } else { 0 };
            let reach = [table[0] + 0.1 + 1.1 * ends as f32, table[1] + 2.0 * 0.56];
            if let Some((side, center)) = self.place_for(reach) {
                self.table_with_chairs(table, wanted - 2 * ends, ends == 1, side, center);
                return;
            }
        }
        if let Some(table) = self.put_sized(&tables::DINING_TABLE, [0.8, 0.0, 0.75], Wish::Anywhere, 0.9) {
            let chair = seats::CHAIR.any(self.sampler);
            let distance = chair.size().z / 2.0 + 0.04;
            self.stand_at(&chair, table.side.opposite(), table.before(distance));
            self.clutter(&table, 1);
        }
    }

    fn table_with_chairs(&mut self, size: [f32; 2], chairs: usize, ends: bool, side: Side, center: [f32; 2]) {
        let table = tables::DINING_TABLE.sized(self.sampler, [size[0], 0.0, size[1]]);
        let Some(table) = self.stand_at(&table, side, center) else { return };
        let chair = seats::CHAIR.any(self.sampler);
        let away = size[1] / 2.0 + chair.size().z / 2.0 + 0.03;
        let columns = (chairs / 2).max(1);
        for column in 0..columns {
            let x = (column as f32 + 0.5) / columns as f32 * size[0] - size[0] / 2.0;
            self.stand_at(&chair, side, shifted(side, center, [x, -away]));
            self.stand_at(&chair, side.opposite(), shifted(side, center, [x, away]));
        }
        if ends {
            let away = size[0] / 2.0 + chair.size().z / 2.0 + 0.03;
            let (left, right) = (Side::ALL[(side as usize + 1) % 4], Side::ALL[(side as usize + 3) % 4]);
            self.stand_at(&chair, left, shifted(side, center, [-away, 0.0]));
            self.stand_at(&chair, right, shifted(side, center, [away, 0.0]));
        }
        let kind = if self.maybe(0.6) { &decor::VASE } else { &decor::SMALL_PLANT };
        self.on_top(kind, &table, [0.0, 0.0]);
        if self.maybe(0.5) {
            let rug = [size[0] + 1.1, size[1] + 1.3];
            self.lay_rug(rug, side, center);
        }
    }

    /// Returns a free position and back side for a piece, preferably wide in the longer room direction.
    pub(super) fn place_for(&self, [width, depth]: [f32; 2]) -> Option<(Side, [f32; 2])> {
        let room = self.space.room.size();
        let mut turns = [(Side::North, [width, depth]), (Side::West, [depth, width])];
        if room[0] < room[1] {
            turns.reverse();
        }
        turns.into_iter().find_map(|(side, size)| Some((side, self.open_floor(size)?)))
    }
}

/// Moves a position by an offset in the frame of a piece with the back to `side`.
pub(super) fn shifted(side: Side, center: [f32; 2], offset: [f32; 2]) -> [f32; 2] {
    let [x, z] = turned(side.quarter(), offset);
    [center[0] + x, center[1] + z]
}
