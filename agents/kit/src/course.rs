use crate::map::Occupancy;
use crate::path::{Path, path};
use crate::perception::Place;

/// Steps for which it keeps to where a way ends.
const KEPT_STEPS: u32 = 40;
/// Goals this near to each other are the same, metres.
const SAME_M: f32 = 0.5;
/// Within this distance of its end a way has been gone, metres.
const GONE_M: f32 = 0.3;

/// Keeps to a way. Where a goal cannot be reached the way to it ends somewhere near, and after the next picture somewhere else:
/// a body that follows the best way of every step walks to and fro between the two.
#[derive(Clone, Debug, Default)]
pub struct Course {
    to: Place,
    end: Place,
    steps_left: u32,
}

impl Course {
    /// A way from `from` to within `reach_m` of `to` that ends where the last one did, as long as it leads there, is not gone to
    /// its end and not old.
    pub fn way(&mut self, map: &Occupancy, from: Place, to: Place, reach_m: f32) -> Path {
        let goes_on = self.steps_left > 0
            && self.to.distance_m(to) <= SAME_M
            && self.end.distance_m(to) > reach_m
            && self.end.distance_m(from) > GONE_M;
        if goes_on {
            self.steps_left -= 1;
            let way = path(map, from, self.end, GONE_M);
            if way.left_m <= GONE_M {
                return Path { left_m: self.end.distance_m(to), ..way };
            }
        }
        let way = path(map, from, to, reach_m);
        let end = way.places.last().copied().unwrap_or(from);
        *self = Self { to, end, steps_left: KEPT_STEPS };
        way
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A room whose north wall has a niche on each side, of which a goal beyond the wall is about as far.
    fn room() -> Occupancy {
        Occupancy::default()
            .with_floor(Place::new(-3.0, -3.0), Place::new(3.0, 3.0))
            .with_wall(Place::new(-3.0, -3.1), Place::new(3.0, -3.0))
            .with_wall(Place::new(-0.5, -3.0), Place::new(0.5, -1.0))
            .with_wall(Place::new(-9.0, -9.0), Place::new(9.0, -3.0))
    }

    #[test]
    fn it_keeps_to_an_end_until_it_is_there() {
        let (map, mut course) = (room(), Course::default());
        let to = Place::new(0.05, -4.0);
        let first = course.way(&map, Place::new(1.0, 0.0), to, 0.5);
        let end = *first.places.last().unwrap();
        assert!(first.left_m > 0.9 && end.x > 0.5, "{end:?}");
        // The goal is believed a little farther to the left now, but the way still leads to the right.
        let there = Place::new(-0.2, -4.0);
        let other = path(&map, Place::new(0.8, 0.0), there, 0.5);
        assert!(other.places.last().unwrap().x < -0.5, "{:?}", other.places.last());
        let kept = course.way(&map, Place::new(0.8, 0.0), there, 0.5);
        assert!(kept.places.last().unwrap().distance_m(end) <= GONE_M);
        assert!((kept.left_m - end.distance_m(there)).abs() < 1e-6);
        // At its end it looks for another.
        let next = course.way(&map, end, there, 0.5);
        assert!(next.places.last().unwrap().x < -0.5);
    }

    #[test]
    fn other_goals_have_other_ways() {
        let (map, mut course) = (room(), Course::default());
        course.way(&map, Place::new(1.0, 0.0), Place::new(0.05, -4.0), 0.5);
        let back = course.way(&map, Place::new(1.0, 0.0), Place::new(-2.0, 2.0), 0.2);
        assert!(back.left_m <= 0.2);
    }
}
