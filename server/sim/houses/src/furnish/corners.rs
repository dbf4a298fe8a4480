//! The smaller parts of rooms that are no rectangles.

use super::super::furniture::{cabinets, lights, plants, shelves, tables};
use super::*;

impl Decorator<'_> {
    /// A reading corner: an armchair, a lamp or small table, a shelf.
    pub(super) fn corner(&mut self) {
        if let Some(chair) = self.armchair(Wish::Corner) {
            let table = tables::SIDE_TABLE.any(self.taste);
            match [1.0, -1.0].into_iter().find_map(|hand| self.beside(&table, &chair, hand)) {
                Some(table) => self.lamp_on(&table, 0.0),
                None => drop(self.put(&lights::FLOOR_LAMP, Wish::Corner, 0.0)),
            }
        }
        if self.maybe(0.5) {
            self.put(&shelves::BOOKCASE, Wish::Anywhere, 0.4);
        }
        self.put(&plants::FLOOR_PLANT, Wish::Corner, 0.0);
    }

    /// A place to work at, or shelves.
    pub(super) fn work_corner(&mut self) {
        if self.maybe(0.5) {
            self.desk();
        }
        self.put(&shelves::BOOKCASE, Wish::Anywhere, 0.4);
        self.put(&cabinets::TALL_CABINET, Wish::Anywhere, 0.4);
    }

    /// A place for tableware.
    pub(super) fn pantry(&mut self) {
        let make = if self.maybe(0.5) { &cabinets::SIDEBOARD } else { &cabinets::TALL_CABINET };
        if let Some(cabinet) = self.put(make, Wish::Anywhere, 0.5)
            && cabinet.height_m() < 1.1
        {
            self.clutter(&cabinet, 2);
        }
        self.put(&plants::FLOOR_PLANT, Wish::Corner, 0.0);
    }
}
