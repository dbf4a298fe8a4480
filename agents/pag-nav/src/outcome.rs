//! Outcomes of Submits: by verdict, by silence, or counted as completed.

use crate::agent::PagNav;
use crate::candidate::Candidate;
use crate::ground::LEAST_SUPPORT;
use crate::memory::PendingSubmit;
use crate::verify::{Readiness, Warrant};
use crate::weights::Weights;
use avln_client::{Action, Feedback, SilenceRule, WrongSubmit};
use avln_kit::geometry::{FloorPoint, Pose2d};
use avln_kit::hearing::HeardSound;
use avln_kit::map::{ObjectHypothesis, range_m};
use avln_kit::outcome::SubmitOutcome;

/// Sound steps over which the level is averaged.
const RECENT: usize = 3;
/// Steps beyond a cycle of the sounding windows for which the agent waits at a candidate.
const SLACK_STEPS: u32 = 5;

impl PagNav {
    /// Returns true if a target should sound at its Submit.
    fn needs_sound(&self) -> bool {
        self.weights.switches.silence_outcomes && self.falls_silent
    }

    /// Returns true if the agent waits for a found target's silence after a Submit. At the end of a turn, every source falls silent:
    /// the evidence would cost a whole cycle of turns, up to a fifth of the steps.
    fn awaits_silence(&self) -> bool {
        self.weights.switches.silence_outcomes && self.falls_silent && self.silence != SilenceRule::WindowEnd
    }

    /// Returns the mean level of the last sounds in the current window, if there are enough.
    fn recent_level(&self) -> Option<f32> {
        let recent = self.levels.len().checked_sub(RECENT).map(|from| &self.levels[from..])?;
        Some(recent.iter().sum::<f32>() / RECENT as f32)
    }

    /// Returns the sounding source and its level, if it is near and will sound long enough for an outcome.
    fn audible(&self, candidate: &Candidate) -> Option<(usize, f32)> {
        let level = self.recent_level().filter(|&level| range_m(level) <= self.weights.look_range_m)?;
        let source = self.schedule.current();
        let located = candidate.source.filter(|&source| self.here.sources[source].is_located(&self.weights));
        let is_its = match located {
            Some(located) => located == source,
            None => !self.is_elsewhere(source, candidate),
        };
        (is_its && self.schedule.steps_left() >= SubmitOutcome::STEPS).then_some((source, level))
    }

    /// Returns whether the agent claims at an open gate now, waits for the target's sound, or rejects the candidate.
    pub(crate) fn readiness(&self, candidate: &Candidate) -> Readiness {
        let is_hurry = self.remaining_steps < self.weights.hurry_steps;
        // After its first steps, the outcome can be inferred from a source that sounds at present.
        let is_starting = candidate.source == Some(self.schedule.current())
            && self.levels.len() < RECENT
            && self.schedule.steps_left() as usize > RECENT;
        let is_known = self.is_supported(candidate) && !is_starting || self.audible(candidate).is_some();
        if !self.needs_sound() || is_hurry || is_known {
            return Readiness::Now;
        }
        if self.is_silent_there(candidate) {
            return Readiness::Unheard;
        }
        let cycle_steps = self.window_steps * self.open_sources().count() as u32 + SLACK_STEPS;
        if self.waited_steps(candidate) > cycle_steps { Readiness::Unheard } else { Readiness::Wait }
    }

    /// Returns true if all sounds come from elsewhere.
    fn is_silent_there(&self, candidate: &Candidate) -> bool {
        self.open_sources().all(|source| self.is_elsewhere(source, candidate))
    }

    /// Returns true if a source is faint at the candidate, or has a certain estimate that does not support the candidate.
    fn is_elsewhere(&self, source: usize, candidate: &Candidate) -> bool {
        let certainty = self.here.sources[source].estimate.map_or(0.0, |estimate| estimate.certainty);
        let object = &self.here.objects.all()[candidate.object];
        let is_off = || certainty >= self.weights.certain && self.support(object, source) < LEAST_SUPPORT;
        self.weights.switches.source_positions && (self.is_faint(source, object) || is_off())
    }

    /// Returns true if all levels of a source around an object belong to a greater range.
    fn is_faint(&self, source: usize, object: &ObjectHypothesis) -> bool {
        /// Range by level in multiples of `look_range_m`.
        const FAINT: f32 = 1.5;
        // The first steps of a window may be quiet.
        if source == self.schedule.current() && self.levels.len() < RECENT {
            return false;
        }
        let Weights { intensity_m, look_range_m, .. } = self.weights;
        let nearness = self.here.sources[source]
            .intensity
            .nearness(|place| object.detection.distance_m(place), intensity_m);
        nearness > 0.0 && nearness < intensity_m / (FAINT * look_range_m)
    }

    /// Returns the steps of waiting at a candidate.
    pub(crate) fn waited_steps(&self, candidate: &Candidate) -> u32 {
        self.here.waited.get(&(candidate.object, candidate.goal)).copied().unwrap_or(0)
    }

    /// Waits a step at a candidate: turns to and fro with the candidate in view.
    pub(crate) fn wait(&mut self, candidate: &Candidate, pose: &Pose2d) -> Action {
        let key = (candidate.object, candidate.goal);
        *self.here.waited.entry(key).or_default() += 1;
        // Waiting does not use up patience.
        if let Some(steps) = self.here.sought.get_mut(&key) {
            *steps = steps.saturating_sub(1);
        }
        if pose.bearing_rad(candidate.place) >= 0.0 { Action::TurnLeft } else { Action::TurnRight }
    }

    /// Claims a candidate.
    pub(crate) fn claim(&mut self, candidate: &Candidate, warrant: Warrant) -> Action {
        let action = warrant.claim(&self.mission);
        if action == Action::Submit {
            let is_hurry = self.remaining_steps < self.weights.hurry_steps;
            let audible = self.audible(candidate);
            let source = audible.map(|(source, _)| source).or(candidate.source);
            // Near the end, the steps of waiting for an outcome are worth more.
            let heard = audible.filter(|_| self.awaits_silence() && !is_hurry);
            let heard =
                heard.map(|(source, level)| SubmitOutcome::new(self.silence, source, &self.schedule, level));
            let Candidate { object, goal, .. } = *candidate;
            self.pending = Some(PendingSubmit { object: Some(object), goal, source, heard });
        }
        self.claimed = true;
        action
    }

    /// Applies the pending Submit's outcome, once it is known. Without evidence the goal counts as completed.
    pub(crate) fn settle(&mut self, feedback: Feedback, heard: Option<&HeardSound>, here: FloorPoint) {
        let Some(pending) = &mut self.pending else { return };
        let found_level = self.weights.found_level;
        let found = match &mut pending.heard {
            Some(outcome) => outcome.update(feedback, heard, found_level),
            None => Some(feedback != Feedback::Verdict(false)),
        };
        let Some(found) = found else { return };
        let pending = *pending;
        self.pending = None;
        self.levels.clear();
        if let Some(object) = pending.object {
            if found || matches!(feedback, Feedback::Verdict(_)) {
                // Found or wrong, the object is no candidate for another goal.
                self.here.objects.refute(object);
            } else {
                // The inference may be wrong: the object comes after all others, also at a located source.
                (0..2).for_each(|_| self.set_object_aside(object, pending.goal));
            }
        }
        let skips = self.wrong_submit == WrongSubmit::SkipsGoal && self.mission.is_ordered;
        if found || skips {
            self.mission.complete(pending.goal);
            self.focus = None;
            self.searched_steps = 0;
        }
        if let Some(source) = pending.source {
            self.settle_source(source, pending.goal, found, here);
            match pending.heard {
                Some(outcome) if found => outcome.silence(source, &mut self.schedule),
                None if found && self.falls_silent => match self.silence {
                    SilenceRule::WindowEnd => self.schedule.silence_after_turn(source),
                    _ => self.schedule.silence(source),
                },
                _ => {}
            }
        }
        self.outcome = Some((pending, found));
    }

    fn settle_source(&mut self, source: usize, goal: usize, found: bool, here: FloorPoint) {
        if found {
            self.pairing.found(source);
            if self.mission.is_ordered {
                // Earlier Submits were for the previous goal.
                self.here.sources.iter_mut().for_each(|source| source.missed.clear());
            }
        } else {
            self.pairing.missed(source, goal);
            let all = !self.mission.is_ordered;
            for (index, memory) in self.here.sources.iter_mut().enumerate() {
                if all || index == source {
                    memory.missed.push(here);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::Preset;
    use avln_client::{Agent, FeedbackRule, GoalCue, Mission, TaskSpec};
    use avln_kit::map::{SourceEstimate, expected_level};
    use avln_kit::perception::DetectedObject;

    /// An agent at an object of goal 0, in a mission with two goals, without sounds.
    fn agent() -> (PagNav, Pose2d) {
        agent_under(FeedbackRule::None)
    }

    fn agent_under(feedback: FeedbackRule) -> (PagNav, Pose2d) {
        let mut agent = PagNav::preset(Preset::PagNavPlus);
        let goals = vec![GoalCue::Category("bed".to_owned()); 2];
        agent.begin(&TaskSpec { feedback, ..TaskSpec::default() }, &Mission { goals, ..Mission::default() });
        let here = Pose2d::default();
        agent.here.objects.recognise(&here, vec![bed()], fit);
        agent.remaining_steps = 800;
        agent.mission.remaining_submits = 1;
        (agent, here)
    }

    fn bed() -> DetectedObject {
        DetectedObject {
            min: FloorPoint::new(-0.1, -1.1),
            max: FloorPoint::new(0.1, -0.9),
            high_m: 0.6,
            embedding: vec![1.0],
            views: 1,
            ..DetectedObject::default()
        }
    }

    fn fit(_: &DetectedObject, goal: usize) -> f32 {
        if goal == 0 { 0.9 } else { 0.0 }
    }

    /// Adds a source at a place, heard at the object from `range_m` metres.
    fn hear(agent: &mut PagNav, source: usize, place: FloorPoint, range_m: f32) {
        let memory = &mut agent.here.sources[source];
        memory.estimate = Some(SourceEstimate { place, certainty: 0.9 });
        memory.intensity.hear(FloorPoint::default(), expected_level(range_m));
    }

    fn readiness(agent: &PagNav, here: &Pose2d) -> Readiness {
        agent.readiness(&agent.select(here).expect("a candidate"))
    }

    #[test]
    fn located_sources_need_no_wait() {
        let (mut agent, here) = agent();
        assert_eq!(readiness(&agent, &here), Readiness::Wait);
        hear(&mut agent, 1, FloorPoint::new(0.0, -1.0), 1.0);
        assert_eq!(readiness(&agent, &here), Readiness::Now);
    }

    #[test]
    fn claims_with_verdicts_wait_for_sound() {
        let (agent, here) = agent_under(FeedbackRule::Verdict);
        assert_eq!(readiness(&agent, &here), Readiness::Wait);
    }

    #[test]
    fn last_claims_wait_for_sound() {
        let (mut agent, here) = agent();
        agent.mission.remaining_submits = 0;
        assert!(agent.mission.is_last_claim());
        assert_eq!(readiness(&agent, &here), Readiness::Wait);
        agent.remaining_steps = agent.weights.hurry_steps - 1;
        assert_eq!(readiness(&agent, &here), Readiness::Now);
    }

    #[test]
    fn silence_is_awaited_only_within_a_turn() {
        for (silence, is_awaited) in [(SilenceRule::Immediate, true), (SilenceRule::WindowEnd, false)] {
            let (mut agent, here) = agent();
            (agent.silence, agent.weights.verify_looks) = (silence, 1);
            hear(&mut agent, 0, FloorPoint::new(0.0, -1.0), 1.0);
            agent.levels = vec![expected_level(1.0); RECENT];
            agent.fresh = agent.here.objects.recognise(&here, vec![bed()], fit);
            assert_eq!(agent.decide(&here), Action::Submit);
            assert_eq!(agent.pending.expect("a Submit").heard.is_some(), is_awaited, "{silence:?}");
            agent.settle(Feedback::None, None, here.place);
            // Without evidence the goal counts as completed, and the source sounds until the end of its turn.
            assert_eq!(agent.mission.is_active(0), is_awaited);
            assert_eq!(agent.schedule.advance(), Some(0));
            assert_eq!(agent.schedule.is_silent(0), !is_awaited);
        }
    }

    #[test]
    fn faint_sources_are_elsewhere() {
        let (mut agent, here) = agent();
        for source in [0, 1] {
            assert_eq!(readiness(&agent, &here), Readiness::Wait);
            agent.here.sources[source].intensity.hear(FloorPoint::default(), expected_level(9.0));
        }
        // The current source may become louder in its first steps.
        assert_eq!(readiness(&agent, &here), Readiness::Wait);
        agent.levels = vec![expected_level(9.0); RECENT];
        assert_eq!(readiness(&agent, &here), Readiness::Unheard);
    }
}
