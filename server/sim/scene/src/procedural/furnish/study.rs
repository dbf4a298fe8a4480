//! Offices and gyms.

use super::super::furniture::{baths, decor, lights, living, seats, sports, storage, tables};
use super::*;

impl Decorator<'_> {
    pub(super) fn office(&mut self) {
        let desk = tables::desk(self.taste);
        if let Some(desk) = self.stand(&desk, Wish::Middle, 0.9) {
            let width = self.taste.length_m(0.55, 0.68);
            let monitor = living::standing_tv(self.taste, width);
            self.lay(&monitor, &desk, [0.0, desk.height_m(), -0.12]);
            let lamp = lights::table_lamp(self.taste);
            self.lay(&lamp, &desk, [-0.42, desk.height_m(), -0.08]);
            let chair = seats::office_chair(self.taste);
            let distance = chair.size().z / 2.0 + 0.05;
            self.stand_at(&chair, desk.side.opposite(), desk.before(distance));
        }
        for _ in 0..1 + self.rng.below(2) {
            let shelf = storage::bookshelf(self.taste);
            self.stand(&shelf, Wish::Corner, 0.6);
        }
        let cabinet = storage::sideboard(self.taste, 0.9, 0.4);
        self.stand(&cabinet, Wish::Anywhere, 0.6);
        if self.rng.chance(0.5) {
            let chair = seats::armchair(self.taste);
            self.stand(&chair, Wish::Corner, 0.5);
        }
        self.floor_plant();
        let bin = decor::bin(self.taste);
        self.stand(&bin, Wish::Corner, 0.0);
        self.pictures(2);
    }

    pub(super) fn gym(&mut self) {
        let mut kinds =
            [sports::treadmill, sports::exercise_bike, sports::weight_bench, sports::dumbbell_rack];
        self.rng.shuffle(&mut kinds);
        for draw in kinds {
            let machine = draw(self.taste);
            self.stand(&machine, Wish::Anywhere, 0.6);
        }
        let bench = seats::bench(self.taste, 0.4);
        self.stand(&bench, Wish::Anywhere, 0.4);
        let stool = seats::stool(self.taste, false);
        self.stand(&stool, Wish::Corner, 0.0);
        if self.rng.chance(0.6) {
            let tv = living::wall_tv(self.taste, 0.9);
            self.hang(&tv, 1.2, Wish::Middle);
        }
        self.mirror(0.9, 1.5, Wish::Middle);
        let towel = baths::towel(self.taste);
        self.hang(&towel, 1.15, Wish::Anywhere);
        self.floor_plant();
        self.pictures(1);
    }

    /// Closets, laundries and garages: cupboards, shelves, coats.
    pub(super) fn store_room(&mut self) {
        let room = self.space.room.size();
        let count = 1 + self.rng.below(1 + (room[0] * room[1] / 6.0) as usize).min(4);
        for _ in 0..count {
            let shelf = storage::bookshelf(self.taste);
            self.stand(&shelf, Wish::Anywhere, 0.5);
            let width = self.taste.length_m(0.7, 0.95);
            let cupboard = storage::wardrobe(self.taste, width);
            self.stand(&cupboard, Wish::Corner, 0.5);
        }
        let bin = decor::bin(self.taste);
        self.stand(&bin, Wish::Corner, 0.0);
        let coats = 1 + self.rng.below(3);
        self.coats(coats);
    }
}
