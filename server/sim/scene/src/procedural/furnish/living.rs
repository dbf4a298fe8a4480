//! Living rooms and hallways.

use super::super::furniture::{beds, decor, lights, living, seats, storage, tables};
use super::*;

impl Decorator<'_> {
    pub(super) fn living_room(&mut self) {
        if let Some(sofa) = self.sofa_group() {
            self.television(Wish::Facing(sofa.side.opposite(), sofa.along()));
            let table = tables::side_table(self.taste);
            if let Some(table) = self.beside(&table, &sofa, 1.0) {
                self.lamp_on(&table);
            }
        }
        if self.rng.chance(0.75) {
            let fireplace = living::fireplace(self.taste);
            self.stand(&fireplace, Wish::Middle, 0.7);
        }
        for _ in 0..1 + self.rng.below(2) {
            let chair = seats::armchair(self.taste);
            self.stand(&chair, Wish::Anywhere, 0.6);
        }
        let shelf = storage::bookshelf(self.taste);
        self.stand(&shelf, Wish::Corner, 0.6);
        let lamp = lights::floor_lamp(self.taste);
        self.stand(&lamp, Wish::Corner, 0.0);
        let stool = seats::footstool(self.taste);
        self.stand(&stool, Wish::Anywhere, 0.3);
        self.floor_plant();
        let pictures = 2 + self.rng.below(2);
        self.pictures(pictures);
    }

    /// A sofa with cushions, a low table and a rug before it.
    fn sofa_group(&mut self) -> Option<Spot> {
        let seats_wanted = 2 + self.rng.below(2);
        let mut sofa = seats::sofa(self.taste, seats_wanted);
        let mut spot = self.stand(&sofa, Wish::Middle, 1.4);
        if spot.is_none() {
            sofa = seats::sofa(self.taste, 2);
            spot = self.stand(&sofa, Wish::Anywhere, 0.6);
        }
        let spot = spot?;
        let width = sofa.size().x;
        for hand in [-1.0, 1.0] {
            let cushion = beds::cushion(self.taste, &sofa.attributes.color);
            self.lay(&cushion, &spot, [hand * (width / 2.0 - 0.42), 0.45, 0.12]);
        }
        let table = tables::coffee_table(self.taste);
        let center = spot.before(0.42 + table.size().z / 2.0);
        if let Some(table) = self.stand_at(&table, spot.side, center) {
            let vase = decor::vase(self.taste);
            let height = table.height_m();
            self.lay(&vase, &table, [0.12, height, 0.05]);
        }
        self.lay_rug([2.0, 1.4], spot.side, center);
        Some(spot)
    }

    /// A television on a stand or above it, or on the bare wall; where `wish` says if possible.
    fn television(&mut self, wish: Wish) {
        let width = self.taste.length_m(0.95, 1.25);
        let stand = storage::tv_stand(self.taste, width + 0.25);
        let Some(stand) = self.stand(&stand, wish, 0.6) else {
            let tv = living::wall_tv(self.taste, width);
            if self.hang(&tv, 1.05, wish).is_none() && !matches!(wish, Wish::Anywhere) {
                self.television(Wish::Anywhere);
            }
            return;
        };
        let above = self.rng.chance(0.4);
        let tv = living::wall_tv(self.taste, width);
        if !above || self.hang(&tv, 0.95, Wish::Facing(stand.side, stand.along())).is_none() {
            let tv = living::standing_tv(self.taste, width);
            self.lay(&tv, &stand, [0.0, stand.height_m(), 0.0]);
        }
    }

    /// A lamp on a table.
    pub(super) fn lamp_on(&mut self, table: &Spot) {
        let lamp = lights::table_lamp(self.taste);
        let height = table.height_m();
        self.lay(&lamp, table, [0.0, height, 0.0]);
    }

    pub(super) fn hallway(&mut self) {
        let bench = seats::bench(self.taste, 0.34);
        self.stand(&bench, Wish::Anywhere, 0.0);
        let coats = 1 + self.rng.below(2);
        self.coats(coats);
        let cabinet = storage::sideboard(self.taste, 0.8, 0.28);
        if let Some(cabinet) = self.stand(&cabinet, Wish::Anywhere, 0.0) {
            let vase = decor::vase(self.taste);
            let height = cabinet.height_m();
            self.lay(&vase, &cabinet, [0.2, height, 0.0]);
            self.mirror(0.5, 0.8, Wish::Facing(cabinet.side, cabinet.along()));
        }
        if self.rng.chance(0.6) {
            self.floor_plant();
        }
        let pictures = 1 + self.rng.below(2);
        self.pictures(pictures);
        let room = self.space.room;
        let side = if room.size()[0] > room.size()[1] { Side::North } else { Side::West };
        self.lay_rug([1.8, 0.7], side, room.center());
    }
}
