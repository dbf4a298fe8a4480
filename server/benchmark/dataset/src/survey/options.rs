use serde::{Deserialize, Serialize};

/// Survey thresholds, recorded with a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SurveyOptions {
    /// Seed for word choice.
    pub seed: u64,
    /// Picture side, pixels.
    pub look_px: u32,
    /// Most viewpoints tried per object.
    pub looks: usize,
    /// Most viewpoints kept.
    pub viewpoints: usize,
    /// Least pixel share, 0 to 1.
    pub min_share: f32,
    /// Largest pixel share, 0 to 1.
    pub max_share: f32,
    /// Largest outline share on the picture border, 0 to 1.
    pub max_truncation: f32,
    /// Least visible contrast in the strongest channel, 0 to 255.
    pub contrast_levels: u8,
    /// Least outline share with visible contrast, 0 to 1.
    pub min_contrast: f32,
    /// Least colour distance to the surrounding ring, 0 to 1 (1 minus the histogram intersection).
    pub min_distinctness: f32,
    /// Most sentences per instance.
    pub sentences: usize,
    /// Least words per sentence.
    pub min_words: usize,
    /// Most words per sentence.
    pub max_words: usize,
    /// Most reference pictures per instance.
    pub images: usize,
    /// Least picture difference to all other instances in the category, 0 to 1.
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
    /// Checks the ranges; returns the first violation.
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
