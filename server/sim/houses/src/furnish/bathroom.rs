//! Bathrooms.

use super::super::furniture::{baths, cabinets, sinks, towels};
use super::*;

impl Decorator<'_> {
    pub(super) fn bathroom(&mut self) {
        let small = self.area_m2() < 5.5;
        let tub = self.maybe(0.42) && !small;
        if tub {
            self.put(&baths::BATHTUB, Wish::Corner, 0.6);
        }
        let toilet = |this: &mut Self, front_m| this.put(&baths::TOILET, Wish::Corner, front_m).is_some();
        let _ = toilet(self, 0.6) || toilet(self, 0.4);
        if !tub || self.maybe(0.8) {
            self.put(&baths::SHOWER, Wish::Corner, 0.5);
        }
        self.wash_place();
        if self.area_m2() > 7.0 && self.maybe(0.55) {
            self.wash_place();
        }
        let towels = 1;
        self.towels(towels);
        let room = self.space.room;
        self.lay_rug([0.8, 0.55], Side::North, room.center());
    }

    /// A sink on a pedestal, or on a cabinet; a mirror above it.
    pub(super) fn wash_place(&mut self) {
        let on_cabinet = self.maybe(0.55) && self.area_m2() > 4.5;
        if on_cabinet && let Some(spot) = self.put(&cabinets::VANITY, Wish::Anywhere, 0.6) {
            self.on_top(&sinks::VESSEL_SINK, &spot, [0.0, 0.0]);
            self.mirror([0.55, 0.7], Wish::Facing(spot.side, spot.along()));
            if self.maybe(0.3) {
                self.on_top(&towels::TOWEL_PILE, &spot, [1.0, 0.0]);
            }
            return;
        }
        let sink = |this: &mut Self, front_m| this.put(&sinks::PEDESTAL_SINK, Wish::Anywhere, front_m);
        if let Some(spot) = sink(self, 0.6).or_else(|| sink(self, 0.4)) {
            self.mirror([0.5, 0.7], Wish::Facing(spot.side, spot.along()));
        }
    }
}
