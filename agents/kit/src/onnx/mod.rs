//! Perception by user-supplied ONNX models: a detector with classes, or a detector and an image encoder with a text space (CLIP).
//!
//! Start reading at [`OnnxRecognition`]. `docs/models.md` specifies the inputs and outputs of models.
//!
//! This module contains no model and no ONNX Runtime; the runtime library is loaded on first use.

mod model;
mod naming;

pub use model::ModelsError;

use crate::geometry::{PinholeCamera, Pose2d};
use crate::onnx::model::{CropBox, Model, Models, Numbers, unit};
use crate::onnx::naming::{Appearance, Naming, cosine};
use crate::perception::cue::{Layout, Query};
use crate::perception::objects::DetectedObject;
use crate::perception::{Recognition, WallTest};
use avln_client::{DepthImage, GoalCue, Image, Mission, Observation, TaskSpec};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Largest depth difference to an object's median: a constant, metres, plus a share of the median.
const DEEP_M: f32 = 0.35;
const DEEP_SHARE: f32 = 0.1;
/// Detection limit per image: the best ones.
const MOST_THINGS: usize = 24;
/// Embedding weight for image cues; view similarity has the rest.
const EMBEDDING: f32 = 0.7;

/// Recognition by user-supplied models.
pub struct OnnxRecognition {
    detector: Model,
    naming: Naming,
    least_score: f32,
    view: PinholeCamera,
    goals: Vec<OnnxGoal>,
    layout: Layout,
    /// Pose at the last processed image.
    last: Option<Pose2d>,
    failure: SharedFailure,
}

/// The first model failure after loading; clones share it. A failed image counts as empty.
pub type SharedFailure = Arc<OnceLock<ModelsError>>;

/// A detected box with its class scores.
struct ScoredBox {
    frame: CropBox,
    scores: Vec<f32>,
}

/// Embedding and category of the object in an image's middle.
type MiddleObject = (Option<Vec<f32>>, Option<String>);

/// A goal: the parsed cue, and the embedding from a reference image's middle.
struct OnnxGoal {
    query: Query,
    embedding: Option<Vec<f32>>,
    /// Most likely category of a reference image's middle.
    category: Option<String>,
}

impl OnnxRecognition {
    /// Loads the models of a file and tries them; fails if a file cannot be loaded or a shape is wrong.
    pub fn load(path: &Path) -> Result<Self, ModelsError> {
        let models = Models::read(path)?;
        let mut recognition = Self {
            least_score: models.detector.least_score,
            naming: Naming::load(&models)?,
            detector: Model::load(&models.runtime, models.detector.model)?,
            view: PinholeCamera::new(&TaskSpec::default()),
            goals: Vec::new(),
            layout: Layout::default(),
            last: None,
            failure: SharedFailure::default(),
        };
        // Wrong shapes must appear here, before a run begins.
        let blank = Image { width: 64, height: 64, pixels: vec![128; 3 * 64 * 64] };
        recognition.detect(&blank)?;
        recognition.naming.check(&blank)?;
        Ok(recognition)
    }

    /// Returns the shared failure.
    pub fn failure(&self) -> SharedFailure {
        self.failure.clone()
    }

    fn or_failure<T>(&self, looked: Result<T, ModelsError>) -> Option<T> {
        looked.map_err(|error| _ = self.failure.set(error)).ok()
    }

    /// Returns the detected boxes, best first.
    fn detect(&mut self, image: &Image) -> Result<Vec<ScoredBox>, ModelsError> {
        let [boxes, scores] = self.detector.run(image, CropBox::ALL)?;
        let mut found = detections(&boxes, &scores, self.naming.classes())
            .map_err(|problem| self.detector.wrong(problem))?;
        found.retain(|found| found.best() >= self.least_score);
        found.sort_by(|a, b| b.best().total_cmp(&a.best()));
        let inside =
            found.into_iter().filter_map(|found| Some(ScoredBox { frame: found.frame.inside()?, ..found }));
        Ok(inside.take(MOST_THINGS).collect())
    }

    fn goal(&mut self, cue: &GoalCue) -> OnnxGoal {
        let looked = match cue {
            GoalCue::Image(image) => {
                let looked = self.in_the_middle(image);
                self.or_failure(looked)
            }
            GoalCue::Category(_) | GoalCue::Description(_) => None,
        };
        let (embedding, category) = looked.unwrap_or_default();
        OnnxGoal { query: Query::new(cue), embedding, category }
    }

    /// Returns embedding and category of the object in an image's middle. Without an object there is no category, and an embedding only
    /// if the names need no object.
    fn in_the_middle(&mut self, image: &Image) -> Result<MiddleObject, ModelsError> {
        let is_there = |found: &ScoredBox| {
            let [left, top, right, bottom] = found.frame.0;
            (left..=right).contains(&0.5) && (top..=bottom).contains(&0.5)
        };
        let found = self.detect(image)?.into_iter().find(is_there);
        let Some(found) = found else { return Ok((self.naming.embedding(image, None)?, None)) };
        let Appearance { kinds, embedding } = self.naming.appearance(image, &found)?;
        let best = kinds.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
        Ok((Some(embedding), best.map(|(category, _)| category)))
    }

    fn look(
        &mut self,
        pose: &Pose2d,
        image: &Image,
        depth: &DepthImage,
    ) -> Result<Vec<DetectedObject>, ModelsError> {
        let mut detections = Vec::new();
        for found in self.detect(image)? {
            let pixels = self.pixels(found.frame, pose, depth);
            if let Some(detection) = DetectedObject::of_pixels(&self.view, pose, image, depth, pixels) {
                let Appearance { kinds, embedding } = self.naming.appearance(image, &found)?;
                detections.push(DetectedObject { kinds, embedding, ..detection });
            }
        }
        Ok(detections)
    }

    /// Returns a crop's pixels (column, row) at the depth in its middle.
    fn pixels(&self, frame: CropBox, pose: &Pose2d, depth: &DepthImage) -> Vec<(usize, usize)> {
        let all = |frame: CropBox| {
            let (columns, rows) = (frame.columns(self.view.width), frame.rows(self.view.height));
            rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
        };
        let range_m = |(column, row): (usize, usize)| Some(self.view.seen(pose, depth, column, row)?.range_m);
        let mut ranges: Vec<f32> = all(frame.middle()).filter_map(range_m).collect();
        ranges.sort_by(f32::total_cmp);
        let Some(&median_m) = ranges.get(ranges.len() / 2) else { return Vec::new() };
        let reach_m = DEEP_M + DEEP_SHARE * median_m;
        all(frame).filter(|&pixel| range_m(pixel).is_some_and(|m| (m - median_m).abs() <= reach_m)).collect()
    }
}

impl Recognition for OnnxRecognition {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        (self.view, self.last) = (PinholeCamera::new(task), None);
        self.goals = mission.goals.iter().map(|cue| self.goal(cue)).collect();
        self.layout = Layout::default();
    }

    fn see(&mut self, pose: &Pose2d, seen: &Observation, _: WallTest) -> Option<Vec<DetectedObject>> {
        let (image, depth) = (seen.rgb.as_ref()?, seen.depth.as_ref()?);
        self.layout = Layout::of(image);
        // A view from almost the same pose would count the same evidence twice, and models are slow.
        if self.last.is_some_and(|last| last.sees_like(pose)) {
            return None;
        }
        self.last = Some(*pose);
        let looked = self.look(pose, image, depth);
        self.or_failure(looked)
    }

    fn fit(&self, detection: &DetectedObject, goal: usize) -> f32 {
        let Some(OnnxGoal { query, embedding, .. }) = self.goals.get(goal) else { return 0.0 };
        let view = query.fit(detection, &self.layout);
        let [unlike, alike] = self.naming.alike();
        embedding.as_ref().filter(|_| !detection.embedding.is_empty()).map_or(view, |wanted| {
            let likeness = (cosine(wanted, &unit(&detection.embedding)) - unlike) / (alike - unlike);
            EMBEDDING * likeness.clamp(0.0, 1.0) + (1.0 - EMBEDDING) * view
        })
    }

    fn refresh(&mut self) {
        self.last = None;
    }

    fn category_of(&self, goal: usize) -> Option<&str> {
        self.goals.get(goal)?.category.as_deref()
    }
}

impl ScoredBox {
    /// Returns the highest score.
    fn best(&self) -> f32 {
        self.scores.iter().copied().fold(f32::MIN, f32::max)
    }
}

/// Pairs boxes with their scores: one per class if the classes are known.
fn detections(boxes: &Numbers, scores: &Numbers, classes: Option<usize>) -> Result<Vec<ScoredBox>, String> {
    let count = boxes.1.len() / 4;
    if boxes.0.last() != Some(&4) {
        return Err(format!("its output 0 has the shape {:?}; the last dimension must be 4", boxes.0));
    }
    if count > 0 && (scores.1.is_empty() || !scores.1.len().is_multiple_of(count)) {
        return Err(format!("its output 1 has {} scores for {count} boxes", scores.1.len()));
    }
    let kinds = scores.1.len().checked_div(count).unwrap_or(1).max(1);
    if let Some(classes) = classes.filter(|&classes| count > 0 && classes != kinds) {
        return Err(format!(
            "its output 1 has {kinds} scores per box, but detector.classes has {classes} names"
        ));
    }
    let frames = boxes.1.chunks_exact(4).map(|side| CropBox([side[0], side[1], side[2], side[3]]));
    let scores = scores.1.chunks(kinds).map(<[f32]>::to_vec);
    Ok(frames.zip(scores).map(|(frame, scores)| ScoredBox { frame, scores }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_and_scores_are_paired() {
        let boxes = (vec![1, 2, 4], vec![0.0; 8]);
        let scores = (vec![1, 2, 3], vec![0.1, 0.7, 0.2, 0.3, 0.1, 0.0]);
        let found = detections(&boxes, &scores, Some(3)).unwrap();
        assert_eq!(found.iter().map(ScoredBox::best).collect::<Vec<_>>(), [0.7, 0.3]);
        assert_eq!(found[1].scores, [0.3, 0.1, 0.0]);
        let refusal = |boxes: &Numbers, scores: &Numbers, classes| {
            detections(boxes, scores, classes).err().expect("a refusal")
        };
        assert!(refusal(&boxes, &(vec![3], vec![0.0; 3]), None).contains("3 scores for 2 boxes"));
        assert!(refusal(&(vec![8], vec![0.0; 8]), &(vec![2], vec![0.0; 2]), None).contains("must be 4"));
        assert!(refusal(&boxes, &scores, Some(80)).contains("3 scores per box, but detector.classes has 80"));
        assert_eq!(detections(&(vec![1, 0, 4], vec![]), &(vec![1, 0], vec![]), Some(2)).unwrap().len(), 0);
    }
}
