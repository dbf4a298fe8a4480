//! Bedrooms, bathrooms, closets, utility rooms and garages.

use super::*;

/// Narrow beds tried instead of a wide bed.
// Low narrow beds fit below windows, and styles differ in height.
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
            self.put(&seats::CHAIR, Wish::Corner, 0.4);
        }
        if self.area_m2() > 18.0
            && self.maybe(0.3)
            && let Some(sofa) = self.put_sized(&seats::SOFA, [1.5, 0.0, 0.0], Wish::Anywhere, 0.6)
        {
            let depth = sofa.footprint()[1];
            self.lean_cushions(&sofa, "", &[-0.3], [0.455, 0.35 - depth / 2.0]);
        }
        if self.area_m2() > 14.0 && self.maybe(0.3) {
            self.desk();
        }
    }

    /// Adds furniture missing in the main part, and a reading corner.
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
        let width = self.sampler.rng.range(0.95, 1.5);
        for (width, wish, front) in [(width, Wish::Corner, 0.6), (0.8, Wish::Anywhere, 0.45)] {
            if self.put_sized(&storage::WARDROBE, [width, 0.0, 0.0], wish, front).is_some() {
                return;
            }
        }
    }

    /// Places a bed with the long side at a wall; the spot's back is the head.
    fn stand_along_wall(&mut self, bed: &Piece) -> Option<Spot> {
        const TURN: u8 = 1;
        let turned = Piece { model: bed.model.moved(TURN, Vector3::zeros()), ..bed.clone() };
        let spot = self.stand(&turned, Wish::Corner, 0.4)?;
        Some(Spot { side: Side::ALL[(spot.side as usize + usize::from(TURN)) % 4], ..spot })
    }

    /// Adds a bed with cushions, clothes, nightstands, a bench and a rug.
    fn bed_group(&mut self) -> Option<Spot> {
        let wide = self.maybe(0.7);
        let width = if wide { self.sampler.rng.range(1.4, 1.7) } else { self.sampler.rng.range(0.95, 1.1) };
        let mut bed = textiles::BED.sized(self.sampler, [width, 0.0, 0.0]);
        let mut spot = self.stand(&bed, Wish::Middle, 0.6);
        for _ in 0..NARROW_BEDS {
            if spot.is_some() {
                break;
            }
            bed = textiles::BED.sized(self.sampler, [0.95, 0.0, 0.0]);
            spot = self.stand(&bed, Wish::Anywhere, 0.0).or_else(|| self.stand_along_wall(&bed));
        }
        let spot = spot?;
        let width = spot.footprint()[0];
        let cushions = self.count(2, 4);
        let fitting: &[f32] = if width > 1.3 { &[-0.24, 0.24, -0.7, 0.7][..cushions] } else { &[0.0] };
        let inside: Vec<f32> = fitting.iter().copied().filter(|x| x.abs() + 0.24 <= width / 2.0).collect();
        self.lean_cushions(&spot, &bed.attributes.color, &inside, [textiles::COVER_M, -0.5]);
        if self.maybe(0.2) {
            self.lay_flat(&textiles::FOLDED, &spot, [width * 0.2, 0.6], textiles::COVER_M);
        }
        let nightstand = storage::NIGHTSTAND.any(self.sampler);
        for hand in [-1.0, 1.0] {
            if let Some(nightstand) = self.beside(&nightstand, &spot, hand) {
                self.lamp_on(&nightstand, 0.0);
            }
        }
        if wide && self.maybe(0.4) {
            let bench = seats::SEATING.sized(self.sampler, [width * 0.8, 0.0, 0.4]);
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

    /// Adds a chest of drawers, sometimes with a television, opposite the bed if possible.
    fn chest(&mut self, bed: Option<&Spot>) {
        let chest = storage::CHEST.any(self.sampler);
        let wish = bed.map_or(Wish::Anywhere, |bed| Wish::Facing(bed.side.opposite(), bed.along()));
        let facing = self.stand(&chest, wish, 0.6);
        let Some(spot) = facing.or_else(|| self.stand(&chest, Wish::Anywhere, 0.6)) else { return };
        if self.maybe(0.25) {
            let tv = displays::TV.sized(self.sampler, [0.72, 0.0, 0.0]);
            self.piece_on_top(&tv, &spot, [0.0, -0.3]);
        } else {
            self.clutter(&spot, 2);
            if self.maybe(0.4) {
                self.mirror([0.6, 0.7], Wish::Facing(spot.side, spot.along()));
            }
        }
    }
}

impl Decorator<'_> {
    pub(super) fn bathroom(&mut self) {
        let small = self.area_m2() < 5.5;
        let tub = self.maybe(0.42) && !small;
        if tub {
            self.put(&fixtures::BATHTUB, Wish::Corner, 0.6);
        }
        let toilet = |this: &mut Self, front_m| this.put(&fixtures::TOILET, Wish::Corner, front_m).is_some();
        let _ = toilet(self, 0.6) || toilet(self, 0.4);
        if !tub || self.maybe(0.8) {
            self.put(&fixtures::SHOWER, Wish::Corner, 0.5);
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

    /// Adds a sink on a pedestal or cabinet, and a mirror above.
    pub(super) fn wash_place(&mut self) {
        let on_cabinet = self.maybe(0.55) && self.area_m2() > 4.5;
        if on_cabinet && let Some(spot) = self.put(&storage::VANITY, Wish::Anywhere, 0.6) {
            self.on_top(&fixtures::VESSEL_SINK, &spot, [0.0, 0.0]);
            self.mirror([0.55, 0.7], Wish::Facing(spot.side, spot.along()));
            if self.maybe(0.3) {
                self.on_top(&textiles::TOWEL_PILE, &spot, [1.0, 0.0]);
            }
            return;
        }
        let sink = |this: &mut Self, front_m| this.put(&fixtures::PEDESTAL_SINK, Wish::Anywhere, front_m);
        if let Some(spot) = sink(self, 0.6).or_else(|| sink(self, 0.4)) {
            self.mirror([0.5, 0.7], Wish::Facing(spot.side, spot.along()));
        }
    }
}

impl Decorator<'_> {
    pub(super) fn closet(&mut self) {
        if self.area_m2() > 2.5 {
            self.put(&storage::BOOKCASE, Wish::Corner, 0.5);
        }
        let coats = self.count(1, 3);
        self.coats(coats);
        if let Some(chest) = self.put(&storage::CHEST, Wish::Anywhere, 0.5) {
            self.on_top(&textiles::FOLDED, &chest, [-0.4, 0.0]);
        }
        if self.maybe(0.5) {
            self.put(&decor::BASKET, Wish::Corner, 0.0);
        }
        if self.maybe(0.4) {
            self.put(&seats::FOOTSTOOL, Wish::Anywhere, 0.0);
        }
    }

    pub(super) fn laundry(&mut self) {
        let machines = self.count(1, 2);
        for _ in 0..machines {
            if let Some(machine) = self.put(&kitchen::WASHER, Wish::Corner, 0.6)
                && self.maybe(0.5)
            {
                self.on_top(&textiles::TOWEL_PILE, &machine, [0.0, 0.0]);
            }
        }
        if self.maybe(0.6) {
            self.put(&fixtures::PEDESTAL_SINK, Wish::Anywhere, 0.6);
        }
        if self.maybe(0.5) {
            self.put_sized(&kitchen::COUNTER, [1.0, 0.0, 0.0], Wish::Anywhere, 0.6);
        }
        self.put(&decor::BASKET, Wish::Corner, 0.0);
        self.put(&storage::BOOKCASE, Wish::Anywhere, 0.5);
        if self.maybe(0.5) {
            self.towels(1);
        }
    }

    pub(super) fn utility(&mut self) {
        for _ in 0..self.count(1, 2) {
            self.put(&storage::BOOKCASE, Wish::Anywhere, 0.5);
        }
        self.put(&storage::TALL_CABINET, Wish::Anywhere, 0.5);
        if self.maybe(0.5) {
            self.put(&kitchen::WASHER, Wish::Corner, 0.6);
        }
        if self.maybe(0.5) {
            self.put(&fixtures::RADIATOR, Wish::Anywhere, 0.0);
        }
        self.bin();
    }

    pub(super) fn garage(&mut self) {
        for _ in 0..self.count(2, 3) {
            self.put(&storage::BOOKCASE, Wish::Anywhere, 0.6);
        }
        for _ in 0..self.count(1, 3) {
            self.put(&storage::TALL_CABINET, Wish::Anywhere, 0.6);
        }
        self.desk();
        for _ in 0..self.count(1, 2) {
            self.put(&decor::BASKET, Wish::Corner, 0.0);
        }
        if self.maybe(0.5) {
            self.put(&sports::MACHINE, Wish::Anywhere, 0.6);
        }
        self.put(&seats::STOOL, Wish::Anywhere, 0.0);
        self.bin();
    }
}
