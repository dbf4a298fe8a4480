//! Rooms for clothes, washing, machines and cars.

use super::super::furniture::{
    cabinets, chests, clothes, counters, decor, hearths, shelves, sinks, sports, stools, towels, washing,
};
use super::*;

impl Decorator<'_> {
    pub(super) fn closet(&mut self) {
        if self.area_m2() > 2.5 {
            self.put(&shelves::BOOKCASE, Wish::Corner, 0.5);
        }
        let coats = self.count(1, 3);
        self.coats(coats);
        if let Some(chest) = self.put(&chests::CHEST, Wish::Anywhere, 0.5) {
            self.on_top(&clothes::FOLDED, &chest, [-0.4, 0.0]);
        }
        if self.maybe(0.5) {
            self.put(&decor::BASKET, Wish::Corner, 0.0);
        }
        if self.maybe(0.4) {
            self.put(&stools::FOOTSTOOL, Wish::Anywhere, 0.0);
        }
    }

    pub(super) fn laundry(&mut self) {
        let machines = self.count(1, 2);
        for _ in 0..machines {
            if let Some(machine) = self.put(&washing::WASHER, Wish::Corner, 0.6)
                && self.maybe(0.5)
            {
                self.on_top(&towels::TOWEL_PILE, &machine, [0.0, 0.0]);
            }
        }
        if self.maybe(0.6) {
            self.put(&sinks::PEDESTAL_SINK, Wish::Anywhere, 0.6);
        }
        if self.maybe(0.5) {
            self.put_sized(&counters::COUNTER, [1.0, 0.0, 0.0], Wish::Anywhere, 0.6);
        }
        self.put(&decor::BASKET, Wish::Corner, 0.0);
        self.put(&shelves::BOOKCASE, Wish::Anywhere, 0.5);
        if self.maybe(0.5) {
            self.towels(1);
        }
    }

    pub(super) fn utility(&mut self) {
        for _ in 0..self.count(1, 2) {
            self.put(&shelves::BOOKCASE, Wish::Anywhere, 0.5);
        }
        self.put(&cabinets::TALL_CABINET, Wish::Anywhere, 0.5);
        if self.maybe(0.5) {
            self.put(&washing::WASHER, Wish::Corner, 0.6);
        }
        if self.maybe(0.5) {
            self.put(&hearths::RADIATOR, Wish::Anywhere, 0.0);
        }
        self.bin();
    }

    pub(super) fn garage(&mut self) {
        for _ in 0..self.count(2, 3) {
            self.put(&shelves::BOOKCASE, Wish::Anywhere, 0.6);
        }
        for _ in 0..self.count(1, 3) {
            self.put(&cabinets::TALL_CABINET, Wish::Anywhere, 0.6);
        }
        self.desk();
        for _ in 0..self.count(1, 2) {
            self.put(&decor::BASKET, Wish::Corner, 0.0);
        }
        if self.maybe(0.5) {
            self.put(&sports::MACHINE, Wish::Anywhere, 0.6);
        }
        self.put(&stools::STOOL, Wish::Anywhere, 0.0);
        self.bin();
    }
}
