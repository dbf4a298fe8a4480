//! Thresholds and tests of the survey, and instances removed by each test.

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

/// Test of the survey, in order of application.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum SurveyTest {
    /// An allowed number of distractors.
    Distractors,
    /// A reachable success region.
    Region,
    /// A visible pixel.
    Visible,
    /// Least pixel share.
    Small,
    /// Largest pixel share.
    Large,
    /// Largest outline share on the picture border.
    Truncated,
    /// Least outline share with contrast.
    Contrast,
    /// Least colour distance to the surroundings.
    Color,
    /// Recognition by the verifier.
    Verifier,
}

/// Instances of target categories removed by each test. An instance counts for the test that stops its best view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Removals {
    /// Instances with too few or too many distractors.
    pub distractors: u32,
    /// Instances without a reachable viewpoint: too few points in the success region.
    pub no_viewpoint: u32,
    /// Instances visible in no view.
    pub hidden: u32,
    /// Instances with too few pixels.
    pub too_small: u32,
    /// Instances with too many pixels.
    pub too_large: u32,
    /// Instances cut by the picture border.
    pub truncated: u32,
    /// Instances without contrast at the outline.
    pub contrast: u32,
    /// Instances in the colours of their surroundings.
    pub colour: u32,
    /// Instances not recognised by the verifier.
    pub verifier: u32,
}

impl Removals {
    /// Counts an instance removed by `test`.
    pub(crate) fn note(&mut self, test: SurveyTest) {
        let count = match test {
            SurveyTest::Distractors => &mut self.distractors,
            SurveyTest::Region => &mut self.no_viewpoint,
            SurveyTest::Visible => &mut self.hidden,
            SurveyTest::Small => &mut self.too_small,
            SurveyTest::Large => &mut self.too_large,
            SurveyTest::Truncated => &mut self.truncated,
            SurveyTest::Contrast => &mut self.contrast,
            SurveyTest::Color => &mut self.colour,
            SurveyTest::Verifier => &mut self.verifier,
        };
        *count += 1;
    }

    /// Returns the counts with the names of the tests, in order of application.
    pub fn by_test(&self) -> [(&'static str, u32); 9] {
        [
            ("distractors", self.distractors),
            ("no viewpoint", self.no_viewpoint),
            ("hidden", self.hidden),
            ("too small", self.too_small),
            ("too large", self.too_large),
            ("truncated", self.truncated),
            ("contrast", self.contrast),
            ("colour", self.colour),
            ("verifier", self.verifier),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn removals_count_by_test() {
        let mut removals = Removals::default();
        let tests = [SurveyTest::Region, SurveyTest::Verifier, SurveyTest::Color, SurveyTest::Verifier];
        tests.into_iter().for_each(|test| removals.note(test));
        let counted: Vec<_> = removals.by_test().into_iter().filter(|(_, count)| *count > 0).collect();
        assert_eq!(counted, [("no viewpoint", 1), ("colour", 1), ("verifier", 2)]);
    }
}
