//! Perception: detected objects with boxes and colours, and their fit with goal cues.

pub(crate) mod category;
pub(crate) mod cue;
pub(crate) mod network;
pub(crate) mod objects;
pub(crate) mod palette;

pub use category::likeness as category_likeness;
pub use cue::{CueWords, Layout, Query};
pub use network::NetworkRecognition;
pub use objects::{DetectedObject, detect_objects};
pub use palette::Palette;

use crate::geometry::{FloorPoint, PinholeCamera, Pose2d};
use avln_client::{Mission, Observation, TaskSpec};
use std::sync::Arc;

/// Detection of objects in images, and their fit with the goals.
pub trait Recognition: Send {
    /// Starts a mission: forgets the last one and parses the goal cues.
    fn begin(&mut self, task: &TaskSpec, mission: &Mission);

    /// Returns the objects in an image, in the pose frame; `None` for a skipped image (no colours or depth, or almost
    /// the previous view). `is_wall` returns the map's walls.
    fn see(
        &mut self,
        pose: &Pose2d,
        seen: &Observation,
        is_wall: &dyn Fn(FloorPoint) -> bool,
    ) -> Option<Vec<DetectedObject>>;

    /// Returns the fit of an object in view with a goal in the last image, 0 to 1.
    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32;
}

/// Training-free recognition: connected stretches of depth are objects, cues are compared with their extents and
/// colours, and image cues with the whole view.
pub struct ClassicalRecognition {
    view: PinholeCamera,
    queries: Vec<Query>,
    layout: Layout,
}

impl Default for ClassicalRecognition {
    fn default() -> Self {
        Self {
            view: PinholeCamera::new(&TaskSpec::default()),
            queries: Vec::new(),
            layout: Layout::default(),
        }
    }
}

impl Recognition for ClassicalRecognition {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let queries = mission.goals.iter().map(Query::new).collect();
        *self = Self { view: PinholeCamera::new(task), queries, layout: Layout::default() };
    }

    fn see(
        &mut self,
        pose: &Pose2d,
        seen: &Observation,
        is_wall: &dyn Fn(FloorPoint) -> bool,
    ) -> Option<Vec<DetectedObject>> {
        let (image, depth) = (seen.rgb.as_ref()?, seen.depth.as_ref()?);
        self.layout = Layout::of(image);
        Some(detect_objects(&self.view, pose, image, depth, is_wall))
    }

    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32 {
        self.queries.get(goal).map_or(0.0, |query| query.fit(detection, &self.layout))
    }
}

/// Ground truth from the host for privileged agents in the same process, to measure the value of perfect senses. It
/// never crosses the wire. Positions are in the pose frame.
pub trait Hints: Send + Sync {
    /// Returns the position of the source in the last observation; `None` in silence.
    fn source(&self) -> Option<FloorPoint>;

    /// Returns the open targets in view.
    fn targets(&self) -> Vec<TargetHint>;
}

/// A target in view.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TargetHint {
    /// Goal index.
    pub goal: usize,
    /// Lowest box corner, metres; y is the height above the body's floor.
    pub min_m: [f32; 3],
    /// Highest corner.
    pub max_m: [f32; 3],
}

/// Recognition by hints: it detects exactly the targets in view.
pub struct HintRecognition {
    hints: Arc<dyn Hints>,
    goals: usize,
}

impl HintRecognition {
    /// Creates a recognition by `hints`.
    pub fn new(hints: Arc<dyn Hints>) -> Self {
        Self { hints, goals: 0 }
    }

    fn detection(&self, target: TargetHint) -> DetectedObject {
        let ([x0, y0, z0], [x1, y1, z1]) = (target.min_m, target.max_m);
        DetectedObject {
            min: FloorPoint::new(x0, z0),
            max: FloorPoint::new(x1, z1),
            low_m: y0,
            high_m: y1,
            embedding: (0..self.goals).map(|goal| if goal == target.goal { 1.0 } else { 0.0 }).collect(),
            views: 1,
            ..DetectedObject::default()
        }
    }
}

impl Recognition for HintRecognition {
    fn begin(&mut self, _task: &TaskSpec, mission: &Mission) {
        self.goals = mission.goals.len();
    }

    fn see(
        &mut self,
        _: &Pose2d,
        _: &Observation,
        _: &dyn Fn(FloorPoint) -> bool,
    ) -> Option<Vec<DetectedObject>> {
        Some(self.hints.targets().into_iter().map(|target| self.detection(target)).collect())
    }

    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32 {
        detection.embedding.get(goal).copied().unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_client::GoalCue;

    struct OneTarget;

    impl Hints for OneTarget {
        fn source(&self) -> Option<FloorPoint> {
            None
        }
        fn targets(&self) -> Vec<TargetHint> {
            vec![TargetHint { goal: 1, min_m: [1.0, 0.0, -2.0], max_m: [2.0, 0.8, -1.5] }]
        }
    }

    #[test]
    fn hints_fit_only_their_goal() {
        let mut told = HintRecognition::new(Arc::new(OneTarget));
        let goals = ["bed", "sofa"].map(|label| GoalCue::Category(label.into())).to_vec();
        told.begin(&TaskSpec::default(), &Mission { goals, ..Mission::default() });
        let seen = told.see(&Pose2d::default(), &Observation::default(), &|_| false).unwrap();
        assert_eq!((seen.len(), seen[0].high_m, seen[0].max), (1, 0.8, FloorPoint::new(2.0, -1.5)));
        assert_eq!((told.fit(&seen[0], 0), told.fit(&seen[0], 1)), (0.0, 1.0));
    }
}
