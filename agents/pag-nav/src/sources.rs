//! Estimated sound sources, for the switch `source_positions`.

use crate::agent::PagNav;
use crate::candidate::Evidence;
use avln_kit::LOOK_M;
use avln_kit::geometry::{FloorPoint, Pose2d};
use avln_kit::hearing::HeardSound;
use avln_kit::map::{SoundField, SourceEstimate};

/// Margin around the seen area in which sources may be, metres.
const AROUND_M: f32 = 1.5;

/// Distance to an estimate within which the object may be in view, metres, and the share of a wait that counts there.
const BESIDE_M: f32 = 5.0;
const BESIDE_SHARE: f32 = 0.3;

impl PagNav {
    /// Adds a sound to the belief about its source.
    pub(crate) fn locate_source(&mut self, index: usize, pose: &Pose2d, heard: &HeardSound) {
        let map = &self.here.map;
        let source = &mut self.here.sources[index];
        let field = self.field.take().filter(|field| field.listener() == pose.place);
        let field = field.unwrap_or_else(|| SoundField::new(map, pose.place, map.area(AROUND_M)));
        source.approach(heard.level);
        source.intensity.hear(pose.place, heard.level);
        source.belief.hear(&field, pose, heard);
        let hint = self.hints.as_ref().and_then(|hints| hints.source());
        let hint = hint.map(|place| SourceEstimate { place, certainty: 1.0 });
        let estimate = hint.or_else(|| source.belief.estimate(&field, map, &source.missed));
        if source.locate(estimate) {
            self.pairing.forget(index);
        }
        self.field = Some(field);
    }

    /// Records the objects' fits at located sources in view.
    pub(crate) fn look_at_sources(&mut self, pose: &Pose2d) {
        for index in 0..self.here.sources.len() {
            let is_located = self.here.sources[index].is_located(&self.weights);
            let Some(estimate) = self.here.sources[index].estimate.filter(|_| is_located) else { continue };
            if self.here.map.is_in_view(pose, estimate.place, LOOK_M) {
                self.here.sources[index].look_at(estimate.place);
                for goal in 0..self.mission.goals() {
                    self.pairing.see(index, goal, self.fit_at(estimate.place, goal));
                }
            }
        }
    }

    /// Returns the best visual fit with a goal among the objects at a position, 0 to 1.
    fn fit_at(&self, place: FloorPoint, goal: usize) -> f32 {
        const AT_M: f32 = 0.4;
        let all = self.here.objects.all().iter().enumerate();
        let at = all.filter(|(_, object)| object.detection.distance_m(place) <= AT_M);
        let fits = at.map(|(index, object)| {
            let evidence = Evidence { vis: object.vis(goal), context: self.context(index, goal), sound: 0.0 };
            evidence.seen(&self.weights)
        });
        fits.fold(0.0, f32::max)
    }

    /// Returns the sources that still sound, as far as known.
    pub(crate) fn open_sources(&self) -> impl Iterator<Item = usize> + '_ {
        let is_counted = self.weights.switches.count_windows;
        (0..self.here.sources.len()).filter(move |&source| !is_counted || !self.schedule.is_silent(source))
    }

    /// Returns the most likely source to walk to: the cheapest likely goal, otherwise the cheapest unviewed source.
    pub(crate) fn choose_source(&self, pose: &Pose2d) -> Option<(usize, SourceEstimate)> {
        let heard: Vec<(usize, SourceEstimate)> = self
            .open_sources()
            .filter_map(|source| Some((source, self.here.sources[source].estimate?)))
            .filter(|(source, _)| !self.is_settled(*source))
            .collect();
        let cost =
            |(source, estimate): &(usize, SourceEstimate)| self.cost_steps(*source, estimate.place, pose);
        let first = |is_wanted: &dyn Fn(usize) -> bool| {
            let wanted = heard.iter().filter(|(source, _)| is_wanted(*source));
            wanted.min_by(|a, b| cost(a).total_cmp(&cost(b))).copied()
        };
        first(&|source| self.is_right_goal(source)).or_else(|| first(&|_| true))
    }

    /// Returns a source's cost in steps: walk or wait, adjusted for past effort, doubt and loyalty.
    fn cost_steps(&self, source: usize, place: FloorPoint, pose: &Pose2d) -> f32 {
        let known = &self.here.sources[source];
        let weights = &self.weights;
        let is_counted = weights.switches.count_windows && !known.is_located(weights);
        let wait_steps = if is_counted { self.schedule.wait_steps(source) as f32 } else { 0.0 };
        let way_m = place.distance_m(pose.place);
        // Near a source, the agent can look for its object before it sounds again.
        let wait_steps = if way_m <= BESIDE_M { BESIDE_SHARE * wait_steps } else { wait_steps };
        let walk_steps = way_m * weights.steps_per_m;
        let loyalty_steps = if self.focus == Some(source) { weights.loyalty_steps } else { 0.0 };
        let vain_steps = weights.vain * known.sought_steps as f32;
        let doubt_steps = weights.doubt_steps * (1.0 - self.right(source));
        let certainty = known.estimate.map_or(0.0, |estimate| estimate.certainty);
        let vague_steps = weights.vague_steps * (1.0 - certainty / weights.certain).max(0.0);
        walk_steps.max(wait_steps) + vain_steps + doubt_steps + vague_steps - loyalty_steps
    }

    /// Counts a step towards a source.
    pub(crate) fn head_for(&mut self, source: usize) {
        self.focus = Some(source);
        self.here.sources[source].sought_steps += 1;
    }

    /// Allows new steps towards all sources without enough views.
    pub(crate) fn seek_again(&mut self) {
        let looks = self.weights.verify_looks;
        for source in self.here.sources.iter_mut().filter(|source| source.looks < looks) {
            source.sought_steps = 0;
        }
    }

    /// Returns the probability that a source belongs to an active goal; 1 without joint association.
    fn right(&self, source: usize) -> f32 {
        if self.weights.switches.joint_association { self.pairing.right(source, &self.mission) } else { 1.0 }
    }

    /// Returns true if a source hardly belongs to an active goal.
    pub(crate) fn is_of_another_goal(&self, source: usize) -> bool {
        const HARDLY: f32 = 0.2;
        self.right(source) < HARDLY
    }

    /// Returns true if a source is likely an active goal, provided that further comparisons can still decide.
    pub(crate) fn is_right_goal(&self, source: usize) -> bool {
        let right = self.right(source);
        if right >= self.weights.commit {
            return true;
        }
        let is_hurry = self.remaining_steps < self.weights.hurry_steps;
        let no_better = || self.open_sources().all(|other| self.right(other) <= right);
        (is_hurry || self.open_sources().all(|other| self.is_settled(other))) && no_better()
    }

    /// Returns true if a source was viewed sufficiently, or sought for too long.
    pub(crate) fn is_settled(&self, source: usize) -> bool {
        let known = &self.here.sources[source];
        known.looks >= self.weights.verify_looks || known.sought_steps >= self.weights.source_steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::memory::{PendingSubmit, SourceMemory};
    use crate::preset::Ablation;
    use crate::preset::Preset;
    use avln_client::{Agent, Mission, TaskSpec};
    use avln_kit::outcome::SubmitOutcome;

    fn agent() -> PagNav {
        let mut agent = PagNav::preset(Preset::PagNavPlus);
        let goals = vec![avln_client::GoalCue::Category("bed".to_owned()); 2];
        agent.begin(&TaskSpec::default(), &Mission { goals, ..Mission::default() });
        agent
    }

    #[test]
    fn louder_sounds_renew_the_effort() {
        let mut source = SourceMemory { sought_steps: 200, ..SourceMemory::default() };
        source.intensity.hear(FloorPoint::default(), 0.01);
        source.approach(0.012);
        assert_eq!(source.sought_steps, 200);
        source.approach(0.014);
        assert_eq!(source.sought_steps, 0);
    }

    #[test]
    fn without_acoustic_memory_only_the_present_window_counts() {
        for no_acoustic_memory in [false, true] {
            let mut agent = agent();
            agent.ablation = Ablation { no_acoustic_memory, ..Ablation::default() };
            let is_known = |agent: &PagNav| [0, 1].map(|index| agent.here.sources[index].estimate.is_some());
            let hear = |agent: &mut PagNav, steps: u32| {
                let heard = HeardSound { itd_s: 0.0, level: 0.1 };
                (0..steps).for_each(|_| agent.listen(Some(heard), &Pose2d::default()));
            };
            let window = agent.window_steps;
            hear(&mut agent, window);
            assert_eq!(is_known(&agent), [true, false]);
            hear(&mut agent, window);
            assert_eq!(is_known(&agent), [!no_acoustic_memory, true]);
            [3.0, 0.0].into_iter().for_each(|height_m| agent.change_storey(height_m));
            assert_eq!(is_known(&agent), [!no_acoustic_memory; 2]);
            // The sound after a Submit belongs to an unknown source.
            hear(&mut agent, 1);
            let outcome = SubmitOutcome::new(agent.silence, 0, &agent.schedule, 0.1);
            agent.pending =
                Some(PendingSubmit { object: None, goal: 0, source: Some(0), heard: Some(outcome) });
            hear(&mut agent, 1);
            assert_eq!(is_known(&agent)[0], !no_acoustic_memory);
        }
    }

    #[test]
    fn sources_without_views_are_sought_again() {
        let mut agent = agent();
        for (source, looks) in [(0, 0), (1, agent.weights.verify_looks)] {
            let memory = &mut agent.here.sources[source];
            (memory.looks, memory.sought_steps) = (looks, agent.weights.source_steps);
            assert!(agent.is_settled(source));
        }
        agent.seek_again();
        assert!(!agent.is_settled(0) && agent.is_settled(1));
    }

    #[test]
    fn vague_and_distant_sources_cost_more() {
        let mut agent = agent();
        let pose = Pose2d::default();
        let mut cost = |certainty: f32, z: f32| {
            let place = FloorPoint::new(0.0, z);
            agent.here.sources[1].estimate = Some(SourceEstimate { place, certainty });
            agent.cost_steps(1, place, &pose)
        };
        assert!((cost(0.0, -20.0) - cost(0.9, -20.0) - 60.0).abs() < 1e-3);
        assert!(cost(0.9, -20.0) > cost(0.9, -4.0));
        // Source 1 sounds in 25 steps; near it, a third of this wait counts less than the way of 4 m.
        assert!((cost(0.9, -4.0) - 24.0).abs() < 1e-3);
    }
}
