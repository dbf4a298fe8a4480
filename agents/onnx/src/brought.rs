use crate::config::{Models, ModelsError, unit, words};
use crate::crop::Frame;
use crate::model::{Model, Numbers};
use avln_client::{DepthImage, GoalCue, Image, Mission, Observation, TaskSpec};
use avln_kit::perception::{Layout, Place, Query, Recognition, Stand, Thing, View};
use std::{path::Path, sync::Arc, sync::OnceLock};

/// Points of a thing lie no farther than this from its median depth, metres, and by this share of it.
const DEEP_M: f32 = 0.35;
const DEEP_SHARE: f32 = 0.1;
/// Things to look at in one picture: the best.
const MOST_THINGS: usize = 24;
/// Likelihoods below this are left out.
const UNLIKELY: f32 = 0.003;
/// Weight of the likeness of embeddings against the likeness of views, in the fit with a picture.
const EMBEDDING: f32 = 0.7;

/// Perception by models that people bring.
pub struct Brought {
    detector: Model,
    encoder: Model,
    words: Vec<(String, Vec<f32>)>,
    least_score: f32,
    scale: f32,
    alike: [f32; 2],
    view: View,
    goals: Vec<Goal>,
    layout: Layout,
    /// From where it looked last.
    last: Option<Stand>,
    failure: Failure,
}

/// The first look that failed, if one did: it showed nothing. Clones tell the same.
pub type Failure = Arc<OnceLock<ModelsError>>;

/// What is looked for: the cue, and the embedding of what is in the middle of a picture.
struct Goal {
    query: Query,
    embedding: Option<Vec<f32>>,
}

impl Brought {
    /// Loads the models that a file names, and tries them on a blank picture.
    ///
    /// # Errors
    /// When the file, ONNX Runtime or a model cannot be loaded, or a model does not give what it must.
    pub fn load(path: &Path) -> Result<Self, ModelsError> {
        let Models { runtime, detector, encoder } = Models::read(path)?;
        let mut brought = Self {
            detector: Model::load(&runtime, detector.model)?,
            encoder: Model::load(&runtime, encoder.model)?,
            words: words(&encoder.words)?,
            least_score: detector.least_score,
            scale: encoder.scale,
            alike: encoder.alike,
            view: View::new(&TaskSpec::default()),
            goals: Vec::new(),
            layout: Layout::default(),
            last: None,
            failure: Failure::default(),
        };
        let blank = Image { width: 64, height: 64, pixels: vec![128; 3 * 64 * 64] };
        brought.detect(&blank)?;
        brought.encode(&blank, Frame::ALL)?;
        Ok(brought)
    }

    /// Tells when a model fails later on.
    pub fn failure(&self) -> Failure {
        self.failure.clone()
    }

    fn or_failure<T>(&self, looked: Result<T, ModelsError>) -> Option<T> {
        looked.map_err(|error| _ = self.failure.set(error)).ok()
    }

    /// Frames of the things in a picture, the best first.
    fn detect(&mut self, image: &Image) -> Result<Vec<Frame>, ModelsError> {
        let [boxes, scores] = self.detector.run(image, Frame::ALL)?;
        let found = detections(&boxes, &scores).map_err(|problem| self.detector.wrong(problem))?;
        let mut found: Vec<(Frame, f32)> =
            found.into_iter().filter(|(_, score)| *score >= self.least_score).collect();
        found.sort_by(|a, b| b.1.total_cmp(&a.1));
        Ok(found.into_iter().filter_map(|(frame, _)| frame.inside()).take(MOST_THINGS).collect())
    }

    /// The embedding of what a frame shows, of length 1.
    fn encode(&mut self, image: &Image, frame: Frame) -> Result<Vec<f32>, ModelsError> {
        let [(_, numbers)] = self.encoder.run(image, frame)?;
        let length = self.words.first().map_or(0, |(_, embedding)| embedding.len());
        if numbers.len() != length {
            let problem = format!("it gives {} numbers, and the words have {length}", numbers.len());
            return Err(self.encoder.wrong(problem));
        }
        Ok(unit(&numbers))
    }

    /// The words for an embedding, each with its likelihood: softmax over all words.
    fn kinds(&self, embedding: &[f32]) -> Vec<(String, f32)> {
        let scores: Vec<f32> =
            self.words.iter().map(|(_, word)| self.scale * cosine(word, embedding)).collect();
        let top = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let all: f32 = scores.iter().map(|score| (score - top).exp()).sum();
        let named = self.words.iter().zip(scores).map(|((word, _), score)| (word, (score - top).exp() / all));
        named.filter(|(_, p)| *p > UNLIKELY).map(|(word, p)| (word.clone(), p)).collect()
    }

    fn goal(&mut self, cue: &GoalCue) -> Goal {
        let embedding = match cue {
            GoalCue::Image(image) => {
                let looked = self.in_the_middle(image);
                self.or_failure(looked)
            }
            GoalCue::Category(_) | GoalCue::Description(_) => None,
        };
        Goal { query: Query::new(cue), embedding }
    }

    /// The embedding of the thing in the middle of a picture; of the whole where nothing is found there.
    fn in_the_middle(&mut self, image: &Image) -> Result<Vec<f32>, ModelsError> {
        let is_there = |frame: &Frame| {
            let [left, top, right, bottom] = frame.0;
            (left..=right).contains(&0.5) && (top..=bottom).contains(&0.5)
        };
        let frame = self.detect(image)?.into_iter().find(is_there).unwrap_or(Frame::ALL);
        self.encode(image, frame)
    }

    fn look(&mut self, stand: &Stand, image: &Image, depth: &DepthImage) -> Result<Vec<Thing>, ModelsError> {
        let mut things = Vec::new();
        for frame in self.detect(image)? {
            let pixels = self.pixels(frame, stand, depth);
            let Some(thing) = Thing::of_pixels(&self.view, stand, image, depth, pixels) else { continue };
            let embedding = self.encode(image, frame)?;
            things.push(Thing { kinds: self.kinds(&embedding), embedding, ..thing });
        }
        Ok(things)
    }

    /// Pixels (column, row) of a frame that belong to what is in its middle: as far away as that.
    fn pixels(&self, frame: Frame, stand: &Stand, depth: &DepthImage) -> Vec<(usize, usize)> {
        let all = |frame: Frame| {
            let (columns, rows) = (frame.columns(self.view.width), frame.rows(self.view.height));
            rows.flat_map(move |row| columns.clone().map(move |column| (column, row)))
        };
        let range_m =
            |(column, row): (usize, usize)| Some(self.view.seen(stand, depth, column, row)?.range_m);
        let mut ranges: Vec<f32> = all(frame.middle()).filter_map(range_m).collect();
        ranges.sort_by(f32::total_cmp);
        let Some(&median_m) = ranges.get(ranges.len() / 2) else { return Vec::new() };
        let reach_m = DEEP_M + DEEP_SHARE * median_m;
        all(frame).filter(|&pixel| range_m(pixel).is_some_and(|m| (m - median_m).abs() <= reach_m)).collect()
    }
}

impl Recognition for Brought {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        (self.view, self.last) = (View::new(task), None);
        self.goals = mission.goals.iter().map(|cue| self.goal(cue)).collect();
        self.layout = Layout::default();
    }

    fn see(&mut self, stand: &Stand, seen: &Observation, _: &dyn Fn(Place) -> bool) -> Option<Vec<Thing>> {
        let (image, depth) = (seen.rgb.as_ref()?, seen.depth.as_ref()?);
        self.layout = Layout::of(image);
        if self.last.is_some_and(|last| last.sees_like(stand)) {
            return None;
        }
        self.last = Some(*stand);
        let looked = self.look(stand, image, depth);
        self.or_failure(looked)
    }

    fn fit(&self, thing: &Thing, goal: usize) -> f32 {
        let Some(Goal { query, embedding }) = self.goals.get(goal) else { return 0.0 };
        let view = query.fit(thing, &self.layout);
        let [unlike, alike] = self.alike;
        embedding.as_ref().filter(|_| !thing.embedding.is_empty()).map_or(view, |wanted| {
            let likeness = (cosine(wanted, &unit(&thing.embedding)) - unlike) / (alike - unlike);
            EMBEDDING * likeness.clamp(0.0, 1.0) + (1.0 - EMBEDDING) * view
        })
    }
}

/// Pairs boxes with the best of their scores.
fn detections(boxes: &Numbers, scores: &Numbers) -> Result<Vec<(Frame, f32)>, String> {
    let count = boxes.1.len() / 4;
    if boxes.0.last() != Some(&4) {
        return Err(format!("its output 0 has the shape {:?}, and must end in 4", boxes.0));
    }
    if count > 0 && (scores.1.is_empty() || !scores.1.len().is_multiple_of(count)) {
        return Err(format!("its output 1 has {} scores for {count} boxes", scores.1.len()));
    }
    let kinds = scores.1.len().checked_div(count).unwrap_or(1).max(1);
    let best = scores.1.chunks(kinds).map(|scores| scores.iter().copied().fold(f32::MIN, f32::max));
    let frames = boxes.1.chunks_exact(4).map(|side| Frame([side[0], side[1], side[2], side[3]]));
    Ok(frames.zip(best).collect())
}

/// Cosine of two vectors of length 1.
fn cosine(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_and_scores_must_go_together() {
        let boxes = (vec![1, 2, 4], vec![0.0; 8]);
        let found = detections(&boxes, &(vec![1, 2, 3], vec![0.1, 0.7, 0.2, 0.3, 0.1, 0.0])).unwrap();
        assert_eq!(found.iter().map(|(_, score)| *score).collect::<Vec<_>>(), [0.7, 0.3]);
        assert!(detections(&boxes, &(vec![3], vec![0.0; 3])).unwrap_err().contains("3 scores for 2 boxes"));
        let flat = (vec![8], vec![0.0; 8]);
        assert!(detections(&flat, &(vec![2], vec![0.0; 2])).unwrap_err().contains("must end in 4"));
        assert_eq!(detections(&(vec![1, 0, 4], vec![]), &(vec![1, 0], vec![])).unwrap().len(), 0);
    }
}
