//! Bedrooms.

use super::super::furniture::{beds, cabinets, chairs, chests, clothes, screens, sofas, stools};
use super::*;

/// Number of narrow beds tried instead of a wide one: low beds fit below windows.
const NARROW_BEDS: usize = 5;

impl Decorator<'_> {
    pub(super) fn bedroom(&mut self) {
        let bed = self.bed_group();
        if self.area_m2() > 20.0 && self.maybe(0.3) {
            self.bed_group();
        }
        self.wardrobe();
        self.chest(bed.as_ref());
        if self.maybe(0.4) {
            self.armchair(Wish::Corner);
        } else {
            self.put(&chairs::CHAIR, Wish::Corner, 0.4);
        }
        if self.area_m2() > 18.0
            && self.maybe(0.3)
            && let Some(sofa) = self.put_sized(&sofas::SOFA, [1.5, 0.0, 0.0], Wish::Anywhere, 0.6)
        {
            let depth = sofa.footprint()[1];
            self.lean_cushions(&sofa, "", &[-0.3], [0.455, 0.35 - depth / 2.0]);
        }
        if self.area_m2() > 14.0 && self.maybe(0.3) {
            self.desk();
        }
    }

    /// Adds the furniture missing in the main part of a bedroom, and a reading corner.
    pub(super) fn bedroom_corner(&mut self) {
        if !self.has("bed") {
            self.bed_group();
        }
        if !self.has("cabinet") {
            self.wardrobe();
        }
        self.corner();
    }

    fn wardrobe(&mut self) {
        let width = self.taste.rng.range(0.95, 1.5);
        for (width, wish, front) in [(width, Wish::Corner, 0.6), (0.8, Wish::Anywhere, 0.45)] {
            if self.put_sized(&cabinets::WARDROBE, [width, 0.0, 0.0], wish, front).is_some() {
                return;
            }
        }
    }

    /// Places a bed with its long side at a wall; the back of the spot is the head.
    fn stand_along_wall(&mut self, bed: &Piece) -> Option<Spot> {
        const TURN: u8 = 1;
        let turned = Piece { model: bed.model.moved(TURN, Vector3::zeros()), ..bed.clone() };
        let spot = self.stand(&turned, Wish::Corner, 0.4)?;
        Some(Spot { side: Side::ALL[(spot.side as usize + usize::from(TURN)) % 4], ..spot })
    }

    /// A bed with cushions, clothes, nightstands, a bench and a rug.
    fn bed_group(&mut self) -> Option<Spot> {
        let wide = self.maybe(0.7);
        let width = if wide { self.taste.rng.range(1.4, 1.7) } else { self.taste.rng.range(0.95, 1.1) };
        let mut bed = beds::BED.sized(self.taste, [width, 0.0, 0.0]);
        let mut spot = self.stand(&bed, Wish::Middle, 0.6);
        for _ in 0..NARROW_BEDS {
            if spot.is_some() {
                break;
            }
            bed = beds::BED.sized(self.taste, [0.95, 0.0, 0.0]);
            spot = self.stand(&bed, Wish::Anywhere, 0.0).or_else(|| self.stand_along_wall(&bed));
        }
        let spot = spot?;
        let width = spot.footprint()[0];
        let cushions = self.count(2, 4);
        let fitting: &[f32] = if width > 1.3 { &[-0.24, 0.24, -0.7, 0.7][..cushions] } else { &[0.0] };
        let inside: Vec<f32> = fitting.iter().copied().filter(|x| x.abs() + 0.24 <= width / 2.0).collect();
        self.lean_cushions(&spot, &bed.attributes.color, &inside, [beds::COVER_M, -0.5]);
        if self.maybe(0.2) {
            self.lay_flat(&clothes::FOLDED, &spot, [width * 0.2, 0.6], beds::COVER_M);
        }
        let nightstand = chests::NIGHTSTAND.any(self.taste);
        for hand in [-1.0, 1.0] {
            if let Some(nightstand) = self.beside(&nightstand, &spot, hand) {
                self.lamp_on(&nightstand, 0.0);
            }
        }
        if wide && self.maybe(0.4) {
            let bench = stools::SEATING.sized(self.taste, [width * 0.8, 0.0, 0.4]);
            self.stand_at(&bench, spot.side, spot.before(0.03 + bench.size().z / 2.0));
        }
        if self.maybe(0.6) {
            self.lay_rug([width + 0.9, 1.3], spot.side, spot.before(-0.5));
        }
        let high = spot.height_m() > 1.3;
        if !high && self.maybe(0.6) {
            self.picture_sized([0.8, 0.55], Wish::Facing(spot.side, spot.along()), 1.65);
        }
        Some(spot)
    }

    /// A chest of drawers, sometimes with a television, opposite the bed if possible.
    fn chest(&mut self, bed: Option<&Spot>) {
        let chest = chests::CHEST.any(self.taste);
        let wish = bed.map_or(Wish::Anywhere, |bed| Wish::Facing(bed.side.opposite(), bed.along()));
        let facing = self.stand(&chest, wish, 0.6);
        let Some(spot) = facing.or_else(|| self.stand(&chest, Wish::Anywhere, 0.6)) else { return };
        if self.maybe(0.25) {
            let tv = screens::TV.sized(self.taste, [0.72, 0.0, 0.0]);
            self.piece_on_top(&tv, &spot, [0.0, -0.3]);
        } else {
            self.clutter(&spot, 2);
            if self.maybe(0.4) {
                self.mirror([0.6, 0.7], Wish::Facing(spot.side, spot.along()));
            }
        }
    }
}
