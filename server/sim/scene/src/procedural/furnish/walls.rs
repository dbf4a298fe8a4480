//! What hangs on walls and ceilings: windows, the front door, pictures, towels, coats, lamps.

use super::super::furniture::{decor, lights, openings};
use super::super::plan::Window;
use super::*;

impl Decorator<'_> {
    /// The closed front door of the house.
    pub(super) fn entrance(&mut self) {
        let here = |door: &Window| door.room == self.index && self.on_wall(door);
        if let Some(place) = self.plan.entrance.filter(here) {
            let door = openings::door(self.taste);
            self.fix(&door, place.side, (place.along[0] + place.along[1]) / 2.0, 0.0);
            self.space.add_door(place.side, place.along, place.y[1]);
            self.doors += 1;
        }
    }

    /// Whether a window stands in the wall of the rectangle that is being furnished.
    fn on_wall(&self, window: &Window) -> bool {
        let room = &self.space.room;
        let span = window.side.span(room);
        let along = span[0] <= window.along[0] && window.along[1] <= span[1];
        along && (window.side.line_m(room) - window.line_m).abs() < 1e-3
    }

    /// The windows of the plan, some with curtains.
    pub(super) fn windows(&mut self, kind: RoomKind) {
        let plan = self.plan;
        for side in Side::ALL {
            for window in plan
                .windows_on(self.index, side)
                .filter(|window| self.on_wall(window))
                .copied()
                .collect::<Vec<_>>()
            {
                self.window(kind, &window);
            }
        }
    }

    fn window(&mut self, kind: RoomKind, window: &Window) {
        let width = window.along[1] - window.along[0];
        let (middle, [sill, head]) = ((window.along[0] + window.along[1]) / 2.0, window.y);
        let patch = Patch { along: about(middle, width + 0.1), y: [sill - 0.03, head] };
        self.fix(&openings::window(width, head - sill), window.side, middle, sill - 0.03);
        self.space.take_wall(window.side, patch);
        if matches!(kind, RoomKind::LivingRoom | RoomKind::Bedroom | RoomKind::DiningRoom | RoomKind::Office)
        {
            self.curtains(window.side, middle, [width, sill, head]);
        }
    }

    fn curtains(&mut self, side: Side, middle: f32, [width, sill, head]: [f32; 3]) {
        let tint = self.taste.tint("curtain", super::super::taste::CLOTH);
        for hand in [-1.0, 1.0] {
            let place = middle + hand * (width / 2.0 + 0.2);
            let y = [sill - 0.12, head + 0.08];
            let patch = Patch { along: about(place, 0.3), y };
            if self.space.wall_is_free(side, &patch) {
                self.fix(&decor::curtain(tint, 0.26, y[1] - y[0]), side, place, y[0]);
                self.space.take_wall(side, patch);
            }
        }
    }

    /// Hangs a shallow piece somewhere on a wall, its lower edge at `base_m`.
    pub(super) fn hang(&mut self, piece: &Piece, base_m: f32, wish: Wish) -> Option<Spot> {
        const MARGIN_M: f32 = 0.07;
        let size = piece.size();
        let mut places = self.wall_places(size.x + 2.0 * MARGIN_M, wish);
        places.sort_by(|a, b| a.2.total_cmp(&b.2));
        let (side, middle) = places.into_iter().find_map(|(side, start, _)| {
            let along = [start, start + size.x + 2.0 * MARGIN_M];
            let patch = Patch { along, y: [base_m - MARGIN_M, base_m + size.y + MARGIN_M] };
            self.space.wall_is_free(side, &patch).then_some((side, (along[0] + along[1]) / 2.0))
        })?;
        let y = [base_m, base_m + size.y];
        self.space.take_wall(side, Patch { along: about(middle, size.x), y });
        Some(self.fix(piece, side, middle, base_m))
    }

    /// Hangs a deep piece, which takes floor as well when it hangs low.
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

    /// Fixes a piece to a wall without asking.
    pub(super) fn fix(&mut self, piece: &Piece, side: Side, middle: f32, base_m: f32) -> Spot {
        let size = piece.size();
        let rect = side.band(&self.space.room, about(middle, size.x), [0.002, size.z + 0.002]);
        let covered = self.covered.len();
        let spot = self.set(piece, side, &rect, base_m);
        self.covered.truncate(covered);
        spot
    }

    /// Pictures at eye height.
    pub(super) fn pictures(&mut self, count: usize) {
        for _ in 0..count {
            let (width, height) = (self.taste.length_m(0.45, 1.0), self.taste.length_m(0.45, 0.75));
            let picture = decor::picture(self.taste, width, height);
            self.hang(&picture, 1.5 - height / 2.0, Wish::Middle);
        }
    }

    /// Towels at hand height; returns how many there was room for.
    pub(super) fn towels(&mut self, count: usize) {
        for _ in 0..count {
            let towel = super::super::furniture::baths::towel(self.taste);
            let base = 1.42 - towel.size().y / 2.0;
            self.hang(&towel, base, Wish::Anywhere);
        }
    }

    /// Coats on hooks along one wall.
    pub(super) fn coats(&mut self, count: usize) {
        for _ in 0..count {
            let coat = decor::coat(self.taste);
            let size = coat.size();
            let base = 1.78 - size.y;
            let mut places = self.wall_places(size.x, Wish::Anywhere);
            places.sort_by(|a, b| a.2.total_cmp(&b.2));
            let fitting = places.into_iter().find(|&(side, start, _)| {
                let claim =
                    Claim { y: [base, 1.8], ..self.claim_at_wall(side, [start, start + size.x], size, 0.0) };
                self.space.fits(&claim)
            });
            if let Some((side, start, _)) = fitting {
                self.hang_deep(&coat, base, side, start + size.x / 2.0);
            }
        }
    }

    /// A lamp in the middle of the ceiling.
    pub(super) fn ceiling_lamp(&mut self) {
        let lamp = lights::pendant(self.taste);
        let [x, z] = self.space.room.center();
        self.add(&lamp, Side::North, Vector3::new(x, CEILING_M, z));
    }

    /// A mirror, if there is room for it.
    pub(super) fn mirror(&mut self, width: f32, height: f32, wish: Wish) {
        let mirror = decor::mirror(self.taste, width, height);
        self.hang(&mirror, 1.5 - height / 2.0, wish);
    }

    /// A plant on the floor.
    pub(super) fn floor_plant(&mut self) {
        let plant = decor::plant(self.taste, true);
        self.stand(&plant, Wish::Corner, 0.0);
    }
}
