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

impl SurveyOptions {
    /// Says which option is beyond its limits, when one is.
    pub(crate) fn check(&self) -> Result<(), String> {
        let counts = [
            ("look_px", self.look_px as usize, 16, 1024),
            ("looks", self.looks, 1, 64),
            ("viewpoints", self.viewpoints, 1, 64),
            ("sentences", self.sentences, 0, 16),
            ("min_words", self.min_words, 1, self.max_words),
            ("max_words", self.max_words, self.min_words, 60),
            ("images", self.images, 0, 3),
        ];
        let shares = [
            ("min_share", self.min_share),
            ("max_share", self.max_share),
            ("max_truncation", self.max_truncation),
            ("min_contrast", self.min_contrast),
            ("min_distinctness", self.min_distinctness),
            ("min_image_margin", self.min_image_margin),
        ];
        for (name, value, least, most) in counts {
            if !(least..=most).contains(&value) {
                return Err(format!("`survey.{name}` is {value}; {least} to {most} are possible"));
            }
        }
        match shares.into_iter().find(|(_, value)| !(0.0..=1.0).contains(value)) {
            Some((name, value)) => Err(format!("`survey.{name}` is {value}; 0 to 1 are possible")),
            None => Ok(()),
        }
    }
}
