//! Room memory: room-type probabilities over the floor plan.

use crate::geometry::FloorPoint;
use crate::map::objects::ObjectHypothesis;
use crate::map::occupancy::Occupancy;
use crate::map::priors::{CATEGORIES, ROOMS, in_room};
use std::array;
use std::collections::BTreeMap;

/// Cell side, metres.
const CELL_M: f32 = 0.5;
/// Radius around an object in which it is evidence, metres.
const REACH_M: f32 = 1.5;
/// Radius of the mean around a position, metres.
const AROUND_M: f32 = 2.0;
/// Weight of the cue of one view: views of an object are correlated.
const WEIGHT: f32 = 0.3;
/// Limit of the log-evidence.
const MOST: f32 = 5.0;

/// The paper's room memory R_t for one storey: log-evidence of every room type by cell.
#[derive(Clone, Debug, Default)]
pub struct RoomMemory {
    cells: BTreeMap<(i32, i32), [f32; ROOMS.len()]>,
}

/// A distribution over room types.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomMix([f32; ROOMS.len()]);

impl Default for RoomMix {
    /// Returns the uniform distribution.
    fn default() -> Self {
        Self([1.0 / ROOMS.len() as f32; ROOMS.len()])
    }
}

impl RoomMix {
    /// Returns the probability of a room type.
    pub fn probability(&self, room: usize) -> f32 {
        self.0[room]
    }

    /// Returns the mean of a value by room type.
    pub fn expectation(&self, value: impl Fn(usize) -> f32) -> f32 {
        self.0.iter().enumerate().map(|(room, share)| share * value(room)).sum()
    }

    #[cfg(test)]
    pub(crate) fn certain(room: usize) -> Self {
        Self(array::from_fn(|other| if other == room { 1.0 } else { 0.0 }))
    }
}

impl RoomMemory {
    /// Adds the room cue of a frame (Psi_room of the paper): the evidence of the objects in view for the cells around them.
    pub fn see<'a>(&mut self, map: &Occupancy, seen: impl Iterator<Item = &'a ObjectHypothesis>) {
        for object in seen {
            let cue = cue(object);
            let middle = object.detection.center();
            for (cell, place) in cells_within(middle, REACH_M) {
                // The object's end is exempt: it may be fixed to a wall.
                if map.has_clear_line(place, middle) {
                    let evidence = self.cells.entry(cell).or_default();
                    for (sum, more) in evidence.iter_mut().zip(&cue) {
                        *sum = (*sum + WEIGHT * more).clamp(-MOST, MOST);
                    }
                }
            }
        }
    }

    /// Returns r(x): the mean distribution over the known cells within 2 m without a wall between; uniform if none is known.
    pub fn around(&self, map: &Occupancy, place: FloorPoint) -> RoomMix {
        let (mut sum, mut count) = ([0.0; ROOMS.len()], 0.0);
        for (cell, center) in cells_within(place, AROUND_M) {
            let Some(evidence) = self.cells.get(&cell) else { continue };
            if map.has_clear_line(center, place) {
                let shares = softmax(evidence);
                sum.iter_mut().zip(shares).for_each(|(sum, share)| *sum += share);
                count += 1.0;
            }
        }
        if count == 0.0 { RoomMix::default() } else { RoomMix(sum.map(|share| share / count)) }
    }
}

/// Returns an object's log-likelihood by room type, with mean 0.
fn cue(object: &ObjectHypothesis) -> [f32; ROOMS.len()] {
    let known: f32 = (0..CATEGORIES.len()).map(|category| object.category(category)).sum();
    let logs: [f32; ROOMS.len()] = array::from_fn(|room| {
        let of = |category: usize| object.category(category) * in_room(category, room);
        let likelihood: f32 = (0..CATEGORIES.len()).map(of).sum();
        // Other categories are equally frequent everywhere.
        libm::logf(likelihood + 0.3 * (1.0 - known).max(0.0) + 0.01)
    });
    let mean = logs.iter().sum::<f32>() / ROOMS.len() as f32;
    logs.map(|log| log - mean)
}

fn softmax(evidence: &[f32; ROOMS.len()]) -> [f32; ROOMS.len()] {
    let shares = evidence.map(libm::expf);
    let sum: f32 = shares.iter().sum();
    shares.map(|share| share / sum)
}

/// Returns the cells with a centre within `reach_m` metres, and their centres.
fn cells_within(place: FloorPoint, reach_m: f32) -> impl Iterator<Item = ((i32, i32), FloorPoint)> {
    let index = |coordinate: f32| (coordinate / CELL_M).floor() as i32;
    let (columns, rows) = (
        index(place.x - reach_m)..=index(place.x + reach_m),
        index(place.z - reach_m)..=index(place.z + reach_m),
    );
    let center = |(column, row): (i32, i32)| {
        FloorPoint::new((column as f32 + 0.5) * CELL_M, (row as f32 + 0.5) * CELL_M)
    };
    let all = columns.flat_map(move |column| rows.clone().map(move |row| (column, row)));
    all.map(move |cell| (cell, center(cell))).filter(move |(_, center)| center.distance_m(place) <= reach_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2d;
    use crate::map::objects::ObjectMemory;
    use crate::perception::objects::DetectedObject;

    fn memory_with(kinds: &[(&str, f32)], map: &Occupancy) -> RoomMemory {
        let mut objects = ObjectMemory::new(0);
        let detection = DetectedObject {
            max: FloorPoint::new(0.5, 0.5),
            high_m: 0.8,
            kinds: kinds.iter().map(|(kind, share)| ((*kind).to_owned(), *share)).collect(),
            views: 1,
            ..DetectedObject::default()
        };
        objects.recognise(&Pose2d::default(), vec![detection], |_, _| 0.0);
        let mut rooms = RoomMemory::default();
        (0..4).for_each(|_| rooms.see(map, objects.all().iter()));
        rooms
    }

    fn probability(rooms: &RoomMemory, map: &Occupancy, place: FloorPoint, room: &str) -> f32 {
        let index = ROOMS.iter().position(|name| *name == room).unwrap();
        rooms.around(map, place).probability(index)
    }

    #[test]
    fn typical_objects_identify_their_room() {
        let map = Occupancy::default();
        let rooms = memory_with(&[("toilet", 0.9), ("chair", 0.1)], &map);
        let here = FloorPoint::new(0.2, 0.2);
        assert!(probability(&rooms, &map, here, "bathroom") > 0.7);
        assert!(probability(&rooms, &map, here, "bedroom") < 0.1);
        let all: f32 = (0..ROOMS.len()).map(|room| rooms.around(&map, here).probability(room)).sum();
        assert!((all - 1.0).abs() < 1e-5);
    }

    #[test]
    fn unseen_floor_is_uniform() {
        let map = Occupancy::default();
        let rooms = memory_with(&[("toilet", 1.0)], &map);
        assert_eq!(rooms.around(&map, FloorPoint::new(9.0, 0.0)), RoomMix::default());
    }

    #[test]
    fn walls_separate_rooms() {
        let map = Occupancy::default().with_wall(FloorPoint::new(0.8, -5.0), FloorPoint::new(0.9, 5.0));
        let rooms = memory_with(&[("toilet", 1.0)], &map);
        assert_eq!(rooms.around(&map, FloorPoint::new(1.4, 0.2)), RoomMix::default());
        assert!(probability(&rooms, &map, FloorPoint::new(0.2, 0.2), "bathroom") > 0.7);
    }
}
