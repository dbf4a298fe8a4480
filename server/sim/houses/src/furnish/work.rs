//! Offices and gyms.

use super::super::furniture::{boards, cabinets, chairs, lights, screens, shelves, sports, stools, tables};
use super::*;

impl Decorator<'_> {
    pub(super) fn office(&mut self) {
        self.desk();
        if self.area_m2() > 14.0 {
            self.desk();
        }
        for _ in 0..self.count(1, 2) {
            self.put(&shelves::BOOKCASE, Wish::Corner, 0.6);
        }
        if self.maybe(0.5) {
            self.put(&cabinets::TALL_CABINET, Wish::Anywhere, 0.6);
        }
        if self.maybe(0.5) {
            self.armchair(Wish::Corner);
        }
        let board = boards::BOARD.any(self.taste);
        self.hang(&board, 1.5 - board.size().y / 2.0, Wish::Middle);
        self.bin();
    }

    /// A desk with a monitor, a lamp and a chair.
    pub(super) fn desk(&mut self) {
        let Some(desk) = self.put(&tables::DESK, Wish::Middle, 0.9) else { return };
        let monitor = screens::MONITOR.any(self.taste);
        self.piece_on_top(&monitor, &desk, [0.0, -0.5]);
        if self.maybe(0.6) {
            self.on_top(&lights::TABLE_LAMP, &desk, [-1.0, -0.6]);
        }
        let make = if self.maybe(0.75) { &chairs::OFFICE_CHAIR } else { &chairs::CHAIR };
        let chair = make.any(self.taste);
        let distance = chair.size().z / 2.0 + 0.05;
        self.stand_at(&chair, desk.side.opposite(), desk.before(distance));
        self.clutter(&desk, 1);
    }

    pub(super) fn gym(&mut self) {
        let machines = (self.area_m2() / 5.0).clamp(2.0, 4.0) as usize;
        for _ in 0..machines {
            self.put(&sports::MACHINE, Wish::Anywhere, 0.6);
        }
        for _ in 0..self.count(1, 2) {
            self.put(&sports::KIT_PIECE, Wish::Corner, 0.0);
        }
        if self.maybe(0.6) {
            self.put(&stools::SEATING, Wish::Anywhere, 0.4);
        }
        if self.maybe(0.5) {
            let tv = screens::WALL_TV.sized(self.taste, [0.9, 0.0, 0.0]);
            self.hang(&tv, 1.3, Wish::Middle);
        }
        self.mirror([0.9, 1.4], Wish::Middle);
        self.towels(1);
    }
}
