//! Perception by user-supplied ONNX models: a detector with classes, or a detector and an image encoder with a text space (CLIP).
//!
//! Start reading at [`OnnxRecognition`]. `docs/models.md` specifies the inputs and outputs of models.
//!
//! This module contains no model and no ONNX Runtime; the runtime library is loaded on first use.

use crate::geometry::{PinholeCamera, Pose2d};
use crate::onnx::model::{CropBox, Model, Models, Numbers, unit, words};
use crate::perception::cue::{Layout, Query};
use crate::perception::objects::DetectedObject;
use crate::perception::{Recognition, WIDER, WallTest};
use avln_client::{DepthImage, GoalCue, Image, MethodType, Mission, Observation, TaskSpec};
pub use model::ModelsError;
use std::path::Path;
use std::sync::{Arc, OnceLock};

mod model;

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

    fn method_type(&self) -> MethodType {
        MethodType::FoundationModels
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

/// Smaller probabilities are dropped.
const UNLIKELY: f32 = 0.003;
/// Cosines of class scores for different and for equal objects.
const ALIKE_CLASSES: [f32; 2] = [0.3, 0.9];

/// Origin of a box's categories and embedding.
enum Naming {
    /// Class scores of the detector.
    Classes {
        /// Category per score.
        names: Vec<String>,
        /// Score of a certain class.
        sure_score: f32,
    },
    /// Embeddings of image crops and words.
    Encoder {
        model: Model,
        words: Vec<(String, Vec<f32>)>,
        scale: f32,
        /// Embedding cosines for different and for equal objects.
        alike: [f32; 2],
    },
}

/// Categories with probabilities, and the embedding of a box.
struct Appearance {
    kinds: Vec<(String, f32)>,
    embedding: Vec<f32>,
}

impl Naming {
    /// Loads the encoder, or takes the detector's classes.
    fn load(models: &Models) -> Result<Self, ModelsError> {
        let Some(encoder) = &models.encoder else {
            let names = models.detector.classes.iter().map(|name| name.replace(' ', "_")).collect();
            return Ok(Self::Classes { names, sure_score: models.detector.sure_score });
        };
        Ok(Self::Encoder {
            model: Model::load(&models.runtime, encoder.model.clone())?,
            words: words(&encoder.words)?,
            scale: encoder.scale,
            alike: encoder.alike,
        })
    }

    /// Runs the encoder once; fails if its output is invalid.
    fn check(&mut self, image: &Image) -> Result<(), ModelsError> {
        self.embedding(image, None).map(|_| ())
    }

    /// Returns the number of classes; `None` for a class-agnostic detector.
    fn classes(&self) -> Option<usize> {
        match self {
            Self::Classes { names, .. } => Some(names.len()),
            Self::Encoder { .. } => None,
        }
    }

    /// Returns the embedding cosines for different and for equal objects.
    fn alike(&self) -> [f32; 2] {
        match self {
            Self::Classes { .. } => ALIKE_CLASSES,
            Self::Encoder { alike, .. } => *alike,
        }
    }

    /// Returns the unit embedding of a box. Without a box the encoder sees the whole image, and classes have none.
    fn embedding(
        &mut self,
        image: &Image,
        found: Option<&ScoredBox>,
    ) -> Result<Option<Vec<f32>>, ModelsError> {
        match self {
            Self::Classes { .. } => Ok(found.map(|found| unit(&found.scores))),
            Self::Encoder { model, words, .. } => {
                let frame = found.map_or(CropBox::ALL, |found| found.frame);
                encode(model, words, image, frame).map(Some)
            }
        }
    }

    /// Returns a box's categories and embedding.
    fn appearance(&mut self, image: &Image, found: &ScoredBox) -> Result<Appearance, ModelsError> {
        let embedding = self.embedding(image, Some(found))?.unwrap_or_default();
        let kinds = match self {
            Self::Classes { names, sure_score } => kinds_of_scores(names, &found.scores, *sure_score),
            Self::Encoder { words, scale, .. } => kinds_of_words(words, &embedding, *scale),
        };
        Ok(Appearance { kinds, embedding })
    }
}

/// Returns a crop's unit embedding.
fn encode(
    model: &mut Model,
    words: &[(String, Vec<f32>)],
    image: &Image,
    frame: CropBox,
) -> Result<Vec<f32>, ModelsError> {
    let [(_, numbers)] = model.run(image, frame)?;
    let length = words.first().map_or(0, |(_, embedding)| embedding.len());
    if numbers.len() != length {
        let problem =
            format!("its output has {} numbers, but the word embeddings have {length}", numbers.len());
        return Err(model.wrong(problem));
    }
    Ok(unit(&numbers))
}

/// Returns the likely classes and their narrower everyday words, with probabilities.
fn kinds_of_scores(names: &[String], scores: &[f32], sure_score: f32) -> Vec<(String, f32)> {
    let mut kinds: Vec<(String, f32)> = Vec::new();
    for (name, score) in names.iter().zip(scores) {
        let probability = (score / sure_score).clamp(0.0, 1.0);
        match kinds.iter_mut().find(|(known, _)| known == name) {
            Some((_, best)) => *best = best.max(probability),
            None => kinds.push((name.clone(), probability)),
        }
    }
    let of = |wide: &str| kinds.iter().find(|(name, _)| name == wide).map(|(_, p)| *p);
    let unnamed = WIDER.iter().filter(|(narrow, _)| of(narrow).is_none());
    let narrow: Vec<(String, f32)> =
        unnamed.filter_map(|(narrow, wide)| Some(((*narrow).to_owned(), of(wide)?))).collect();
    kinds.extend(narrow);
    kinds.retain(|(_, probability)| *probability > UNLIKELY);
    kinds
}

/// Returns an embedding's words with their probabilities: softmax over all words.
fn kinds_of_words(words: &[(String, Vec<f32>)], embedding: &[f32], scale: f32) -> Vec<(String, f32)> {
    let scores: Vec<f32> = words.iter().map(|(_, word)| scale * cosine(word, embedding)).collect();
    let top = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let all: f32 = scores.iter().map(|score| libm::expf(score - top)).sum();
    let named = words.iter().zip(scores).map(|((word, _), score)| (word, libm::expf(score - top) / all));
    named.filter(|(_, p)| *p > UNLIKELY).map(|(word, p)| (word.clone(), p)).collect()
}

/// Returns the cosine of two unit vectors.
fn cosine(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
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

    #[test]
    fn scores_become_probabilities_of_categories() {
        let names = ["chair", "stool", "chair", "bench"].map(str::to_owned);
        let kinds = kinds_of_scores(&names, &[0.1, 0.001, 0.3, 0.9], 0.5);
        let of = |word: &str| kinds.iter().find(|(name, _)| name == word).map(|(_, p)| *p);
        assert_eq!((of("chair"), of("armchair"), of("bench")), (Some(0.6), Some(0.6), Some(1.0)));
        assert_eq!((of("stool"), of("desk")), (None, None));
    }
}
