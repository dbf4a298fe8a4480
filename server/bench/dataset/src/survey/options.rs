use serde::{Deserialize, Serialize};

/// The thresholds of a survey: what counts as recognisable, and what as told apart. Recorded with a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurveyOptions {
    /// Seed of the choice of words.
    pub seed: u64,
    /// Side of the pictures that are looked at, pixels.
    pub look_px: u32,
    /// Places from which an object is looked at, at most.
    pub looks: usize,
    /// Viewpoints that are kept, at most.
    pub viewpoints: usize,
    /// Share of the picture that an object fills at least, 0 to 1.
    pub min_share: f32,
    /// Share of the picture that an object fills at most, 0 to 1.
    pub max_share: f32,
    /// Share of an object's outline that may lie on the border of the picture, 0 to 1.
    pub max_truncation: f32,
    /// Difference to its surroundings, in the strongest of red, green and blue, that makes an outline visible, 0 to 255.
    pub contrast_levels: u8,
    /// Share of the outline that is visible at least, 0 to 1.
    pub min_contrast: f32,
    /// Distance at least between the colours of the object and those of a ring around it, 0 to 1
    /// (1 less the intersection of their histograms).
    pub min_distinctness: f32,
    /// Sentences for each instance, at most.
    pub sentences: usize,
    /// Words of a sentence, fewest.
    pub min_words: usize,
    /// Words of a sentence, most.
    pub max_words: usize,
    /// Reference pictures for each instance, at most.
    pub images: usize,
    /// Margin at least by which each reference picture is told from every other instance of the category, 0 to 1.
    pub min_image_margin: f32,
}

impl Default for SurveyOptions {
    fn default() -> Self {
        Self {
            seed: 0,
            look_px: 96,
            looks: 10,
            viewpoints: 6,
            min_share: 0.006,
            max_share: 0.85,
            max_truncation: 0.35,
            contrast_levels: 16,
            min_contrast: 0.4,
            min_distinctness: 0.25,
            sentences: 3,
            min_words: 8,
            max_words: 35,
            images: 3,
            min_image_margin: 0.35,
        }
    }
}
