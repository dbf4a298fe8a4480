//! Tables with chairs around them.

use super::super::furniture::{chairs, decor, plants, tables};
use super::*;

impl Decorator<'_> {
    /// A table with chairs; smaller tables are tried if necessary.
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
            let chair = chairs::CHAIR.any(self.taste);
            let distance = chair.size().z / 2.0 + 0.04;
            self.stand_at(&chair, table.side.opposite(), table.before(distance));
            self.clutter(&table, 1);
        }
    }

    fn table_with_chairs(&mut self, size: [f32; 2], chairs: usize, ends: bool, side: Side, center: [f32; 2]) {
        let table = tables::DINING_TABLE.sized(self.taste, [size[0], 0.0, size[1]]);
        let Some(table) = self.stand_at(&table, side, center) else { return };
        let chair = chairs::CHAIR.any(self.taste);
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
        let make = if self.maybe(0.6) { &decor::VASE } else { &plants::SMALL_PLANT };
        self.on_top(make, &table, [0.0, 0.0]);
        if self.maybe(0.5) {
            let rug = [size[0] + 1.1, size[1] + 1.3];
            self.lay_rug(rug, side, center);
        }
    }

    /// Free position for a piece of `width` by `depth` and its back side, preferably wide in the longer room
    /// direction.
    pub(super) fn place_for(&self, [width, depth]: [f32; 2]) -> Option<(Side, [f32; 2])> {
        let room = self.space.room.size();
        let mut turns = [(Side::North, [width, depth]), (Side::West, [depth, width])];
        if room[0] < room[1] {
            turns.reverse();
        }
        turns.into_iter().find_map(|(side, size)| Some((side, self.open_floor(size)?)))
    }
}

/// A position moved by an offset in the frame of a piece with its back to `side`.
pub(super) fn shifted(side: Side, center: [f32; 2], offset: [f32; 2]) -> [f32; 2] {
    let [x, z] = turned(side.quarter(), offset);
    [center[0] + x, center[1] + z]
}
