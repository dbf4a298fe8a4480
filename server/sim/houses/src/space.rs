//! Used and free space in a room.

use super::plan::CEILING_M;
use super::rect::{Lattice, Rect, Side, common};

/// Free depth on both sides of a door, metres.
pub(super) const DOOR_CLEAR_M: f32 = 0.9;

/// Half the aisle width, metres.
// A body of 0.25 m, plus 0.075 m lost on the navmesh lattice.
const AISLE_RADIUS_M: f32 = 0.33;

/// Lower objects block a walking body, metres.
const BODY_HEIGHT_M: f32 = 1.5;

/// Furniture nearer to a wall hides the wall behind it, metres.
const NEAR_WALL_M: f32 = 0.3;

/// A room's floor and walls with their used parts.
pub(super) struct Space {
    pub(super) room: Rect,
    /// Footprints on the floor or hanging low.
    solids: Vec<Rect>,
    /// Free zones in front of doors and furniture.
    free: Vec<Rect>,
    /// Zones that must be reachable.
    goals: Vec<Rect>,
    /// Used wall patches, in the order of [`Side::ALL`].
    patches: [Vec<Patch>; 4],
}

/// A wall rectangle: a horizontal range and a height range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    pub(super) along: [f32; 2],
    pub(super) y: [f32; 2],
}

impl Patch {
    fn overlaps(&self, other: &Patch) -> bool {
        common(self.along, other.along) > 0.0 && common(self.y, other.y) > 0.0
    }
}

/// A position for a piece: footprint, height range, free floor in front.
#[derive(Clone, Copy, Debug)]
pub(super) struct Claim {
    pub(super) rect: Rect,
    pub(super) y: [f32; 2],
    pub(super) front: Option<Rect>,
}

impl Space {
    pub(super) fn new(room: Rect) -> Self {
        Self { room, solids: vec![], free: vec![], goals: vec![], patches: Default::default() }
    }

    /// Reserves the floor in front of a door.
    pub(super) fn add_door(&mut self, side: Side, along: [f32; 2], height_m: f32) {
        self.keep_free(side, along, DOOR_CLEAR_M);
        self.take_wall(side, Patch { along: [along[0] - 0.08, along[1] + 0.08], y: [0.0, height_m + 0.08] });
    }

    /// Free zone count.
    pub(super) fn zones(&self) -> usize {
        self.free.len()
    }

    /// Reserves the floor at an entry side.
    pub(super) fn keep_free(&mut self, side: Side, along: [f32; 2], depth_m: f32) {
        let zone = side.strip(&self.room, along, depth_m.min(self.depth_m(side)));
        self.free.push(zone);
        self.goals.push(zone);
    }

    /// Marks a wall patch as used.
    pub(super) fn take_wall(&mut self, side: Side, patch: Patch) {
        self.patches[side as usize].push(patch);
    }

    /// Returns true if a wall patch is free.
    pub(super) fn wall_is_free(&self, side: Side, patch: &Patch) -> bool {
        let span = side.span(&self.room);
        let inside = span[0] <= patch.along[0] && patch.along[1] <= span[1] && patch.y[1] <= CEILING_M;
        inside && !self.patches[side as usize].iter().any(|taken| taken.overlaps(patch))
    }

    /// Returns true if a piece fits: inside, off the free zones, at a free wall, with all doors and fronts
    /// connected.
    pub(super) fn fits(&self, claim: &Claim) -> bool {
        self.stands(claim) && self.still_connected(claim)
    }

    /// Like [`Space::fits`], but free floor in front of furniture (not doors) may be used.
    pub(super) fn fits_in_front(&self, claim: &Claim, doors: usize) -> bool {
        self.room.holds(&claim.rect)
            && self.is_clear(&claim.rect)
            && !self.free[..doors].iter().any(|zone| zone.overlaps(&claim.rect))
            && self.still_connected(claim)
    }

    /// Like [`Space::fits`], but the piece may reach 0.2 m into free floor in front of furniture.
    pub(super) fn fits_closely(&self, claim: &Claim, doors: usize) -> bool {
        const REACH_M: f32 = 0.2;
        let blocked = |zone: &Rect| zone.inset(REACH_M).overlaps(&claim.rect);
        !self.free[doors..].iter().any(blocked) && self.fits_in_front(claim, doors)
    }

    /// Returns the first claim that fits.
    pub(super) fn first_fit(&self, claims: impl Iterator<Item = Claim>) -> Option<Claim> {
        // The connection test is a flood fill, so it comes last and is limited in number.
        const TRIES: usize = 40;
        claims.filter(|claim| self.stands(claim)).take(TRIES).find(|claim| self.still_connected(claim))
    }

    fn is_clear(&self, rect: &Rect) -> bool {
        !self.solids.iter().any(|solid| solid.overlaps(rect))
    }

    fn stands(&self, claim: &Claim) -> bool {
        let front_ok = |front: &Rect| self.room.holds(front) && self.is_clear(front);
        self.room.holds(&claim.rect)
            && self.is_clear(&claim.rect)
            && !self.free.iter().any(|zone| zone.overlaps(&claim.rect))
            && claim.front.iter().all(front_ok)
            && self.near_patches(claim).iter().all(|(side, patch)| self.wall_is_free(*side, patch))
    }

    /// Marks the claim's floor and wall as used.
    pub(super) fn take(&mut self, claim: &Claim) {
        for (side, patch) in self.near_patches(claim) {
            self.take_wall(side, patch);
        }
        // A body walks below higher pieces.
        if claim.y[0] < BODY_HEIGHT_M {
            self.solids.push(claim.rect);
        }
        if let Some(front) = claim.front {
            self.free.push(front);
            self.goals.push(front);
        }
    }

    /// Returns the wall patches hidden by a piece.
    fn near_patches(&self, claim: &Claim) -> Vec<(Side, Patch)> {
        let near = |side: Side| {
            let along = side.span(&claim.rect);
            let gap = side.line_m(&claim.rect) - side.line_m(&self.room);
            (gap.abs() < NEAR_WALL_M).then_some((side, Patch { along, y: claim.y }))
        };
        Side::ALL.into_iter().filter_map(near).collect()
    }

    /// Room depth from the wall on `side`.
    pub(super) fn depth_m(&self, side: Side) -> f32 {
        self.room.size()[usize::from(side.runs_along_x())]
    }

    /// Returns true if a body of aisle width still reaches all doors and fronts.
    fn still_connected(&self, claim: &Claim) -> bool {
        if claim.y[0] >= BODY_HEIGHT_M {
            return true;
        }
        let mut solids = self.solids.clone();
        solids.push(claim.rect);
        let goals: Vec<Rect> = self.goals.iter().copied().chain(claim.front).collect();
        connected(&self.room, &solids, &goals, AISLE_RADIUS_M)
    }
}

/// Required connected share of the free floor.
const WHOLE_FLOOR: f32 = 0.92;

/// Returns true if a disc with `radius_m` can move in `room` around `solids` between all `goals` and almost
/// everywhere else.
fn connected(room: &Rect, solids: &[Rect], goals: &[Rect], radius_m: f32) -> bool {
    let lattice = Lattice::over(room, 0, 1);
    // A room narrower than the body still has a centre line, so that it can be furnished at all.
    let walkable = room.inset(radius_m.min(room.size()[0] / 2.0 - 0.05).min(room.size()[1] / 2.0 - 0.05));
    let is_free = |cell: usize| {
        let place = lattice.center(cell);
        walkable.distance_m(place) == 0.0 && solids.iter().all(|solid| solid.distance_m(place) >= radius_m)
    };
    let free: Vec<bool> = (0..lattice.count()).map(is_free).collect();
    let inside = |cell: usize, zone: &Rect| free[cell] && zone.distance_m(lattice.center(cell)) == 0.0;
    let Some(first) = goals.first() else { return true };
    let mut reached = vec![false; free.len()];
    let mut open: Vec<usize> = (0..free.len()).find(|&cell| inside(cell, first)).into_iter().collect();
    while let Some(cell) = open.pop() {
        if free[cell] && !reached[cell] {
            reached[cell] = true;
            open.extend(lattice.neighbours(cell));
        }
    }
    let count = |cells: &[bool]| cells.iter().filter(|&&cell| cell).count() as f32;
    let whole = count(&reached) >= WHOLE_FLOOR * count(&free);
    whole && goals.iter().all(|goal| (0..free.len()).any(|cell| reached[cell] && inside(cell, goal)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room() -> Space {
        let mut space = Space::new(Rect::new([0.0, 4.0], [0.0, 3.0]));
        space.add_door(Side::North, [0.5, 1.4], 2.05);
        space.add_door(Side::South, [2.6, 3.5], 2.05);
        space
    }

    fn claim(x: [f32; 2], z: [f32; 2]) -> Claim {
        Claim { rect: Rect::new(x, z), y: [0.0, 1.0], front: None }
    }

    #[test]
    fn doorways_and_aisles_stay_free() {
        let space = room();
        assert!(!space.fits(&claim([1.0, 1.5], [0.5, 1.0])), "in front of the door");
        assert!(!space.fits(&claim([3.8, 4.3], [1.0, 1.5])), "through the wall");
        assert!(!space.fits(&claim([0.0, 3.6], [1.3, 1.7])), "leaves 0.4 m between the doors");
        assert!(space.fits(&claim([0.0, 3.3], [1.3, 1.7])), "leaves 0.7 m between the doors");
    }

    #[test]
    fn only_low_furniture_fits_below_windows() {
        let mut space = room();
        space.take_wall(Side::West, Patch { along: [1.0, 2.0], y: [0.9, 2.1] });
        let low = Claim { y: [0.0, 0.8], ..claim([0.0, 0.4], [1.2, 1.8]) };
        assert!(space.fits(&low));
        assert!(!space.fits(&Claim { y: [0.0, 1.4], ..low }));
        space.take(&low);
        assert!(!space.fits(&claim([0.2, 0.6], [1.6, 2.0])), "taken");
        assert!(!space.wall_is_free(Side::West, &Patch { along: [1.3, 1.5], y: [0.5, 0.7] }));
    }
}
