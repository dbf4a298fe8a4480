//! Sound paths from possible sources to the listener, through the known map.

use crate::geometry::{FloorPoint, floor};
use crate::map::occupancy::{Cell, Occupancy};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

pub(crate) const STEP_M: f32 = 0.25;
/// Cells per side: a square of 40 m around the start.
pub(crate) const SIDE: usize = 160;
/// Radius around the listener in which walls do not stop sound, metres: the listener may touch one.
const NEAR_M: f32 = 0.5;

/// A sound path from a possible source to the listener: around known walls, straight through the unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SoundRay {
    /// Apparent origin: the source, or the last corner on the path.
    pub from: FloorPoint,
    /// Length, metres.
    pub length_m: f32,
}

/// The sound paths from all cells around a listener.
pub struct SoundField {
    rays: Vec<Option<SoundRay>>,
    listener: FloorPoint,
}

#[derive(Clone, Copy)]
struct ReachedCell {
    ray: SoundRay,
    /// Last bend on the path from the listener, and the length up to it.
    bend: FloorPoint,
    bend_m: f32,
    /// Closed flag, and whether sound continues beyond the cell.
    done: bool,
    passes: bool,
}

impl SoundField {
    /// Computes the paths to all cells in `area` (corners) by Lazy Theta* (Nash et al. 2010).
    pub fn new(map: &Occupancy, listener: FloorPoint, area: [FloorPoint; 2]) -> Self {
        let mut reached: Vec<Option<ReachedCell>> = vec![None; SIDE * SIDE];
        let mut open = BinaryHeap::new();
        if let Some(start) = index(listener) {
            reached[start] = Some(ReachedCell::at_listener(listener));
            open.push((Reverse(0_u32), start));
        }
        while let Some((_, at)) = open.pop() {
            let Some(mut here) = reached[at].filter(|reached| !reached.done) else { continue };
            if !map.has_clear_line(here.bend, center(at)) {
                here = around_corner(&reached, listener, at, area).unwrap_or(here);
            }
            let passes = here.ray.length_m < NEAR_M || !is_wall(map, center(at));
            reached[at] = Some(ReachedCell { done: true, passes, ..here });
            if !passes {
                continue;
            }
            for next in neighbours(at, area) {
                let candidate = here.straight_on(listener, center(next));
                let known = reached[next];
                // The margin stops equal paths from reopening cells.
                if known.is_none_or(|k| !k.done && candidate.ray.length_m < k.ray.length_m - 1e-3) {
                    reached[next] = Some(candidate);
                    open.push((Reverse((candidate.ray.length_m * 1000.0) as u32), next));
                }
            }
        }
        Self { rays: reached.into_iter().map(|reached| reached.map(|r| r.ray)).collect(), listener }
    }

    /// Returns the listener's position.
    pub fn listener(&self) -> FloorPoint {
        self.listener
    }

    /// Returns the path from cell `index`; `None` outside the area.
    pub fn ray(&self, index: usize) -> Option<SoundRay> {
        self.rays.get(index).copied().flatten()
    }

    /// Returns true if the path from a cell is straight.
    pub fn is_straight(&self, index: usize) -> bool {
        self.ray(index).is_some_and(|ray| ray.from == center(index) || ray.from == self.listener)
    }
}

impl ReachedCell {
    fn at_listener(listener: FloorPoint) -> Self {
        let ray = SoundRay { from: listener, length_m: 0.0 };
        Self { ray, bend: listener, bend_m: 0.0, done: false, passes: true }
    }

    /// Extends the path straight from the last bend to `next`.
    fn straight_on(&self, listener: FloorPoint, next: FloorPoint) -> Self {
        let length_m = self.bend_m + self.bend.distance_m(next);
        let from = if self.bend == listener { next } else { self.ray.from };
        Self { ray: SoundRay { from, length_m }, done: false, ..*self }
    }

    /// Extends the path with a bend at `at`.
    fn bent(&self, listener: FloorPoint, at: FloorPoint, next: FloorPoint) -> Self {
        let from = if self.bend == listener { at } else { self.ray.from };
        let ray = SoundRay { from, length_m: self.ray.length_m + at.distance_m(next) };
        Self { ray, bend: at, bend_m: self.ray.length_m, ..*self }
    }
}

/// Returns the shortest path to cell `at` with a bend in a neighbouring cell.
fn around_corner(
    reached: &[Option<ReachedCell>],
    listener: FloorPoint,
    at: usize,
    area: [FloorPoint; 2],
) -> Option<ReachedCell> {
    let ways = neighbours(at, area).filter_map(|next| {
        let path = reached[next].filter(|path| path.done && path.passes)?;
        Some(path.bent(listener, center(next), center(at)))
    });
    ways.min_by(|a, b| a.ray.length_m.total_cmp(&b.ray.length_m))
}

fn is_wall(map: &Occupancy, place: FloorPoint) -> bool {
    map.is_wall(Cell::at(place))
}

pub(crate) fn center(index: usize) -> FloorPoint {
    let coordinate = |index: usize| (index as f32 + 0.5 - 0.5 * SIDE as f32) * STEP_M;
    FloorPoint::new(coordinate(index % SIDE), coordinate(index / SIDE))
}

fn index(place: FloorPoint) -> Option<usize> {
    let cell = |coordinate: f32| floor(coordinate / STEP_M + 0.5 * SIDE as f32);
    let (column, row) = (cell(place.x), cell(place.z));
    let inside = 0..SIDE as i32;
    (inside.contains(&column) && inside.contains(&row)).then(|| row as usize * SIDE + column as usize)
}

fn neighbours(at: usize, [low, high]: [FloorPoint; 2]) -> impl Iterator<Item = usize> {
    let (column, row) = ((at % SIDE) as i32, (at / SIDE) as i32);
    let around = (-1..=1).flat_map(move |dr| (-1..=1).map(move |dc| (column + dc, row + dr)));
    let side = 0..SIDE as i32;
    around
        .filter(move |(c, r)| side.contains(c) && side.contains(r))
        .map(|(c, r)| r as usize * SIDE + c as usize)
        .filter(move |&next| {
            let FloorPoint { x, z } = center(next);
            next != at && (low.x..=high.x).contains(&x) && (low.z..=high.z).contains(&z)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: [FloorPoint; 2] = [FloorPoint { x: -5.0, z: -5.0 }, FloorPoint { x: 5.0, z: 5.0 }];

    #[test]
    fn sound_is_straight_in_the_open() {
        let field = SoundField::new(&Occupancy::default(), FloorPoint::new(0.0, 0.0), AREA);
        let at = index(FloorPoint::new(3.1, -2.1)).unwrap();
        let ray = field.ray(at).unwrap();
        assert!(ray.from == center(at) && field.is_straight(at));
        assert!((ray.length_m - center(at).distance_m(FloorPoint::default())).abs() < 0.05);
        assert_eq!(field.ray(index(FloorPoint::new(7.0, 0.0)).unwrap()), None);
    }

    #[test]
    fn sound_bends_around_corners() {
        let map = Occupancy::default().with_wall(FloorPoint::new(-1.0, -1.1), FloorPoint::new(4.9, -0.9));
        let field = SoundField::new(&map, FloorPoint::new(0.0, 0.0), AREA);
        let at = index(FloorPoint::new(0.1, -2.1)).unwrap();
        let ray = field.ray(at).unwrap();
        assert!(ray.from.distance_m(FloorPoint::new(-1.1, -1.0)) < 0.6, "{ray:?}");
        // By hand: √(1.1² + 1) to the corner and as much from there to (0.1, -2.1).
        assert!((ray.length_m - 3.1).abs() < 0.4 && !field.is_straight(at), "{ray:?}");
    }

    #[test]
    fn short_detours_are_not_straight() {
        let map = Occupancy::default().with_wall(FloorPoint::new(0.0, -2.1), FloorPoint::new(4.9, -1.9));
        let field = SoundField::new(&map, FloorPoint::new(0.0, 0.0), AREA);
        let [shadow, sight] =
            [FloorPoint::new(0.4, -4.9), FloorPoint::new(-0.6, -4.9)].map(|place| index(place).unwrap());
        let detour_m = field.ray(shadow).unwrap().length_m - center(shadow).distance_m(FloorPoint::default());
        assert!(detour_m < 0.15, "{detour_m}");
        assert!(field.is_straight(sight) && !field.is_straight(shadow));
    }
}
