//! Rooms: the room memory, and common-sense priors of a category's rooms and neighbours.

use crate::geometry::FloorPoint;
use crate::map::objects::{ObjectHypothesis, ObjectMemory};
use crate::map::occupancy::Occupancy;
use crate::perception::WIDER;
use crate::perception::category::CATEGORIES;
use crate::perception::cue::Query;
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

/// Room types of the room memory.
pub const ROOMS: [&str; 10] = [
    "bathroom",
    "bedroom",
    "kitchen",
    "living room",
    "dining room",
    "office",
    "gym",
    "hallway",
    "laundry room",
    "closet",
];
/// Other words for room types.
const ROOM_WORDS: [(&str, &str); 2] = [("corridor", "hallway"), ("study", "office")];

/// Percentage of rooms of a type (column) with at least one object of a category (row): common sense, written by hand, as the
/// language model's room-object associations in SG-Nav (Yin et al. 2024).
const IN_ROOM: [[u8; ROOMS.len()]; CATEGORIES.len()] = [
    [5, 45, 45, 60, 95, 95, 10, 15, 5, 5],
    [5, 45, 50, 90, 95, 95, 5, 25, 10, 5],
    [25, 70, 25, 80, 70, 65, 20, 65, 5, 5],
    [60, 45, 90, 50, 45, 60, 15, 25, 60, 40],
    [2, 80, 3, 90, 10, 15, 2, 5, 2, 5],
    [1, 20, 3, 95, 5, 20, 2, 5, 1, 1],
    [1, 97, 1, 4, 1, 5, 2, 1, 1, 1],
    [10, 80, 10, 25, 15, 25, 2, 15, 10, 40],
    [20, 35, 30, 65, 50, 45, 15, 30, 5, 2],
    [95, 2, 90, 2, 2, 2, 5, 1, 60, 1],
    [95, 1, 1, 1, 1, 1, 2, 1, 2, 1],
    [15, 20, 50, 25, 20, 15, 15, 5, 10, 5],
    [90, 10, 30, 1, 1, 1, 30, 1, 40, 15],
    [1, 40, 10, 85, 10, 70, 40, 1, 1, 1],
    [75, 1, 1, 1, 1, 1, 10, 1, 2, 1],
    [65, 2, 1, 1, 1, 1, 2, 1, 1, 1],
    [35, 3, 95, 10, 15, 5, 2, 2, 40, 1],
    [1, 10, 3, 55, 20, 10, 1, 2, 1, 1],
    [1, 8, 1, 5, 1, 5, 95, 1, 2, 1],
    [5, 30, 15, 50, 25, 25, 25, 40, 5, 5],
    [15, 50, 3, 5, 2, 3, 10, 15, 50, 90],
    [5, 2, 95, 5, 5, 5, 2, 1, 90, 2],
    [80, 45, 2, 20, 10, 5, 50, 30, 5, 20],
    [20, 30, 35, 55, 25, 75, 15, 15, 40, 60],
];

/// Percentage of objects of one category with the other close by; pairs without an entry have [`RARE`].
const NEIGHBOURS: [(&str, &str, u8); 49] = [
    ("chair", "table", 90),
    ("chair", "sofa", 40),
    ("chair", "cushion", 40),
    ("chair", "plant", 30),
    ("chair", "cabinet", 30),
    ("chair", "picture", 20),
    ("table", "sofa", 70),
    ("table", "tv_monitor", 50),
    ("table", "plant", 40),
    ("table", "stool", 40),
    ("table", "seating", 40),
    ("table", "picture", 30),
    ("table", "shelving", 30),
    ("picture", "sofa", 50),
    ("picture", "fireplace", 50),
    ("picture", "bed", 45),
    ("picture", "chest_of_drawers", 30),
    ("cushion", "sofa", 90),
    ("cushion", "bed", 85),
    ("cushion", "seating", 60),
    ("sofa", "tv_monitor", 80),
    ("sofa", "fireplace", 50),
    ("sofa", "plant", 40),
    ("bed", "chest_of_drawers", 80),
    ("bed", "clothes", 40),
    ("bed", "tv_monitor", 30),
    ("chest_of_drawers", "mirror", 50),
    ("chest_of_drawers", "clothes", 50),
    ("sink", "toilet", 85),
    ("sink", "counter", 85),
    ("sink", "towel", 80),
    ("sink", "mirror", 80),
    ("sink", "cabinet", 70),
    ("sink", "shower", 60),
    ("sink", "bathtub", 60),
    ("sink", "appliances", 60),
    ("toilet", "towel", 70),
    ("toilet", "shower", 70),
    ("toilet", "bathtub", 65),
    ("towel", "shower", 80),
    ("towel", "bathtub", 80),
    ("towel", "gym_equipment", 30),
    ("shower", "bathtub", 60),
    ("stool", "counter", 70),
    ("counter", "cabinet", 80),
    ("counter", "appliances", 90),
    ("cabinet", "appliances", 70),
    ("tv_monitor", "cabinet", 60),
    ("clothes", "cabinet", 40),
];
const ALIKE: u8 = 40;
const RARE: u8 = 5;
/// Prior without evidence.
pub const NEUTRAL: f32 = 0.3;
/// Radius of the observed object context N_obj, metres.
const NEAR_M: f32 = 2.0;

fn percent(value: u8) -> f32 {
    f32::from(value) / 100.0
}

/// Returns a category's index in the tables; everyday words have the index of their wider category.
fn category_index(name: &str) -> Option<usize> {
    let wide = WIDER.iter().find(|(narrow, _)| *narrow == name).map_or(name, |(_, wide)| wide);
    CATEGORIES.iter().position(|category| *category == wide)
}

fn room_index(name: &str) -> Option<usize> {
    let usual = ROOM_WORDS.iter().find(|(word, _)| *word == name).map_or(name, |(_, usual)| usual);
    ROOMS.iter().position(|room| *room == usual)
}

/// Returns the probability of a category in a room of a type.
fn in_room(category: usize, room: usize) -> f32 {
    percent(IN_ROOM[category][room])
}

/// Returns the probability of one category close to another.
fn neighbours(one: usize, other: usize) -> f32 {
    if one == other {
        return percent(ALIKE);
    }
    let (one, other) = (CATEGORIES[one], CATEGORIES[other]);
    let is_pair = |a: &str, b: &str| (a, b) == (one, other) || (b, a) == (one, other);
    percent(NEIGHBOURS.iter().find(|(a, b, _)| is_pair(a, b)).map_or(RARE, |&(_, _, share)| share))
}

/// A goal as input of the priors: its category, and the room and neighbour that the cue names.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GoalPrior {
    category: Option<usize>,
    room: Option<usize>,
    near: Option<usize>,
    /// Row of the table of neighbours.
    neighbours: Vec<f32>,
}

impl GoalPrior {
    /// Creates the input for a cue; `seen` is the predicted category of an image.
    pub fn new(query: &Query, seen: Option<&str>) -> Self {
        let (category, room, near) = match query {
            Query::Words(words) => {
                (Some(words.category.as_str()), words.room.as_deref(), words.near.as_deref())
            }
            Query::Picture { .. } => (seen, None, None),
        };
        let category = category.and_then(category_index);
        let row = |goal: usize| (0..CATEGORIES.len()).map(|other| neighbours(goal, other)).collect();
        Self {
            category,
            room: room.and_then(room_index),
            near: near.and_then(category_index),
            neighbours: category.map_or_else(Vec::new, row),
        }
    }

    /// Returns P_room(g | r): the probability of the room that the cue names, otherwise of the category in such a room.
    pub fn room(&self, mix: &RoomMix) -> f32 {
        match (self.room, self.category) {
            (Some(room), _) => mix.probability(room),
            (None, Some(category)) => mix.expectation(|room| in_room(category, room)),
            (None, None) => NEUTRAL,
        }
    }

    /// Returns P_obj(g | N_obj): the best support by an object within 2 m, without the object `skipped`.
    pub fn objects(&self, objects: &ObjectMemory, place: FloorPoint, skipped: Option<usize>) -> f32 {
        let all = objects.all().iter().enumerate();
        let near = all.filter(|(index, object)| {
            Some(*index) != skipped && object.detection.distance_m(place) <= NEAR_M
        });
        let supports = near.map(|(_, object)| match self.near {
            Some(wanted) => object.category(wanted),
            None => {
                let pairs = self.neighbours.iter().enumerate();
                pairs.map(|(other, share)| share * object.category(other)).fold(0.0, f32::max)
            }
        });
        let is_known = self.near.is_some() || self.category.is_some();
        supports.reduce(f32::max).filter(|_| is_known).unwrap_or(NEUTRAL)
    }

    /// Returns P_ctx(g | o, R, O) of the object `index`: the mean of the priors by room and by neighbouring objects.
    pub fn context(&self, objects: &ObjectMemory, index: usize, mix: &RoomMix) -> f32 {
        let Some(object) = objects.all().get(index) else { return NEUTRAL };
        0.5 * self.room(mix) + 0.5 * self.objects(objects, object.detection.center(), Some(index))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose2d;
    use crate::map::objects::ObjectMemory;
    use crate::perception::objects::DetectedObject;
    use avln_client::GoalCue;

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

    fn prior(sentence: &str) -> GoalPrior {
        GoalPrior::new(&Query::new(&GoalCue::Description(sentence.into())), None)
    }

    fn object(category: &str, x: f32) -> DetectedObject {
        DetectedObject {
            min: FloorPoint::new(x, 0.0),
            max: FloorPoint::new(x + 0.5, 0.5),
            high_m: 0.8,
            kinds: vec![(category.to_owned(), 1.0)],
            views: 1,
            ..DetectedObject::default()
        }
    }

    #[test]
    fn every_category_has_a_typical_room() {
        for (category, row) in CATEGORIES.iter().zip(&IN_ROOM) {
            assert!(
                row.iter().any(|&share| share >= 40) && row.iter().all(|&share| share <= 97),
                "{category}"
            );
        }
        for (one, other, _) in NEIGHBOURS {
            assert!(category_index(one).is_some() && category_index(other).is_some(), "{one} {other}");
        }
        let others = WIDER.iter().map(|(_, wide)| *wide).filter(|wide| !CATEGORIES.contains(wide));
        assert!(others.eq(["lighting"; 2]), "lamps have no row in the tables");
    }

    #[test]
    fn neighbours_support_a_goal() {
        let mut objects = ObjectMemory::new(1);
        objects.recognise(&Pose2d::default(), vec![object("sofa", 0.0), object("toilet", 9.0)], |_, _| 0.0);
        let support =
            |sentence: &str, x: f32| prior(sentence).objects(&objects, FloorPoint::new(x, 0.0), None);
        assert!((support("the cushion", 0.5) - 0.9).abs() < 1e-6);
        assert!((support("the cushion", 9.0) - 0.05).abs() < 1e-6);
        assert_eq!(support("the cushion", 5.0), NEUTRAL);
        assert_eq!((support("the lamp near a sofa", 0.5), support("the lamp near a sofa", 9.0)), (1.0, 0.0));
        assert_eq!(prior("the cushion").objects(&objects, FloorPoint::new(0.5, 0.0), Some(0)), NEUTRAL);
    }

    #[test]
    fn images_use_the_predicted_category() {
        let cue = GoalCue::Image(avln_client::Image { width: 2, height: 2, pixels: vec![9; 12] });
        let [known, unknown] = [Some("bed"), None].map(|seen| GoalPrior::new(&Query::new(&cue), seen));
        assert_eq!((known, unknown.room(&RoomMix::default())), (prior("the bed"), NEUTRAL));
        assert_eq!(prior("the desk"), prior("the table"));
    }

    #[test]
    fn stated_rooms_replace_the_table() {
        let office = room_index("study").unwrap();
        let sure = RoomMix::certain(office);
        assert_eq!(prior("the bed in the study").room(&sure), 1.0);
        assert!(prior("the bed").room(&sure) < 0.1 && prior("the chair").room(&sure) > 0.9);
    }
}
