//! Submit outcomes, inferred from sound without a verdict: a found target falls silent.

use crate::hearing::{HeardSound, SoundSchedule};
use avln_client::{Feedback, SilenceRule};

/// Fewest and most steps from a Submit to the silence of a found target under [`SilenceRule::Delayed`].
const DELAY_STEPS: (u32, u32) = (5, 20);

/// A Submit's outcome. Silence counts only once the rule says that a found target must be silent.
#[derive(Clone, Copy, Debug)]
pub struct SubmitOutcome {
    rule: SilenceRule,
    level: f32,
    /// Remaining steps of the source's turn at the Submit; 0 if another source sounded.
    turn_steps: u32,
    /// Steps after which silence is evidence.
    due_steps: u32,
    steps: u32,
    /// Last step of the turn with a loud source.
    loud_step: u32,
    verdict: Option<bool>,
}

impl SubmitOutcome {
    /// Steps from the start of a silence to its evidence: the first still contains the reverberation. A source must be
    /// scheduled to sound for as long after a Submit.
    pub const STEPS: u32 = 2;

    /// Starts at a Submit for `source`, given the source's current level.
    pub fn new(rule: SilenceRule, source: usize, schedule: &SoundSchedule, level: f32) -> Self {
        let turn_steps = if schedule.current() == source { schedule.steps_left() } else { 0 };
        // At the end of its turn, every source gives way to the next one: only a missing return is evidence.
        let return_steps = schedule.return_steps() + Self::STEPS;
        let most_steps = DELAY_STEPS.1 + Self::STEPS;
        let due_steps = match rule {
            SilenceRule::Immediate | SilenceRule::Other => Self::STEPS,
            SilenceRule::Delayed if turn_steps >= most_steps => most_steps,
            SilenceRule::Delayed => return_steps.max(most_steps),
            SilenceRule::WindowEnd => return_steps,
        };
        Self { rule, level, turn_steps, due_steps, steps: 0, loud_step: 0, verdict: None }
    }

    /// Adds the next step; `None` while open. Without a verdict, true below `found_level` (0 to 1) of the level at the Submit.
    pub fn update(
        &mut self,
        feedback: Feedback,
        heard: Option<&HeardSound>,
        found_level: f32,
    ) -> Option<bool> {
        self.steps += 1;
        let is_quiet = heard.is_none_or(|heard| heard.level < found_level * self.level);
        if !is_quiet && self.steps <= self.turn_steps {
            self.loud_step = self.steps;
        }
        if let Feedback::Verdict(found) = feedback {
            self.verdict = Some(found);
        }
        match self.verdict {
            Some(true) if self.steps < self.switch_step() => None,
            Some(found) => Some(found),
            None => (self.steps >= self.due_steps).then_some(is_quiet),
        }
    }

    /// Returns the step in which it is known when a found source falls silent; 0 if the rule determines it.
    fn switch_step(&self) -> u32 {
        match self.rule {
            SilenceRule::Delayed => (self.turn_steps + 1).min(DELAY_STEPS.1 + Self::STEPS),
            SilenceRule::Immediate | SilenceRule::WindowEnd | SilenceRule::Other => 0,
        }
    }

    /// Marks the source as found, before the observations deferred since the Submit are caught up.
    pub fn silence(self, source: usize, schedule: &mut SoundSchedule) {
        match self.rule {
            SilenceRule::Immediate | SilenceRule::Other => schedule.silence(source),
            SilenceRule::WindowEnd => schedule.silence_after_turn(source),
            SilenceRule::Delayed => {
                let (least, most) = DELAY_STEPS;
                let sounded = self.loud_step.clamp(least.min(self.turn_steps), most.min(self.turn_steps));
                schedule.catch_up(sounded);
                schedule.silence(source);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW_STEPS: u32 = 25;
    const LATER: [SilenceRule; 2] = [SilenceRule::Delayed, SilenceRule::WindowEnd];

    fn heard(level: f32) -> Option<HeardSound> {
        Some(HeardSound { itd_s: 0.0, level })
    }

    /// A Submit for source 0 with `left` steps of its turn remaining, beside `others` distant open sources.
    #[derive(Clone, Copy, Debug)]
    struct Trial {
        rule: SilenceRule,
        left: u32,
        others: usize,
        /// Steps until the silence; `None` after a wrong Submit.
        sounds: Option<u32>,
        feedback: Feedback,
    }

    /// Step in which the outcome was known, the outcome, and whether the schedule then agreed with the sounding source.
    #[derive(Debug, PartialEq)]
    struct Settled {
        step: u32,
        found: bool,
        agrees: bool,
    }

    impl Trial {
        fn schedule(&self) -> SoundSchedule {
            let mut schedule = SoundSchedule::new(self.others + 1, WINDOW_STEPS);
            for _ in self.left..WINDOW_STEPS {
                schedule.advance();
            }
            assert_eq!((schedule.current(), schedule.steps_left()), (0, self.left));
            schedule
        }

        /// Sounding sources after the Submit; `None` if all are silent.
        fn sounding(self) -> impl Iterator<Item = Option<usize>> {
            let (mut place, mut left) = (0, self.left);
            (1..).map(move |step: u32| {
                let is_silent = self.sounds.is_some_and(|sounds| step > sounds);
                if is_silent && self.others == 0 {
                    return None;
                }
                if left == 0 || (is_silent && place == 0) {
                    place = (place + 1) % (self.others + 1);
                    place = if is_silent { place.max(1) } else { place };
                    left = WINDOW_STEPS;
                }
                left -= 1;
                Some(place)
            })
        }

        fn settle(self) -> Settled {
            let mut schedule = self.schedule();
            let mut outcome = SubmitOutcome::new(self.rule, 0, &schedule, 0.1);
            let mut feedback = self.feedback;
            for (step, sounding) in (1..).zip(self.sounding().take(200)) {
                let heard = sounding.and_then(|source| heard(if source == 0 { 0.1 } else { 0.01 }));
                if let Some(found) = outcome.update(feedback, heard.as_ref(), 0.5) {
                    if found {
                        outcome.silence(0, &mut schedule);
                    }
                    assert_eq!(schedule.is_silent(0), found);
                    return Settled { step, found, agrees: schedule.advance() == sounding };
                }
                feedback = Feedback::None;
                schedule.defer();
            }
            panic!("{self:?} has no outcome");
        }
    }

    /// Trials with right and wrong Submits, at all places of the turn.
    fn trials(rule: SilenceRule, feedback: Feedback) -> impl Iterator<Item = Trial> {
        let turns = (2..WINDOW_STEPS).flat_map(|left| (0..3).map(move |others| (left, others)));
        turns.flat_map(move |(left, others)| {
            let silences: Vec<_> = match rule {
                SilenceRule::Delayed => (5..=20).map(Some).collect(),
                SilenceRule::WindowEnd => vec![Some(left)],
                SilenceRule::Immediate | SilenceRule::Other => vec![Some(0)],
            };
            let all = silences.into_iter().chain([None]);
            all.map(move |sounds| Trial { rule, left, others, sounds, feedback })
        })
    }

    #[test]
    fn later_silence_yields_the_true_outcome() {
        for trial in LATER.into_iter().flat_map(|rule| trials(rule, Feedback::None)) {
            let settled = trial.settle();
            assert_eq!(settled.found, trial.sounds.is_some(), "{trial:?}: {settled:?}");
            assert!(settled.agrees, "{trial:?}: {settled:?}");
        }
    }

    #[test]
    fn nothing_is_inferred_before_the_delay() {
        for trial in trials(SilenceRule::Delayed, Feedback::Accepted) {
            let settled = trial.settle();
            assert!(settled.step >= 22, "{trial:?}: {settled:?}");
            assert!(trial.left < 22 || settled.step == 22, "{trial:?}: {settled:?}");
        }
    }

    #[test]
    fn window_end_is_judged_at_the_return() {
        for trial in trials(SilenceRule::WindowEnd, Feedback::None) {
            let return_steps = trial.left + WINDOW_STEPS * trial.others as u32;
            assert_eq!(trial.settle().step, return_steps + SubmitOutcome::STEPS, "{trial:?}");
        }
    }

    #[test]
    fn immediate_silence_is_judged_after_two_steps() {
        for rule in [SilenceRule::Immediate, SilenceRule::Other] {
            for trial in trials(rule, Feedback::None) {
                let expected = Settled { step: 2, found: trial.sounds.is_some(), agrees: true };
                assert_eq!(trial.settle(), expected, "{trial:?}");
            }
        }
    }

    #[test]
    fn outcome_waits_for_the_reverberation() {
        let schedule = SoundSchedule::new(2, WINDOW_STEPS);
        let new = || SubmitOutcome::new(SilenceRule::Immediate, 0, &schedule, 0.1);
        for (second, found) in [(0.07, false), (0.02, true)] {
            let mut outcome = new();
            assert_eq!(outcome.update(Feedback::Accepted, heard(0.06).as_ref(), 0.5), None);
            assert_eq!(outcome.update(Feedback::None, heard(second).as_ref(), 0.5), Some(found));
        }
        let mut alone = new();
        assert_eq!([(); 2].map(|()| alone.update(Feedback::None, None, 0.5)), [None, Some(true)]);
    }

    #[test]
    fn verdicts_need_no_sound() {
        for rule in [SilenceRule::Immediate, SilenceRule::Delayed, SilenceRule::WindowEnd] {
            for found in [false, true] {
                // With no other source, nothing is left to be attributed.
                let is_wanted = |trial: &Trial| trial.others > 0 && trial.sounds.is_some() == found;
                for trial in trials(rule, Feedback::Verdict(found)).filter(is_wanted) {
                    let settled = trial.settle();
                    assert_eq!((settled.found, settled.agrees), (found, true), "{trial:?}: {settled:?}");
                    let waits = found && rule == SilenceRule::Delayed;
                    assert_eq!(settled.step == 1, !waits, "{trial:?}: {settled:?}");
                }
            }
        }
    }

    #[test]
    fn found_source_sounds_until_its_turn_ends() {
        let trial = Trial {
            rule: SilenceRule::WindowEnd,
            left: 3,
            others: 2,
            sounds: Some(3),
            feedback: Feedback::Verdict(true),
        };
        let mut schedule = trial.schedule();
        SubmitOutcome::new(trial.rule, 0, &schedule, 0.1).silence(0, &mut schedule);
        for expected in trial.sounding().take(120) {
            assert_eq!(schedule.advance(), expected);
            assert!(schedule.is_silent(0), "it is found");
        }
    }
}
