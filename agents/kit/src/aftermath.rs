use crate::perception::Heard;
use avln_client::Feedback;

/// What is heard after a Submit at a source, which tells its outcome where nobody else does: a target that was found falls
/// silent once its tail has rung out.
#[derive(Clone, Copy, Debug)]
pub struct Aftermath {
    level: f32,
    steps: u32,
}

impl Aftermath {
    /// Steps after a Submit until its outcome is known; the source must be due to sound for as long.
    pub const STEPS: u32 = 2;

    /// For a source that was of this level when the Submit was made.
    pub fn of(level: f32) -> Self {
        Self { level, steps: 0 }
    }

    /// Takes in the next step; gives back whether the target was found, or `None` while that is not known. Found is what is
    /// less loud than `found_level` (0 to 1) of what it was.
    pub fn outcome(&mut self, feedback: Feedback, heard: Option<&Heard>, found_level: f32) -> Option<bool> {
        self.steps += 1;
        match feedback {
            Feedback::Verdict(found) => Some(found),
            Feedback::None | Feedback::Accepted if self.steps < Self::STEPS => None,
            Feedback::None | Feedback::Accepted => {
                Some(heard.is_none_or(|heard| heard.level < found_level * self.level))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn heard(level: f32) -> Option<Heard> {
        Some(Heard { itd_s: 0.0, level })
    }

    #[test]
    fn the_tail_is_waited_for() {
        for (second, found) in [(0.07, false), (0.02, true)] {
            let mut aftermath = Aftermath::of(0.1);
            assert_eq!(aftermath.outcome(Feedback::Accepted, heard(0.06).as_ref(), 0.5), None);
            assert_eq!(aftermath.outcome(Feedback::None, heard(second).as_ref(), 0.5), Some(found));
        }
        let mut alone = Aftermath::of(0.1);
        assert_eq!([(); 2].map(|()| alone.outcome(Feedback::None, None, 0.5)), [None, Some(true)]);
    }

    #[test]
    fn a_verdict_needs_no_ears() {
        let told = Aftermath::of(0.1).outcome(Feedback::Verdict(false), None, 0.5);
        assert_eq!(told, Some(false));
    }
}
