//! Tests of the survey, and instances removed by each.

use serde::{Deserialize, Serialize};

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
