//! Bedrooms.

use super::super::furniture::{beds, decor, living, seats, storage};
use super::*;

impl Decorator<'_> {
    pub(super) fn bedroom(&mut self) {
        let bed = self.bed_group();
        let width = self.taste.length_m(0.95, 1.5);
        let wardrobe = storage::wardrobe(self.taste, width);
        if self.stand(&wardrobe, Wish::Corner, 0.6).is_none() {
            let narrow = storage::wardrobe(self.taste, 0.8);
            self.stand(&narrow, Wish::Anywhere, 0.6);
        }
        self.chest(bed.as_ref());
        if self.rng.chance(0.6) {
            let chair =
                if self.rng.chance(0.4) { seats::armchair(self.taste) } else { seats::chair(self.taste) };
            self.stand(&chair, Wish::Corner, 0.4);
        }
        if self.rng.chance(0.5) {
            let stool = seats::footstool(self.taste);
            self.stand(&stool, Wish::Anywhere, 0.3);
        }
        if self.rng.chance(0.6) {
            self.floor_plant();
        }
        if self.rng.chance(0.4) {
            self.coats(1);
        }
        let pictures = 1 + self.rng.below(2);
        self.pictures(pictures);
        if self.rng.chance(0.5) {
            self.mirror(0.5, 1.4, Wish::Anywhere);
        }
    }

    /// A bed with pillows, clothes, nightstands and a rug.
    fn bed_group(&mut self) -> Option<Spot> {
        let width = if self.rng.chance(0.7) {
            self.taste.length_m(1.4, 1.65)
        } else {
            self.taste.length_m(0.95, 1.1)
        };
        let mut bed = beds::bed(self.taste, width);
        let mut spot = self.stand(&bed, Wish::Middle, 0.6);
        if spot.is_none() {
            bed = beds::bed(self.taste, 0.95);
            spot = self.stand(&bed, Wish::Anywhere, 0.0);
        }
        let spot = spot?;
        let cushions = 1 + self.rng.below(2);
        for i in 0..cushions {
            let cushion = beds::cushion(self.taste, &bed.attributes.color);
            let x = if cushions == 1 { 0.0 } else { (i as f32 - 0.5) * 0.5 };
            self.lay(&cushion, &spot, [x, 0.55, -0.25]);
        }
        if self.rng.chance(0.7) {
            let clothes = beds::folded_clothes(self.taste);
            self.lay(&clothes, &spot, [width * 0.2, 0.55, 0.65]);
        }
        for hand in [-1.0, 1.0] {
            let nightstand = storage::nightstand(self.taste);
            if let Some(nightstand) = self.beside(&nightstand, &spot, hand) {
                self.lamp_on(&nightstand);
            }
        }
        self.lay_rug([width + 0.9, 1.3], spot.side, spot.before(-0.5));
        Some(spot)
    }

    /// A chest of drawers, sometimes with a television, opposite the bed if possible.
    fn chest(&mut self, bed: Option<&Spot>) {
        let chest = storage::chest_of_drawers(self.taste);
        let wish = bed.map_or(Wish::Anywhere, |bed| Wish::Facing(bed.side.opposite(), bed.along()));
        let facing = self.stand(&chest, wish, 0.6);
        let Some(spot) = facing.or_else(|| self.stand(&chest, Wish::Anywhere, 0.6)) else { return };
        let height = spot.height_m();
        if self.rng.chance(0.4) {
            let tv = living::standing_tv(self.taste, 0.68);
            self.lay(&tv, &spot, [0.0, height, 0.0]);
        } else {
            let thing =
                if self.rng.chance(0.5) { decor::plant(self.taste, false) } else { decor::vase(self.taste) };
            self.lay(&thing, &spot, [-0.15, height, 0.0]);
        }
    }
}
