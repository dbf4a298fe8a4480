//! Objects on walls and ceilings: windows, front door, pictures, towels, coats, lamps.

use super::*;

impl Decorator<'_> {
    /// Adds the house's closed front door.
    pub(super) fn entrance(&mut self) {
        let here = |door: &Window| door.room == self.index && door.is_on(&self.space.room);
        if let Some(place) = self.plan.entrance.filter(here) {
            let door = openings::door(self.sampler);
            self.fix(&door, place.side, (place.along[0] + place.along[1]) / 2.0, 0.0);
            self.space.add_door(place.side, place.along, place.y[1]);
            self.doors += 1;
        }
    }

    /// Adds windows, some with curtains.
    pub(super) fn windows(&mut self, kind: RoomKind) {
        let (plan, part) = (self.plan, self.space.room);
        for side in Side::ALL {
            plan.windows_on(self.index, &part, side).for_each(|window| self.window(kind, window));
        }
    }

    fn window(&mut self, kind: RoomKind, window: &Window) {
        let width = window.along[1] - window.along[0];
        let (middle, [sill, head]) = ((window.along[0] + window.along[1]) / 2.0, window.y);
        let patch = Patch { along: about(middle, width + 0.1), y: [sill - 0.03, head] };
        self.fix(&openings::window(width, head - sill), window.side, middle, sill - 0.03);
        self.space.take_wall(window.side, patch);
        use RoomKind::*;
        let curtained = matches!(kind, LivingRoom | Bedroom | DiningRoom | Office | Library | GameRoom);
        if kind != Stairs {
            self.dress_window(window.side, middle, [width, sill, head], curtained);
        }
    }

    /// Fixes a piece to a free wall area; `take` marks the area as used.
    pub(super) fn fix_if_free(&mut self, piece: &Piece, side: Side, middle: f32, base_m: f32, take: bool) {
        let size = piece.size();
        let patch = Patch { along: about(middle, size.x), y: [base_m, base_m + size.y] };
        if self.space.wall_is_free(side, &patch) {
            self.fix(piece, side, middle, base_m);
            if take {
                self.space.take_wall(side, patch);
            }
        }
    }

    /// Fixes a piece in front of a flat piece on the wall.
    pub(super) fn fix_over(&mut self, piece: &Piece, side: Side, middle: f32, base_m: f32) {
        const FRONT_M: f32 = 0.04;
        let size = piece.size();
        let rect = side.band(&self.space.room, about(middle, size.x), [FRONT_M, FRONT_M + size.z]);
        if self.space.room.holds(&rect) {
            let covered = self.covered.len();
            self.set(piece, side, &rect, base_m);
            self.covered.truncate(covered);
        }
    }

    /// Hangs a shallow piece, lower edge at `base_m`.
    pub(super) fn hang(&mut self, piece: &Piece, base_m: f32, wish: Wish) -> Option<Spot> {
        const MARGIN_M: f32 = 0.07;
        let size = piece.size();
        let places = self.wall_places(size.x + 2.0 * MARGIN_M, wish);
        let (side, middle) = places.into_iter().find_map(|WallPlace { side, start_m, .. }| {
            let along = [start_m, start_m + size.x + 2.0 * MARGIN_M];
            let patch = Patch { along, y: [base_m - MARGIN_M, base_m + size.y + MARGIN_M] };
            self.space.wall_is_free(side, &patch).then_some((side, (along[0] + along[1]) / 2.0))
        })?;
        let y = [base_m, base_m + size.y];
        self.space.take_wall(side, Patch { along: about(middle, size.x), y });
        Some(self.fix(piece, side, middle, base_m))
    }

    /// Hangs a deep piece, which also uses floor if it hangs low.
    pub(super) fn hang_deep(&mut self, piece: &Piece, base_m: f32, side: Side, middle: f32) -> Option<Spot> {
        let size = piece.size();
        let rect = side.band(&self.space.room, about(middle, size.x), [0.0, size.z]);
        let claim = Claim { rect, y: [base_m, base_m + size.y], front: None };
        let patch = Patch { along: about(middle, size.x), y: claim.y };
        if !self.space.room.holds(&rect) || !self.space.wall_is_free(side, &patch) {
            return None;
        }
        self.space.take(&claim);
        Some(self.fix(piece, side, middle, base_m))
    }

    /// Fixes a piece to a wall without checks.
    pub(super) fn fix(&mut self, piece: &Piece, side: Side, middle: f32, base_m: f32) -> Spot {
        let size = piece.size();
        let rect = side.band(&self.space.room, about(middle, size.x), [0.002, size.z + 0.002]);
        // Pieces on a wall do not darken the floor.
        let covered = self.covered.len();
        let spot = self.set(piece, side, &rect, base_m);
        self.covered.truncate(covered);
        spot
    }

    /// Hangs a deep piece at a free wall above free floor.
    pub(super) fn hang_somewhere(&mut self, piece: &Piece, base_m: f32) -> Option<Spot> {
        let size = piece.size();
        let places = self.wall_places(size.x, Wish::Anywhere);
        let place = places.into_iter().find(|&WallPlace { side, start_m, .. }| {
            let claim = self.claim_at_wall(side, [start_m, start_m + size.x], size, 0.0);
            self.space.fits(&Claim { y: [base_m, base_m + size.y], ..claim })
        })?;
        self.hang_deep(piece, base_m, place.side, place.start_m + size.x / 2.0)
    }

    /// Adds equal pictures in a row at eye height.
    pub(super) fn pictures(&mut self, count: usize) {
        let format =
            [[0.45, 0.6], [0.6, 0.45], [0.9, 0.6], [0.5, 0.5], [0.7, 0.95], [1.1, 0.7], [0.35, 0.45]];
        let [width, height] = format[self.rng.below(format.len())];
        let mut wish = Wish::Middle;
        for _ in 0..count {
            if let Some(spot) = self.picture_sized([width, height], wish, 1.5) {
                wish = Wish::Facing(spot.side, spot.along() + width + 0.2);
            }
        }
    }

    pub(super) fn towels(&mut self, count: usize) {
        for _ in 0..count {
            let towel = textiles::TOWEL.any(self.sampler);
            let base = 1.42 - towel.size().y / 2.0;
            self.hang(&towel, base, Wish::Anywhere);
        }
    }

    pub(super) fn coats(&mut self, count: usize) {
        for _ in 0..count {
            let coat = textiles::HANGING.any(self.sampler);
            self.hang_somewhere(&coat, 1.78 - coat.size().y);
        }
    }

    /// Adds pictures and a lamp over the stairs.
    pub(super) fn stairwell(&mut self) {
        if !self.plan.begins_stairs(self.index) {
            let count = self.count(1, 3);
            self.pictures(count);
            self.ceiling_lamps();
        }
    }

    /// Adds ceiling lamps, one per 16 square metres.
    pub(super) fn ceiling_lamps(&mut self) {
        let lamp = lights::PENDANT.any(self.sampler);
        let room = self.space.room;
        let [x, z] = room.center();
        let count = ((self.area_m2() / 16.0) as usize).clamp(1, 3);
        for i in 0..count {
            let share = (i as f32 + 0.5) / count as f32 - 0.5;
            let [dx, dz] = if room.size()[0] > room.size()[1] { [share, 0.0] } else { [0.0, share] };
            let place = Vector3::new(x + dx * room.size()[0], CEILING_M, z + dz * room.size()[1]);
            self.add(&lamp, Side::North, place);
        }
    }
}
