//! Perception: detected objects with boxes and colours, and their fit with goal cues.

pub(crate) mod category;
pub(crate) mod cue;
mod denoise;
pub(crate) mod objects;

pub use cue::{CueWords, Layout, Query};
pub use objects::{DetectedObject, Palette, detect_objects};

use crate::geometry::{FloorPoint, PinholeCamera, Pose2d};
use avln_client::{DepthImage, GoalCue, Image, MethodType, Mission, Observation, RgbImage, TaskSpec};
use avln_perception::{
    CameraModel, Depth, Perception as _, Picture, Segment, Segmentation, VisionNetwork, WeightsError, lift,
};
use denoise::denoised;
use objects::cosine;
use std::sync::Arc;

/// True for the map's walls.
pub type WallTest<'a> = &'a dyn Fn(FloorPoint) -> bool;

/// Detection of objects in images, and their fit with the goals.
pub trait Recognition: Send {
    /// Starts a mission: forgets the last one and parses the goal cues.
    fn begin(&mut self, task: &TaskSpec, mission: &Mission);

    /// Returns the objects in an image, in the pose frame; `None` for a skipped image (incomplete, or almost
    /// the previous view). `is_wall` returns the map's walls.
    fn see(&mut self, pose: &Pose2d, seen: &Observation, is_wall: WallTest) -> Option<Vec<DetectedObject>>;

    /// Returns the fit of an object in view with a goal in the last image, 0 to 1.
    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32;

    /// Returns the type of a method that sees in this way.
    fn method_type(&self) -> MethodType;

    /// Forgets the last view: the next image is processed, even from almost the same pose.
    fn refresh(&mut self) {}

    /// Returns the predicted category of a goal image; `None` for other cues, or without a prediction.
    fn category_of(&self, _goal: usize) -> Option<&str> {
        None
    }
}

/// Training-free recognition by stretches of depth, extents and colours; image cues by the whole view.
pub struct ClassicalRecognition {
    view: PinholeCamera,
    queries: Vec<Query>,
    layout: Layout,
}

impl Default for ClassicalRecognition {
    fn default() -> Self {
        let view = PinholeCamera::new(&TaskSpec::default());
        Self { view, queries: Vec::new(), layout: Layout::default() }
    }
}

impl Recognition for ClassicalRecognition {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let queries = mission.goals.iter().map(Query::new).collect();
        *self = Self { view: PinholeCamera::new(task), queries, layout: Layout::default() };
    }

    fn see(&mut self, pose: &Pose2d, seen: &Observation, is_wall: WallTest) -> Option<Vec<DetectedObject>> {
        let (image, depth) = (seen.rgb.as_ref()?, seen.depth.as_ref()?);
        self.layout = Layout::of(image);
        Some(detect_objects(&self.view, pose, image, depth, is_wall))
    }

    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32 {
        self.queries.get(goal).map_or(0.0, |query| query.fit(detection, &self.layout))
    }

    fn method_type(&self) -> MethodType {
        MethodType::TrainingFree
    }
}

/// Ground truth in the pose frame for privileged agents of the same process; it never crosses the wire.
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

    fn see(&mut self, _: &Pose2d, _: &Observation, _: WallTest) -> Option<Vec<DetectedObject>> {
        Some(self.hints.targets().into_iter().map(|target| self.detection(target)).collect())
    }

    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32 {
        detection.embedding.get(goal).copied().unwrap_or(0.0)
    }

    fn method_type(&self) -> MethodType {
        MethodType::TrainingFree
    }
}

/// Smaller probabilities are dropped.
const UNLIKELY: f32 = 0.003;
/// Cosines for different and for equal objects.
const ALIKE: [f32; 2] = [0.3, 0.9];
/// Embedding weight for image cues; view similarity has the rest.
const NETWORK: f32 = 0.6;
/// Everyday words for objects, with the network's wider category.
pub(crate) const WIDER: [(&str, &str); 13] = [
    ("armchair", "chair"),
    ("coffee_table", "table"),
    ("desk", "table"),
    ("nightstand", "chest_of_drawers"),
    ("wardrobe", "cabinet"),
    ("bookshelf", "shelving"),
    ("bench", "seating"),
    ("ottoman", "stool"),
    ("refrigerator", "appliances"),
    ("stove", "appliances"),
    ("washing_machine", "appliances"),
    ("lamp", "lighting"),
    ("floor_lamp", "lighting"),
];

/// Recognition by the network of `avln-perception`: segments, lifted to boxes by depth.
pub struct NetworkRecognition {
    network: VisionNetwork,
    view: PinholeCamera,
    camera: CameraModel,
    goals: Vec<GoalMatcher>,
    layout: Layout,
    /// Pose at the last processed image.
    last: Option<Pose2d>,
}

enum GoalMatcher {
    Words(CueWords),
    /// The object in the reference image's middle, if the network found one, and the parsed cue.
    Picture(Option<PictureObject>, Query),
}

struct PictureObject {
    look: Vec<f32>,
    category: String,
}

impl Default for NetworkRecognition {
    fn default() -> Self {
        Self::new().expect("the bundled weights are valid")
    }
}

impl NetworkRecognition {
    /// Creates a recognition with the bundled weights; fails if they are invalid.
    pub fn new() -> Result<Self, WeightsError> {
        let (task, network) = (TaskSpec::default(), VisionNetwork::new()?);
        let (view, camera) = (PinholeCamera::new(&task), camera(&task));
        Ok(Self { network, view, camera, goals: Vec::new(), layout: Layout::default(), last: None })
    }

    fn goal(&mut self, cue: &GoalCue) -> GoalMatcher {
        match Query::new(cue) {
            Query::Words(words) => GoalMatcher::Words(words),
            query @ Query::Picture { .. } => GoalMatcher::Picture(self.look_of(cue), query),
        }
    }

    fn look_of(&mut self, cue: &GoalCue) -> Option<PictureObject> {
        let GoalCue::Image(image) = cue else { return None };
        let segment = self.network.look_at_picture(&picture(image)).ok()??;
        let category = self.network.categories().get(segment.category().0)?.clone();
        Some(PictureObject { look: look(&segment), category })
    }

    /// Builds an object from a segment; `None` if too distant or without depth.
    fn detection(
        &self,
        segment: &Segment,
        seen: &Segmentation,
        pose: &Pose2d,
        (image, depth): (&Image, &DepthImage),
    ) -> Option<DetectedObject> {
        let (width, height) = (seen.width, seen.height);
        let pixels = segment.mask.iter().map(|&pixel| {
            let (row, column) = (pixel as usize / width, pixel as usize % width);
            (column * self.view.width / width, row * self.view.height / height)
        });
        let detection = DetectedObject::of_pixels(&self.view, pose, image, depth, pixels.collect())?;
        let kinds = self.kinds(&self.judged(segment, seen, (image, depth)));
        let [[left, right], [top, bottom]] = [segment.bounds.columns, segment.bounds.rows];
        let edges = [left == 0, right as usize + 1 >= width, top == 0, bottom as usize + 1 >= height];
        let is_cut = edges.iter().filter(|is_at_edge| **is_at_edge).count() >= 2;
        Some(DetectedObject { embedding: look(segment), kinds, is_cut, ..detection })
    }

    /// Returns a segment's category probabilities, by appearance and shape.
    fn judged(
        &self,
        segment: &Segment,
        seen: &Segmentation,
        (image, depth): (&Image, &DepthImage),
    ) -> Vec<f32> {
        let metres = Depth { metres: &depth.metres };
        let solid = lift(seen, segment, &picture(image), &metres, &self.camera);
        solid.map_or_else(|| segment.categories.clone(), |solid| self.network.judge(seen, segment, &solid))
    }

    /// Returns the likely categories and their everyday words, with probabilities.
    fn kinds(&self, likelihoods: &[f32]) -> Vec<(String, f32)> {
        let names = self.network.categories().iter().zip(likelihoods);
        let likely: Vec<(&str, f32)> =
            names.map(|(name, &p)| (name.as_str(), p)).filter(|(_, p)| *p > UNLIKELY).collect();
        let of = |wide: &str| likely.iter().find(|(name, _)| *name == wide).map(|(_, p)| *p);
        let narrow = WIDER.iter().filter_map(|(narrow, wide)| Some((*narrow, of(wide)?)));
        likely.iter().copied().chain(narrow).map(|(name, p)| (name.to_owned(), p)).collect()
    }
}

impl Recognition for NetworkRecognition {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        (self.view, self.camera) = (PinholeCamera::new(task), camera(task));
        self.goals = mission.goals.iter().map(|cue| self.goal(cue)).collect();
        (self.layout, self.last) = (Layout::default(), None);
    }

    fn see(&mut self, pose: &Pose2d, seen: &Observation, _: WallTest) -> Option<Vec<DetectedObject>> {
        let (image, depth) = (seen.rgb.as_ref()?, seen.depth.as_ref()?);
        // A view from almost the same pose would count the same evidence twice, and an image takes 7 ms (AVX-512) to 31 ms.
        if self.last.is_some_and(|last| last.sees_like(pose)) {
            return None;
        }
        self.last = Some(*pose);
        let image = &*denoised(image, depth);
        self.layout = Layout::of(image);
        let metres = Depth { metres: &depth.metres };
        let told = self.network.see(&picture(image), Some((&metres, &self.camera))).ok()?;
        let detection = |segment| self.detection(segment, &told, pose, (image, depth));
        Some(told.segments.iter().filter_map(detection).collect())
    }

    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32 {
        match self.goals.get(goal) {
            Some(GoalMatcher::Words(words)) => words.fit(detection),
            Some(GoalMatcher::Picture(look, query)) => {
                let view = query.fit(detection, &self.layout);
                look.as_ref().map_or(view, |seen| {
                    NETWORK * alike(&seen.look, &detection.embedding) + (1.0 - NETWORK) * view
                })
            }
            None => 0.0,
        }
    }

    fn refresh(&mut self) {
        self.last = None;
    }

    fn category_of(&self, goal: usize) -> Option<&str> {
        match self.goals.get(goal)? {
            GoalMatcher::Words(_) => None,
            GoalMatcher::Picture(seen, _) => seen.as_ref().map(|seen| seen.category.as_str()),
        }
    }

    fn method_type(&self) -> MethodType {
        MethodType::LearntPerception
    }
}

/// Compares two descriptors, 0 to 1.
fn alike(a: &[f32], b: &[f32]) -> f32 {
    let [low, high] = ALIKE;
    ((cosine(a, b) - low) / (high - low)).clamp(0.0, 1.0)
}

fn camera(task: &TaskSpec) -> CameraModel {
    CameraModel { hfov_rad: task.hfov_rad, height_m: task.camera_height_m, pitch_rad: 0.0 }
}

fn picture(image: &RgbImage) -> Picture<'_> {
    Picture { width: image.width as usize, height: image.height as usize, rgb: &image.pixels }
}

/// Returns a segment's descriptor: embedding and category probabilities, equally weighted.
fn look(segment: &Segment) -> Vec<f32> {
    let length = segment.categories.iter().map(|p| p * p).sum::<f32>().sqrt().max(f32::EPSILON);
    let categories = segment.categories.iter().map(|p| p / length);
    segment.embedding.iter().copied().chain(categories).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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

    use avln_client::Pose;
    use avln_perception::{Histogram, PixelBox};

    const SIDE: usize = 32;

    /// A segment in the middle, `SIDE` x `SIDE` pixels, with one category.
    fn segment(recognition: &NetworkRecognition, category: &str) -> Segment {
        let of = |name: &String| if name == category { 1.0 } else { 0.0 };
        let middle = SIDE as u32 / 4..3 * SIDE as u32 / 4;
        let (first, last) = (middle.start, middle.end - 1);
        Segment {
            mask: middle.clone().flat_map(|row| middle.clone().map(move |x| row * SIDE as u32 + x)).collect(),
            categories: recognition.network.categories().iter().map(of).collect(),
            embedding: vec![1.0; 12].into_iter().map(|one: f32| one / 12_f32.sqrt()).collect(),
            histogram: Histogram::default(),
            bounds: PixelBox { columns: [first, last], rows: [first, last] },
        }
    }

    fn seen() -> Segmentation {
        let (categories, confidences) = (vec![0; SIDE * SIDE], vec![1.0; SIDE * SIDE]);
        Segmentation { width: SIDE, height: SIDE, categories, confidences, segments: Vec::new() }
    }

    fn ready(goals: &[&str]) -> NetworkRecognition {
        let mut recognition = NetworkRecognition::new().unwrap();
        let task = TaskSpec { width: 64, height: 64, ..TaskSpec::default() };
        let goals = goals.iter().map(|label| GoalCue::Category((*label).to_owned())).collect();
        recognition.begin(&task, &Mission { goals, ..Mission::default() });
        recognition
    }

    #[test]
    fn segments_become_objects() {
        let recognition = ready(&["chair", "bed"]);
        let image = Image { width: 64, height: 64, pixels: [200, 30, 30].repeat(64 * 64) };
        let depth = DepthImage { width: 64, height: 64, metres: vec![2.0; 64 * 64] };
        let (segment, pose) = (segment(&recognition, "chair"), Pose2d::new(&Pose::default()));
        let detection = recognition.detection(&segment, &seen(), &pose, (&image, &depth)).unwrap();
        // The middle half in 64 pixels and 90 degrees, 2 m ahead, is 2 m wide without outliers.
        assert!(
            (detection.long_m() - 1.85).abs() < 0.1 && (detection.center().z + 2.0).abs() < 1e-4,
            "{detection:?}"
        );
        let likely = |word: &str| detection.is_a(word).unwrap();
        assert!(likely("chair") > 0.0 && likely("armchair") == likely("chair") && likely("unicorn") == 0.0);
        assert!(
            (recognition.fit(&detection, 0) - likely("chair")).abs() < 1e-6
                && recognition.fit(&detection, 2) == 0.0
        );
        let far = DepthImage { metres: vec![8.0; 64 * 64], ..depth };
        assert_eq!(recognition.detection(&segment, &seen(), &pose, (&image, &far)), None);
    }

    #[test]
    fn descriptors_combine_embedding_and_category() {
        let recognition = ready(&[]);
        let [chair, bed] = ["chair", "bed"].map(|category| look(&segment(&recognition, category)));
        assert!(alike(&chair, &chair) > 0.99 && (alike(&chair, &bed) - (0.5 - 0.3) / 0.6).abs() < 1e-3);
    }

    #[test]
    fn images_without_depth_are_skipped() {
        let mut recognition = ready(&["chair"]);
        let image = Image { width: 64, height: 64, pixels: vec![128; 3 * 64 * 64] };
        let blind = Observation { rgb: Some(image), ..Observation::default() };
        assert_eq!(recognition.see(&Pose2d::default(), &blind, &|_| false), None);
    }
}
