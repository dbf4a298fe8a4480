//! Bathrooms.

use super::super::furniture::{baths, decor, kitchen, seats, storage};
use super::super::taste::WOOD;
use super::*;

impl Decorator<'_> {
    pub(super) fn bathroom(&mut self) {
        let tub_first = self.rng.chance(0.5);
        let both = self.rng.chance(0.6);
        if tub_first || both {
            let tub = baths::bathtub(self.taste);
            self.stand(&tub, Wish::Corner, 0.6);
        }
        if !tub_first || both {
            let shower = baths::shower(self.taste);
            self.stand(&shower, Wish::Corner, 0.6);
        }
        let toilet = baths::toilet(self.taste);
        self.stand(&toilet, Wish::Anywhere, 0.6);
        self.wash_place();
        if self.rng.chance(0.4) {
            let machine = kitchen::washing_machine(self.taste);
            self.stand(&machine, Wish::Corner, 0.6);
        }
        let stool = seats::stool(self.taste, false);
        self.stand(&stool, Wish::Anywhere, 0.0);
        if self.rng.chance(0.5) {
            let plant = decor::plant(self.taste, false);
            self.stand(&plant, Wish::Corner, 0.0);
        }
        let bin = decor::bin(self.taste);
        self.stand(&bin, Wish::Corner, 0.0);
        let towels = 2 + self.rng.below(2);
        self.towels(towels);
        let room = self.space.room;
        self.lay_rug([0.8, 0.55], Side::North, room.center());
    }

    /// A sink on a pedestal, or on a cabinet; a mirror above it.
    fn wash_place(&mut self) {
        let on_cabinet = self.rng.chance(0.5);
        if on_cabinet {
            let cabinet = storage::vanity(self.taste);
            if let Some(spot) = self.stand(&cabinet, Wish::Anywhere, 0.6) {
                let sink = baths::vessel_sink(self.taste);
                let height = spot.height_m();
                self.lay(&sink, &spot, [0.0, height, 0.0]);
                self.mirror(0.55, 0.7, Wish::Facing(spot.side, spot.along()));
                return;
            }
        }
        let sink = baths::pedestal_sink(self.taste);
        if let Some(spot) = self.stand(&sink, Wish::Anywhere, 0.6) {
            self.mirror(0.5, 0.7, Wish::Facing(spot.side, spot.along()));
        }
        if !on_cabinet && self.rng.chance(0.6) {
            let tint = self.taste.tint("cabinet", WOOD);
            let cabinet = storage::wall_cabinet(self.taste, tint, 0.5);
            let places = self.wall_places(0.5, Wish::Anywhere);
            for (side, start, _) in places.into_iter().step_by(7) {
                if self.hang_deep(&cabinet, 1.5, side, start + 0.25).is_some() {
                    return;
                }
            }
        }
    }
}
