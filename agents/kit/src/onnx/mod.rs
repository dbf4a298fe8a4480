//! Perception by user-supplied ONNX models: a detector, and an image encoder with a text space (CLIP).
//!
//! Start reading at [`OnnxRecognition`]. `docs/models.md` specifies the inputs and outputs of models.
//!
//! This module contains no model and no ONNX Runtime; the runtime library is loaded on first use.

mod model;

pub use model::ModelsError;

use crate::geometry::{PinholeCamera, Pose2d};
use crate::onnx::model::{CropBox, Model, Models, Numbers, unit, words};
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
/// Smaller probabilities are dropped.
const UNLIKELY: f32 = 0.003;
/// Embedding weight for image cues; view similarity has the rest.
const EMBEDDING: f32 = 0.7;

/// Recognition by user-supplied models.
pub struct OnnxRecognition {
    detector: Model,
    encoder: Model,
    words: Vec<(String, Vec<f32>)>,
    least_score: f32,
    scale: f32,
    alike: [f32; 2],
    view: PinholeCamera,
    goals: Vec<OnnxGoal>,
    layout: Layout,
    /// Pose at the last processed image.
    last: Option<Pose2d>,
    failure: SharedFailure,
}

/// The first model failure after loading; clones share it. A failed image counts as empty.
pub type SharedFailure = Arc<OnceLock<ModelsError>>;

/// A goal: the parsed cue, and the embedding from a reference image's middle.
struct OnnxGoal {
    query: Query,
    embedding: Option<Vec<f32>>,
}

impl OnnxRecognition {
    /// Loads the models of a file and tries them; fails if a file cannot be loaded or a shape is wrong.
    pub fn load(path: &Path) -> Result<Self, ModelsError> {
        let Models { runtime, detector, encoder } = Models::read(path)?;
        let mut recognition = Self {
            detector: Model::load(&runtime, detector.model)?,
            encoder: Model::load(&runtime, encoder.model)?,
            words: words(&encoder.words)?,
            least_score: detector.least_score,
            scale: encoder.scale,
            alike: encoder.alike,
            view: PinholeCamera::new(&TaskSpec::default()),
            goals: Vec::new(),
            layout: Layout::default(),
            last: None,
            failure: SharedFailure::default(),
        };
        // Wrong shapes must appear here, before a run begins.
        let blank = Image { width: 64, height: 64, pixels: vec![128; 3 * 64 * 64] };
        recognition.detect(&blank)?;
        recognition.encode(&blank, CropBox::ALL)?;
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
    fn detect(&mut self, image: &Image) -> Result<Vec<CropBox>, ModelsError> {
        let [boxes, scores] = self.detector.run(image, CropBox::ALL)?;
        let found = detections(&boxes, &scores).map_err(|problem| self.detector.wrong(problem))?;
        let mut found: Vec<(CropBox, f32)> =
            found.into_iter().filter(|(_, score)| *score >= self.least_score).collect();
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(found.into_iter().filter_map(|(frame, _)| frame.inside()).take(MOST_THINGS).collect())
    }

    /// Returns a crop's unit embedding.
    fn encode(&mut self, image: &Image, frame: CropBox) -> Result<Vec<f32>, ModelsError> {
        let [(_, numbers)] = self.encoder.run(image, frame)?;
        let length = self.words.first().map_or(0, |(_, embedding)| embedding.len());
        if numbers.len() != length {
            let problem =
                format!("its output has {} numbers, but the word embeddings have {length}", numbers.len());
            return Err(self.encoder.wrong(problem));
        }
        Ok(unit(&numbers))
    }

    /// Returns an embedding's words with their probabilities: softmax over all words.
    fn kinds(&self, embedding: &[f32]) -> Vec<(String, f32)> {
        let scores: Vec<f32> =
            self.words.iter().map(|(_, word)| self.scale * cosine(word, embedding)).collect();
        let top = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let all: f32 = scores.iter().map(|score| libm::expf(score - top)).sum();
        let named =
            self.words.iter().zip(scores).map(|((word, _), score)| (word, libm::expf(score - top) / all));
        named.filter(|(_, p)| *p > UNLIKELY).map(|(word, p)| (word.clone(), p)).collect()
    }

    fn goal(&mut self, cue: &GoalCue) -> OnnxGoal {
        let embedding = match cue {
            GoalCue::Image(image) => {
                let looked = self.in_the_middle(image);
                self.or_failure(looked)
            }
            GoalCue::Category(_) | GoalCue::Description(_) => None,
        };
        OnnxGoal { query: Query::new(cue), embedding }
    }

    /// Returns the embedding for the object in an image's middle, or for the whole image without an object.
    fn in_the_middle(&mut self, image: &Image) -> Result<Vec<f32>, ModelsError> {
        let is_there = |frame: &CropBox| {
            let [left, top, right, bottom] = frame.0;
            (left..=right).contains(&0.5) && (top..=bottom).contains(&0.5)
        };
        let frame = self.detect(image)?.into_iter().find(is_there).unwrap_or(CropBox::ALL);
        self.encode(image, frame)
    }

    fn look(
        &mut self,
        pose: &Pose2d,
        image: &Image,
        depth: &DepthImage,
    ) -> Result<Vec<DetectedObject>, ModelsError> {
        let mut detections = Vec::new();
        for frame in self.detect(image)? {
            let pixels = self.pixels(frame, pose, depth);
            if let Some(detection) = DetectedObject::of_pixels(&self.view, pose, image, depth, pixels) {
                let embedding = self.encode(image, frame)?;
                detections.push(DetectedObject { kinds: self.kinds(&embedding), embedding, ..detection });
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
        let Some(OnnxGoal { query, embedding }) = self.goals.get(goal) else { return 0.0 };
        let view = query.fit(detection, &self.layout);
        let [unlike, alike] = self.alike;
        embedding.as_ref().filter(|_| !detection.embedding.is_empty()).map_or(view, |wanted| {
            let likeness = (cosine(wanted, &unit(&detection.embedding)) - unlike) / (alike - unlike);
            EMBEDDING * likeness.clamp(0.0, 1.0) + (1.0 - EMBEDDING) * view
        })
    }
}

/// Pairs boxes with their highest scores.
fn detections(boxes: &Numbers, scores: &Numbers) -> Result<Vec<(CropBox, f32)>, String> {
    let count = boxes.1.len() / 4;
    if boxes.0.last() != Some(&4) {
        return Err(format!("its output 0 has the shape {:?}; the last dimension must be 4", boxes.0));
    }
    if count > 0 && (scores.1.is_empty() || !scores.1.len().is_multiple_of(count)) {
        return Err(format!("its output 1 has {} scores for {count} boxes", scores.1.len()));
    }
    let kinds = scores.1.len().checked_div(count).unwrap_or(1).max(1);
    let best = scores.1.chunks(kinds).map(|scores| scores.iter().copied().fold(f32::MIN, f32::max));
    let frames = boxes.1.chunks_exact(4).map(|side| CropBox([side[0], side[1], side[2], side[3]]));
    Ok(frames.zip(best).collect())
}

fn cosine(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_and_scores_are_paired() {
        let boxes = (vec![1, 2, 4], vec![0.0; 8]);
        let found = detections(&boxes, &(vec![1, 2, 3], vec![0.1, 0.7, 0.2, 0.3, 0.1, 0.0])).unwrap();
        assert_eq!(found.iter().map(|(_, score)| *score).collect::<Vec<_>>(), [0.7, 0.3]);
        assert!(detections(&boxes, &(vec![3], vec![0.0; 3])).unwrap_err().contains("3 scores for 2 boxes"));
        let flat = (vec![8], vec![0.0; 8]);
        assert!(detections(&flat, &(vec![2], vec![0.0; 2])).unwrap_err().contains("must be 4"));
        assert_eq!(detections(&(vec![1, 0, 4], vec![]), &(vec![1, 0], vec![])).unwrap().len(), 0);
    }
}
