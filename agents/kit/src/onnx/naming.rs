//! Categories and embeddings of detected boxes.

use crate::onnx::ScoredBox;
use crate::onnx::model::{CropBox, Model, Models, ModelsError, unit, words};
use crate::perception::WIDER;
use avln_client::Image;

/// Smaller probabilities are dropped.
const UNLIKELY: f32 = 0.003;
/// Cosines of class scores for different and for equal objects.
const ALIKE_CLASSES: [f32; 2] = [0.3, 0.9];

/// Origin of a box's categories and embedding.
pub(crate) enum Naming {
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
pub(crate) struct Appearance {
    pub(crate) kinds: Vec<(String, f32)>,
    pub(crate) embedding: Vec<f32>,
}

impl Naming {
    /// Loads the encoder, or takes the detector's classes.
    pub(crate) fn load(models: &Models) -> Result<Self, ModelsError> {
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
    pub(crate) fn check(&mut self, image: &Image) -> Result<(), ModelsError> {
        self.embedding(image, None).map(|_| ())
    }

    /// Returns the number of classes; `None` for a class-agnostic detector.
    pub(crate) fn classes(&self) -> Option<usize> {
        match self {
            Self::Classes { names, .. } => Some(names.len()),
            Self::Encoder { .. } => None,
        }
    }

    /// Returns the embedding cosines for different and for equal objects.
    pub(crate) fn alike(&self) -> [f32; 2] {
        match self {
            Self::Classes { .. } => ALIKE_CLASSES,
            Self::Encoder { alike, .. } => *alike,
        }
    }

    /// Returns the unit embedding of a box. Without a box the encoder sees the whole image, and classes have none.
    pub(crate) fn embedding(
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
    pub(crate) fn appearance(&mut self, image: &Image, found: &ScoredBox) -> Result<Appearance, ModelsError> {
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
pub(crate) fn cosine(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scores_become_probabilities_of_categories() {
        let names = ["chair", "stool", "chair", "bench"].map(str::to_owned);
        let kinds = kinds_of_scores(&names, &[0.1, 0.001, 0.3, 0.9], 0.5);
        let of = |word: &str| kinds.iter().find(|(name, _)| name == word).map(|(_, p)| *p);
        assert_eq!((of("chair"), of("armchair"), of("bench")), (Some(0.6), Some(0.6), Some(1.0)));
        assert_eq!((of("stool"), of("desk")), (None, None));
    }
}
