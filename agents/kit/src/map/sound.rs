use crate::map::{Cell, Occupancy};
use crate::perception::Place;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Side of a cell of places where a source may be, metres.
pub(super) const STEP_M: f32 = 0.25;
/// Cells a side: a square of 40 m around the start.
pub(super) const SIDE: usize = 160;
/// Nearer than this nothing shuts the listener in, metres.
const NEAR_M: f32 = 0.5;

/// How sound of a source at some place would reach the listener: around the walls that are known, straight through what
/// is unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it comes from: the source itself or the corner that it bends around last.
    pub from: Place,
    /// Length of its way, metres.
    pub length_m: f32,
}

/// The rays of all places around a listener.
pub struct SoundField {
    rays: Vec<Option<Ray>>,
    listener: Place,
}

/// A place that sound has reached in the search.
#[derive(Clone, Copy)]
struct Reached {
    ray: Ray,
    /// The last bend of the way from the listener, and the length up to it.
    bend: Place,
    bend_m: f32,
    /// Whether the way is final, and whether sound goes on from here.
    done: bool,
    passes: bool,
}

impl SoundField {
    /// Spreads from `listener` over the cells in `area` (corners of a rectangle): a search whose lines of sight are
    /// looked at when a cell is opened (Nash et al. 2010, Lazy Theta*).
    pub fn new(map: &Occupancy, listener: Place, area: [Place; 2]) -> Self {
        let mut reached: Vec<Option<Reached>> = vec![None; SIDE * SIDE];
        let mut open = BinaryHeap::new();
        if let Some(start) = index(listener) {
            reached[start] = Some(Reached::at_listener(listener));
            open.push((Reverse(0_u32), start));
        }
        while let Some((_, at)) = open.pop() {
            let Some(mut here) = reached[at].filter(|reached| !reached.done) else { continue };
            if !map.hears(here.bend, center(at)) {
                here = around_corner(&reached, listener, at, area).unwrap_or(here);
            }
            let passes = here.ray.length_m < NEAR_M || !is_wall(map, center(at));
            reached[at] = Some(Reached { done: true, passes, ..here });
            if !passes {
                continue;
            }
            for next in neighbours(at, area) {
                let candidate = here.straight_on(listener, center(next));
                let known = reached[next];
                if known.is_none_or(|k| !k.done && candidate.ray.length_m < k.ray.length_m - 1e-3) {
                    reached[next] = Some(candidate);
                    open.push((Reverse((candidate.ray.length_m * 1000.0) as u32), next));
                }
            }
        }
        Self { rays: reached.into_iter().map(|reached| reached.map(|r| r.ray)).collect(), listener }
    }

    /// Where the listener stood.
    pub fn listener(&self) -> Place {
        self.listener
    }

    /// How a source in cell `index` would be heard; `None` outside of the area.
    pub fn ray(&self, index: usize) -> Option<Ray> {
        self.rays.get(index).copied().flatten()
    }

    /// Whether a ray comes straight from its source, not around a corner.
    pub fn is_straight(&self, index: usize) -> bool {
        self.ray(index).is_some_and(|ray| ray.from == center(index) || ray.from == self.listener)
    }
}

impl Reached {
    fn at_listener(listener: Place) -> Self {
        let ray = Ray { from: listener, length_m: 0.0 };
        Self { ray, bend: listener, bend_m: 0.0, done: false, passes: true }
    }

    /// The same way going on straight from its last bend to `next`.
    fn straight_on(&self, listener: Place, next: Place) -> Self {
        let length_m = self.bend_m + self.bend.distance_m(next);
        let from = if self.bend == listener { next } else { self.ray.from };
        Self { ray: Ray { from, length_m }, done: false, ..*self }
    }

    /// The same way bending at its end `at` and going on to `next`.
    fn bent(&self, listener: Place, at: Place, next: Place) -> Self {
        let from = if self.bend == listener { at } else { self.ray.from };
        let ray = Ray { from, length_m: self.ray.length_m + at.distance_m(next) };
        Self { ray, bend: at, bend_m: self.ray.length_m, ..*self }
    }
}

/// The shortest way to cell `at` that bends in one of its neighbours.
fn around_corner(
    reached: &[Option<Reached>],
    listener: Place,
    at: usize,
    area: [Place; 2],
) -> Option<Reached> {
    let ways = neighbours(at, area).filter_map(|next| {
        let way = reached[next].filter(|way| way.done && way.passes)?;
        Some(way.bent(listener, center(next), center(at)))
    });
    ways.min_by(|a, b| a.ray.length_m.total_cmp(&b.ray.length_m))
}

fn is_wall(map: &Occupancy, place: Place) -> bool {
    map.is_wall(Cell::at(place))
}

/// Middle of cell `index`.
pub(super) fn center(index: usize) -> Place {
    let coordinate = |index: usize| (index as f32 + 0.5 - 0.5 * SIDE as f32) * STEP_M;
    Place::new(coordinate(index % SIDE), coordinate(index / SIDE))
}

fn index(place: Place) -> Option<usize> {
    let cell = |coordinate: f32| (coordinate / STEP_M + 0.5 * SIDE as f32).floor();
    let (column, row) = (cell(place.x), cell(place.z));
    let inside = 0.0..SIDE as f32;
    (inside.contains(&column) && inside.contains(&row)).then(|| row as usize * SIDE + column as usize)
}

fn neighbours(at: usize, [low, high]: [Place; 2]) -> impl Iterator<Item = usize> {
    let (column, row) = ((at % SIDE) as i32, (at / SIDE) as i32);
    let around = (-1..=1).flat_map(move |dr| (-1..=1).map(move |dc| (column + dc, row + dr)));
    let side = 0..SIDE as i32;
    around
        .filter(move |(c, r)| side.contains(c) && side.contains(r))
        .map(|(c, r)| r as usize * SIDE + c as usize)
        .filter(move |&next| {
            let Place { x, z } = center(next);
            next != at && (low.x..=high.x).contains(&x) && (low.z..=high.z).contains(&z)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: [Place; 2] = [Place { x: -5.0, z: -5.0 }, Place { x: 5.0, z: 5.0 }];

    #[test]
    fn in_the_open_sound_comes_straight() {
        let field = SoundField::new(&Occupancy::default(), Place::new(0.0, 0.0), AREA);
        let at = index(Place::new(3.1, -2.1)).unwrap();
        let ray = field.ray(at).unwrap();
        assert!(ray.from == center(at) && field.is_straight(at));
        assert!((ray.length_m - center(at).distance_m(Place::default())).abs() < 0.05);
        assert_eq!(field.ray(index(Place::new(7.0, 0.0)).unwrap()), None);
    }

    #[test]
    fn behind_a_wall_it_comes_from_the_corner_and_is_longer() {
        let map = Occupancy::default().with_wall(Place::new(-1.0, -1.1), Place::new(4.9, -0.9));
        let field = SoundField::new(&map, Place::new(0.0, 0.0), AREA);
        let at = index(Place::new(0.1, -2.1)).unwrap();
        let ray = field.ray(at).unwrap();
        assert!(ray.from.distance_m(Place::new(-1.1, -1.0)) < 0.6, "{ray:?}");
        // By hand: √(1.1² + 1) to the corner and as much from there to (0.1, -2.1).
        assert!((ray.length_m - 3.1).abs() < 0.4 && !field.is_straight(at), "{ray:?}");
    }

    #[test]
    fn around_an_edge_it_does_not_come_straight_however_short_the_detour_is() {
        let map = Occupancy::default().with_wall(Place::new(0.0, -2.1), Place::new(4.9, -1.9));
        let field = SoundField::new(&map, Place::new(0.0, 0.0), AREA);
        let [shadow, sight] =
            [Place::new(0.4, -4.9), Place::new(-0.6, -4.9)].map(|place| index(place).unwrap());
        let detour_m = field.ray(shadow).unwrap().length_m - center(shadow).distance_m(Place::default());
        assert!(detour_m < 0.15, "{detour_m}");
        assert!(field.is_straight(sight) && !field.is_straight(shadow));
    }
}
