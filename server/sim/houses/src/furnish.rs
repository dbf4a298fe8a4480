//! Furnishing: groups first, then single pieces, then wall, ceiling and small objects.

mod bedroom;
mod dining;
mod extras;
mod living;

use super::assembly::{Assembly, Piece};
use super::furniture::*;
use super::model::{Facet, Model, about};
use super::plan::{CEILING_M, Plan, RoomKind, Window, remainder};
use super::rect::{Rect, Side, common, turned};
use super::space::{Claim, Patch, Space};
use super::styles::StyleSampler;
use avln_geom::{Aabb, Point3, Rng, Vector3};

/// A room part in progress.
pub(super) struct Decorator<'a> {
    assembly: &'a mut Assembly,
    sampler: &'a mut StyleSampler,
    rng: Rng,
    plan: &'a Plan,
    index: usize,
    space: Space,
    /// Count of free zones in front of doors.
    doors: usize,
    /// Footprints on the floor.
    covered: Vec<Rect>,
    rugs: Vec<Rect>,
    /// Objects on top of furniture.
    laid: Vec<Aabb>,
}

#[derive(Clone, Copy, Debug)]
struct Spot {
    /// Origin of the piece frame.
    origin: Vector3<f32>,
    /// Wall behind the piece.
    side: Side,
    bounds: Aabb,
    /// True for a round top.
    round: bool,
}

/// Preferred wall position.
#[derive(Clone, Copy, Debug)]
enum Wish {
    Anywhere,
    Corner,
    Middle,
    /// Only on this wall, near this position.
    Facing(Side, f32),
}

#[derive(Clone, Copy)]
struct WallPlace {
    side: Side,
    start_m: f32,
    cost: f32,
}

/// Gap between furniture and walls or lateral neighbours, metres.
const GAP_M: f32 = 0.015;

/// Lowest camera, metres.
const LOWEST_EYE_M: f32 = 0.5;

/// Free depth towards another room part, metres: in the main part, elsewhere.
const PASSAGE_M: [f32; 2] = [0.8, 0.5];

/// Free width towards another room part, metres.
const PASSAGE_WIDTH_M: f32 = 1.0;

/// Furnishes a room and returns the footprints on the floor.
pub(super) fn furnish(
    assembly: &mut Assembly,
    sampler: &mut StyleSampler,
    rng: &Rng,
    plan: &Plan,
    index: usize,
) -> Vec<Rect> {
    let room = &plan.rooms[index];
    let mut covered = Vec::new();
    let parts = room.parts();
    for number in 0..parts.len() {
        let (space, doors) = empty(plan, index, &parts, number);
        let rng = rng.fork(&format!("part {number}"));
        let (laid, rugs) = (vec![], vec![]);
        let mut decorator =
            Decorator { assembly, sampler, rng, plan, index, space, doors, covered, rugs, laid };
        match number {
            0 => decorator.fit_out(room.kind),
            _ => decorator.fit_out_rest(room.kind),
        }
        covered = decorator.covered;
    }
    covered
}

/// Returns the empty part `number` with free doors, and the count of door zones.
fn empty(plan: &Plan, index: usize, parts: &[Rect], number: usize) -> (Space, usize) {
    let part = parts[number];
    let passage_m = PASSAGE_M[number.min(1)];
    let mut space = Space::new(part);
    for side in Side::ALL {
        for opening in plan.openings_on(index, &part, side) {
            space.add_door(side, opening.along, opening.height_m);
        }
        let seams = seams(parts, number, side);
        for gap in plan.gaps(index, &part, side) {
            space.take_wall(side, Patch { along: gap, y: [0.0, CEILING_M] });
            for rest in remainder(gap, seams.iter().copied()) {
                space.keep_free(side, rest, passage_m);
            }
        }
        for seam in seams {
            let width_m = (seam[1] - seam[0]).min(PASSAGE_WIDTH_M);
            space.keep_free(side, about((seam[0] + seam[1]) / 2.0, width_m), passage_m);
        }
    }
    // Chairs may later use the zones in front of furniture, but never these.
    let doors = space.zones();
    (space, doors)
}

/// Returns the openings from part `number` to other parts on a side.
fn seams(parts: &[Rect], number: usize, side: Side) -> Vec<[f32; 2]> {
    let part = &parts[number];
    let seam = |other: &Rect| {
        let touching = (side.opposite().line_m(other) - side.line_m(part)).abs() < 1e-3;
        let [a, b] = [side.span(part), side.span(other)];
        (touching && common(a, b) > 1e-3).then_some([a[0].max(b[0]), a[1].min(b[1])])
    };
    parts.iter().filter_map(seam).collect()
}

impl Decorator<'_> {
    fn fit_out(&mut self, kind: RoomKind) {
        self.entrance();
        self.windows(kind);
        match kind {
            RoomKind::Stairs => return self.stairwell(),
            RoomKind::Hallway | RoomKind::Entryway => self.hallway(),
            RoomKind::Closet => self.closet(),
            RoomKind::Laundry => self.laundry(),
            RoomKind::Utility => self.utility(),
            RoomKind::Garage => self.garage(),
            RoomKind::LivingRoom => self.living_room(),
            RoomKind::Library => self.library(),
            RoomKind::GameRoom => self.game_room(),
            RoomKind::Kitchen => self.kitchen(),
            RoomKind::DiningRoom => self.dining_room(),
            RoomKind::Bedroom => self.bedroom(),
            RoomKind::Bathroom => self.bathroom(),
            RoomKind::Office => self.office(),
            RoomKind::Gym => self.gym(),
        }
        self.extras(kind, 2.0);
        self.ceiling_lamps();
    }

    /// Furnishes a smaller part of a non-rectangular room.
    fn fit_out_rest(&mut self, kind: RoomKind) {
        self.entrance();
        self.windows(kind);
        match kind {
            RoomKind::Stairs => return,
            RoomKind::Bedroom => self.bedroom_corner(),
            RoomKind::LivingRoom | RoomKind::Library | RoomKind::GameRoom => self.corner(),
            RoomKind::Office | RoomKind::Garage => self.work_corner(),
            RoomKind::Kitchen | RoomKind::DiningRoom => self.pantry(),
            _ => {}
        }
        self.extras(kind, 0.5);
        if self.area_m2() > 3.0 {
            self.ceiling_lamps();
        }
    }

    fn house_has(&self, kind: RoomKind) -> bool {
        self.plan.rooms.iter().any(|room| room.kind == kind)
    }

    /// Returns true if the room contains `category`.
    fn has(&self, category: &str) -> bool {
        let here = Some(self.index as u16);
        self.assembly.objects().iter().any(|object| object.region == here && object.category == category)
    }

    fn maybe(&mut self, probability: f64) -> bool {
        self.rng.chance(probability)
    }

    /// Draws a number; both ends are included.
    fn count(&mut self, low: usize, high: usize) -> usize {
        low + self.rng.below(high - low + 1)
    }

    fn area_m2(&self) -> f32 {
        let [x, z] = self.space.room.size();
        x * z
    }

    /// Places a piece at a wall with `front_m` free floor in front.
    fn put(&mut self, kind: &FurnitureKind, wish: Wish, front_m: f32) -> Option<Spot> {
        let piece = kind.any(self.sampler);
        self.stand(&piece, wish, front_m)
    }

    /// Places a piece with an approximate width, height and depth.
    fn put_sized(&mut self, kind: &FurnitureKind, size: [f32; 3], wish: Wish, front_m: f32) -> Option<Spot> {
        let piece = kind.sized(self.sampler, size);
        self.stand(&piece, wish, front_m)
    }

    /// Places a piece at a wall with `front_m` free floor in front.
    fn stand(&mut self, piece: &Piece, wish: Wish, front_m: f32) -> Option<Spot> {
        let size = piece.size();
        let places = self.wall_places(size.x, wish);
        let (place, claim) = self.first_fit(&places, size, front_m)?;
        self.space.take(&claim);
        Some(self.set(piece, place.side, &claim.rect, 0.0))
    }

    /// Returns the first position with room for `size`.
    fn first_fit(
        &self,
        places: &[WallPlace],
        size: Vector3<f32>,
        front_m: f32,
    ) -> Option<(WallPlace, Claim)> {
        let claim = |place: &WallPlace| {
            let along = [place.start_m, place.start_m + size.x];
            self.claim_at_wall(place.side, along, size, front_m)
        };
        let claims: Vec<Claim> = places.iter().map(claim).collect();
        let fitting = self.space.first_fit(claims.iter().copied())?;
        let index = claims.iter().position(|claim| claim.rect == fitting.rect)?;
        Some((places[index], fitting))
    }

    /// Returns wall positions every 5 cm, preferred positions first.
    fn wall_places(&mut self, length_m: f32, wish: Wish) -> Vec<WallPlace> {
        const STEP_M: f32 = 0.05;
        let mut places = Vec::new();
        for side in Side::ALL {
            let span = side.span(&self.space.room);
            let play = span[1] - span[0] - length_m - 2.0 * GAP_M;
            // Random costs vary the choice between equally good walls.
            let whim = self.rng.range(0.0, 0.4);
            for step in 0..=(play / STEP_M).max(-1.0) as i32 {
                let start = span[0] + GAP_M + (play - step as f32 * STEP_M);
                let from_middle =
                    (start + length_m / 2.0 - (span[0] + span[1]) / 2.0).abs() / (play / 2.0).max(0.1);
                let cost = match wish {
                    Wish::Anywhere => self.rng.range(0.0, 1.0),
                    Wish::Corner => 1.0 - from_middle + whim,
                    Wish::Middle => from_middle + whim,
                    Wish::Facing(wanted, _) if wanted != side => continue,
                    Wish::Facing(_, place) => (start + length_m / 2.0 - place).abs(),
                };
                places.push(WallPlace { side, start_m: start, cost });
            }
        }
        places.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        places
    }

    fn claim_at_wall(&self, side: Side, along: [f32; 2], size: Vector3<f32>, front_m: f32) -> Claim {
        let near = GAP_M + size.z;
        let front = side.band(&self.space.room, along, [near, near + front_m]);
        Claim {
            rect: side.band(&self.space.room, along, [GAP_M, near]),
            y: [0.0, size.y],
            front: (front_m > 0.0).then_some(front),
        }
    }

    /// Places a piece next to another at the same wall; `hand` is -1 or 1.
    fn beside(&mut self, piece: &Piece, other: &Spot, hand: f32) -> Option<Spot> {
        let size = piece.size();
        let span = other.side.span(&Rect::of(&other.bounds));
        let along = match hand < 0.0 {
            true => [span[0] - 0.03 - size.x, span[0] - 0.03],
            false => [span[1] + 0.03, span[1] + 0.03 + size.x],
        };
        let claim = self.claim_at_wall(other.side, along, size, 0.0);
        if !self.space.fits(&claim) {
            return None;
        }
        self.space.take(&claim);
        Some(self.set(piece, other.side, &claim.rect, 0.0))
    }

    /// Places a piece at `center`, off the walls, over free fronts only.
    fn stand_at(&mut self, piece: &Piece, side: Side, center: [f32; 2]) -> Option<Spot> {
        let size = piece.size();
        let size_xz = if side.runs_along_x() { [size.x, size.z] } else { [size.z, size.x] };
        let claim = Claim { rect: Rect::around(center, size_xz), y: [0.0, size.y], front: None };
        if !self.space.fits_in_front(&claim, self.doors) {
            return None;
        }
        self.space.take(&claim);
        Some(self.set(piece, side, &claim.rect, 0.0))
    }

    /// Returns the centre of a free rectangle nearest to the room centre; if necessary in front of furniture.
    fn open_floor(&self, size: [f32; 2]) -> Option<[f32; 2]> {
        const STEP_M: f32 = 0.1;
        let room = self.space.room;
        let middle = room.center();
        let play = [0, 1].map(|axis| (room.size()[axis] - size[axis]) / 2.0);
        let steps = play.map(|play| (play / STEP_M).floor() as i32);
        let mut places: Vec<[f32; 2]> = Vec::new();
        for i in -steps[0]..=steps[0] {
            places.extend((-steps[1]..=steps[1]).map(|k| [i as f32 * STEP_M, k as f32 * STEP_M]));
        }
        places.sort_by(|a, b| (a[0] * a[0] + a[1] * a[1]).total_cmp(&(b[0] * b[0] + b[1] * b[1])));
        let claim = |offset: [f32; 2]| Claim {
            rect: Rect::around([middle[0] + offset[0], middle[1] + offset[1]], size),
            y: [0.0, 1.0],
            front: None,
        };
        let claims: Vec<Claim> = places.into_iter().map(claim).collect();
        let clear = self.space.first_fit(claims.iter().copied());
        // Every test is a flood fill, so only a sample of the positions is tried.
        let close =
            || claims.iter().step_by(3).take(120).find(|claim| self.space.fits_closely(claim, self.doors));
        clear.or_else(|| close().copied()).map(|claim| claim.rect.center())
    }

    /// Places a piece on top of another; `offset` is in the other's frame.
    fn lay(&mut self, piece: &Piece, other: &Spot, offset: [f32; 3]) {
        let [x, z] = turned(other.side.quarter(), [offset[0], offset[2]]);
        let origin = other.origin + Vector3::new(x, offset[1], z);
        self.add(piece, other.side, origin);
    }

    /// Places a rug around `center`, wide in the direction of `side`, if it fits.
    fn lay_rug(&mut self, [width, depth]: [f32; 2], side: Side, center: [f32; 2]) {
        let rug = textiles::RUG.sized(self.sampler, [width, 0.0, depth]);
        let size = rug.size();
        let size_xz = if side.runs_along_x() { [size.x, size.z] } else { [size.z, size.x] };
        let rect = Rect::around(center, size_xz);
        let clear = !self.rugs.iter().any(|other| other.overlaps(&rect));
        if clear && self.space.room.inset(0.05).holds(&rect) {
            self.add(&rug, side, Vector3::new(center[0], 0.0, center[1]));
            self.rugs.push(rect);
        }
    }

    /// Adds a piece with the smallest footprint corner at `rect`, base at `base_m`.
    fn set(&mut self, piece: &Piece, side: Side, rect: &Rect, base_m: f32) -> Spot {
        let bounds = piece.model.moved(side.quarter(), Vector3::zeros()).bounds();
        let lift = base_m - bounds.min.y;
        let origin = Vector3::new(rect.x[0] - bounds.min.x, lift, rect.z[0] - bounds.min.z);
        if base_m == 0.0 {
            self.covered.push(*rect);
        }
        self.add(piece, side, origin)
    }

    fn add(&mut self, piece: &Piece, side: Side, origin: Vector3<f32>) -> Spot {
        let model = self.shown(piece.model.moved(side.quarter(), origin));
        let placed = Piece { model, ..piece.clone() };
        let bounds = self.assembly.add_object(&placed, self.index);
        let round = ["round", "oval", "hexagonal", "octagonal", "drum-shaped"]
            .contains(&piece.attributes.shape.as_str());
        Spot { origin, side, bounds, round }
    }

    /// Removes hidden faces and undersides below eye level.
    fn shown(&self, model: Model) -> Model {
        let floor = self.plan.rooms[self.index].floor();
        let inside = |point: &Point3<f32>| {
            let place = [point.x, point.z];
            (0.0..=CEILING_M).contains(&point.y) && floor.iter().any(|rect| rect.distance_m(place) == 0.0)
        };
        // Pieces have this gap to walls, so a face towards a wall looks at a point outside the floor.
        let before = |face: &Facet| face.moved(GAP_M + 0.003);
        model.seen().without(|face| face.is_underside(LOWEST_EYE_M) || !before(face).iter().any(inside))
    }
}

impl Spot {
    fn center(&self) -> [f32; 2] {
        Rect::of(&self.bounds).center()
    }

    /// Position `distance_m` in front of the piece.
    fn before(&self, distance_m: f32) -> [f32; 2] {
        let rect = Rect::of(&self.bounds);
        let front = self.side.opposite().line_m(&rect) + self.side.inward() * distance_m;
        let [x, z] = rect.center();
        if self.side.runs_along_x() { [x, front] } else { [front, z] }
    }

    /// Centre on the wall axis.
    fn along(&self) -> f32 {
        let span = self.side.span(&Rect::of(&self.bounds));
        (span[0] + span[1]) / 2.0
    }

    /// Width and depth in the piece frame.
    fn footprint(&self) -> [f32; 2] {
        let size = self.bounds.size();
        if self.side.runs_along_x() { [size.x, size.z] } else { [size.z, size.x] }
    }

    fn height_m(&self) -> f32 {
        self.bounds.max.y - self.origin.y
    }
}
