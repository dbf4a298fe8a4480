//! Kitchens and dining rooms.

use super::super::furniture::Look;
use super::super::furniture::{appliances, cabinets, chests, counters, plants, sinks, stools, washing};
use super::dining::shifted;
use super::*;

/// A piece in a row at a wall.
#[derive(Clone, Copy, PartialEq)]
enum Unit {
    Counter(f32),
    Sink(f32),
    Cooker,
    Fridge,
    Washer,
}

impl Decorator<'_> {
    pub(super) fn kitchen(&mut self) {
        use Unit::*;
        let rows: [&[Unit]; 6] = [
            &[Fridge, Counter(0.8), Sink(1.2), Cooker, Counter(0.8)],
            &[Counter(0.6), Cooker, Sink(1.3), Washer, Fridge],
            &[Fridge, Sink(1.2), Cooker, Counter(0.7)],
            &[Fridge, Sink(1.0), Cooker],
            &[Sink(0.9), Cooker],
            &[Sink(0.8)],
        ];
        let first = self.rng.below(2);
        let look = counters::COUNTER.look(self.taste);
        let row = rows[first..].iter().find(|row| self.row_of(row, &look));
        if row.is_none_or(|row| !row.contains(&Fridge)) {
            self.put(&appliances::FRIDGE, Wish::Corner, 0.6);
        }
        if self.area_m2() > 10.0 && self.maybe(0.3) {
            let width = self.rng.range(0.9, 1.6);
            self.row_of(&[Counter(width)], &look);
        }
        let dining_elsewhere = self.house_has(RoomKind::DiningRoom);
        let island = (dining_elsewhere || self.area_m2() > 22.0) && self.island(&look);
        if !island || self.area_m2() > 26.0 {
            let chairs = 4 + 2 * self.rng.below(2);
            self.dining_set(chairs);
        }
    }

    /// Adds counters and machines in a row at a wall, with cabinets and a hood above. Returns true if there
    /// was room.
    fn row_of(&mut self, units: &[Unit], look: &Look) -> bool {
        let pieces: Vec<Piece> = units.iter().map(|unit| self.unit(*unit, look)).collect();
        let total: f32 = pieces.iter().map(|piece| piece.size().x + GAP_M).sum();
        let size = Vector3::new(total, counters::COUNTER_M, counters::COUNTER_DEPTH_M);
        let mut places = self.wall_places(total, Wish::Corner);
        places.sort_by(|a, b| a.2.total_cmp(&b.2));
        let claims: Vec<(Side, f32, Claim)> = places
            .into_iter()
            .map(|(side, start, _)| {
                (side, start, self.claim_at_wall(side, [start, start + total], size, 0.8))
            })
            .filter(|(side, start, _)| self.tall_ones_fit(units, &pieces, *side, *start))
            .collect();
        let Some(claim) = self.space.first_fit(claims.iter().map(|(.., claim)| *claim)) else { return false };
        let Some((side, start, _)) = claims.into_iter().find(|(.., other)| other.rect == claim.rect) else {
            return false;
        };
        self.space.take(&claim);
        self.set_row(units, &pieces, side, start, look);
        true
    }

    /// Returns true if no window is behind a refrigerator.
    fn tall_ones_fit(&self, units: &[Unit], pieces: &[Piece], side: Side, start: f32) -> bool {
        let mut at = start;
        units.iter().zip(pieces).all(|(unit, piece)| {
            let along = [at, at + piece.size().x];
            at = along[1] + GAP_M;
            *unit != Unit::Fridge || self.space.wall_is_free(side, &Patch { along, y: [0.0, piece.size().y] })
        })
    }

    fn unit(&mut self, unit: Unit, look: &Look) -> Piece {
        match unit {
            Unit::Counter(width) => counters::COUNTER.drawn(look, [width, 0.0, 0.0]),
            Unit::Sink(width) => counters::COUNTER.drawn(look, [width, 0.0, 1.0]),
            Unit::Cooker => appliances::COOKER.any(self.taste),
            Unit::Fridge => appliances::FRIDGE.any(self.taste),
            Unit::Washer => washing::WASHER.any(self.taste),
        }
    }

    fn set_row(&mut self, units: &[Unit], pieces: &[Piece], side: Side, start: f32, look: &Look) {
        let room = self.space.room;
        let style = self.taste.style(cabinets::WALL_CABINET.styles);
        let upper = self.maybe(0.8).then(|| Look { style, ..look.clone() });
        let mut at = start;
        for (unit, piece) in units.iter().zip(pieces) {
            let size = piece.size();
            let (along, middle) = ([at, at + size.x], at + size.x / 2.0);
            at = along[1] + GAP_M;
            let spot = self.set(piece, side, &side.band(&room, along, [GAP_M, GAP_M + size.z]), 0.0);
            match unit {
                Unit::Sink(_) => {
                    let sink = sinks::KITCHEN_SINK.any(self.taste);
                    self.lay(&sink, &spot, [0.0, counters::COUNTER_M, 0.0]);
                    self.above(upper.as_ref(), size.x, side, middle);
                }
                Unit::Counter(_) => {
                    self.on_counter(&spot);
                    self.above(upper.as_ref(), size.x, side, middle);
                }
                Unit::Cooker if self.maybe(0.25) => {
                    let hood = appliances::HOOD.any(self.taste);
                    self.hang_deep(&hood, 1.55, side, middle);
                }
                Unit::Fridge => {
                    let y = [0.0, size.y];
                    self.space.take_wall(side, Patch { along, y });
                }
                _ => {}
            }
        }
    }

    fn on_counter(&mut self, spot: &Spot) {
        if self.maybe(0.2) {
            self.on_top(&appliances::SMALL, spot, [-0.6, -0.4]);
        }
        if self.maybe(0.5) {
            self.on_top(&plants::SMALL_PLANT, spot, [0.8, -0.6]);
        }
    }

    /// Adds a cabinet above a counter, if the kitchen has wall cabinets.
    fn above(&mut self, look: Option<&Look>, width: f32, side: Side, middle: f32) {
        if let Some(look) = look {
            let cabinet = cabinets::WALL_CABINET.drawn(look, [width * 0.95, 0.65, 0.33]);
            self.hang_deep(&cabinet, 1.5, side, middle);
        }
    }

    /// Adds an island with stools. Returns true if there was room.
    fn island(&mut self, look: &Look) -> bool {
        let width = self.taste.rng.range(1.1, 1.6);
        let Some((side, center)) = self.place_for([width, 0.7 + 0.5]) else { return false };
        let style = self.taste.style(counters::ISLAND.styles);
        let island = counters::ISLAND.drawn(&Look { style, ..look.clone() }, [width, 0.0, 0.0]);
        let Some(spot) = self.stand_at(&island, side, shifted(side, center, [0.0, -0.25])) else {
            return false;
        };
        let stool = stools::BAR_STOOL.any(self.taste);
        for x in [-width * 0.27, width * 0.27] {
            self.stand_at(&stool, side, shifted(side, spot.center(), [x, 0.35 + 0.24]));
        }
        self.clutter(&spot, 2);
        true
    }

    pub(super) fn dining_room(&mut self) {
        let chairs = [4, 6, 6, 8][self.rng.below(4)];
        self.dining_set(chairs);
        let make = if self.maybe(0.7) { &cabinets::SIDEBOARD } else { &cabinets::TALL_CABINET };
        if let Some(cabinet) = self.put(make, Wish::Middle, 0.6)
            && cabinet.height_m() < 1.1
        {
            self.clutter(&cabinet, 2);
            self.picture_sized([0.7, 0.5], Wish::Facing(cabinet.side, cabinet.along()), 1.6);
        }
        if self.maybe(0.4) {
            self.put(&chests::CHEST, Wish::Anywhere, 0.6);
        }
        if self.maybe(0.3) {
            self.put(&stools::SEATING, Wish::Anywhere, 0.4);
        }
    }
}
