//! Object memory: hypotheses from detections over time, and their surroundings.

use crate::geometry::{FloorPoint, Pose2d};
use crate::map::occupancy::Occupancy;
use crate::perception::category::likeness;
use crate::perception::cue::{CueWords, Query};
use crate::perception::objects::DetectedObject;

const MOST: usize = 400;
/// Radius for nearby objects, and a room's radius, metres.
const NEAR_M: f32 = 1.2;
const ROOM_M: f32 = 3.0;
/// Assumed height for objects without a detection, metres.
const SUPPOSED_M: f32 = 1.0;
/// Context for goals without surroundings in their cue.
const NEUTRAL: f32 = 0.5;
/// Typical objects by room.
const ROOMS: [(&str, &[&str]); 7] = [
    ("bathroom", &["toilet", "bathtub", "shower", "towel"]),
    ("bedroom", &["bed", "chest_of_drawers", "clothes"]),
    ("kitchen", &["counter", "stool"]),
    ("living room", &["sofa", "tv_monitor", "fireplace"]),
    ("dining room", &["table", "chair"]),
    ("office", &["table", "chair", "cabinet"]),
    ("gym", &["gym_equipment"]),
];

/// The paper's object memory O_t: object hypotheses merged over images, and their compatibility with the goals.
#[derive(Clone, Debug, Default)]
pub struct ObjectMemory {
    all: Vec<ObjectHypothesis>,
    goals: usize,
}

/// An object hypothesis.
#[derive(Clone, Debug)]
pub struct ObjectHypothesis {
    /// Position, extent and appearance.
    pub detection: DetectedObject,
    /// Near views.
    pub looks: u32,
    /// Unsuccessful Submits at the hypothesis.
    pub wrong_submits: i32,
    /// Visual compatibility by goal over all views, 0 to 1 (s_vis in the paper).
    vis: Vec<f32>,
}

impl ObjectMemory {
    /// Creates a memory for `goals` goals.
    pub fn new(goals: usize) -> Self {
        Self { all: Vec::new(), goals }
    }

    /// Adds an image's detections.
    pub fn see(&mut self, seen: Vec<DetectedObject>) {
        for detection in seen {
            // The first match wins: indices stay stable, which Submits and traces refer to.
            match self.all.iter_mut().find(|known| known.detection.is_same(&detection)) {
                Some(known) => known.detection.merge(&detection),
                None => self.add(detection),
            }
        }
    }

    fn add(&mut self, detection: DetectedObject) {
        if self.all.len() < MOST {
            let vis = vec![0.0; self.goals];
            self.all.push(ObjectHypothesis { detection, looks: 0, wrong_submits: 0, vis });
        }
    }

    /// Adds a hypothesis without a detection, for an object that blends into the surroundings.
    pub fn suppose(&mut self, place: FloorPoint) {
        self.add(DetectedObject { min: place, max: place, high_m: SUPPOSED_M, ..DetectedObject::default() });
    }

    /// Returns all hypotheses. Indices are stable within an episode.
    pub fn all(&self) -> &[ObjectHypothesis] {
        &self.all
    }

    /// Compares every object in view within `reach_m` metres with the goals; returns the objects' indices.
    pub fn look(
        &mut self,
        map: &Occupancy,
        pose: &Pose2d,
        reach_m: f32,
        fit: impl Fn(&DetectedObject, usize) -> f32,
    ) -> Vec<usize> {
        let mut in_view = Vec::new();
        for (index, object) in self.all.iter_mut().enumerate() {
            if map.is_in_view(pose, object.detection.center(), reach_m) {
                let fits: Vec<f32> = (0..self.goals).map(|goal| fit(&object.detection, goal)).collect();
                object.look(&fits);
                in_view.push(index);
            }
        }
        in_view
    }

    /// Returns all hypotheses for updates.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = &mut ObjectHypothesis> {
        self.all.iter_mut()
    }

    /// Records an unsuccessful Submit at a hypothesis, and resets the views.
    pub fn refute(&mut self, index: usize) {
        if let Some(object) = self.all.get_mut(index) {
            object.wrong_submits += 1;
            object.looks = 0;
        }
    }

    /// Returns the support from room and surroundings for a goal, 0 to 1 (P_room, P_obj and P_ctx in the paper).
    pub fn context(&self, place: FloorPoint, query: &Query) -> f32 {
        match query {
            Query::Words(words) => self.expects(place, words),
            Query::Picture { .. } => NEUTRAL,
        }
    }

    fn expects(&self, place: FloorPoint, words: &CueWords) -> f32 {
        let stated = words.room.as_deref().map(|room| self.room(place, room));
        let typical = ROOMS.iter().filter(|(_, typical)| typical.contains(&words.category.as_str()));
        let usual = typical.map(|(room, _)| self.room(place, room)).reduce(f32::max);
        let room = stated.or(usual).unwrap_or(NEUTRAL);
        match words.near.as_deref() {
            Some(noun) => 0.5 * room + 0.5 * self.presence(place, NEAR_M, noun),
            None => room,
        }
    }

    /// Returns the confidence in an object within `reach_m` metres with this category, 0 to 1.
    fn presence(&self, place: FloorPoint, reach_m: f32, category: &str) -> f32 {
        let near = self.all.iter().filter(|object| object.detection.distance_m(place) <= reach_m);
        near.map(|object| likeness(&object.detection, category)).fold(0.0, f32::max)
    }

    /// Returns the nearby objects' support for a room, 0 to 1 (the paper's room memory R_t).
    fn room(&self, place: FloorPoint, room: &str) -> f32 {
        let Some((_, typical)) = ROOMS.iter().find(|(name, _)| *name == room) else { return NEUTRAL };
        let sum: f32 = typical.iter().map(|category| self.presence(place, ROOM_M, category)).sum();
        sum / typical.len() as f32
    }
}

impl ObjectHypothesis {
    /// Adds a near view, given the fits by goal, 0 to 1.
    pub fn look(&mut self, fits: &[f32]) {
        /// Views of the mean. Older ones fade, since extents grow from view to view.
        const WINDOW: u32 = 4;
        self.looks += 1;
        let share = 1.0 / self.looks.min(WINDOW) as f32;
        self.vis.iter_mut().zip(fits).for_each(|(vis, fit)| *vis += share * (fit - *vis));
    }

    /// Returns the visual compatibility with a goal, 0 to 1; 0 before the first view.
    pub fn vis(&self, goal: usize) -> f32 {
        self.vis.get(goal).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::perception::objects::Palette;
    use avln_client::GoalCue;

    fn detection(x: f32, size_m: [f32; 2], high_m: f32, rgb: [u8; 3]) -> DetectedObject {
        let (min, max) = (FloorPoint::new(x, 0.0), FloorPoint::new(x + size_m[0], size_m[1]));
        let palette = Palette::of([rgb; 50].into_iter());
        DetectedObject { min, max, low_m: 0.0, high_m, palette, views: 1, ..DetectedObject::default() }
    }

    #[test]
    fn images_of_one_object_give_one_hypothesis() {
        let mut objects = ObjectMemory::new(2);
        let bed = detection(0.0, [2.0, 1.6], 0.6, [40, 60, 190]);
        objects.see(vec![bed.clone(), detection(5.0, [0.5, 0.5], 0.9, [200, 40, 40])]);
        objects.see(vec![bed]);
        assert_eq!(objects.all().len(), 2);
        assert_eq!(objects.all()[0].detection.views, 2);
    }

    #[test]
    fn compatibility_averages_recent_views() {
        let mut objects = ObjectMemory::new(2);
        objects.see(vec![detection(0.0, [1.0, 1.0], 1.0, [0; 3])]);
        let object = objects.iter_mut().next().unwrap();
        assert_eq!((object.vis(0), object.looks), (0.0, 0));
        object.look(&[0.8, 0.0]);
        object.look(&[0.4, 0.2]);
        assert!((object.vis(0) - 0.6).abs() < 1e-6 && (object.vis(1) - 0.1).abs() < 1e-6);
        (0..2).for_each(|_| object.look(&[0.6, 0.1]));
        // Four looks with the mean 0.6; the fifth counts for a quarter.
        object.look(&[1.0, 0.1]);
        assert!((object.vis(0) - 0.7).abs() < 1e-6 && object.looks == 5);
        assert_eq!(object.vis(9), 0.0);
    }

    #[test]
    fn surroundings_support_goals() {
        let mut objects = ObjectMemory::new(1);
        objects.see(vec![detection(0.0, [2.0, 1.6], 0.6, [40, 60, 190])]);
        let context = |sentence: &str, x: f32| {
            objects.context(FloorPoint::new(x, 0.3), &Query::new(&GoalCue::Description(sentence.into())))
        };
        assert!(context("the lamp in the bedroom", 2.5) > context("the lamp in the bathroom", 2.5));
        assert!(context("the lamp near a bed", 2.5) > context("the lamp near a bed", 9.0));
        assert_eq!(context("the lamp", 2.5), NEUTRAL);
    }
}
