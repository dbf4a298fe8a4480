//! Decisions: the next action by stage (search, ground, verify).

use crate::agent::PagNav;
use crate::candidate::{Candidate, Evidence, SoundSupport, Stage, SubmitGate, VerificationDemand, best};
use avln_client::Action;
use avln_kit::geometry::{FloorPoint, Pose2d};
use avln_kit::map::{ObjectHypothesis, Occupancy, SourceEstimate, range_m};

/// Unsuccessful Submits after which a hypothesis is dropped.
const MOST_WRONG: i32 = 3;
/// Steps between searches for stairs.
const STAIRS_EVERY: u32 = 10;

impl PagNav {
    /// Returns the next action, by the stage of the paper.
    pub(crate) fn decide(&mut self, pose: &Pose2d) -> Action {
        if self.remaining_steps <= 1 {
            return Action::Stop;
        }
        if self.pending.is_some() {
            return Action::TurnLeft;
        }
        let wants_stairs = self.wants_stairs();
        if let Some(step) = self.stairs.next_action(pose, &self.motion, wants_stairs) {
            return step;
        }
        let candidate = self.candidate(pose);
        let stage = Stage::of(candidate.as_ref().map(|candidate| self.is_verified(candidate)));
        self.decision.stage = Some(stage);
        self.decision.candidate = candidate;
        let Some(candidate) = candidate.filter(|_| stage != Stage::Search) else {
            return if self.ablation.no_audio { self.wander(pose) } else { self.search(pose) };
        };
        self.head_for(candidate.source);
        let gate = self.gate(&candidate, stage, pose);
        self.decision.gate = Some(gate);
        let nearer = self.weights.nearer.powi(self.object(&candidate).wrong_submits);
        if gate.is_open(nearer * self.weights.submit_m, self.weights.submit_rad)
            && let Some(submit) = self.submit(&candidate, pose)
        {
            return submit;
        }
        let is_near = gate.distance_m <= nearer * self.weights.submit_m && gate.is_verified;
        self.approach(&candidate, is_near, pose)
    }

    /// Returns true if the search on this storey took too long, and it is time to look for stairs.
    fn wants_stairs(&self) -> bool {
        let sought = |source: usize| self.sources[source].sought_steps;
        let sought_steps = match self.focus {
            Some(source) => sought(source),
            None => self.goals.active().map(sought).max().unwrap_or(0),
        };
        // The search is expensive: it runs every few steps only.
        self.remaining_steps.is_multiple_of(STAIRS_EVERY)
            && sought_steps >= self.weights.storey_steps
            && self.remaining_steps > self.weights.hurry_steps
    }

    /// Returns o*: among the goals' best candidates (by S_ground) the first that can be submitted.
    fn candidate(&self, pose: &Pose2d) -> Option<Candidate> {
        let supported: Vec<(usize, Option<usize>, f32)> =
            if self.ablation.no_audio { self.seen() } else { self.supported() };
        let of_goals = self.goals.active().filter_map(|goal| {
            let candidates = supported.iter().map(|&(object, source, sound)| {
                let evidence = self.evidence(object, goal, sound);
                let place = self.place(object, source, pose);
                Candidate { object, goal, source: source.unwrap_or(goal), evidence, place }
            });
            best(candidates.filter(|candidate| !self.is_set_aside(candidate)), &self.weights)
        });
        let cost = |candidate: &Candidate| {
            let wait_steps =
                if self.ablation.no_audio { 0 } else { self.schedule.wait_steps(candidate.source) };
            self.cost_steps(candidate.source, candidate.place, wait_steps, pose)
        };
        of_goals.min_by(|a, b| cost(a).total_cmp(&cost(b)))
    }

    /// Returns hypotheses near sources: object, source, consistency.
    fn supported(&self) -> Vec<(usize, Option<usize>, f32)> {
        const LEAST: f32 = 0.05;
        let open = || (0..self.sources.len()).filter(|&source| !self.schedule.is_silent(source));
        let all = self.objects.all().iter().enumerate();
        all.filter(|(_, object)| object.wrong_submits < MOST_WRONG)
            .filter_map(|(index, object)| {
                let supports = open().map(|source| (index, source, self.sound(object, source)));
                supports.max_by(|a, b| a.2.total_cmp(&b.2))
            })
            .filter(|&(_, _, sound)| sound >= LEAST)
            .map(|(object, source, sound)| (object, Some(source), sound))
            .collect()
    }

    /// Returns the viewed hypotheses without a Submit, for agents without audio.
    fn seen(&self) -> Vec<(usize, Option<usize>, f32)> {
        let all = self.objects.all().iter().enumerate();
        let open = all.filter(|(_, object)| object.wrong_submits == 0 && object.looks > 0);
        open.map(|(index, _)| (index, None, 0.0)).collect()
    }

    /// Returns a hypothesis' consistency with a source's audio memories (s_int in the paper), 0 to 1.
    fn sound(&self, object: &ObjectHypothesis, source: usize) -> f32 {
        let known = &self.sources[source];
        let Some(estimate) = &known.estimate else { return 0.0 };
        let place = object.detection.nearest(estimate.place);
        let heard = SoundSupport {
            off_m: place.distance_m(estimate.place),
            certainty: estimate.certainty,
            loudest_range_m: range_m(known.intensity.loudest()),
            explained: known.intensity.supports(|listener| listener.distance_m(place)),
        };
        heard.consistency(&self.weights)
    }

    /// Returns p(o), the point of a hypothesis nearest to its source (or body): it may be a row of furniture.
    fn place(&self, object: usize, source: Option<usize>, pose: &Pose2d) -> FloorPoint {
        let detection = &self.objects.all()[object].detection;
        let Some(source) = source else { return detection.nearest(pose.place) };
        let heard = self.sources[source].estimate.map(|estimate| detection.nearest(estimate.place));
        heard.unwrap_or_else(|| detection.center())
    }

    fn evidence(&self, object: usize, goal: usize, sound: f32) -> Evidence {
        let known = &self.objects.all()[object];
        let context = self.context(known.detection.center(), goal);
        Evidence { vis: known.vis(goal), context, sound }
    }

    /// Returns true for a viewed candidate that failed verification: others come first until the demand relaxes.
    fn is_set_aside(&self, candidate: &Candidate) -> bool {
        let enough = self.object(candidate).looks >= self.weights.verify_looks;
        let settled = !self.ablation.no_audio && self.is_settled(candidate.source);
        (enough || settled) && !self.is_verified(candidate)
    }

    /// Returns V of the paper: viewed from near, a sufficient fit, and no better source for the goal.
    fn is_verified(&self, candidate: &Candidate) -> bool {
        if self.ablation.no_gate {
            return true;
        }
        let demand = self.demand(candidate);
        let certainty = self.sources[candidate.source].estimate.map_or(0.0, |estimate| estimate.certainty);
        demand.is_met(self.object(candidate).looks, candidate.evidence.vis, certainty)
            && self.is_right_goal(candidate.source)
    }

    fn demand(&self, candidate: &Candidate) -> VerificationDemand {
        if self.ablation.no_audio {
            return self.demand_of_sight(candidate);
        }
        let demand = if self.goals.is_ordered() {
            self.demand_of_sight(candidate)
        } else {
            let sought_steps = self.sources[candidate.source].sought_steps;
            VerificationDemand::of_any(sought_steps, self.remaining_steps, &self.weights)
        };
        if self.goals.is_last() { demand.of_last(self.remaining_steps, &self.weights) } else { demand }
    }

    fn demand_of_sight(&self, candidate: &Candidate) -> VerificationDemand {
        let sought_steps = self.sources[candidate.source].sought_steps;
        let demand = VerificationDemand::after(sought_steps, self.remaining_steps, &self.weights);
        if self.ablation.no_memory { VerificationDemand { looks: 1, ..demand } } else { demand }
    }

    /// Returns the current gate; a wall between body and candidate revokes the verification.
    fn gate(&self, candidate: &Candidate, stage: Stage, pose: &Pose2d) -> SubmitGate {
        let in_sight = self.map.has_clear_line(pose.place, candidate.place);
        SubmitGate {
            is_verified: stage == Stage::Verify && in_sight,
            distance_m: candidate.place.distance_m(pose.place),
            bearing_rad: pose.bearing_rad(candidate.place),
        }
    }

    /// Returns a step towards the candidate's viewpoint, or the turn that faces the candidate.
    fn approach(&mut self, candidate: &Candidate, is_near: bool, pose: &Pose2d) -> Action {
        let facing = self.face(pose, candidate.place);
        if is_near && let Some(turn) = facing {
            return turn;
        }
        let is_seen = self.map.has_clear_line(pose.place, candidate.place);
        self.go_to(candidate.place, is_seen, pose).or(facing).unwrap_or(Action::TurnLeft)
    }

    /// Returns the turn that brings a point into view; `None` if it is in view.
    pub(crate) fn face(&self, pose: &Pose2d, place: FloorPoint) -> Option<Action> {
        let bearing_rad = pose.bearing_rad(place);
        self.motion.turn_toward(bearing_rad).filter(|_| bearing_rad.abs() > self.weights.submit_rad)
    }

    /// Returns true if a source is likely an active goal, provided that further comparisons can still decide.
    pub(crate) fn is_right_goal(&self, source: usize) -> bool {
        if self.ablation.no_audio {
            return true;
        }
        let right = self.goals.right(source);
        let open = || (0..self.sources.len()).filter(|&other| !self.schedule.is_silent(other));
        let no_better = || open().all(|other| self.goals.right(other) <= right);
        let is_hurry = self.remaining_steps < self.weights.hurry_steps;
        let all_settled = is_hurry || open().all(|other| self.is_settled(other));
        right >= self.weights.commit || (all_settled && no_better())
    }

    /// Returns true if a source was viewed sufficiently, or sought for too long.
    pub(crate) fn is_settled(&self, source: usize) -> bool {
        self.is_looked_at(source) || self.sources[source].sought_steps >= self.weights.patience_steps
    }

    /// Returns true if the estimated position of a source was viewed sufficiently.
    pub(crate) fn is_looked_at(&self, source: usize) -> bool {
        self.sources[source].looks >= self.weights.verify_looks
    }

    fn object(&self, candidate: &Candidate) -> &ObjectHypothesis {
        &self.objects.all()[candidate.object]
    }
}

/// Distance to an estimated source at which a path ends, metres.
const REACH_M: f32 = 0.5;
/// Distance to a frontier at which a path ends, metres.
const FRONTIER_M: f32 = 0.2;
/// Nearer frontiers are already in view, metres.
const NEAR_M: f32 = 0.4;
/// Steps for which a frontier stays the target.
const KEPT_STEPS: u32 = 12;

impl PagNav {
    /// Cue-guided search: walks to a source if a path is known, else to the best frontier.
    pub(crate) fn search(&mut self, pose: &Pose2d) -> Action {
        let Some((source, estimate)) = self.choose(pose) else { return Action::TurnLeft };
        self.head_for(source);
        let is_there = estimate.certainty >= self.weights.certain
            && estimate.place.distance_m(pose.place) <= self.weights.arrived_m
            && self.map.has_clear_line(pose.place, estimate.place);
        if is_there {
            self.suppose(source, estimate.place);
        }
        let onward = self.go_to(estimate.place, is_there, pose);
        let onward = onward.or_else(|| self.face(pose, estimate.place).filter(|_| is_there));
        onward.unwrap_or(Action::TurnLeft)
    }

    /// Returns a step towards a point, directly or by the best frontier; `None` at the nearest position.
    pub(crate) fn go_to(&mut self, place: FloorPoint, is_seen: bool, pose: &Pose2d) -> Option<Action> {
        let path = self.follower.path_to(&self.map, pose.place, place, REACH_M);
        let step = self.motion.follow(&path, pose, &self.map);
        let end = path.places.last().copied().unwrap_or(pose.place);
        let leads_there = path.left_m <= self.weights.lost_m && self.map.has_clear_line(end, place);
        if is_seen || (leads_there && step.is_some()) {
            return step;
        }
        self.explore(place, pose).or(step)
    }

    /// Adds a supposed object at a viewed source without any detection.
    fn suppose(&mut self, source: usize, place: FloorPoint) {
        const AT_M: f32 = 0.2;
        let is_known = || self.objects.all().iter().any(|object| object.detection.distance_m(place) <= AT_M);
        if self.is_settled(source) && !is_known() {
            self.objects.suppose(place);
        }
    }

    /// Returns the cheapest likely goal, otherwise the cheapest unviewed source, otherwise the cheapest.
    fn choose(&self, pose: &Pose2d) -> Option<(usize, SourceEstimate)> {
        let open = (0..self.sources.len()).filter(|&source| !self.schedule.is_silent(source));
        let heard: Vec<(usize, SourceEstimate)> =
            open.filter_map(|source| Some((source, self.sources[source].estimate?))).collect();
        let cost = |(source, estimate): &(usize, SourceEstimate)| {
            let is_located = self.sources[*source].is_located(&self.weights);
            let wait_steps = if is_located { 0 } else { self.schedule.wait_steps(*source) };
            let doubt_steps = self.weights.doubt_steps * (1.0 - self.goals.right(*source));
            self.cost_steps(*source, estimate.place, wait_steps, pose) + doubt_steps
        };
        let first = |wanted: &dyn Fn(usize) -> bool| {
            let wanted = heard.iter().filter(|(source, _)| wanted(*source));
            wanted.min_by(|a, b| cost(a).total_cmp(&cost(b))).copied()
        };
        first(&|source| self.is_right_goal(source) && !self.is_settled(source))
            .or_else(|| first(&|source| !self.is_settled(source)))
            .or_else(|| first(&|source| self.is_right_goal(source) && self.is_looked_at(source)))
            .or_else(|| first(&|source| !self.is_looked_at(source)))
            .or_else(|| first(&|_| true))
    }

    /// Returns a source's cost in steps: walk or wait, adjusted for past effort and loyalty.
    pub(crate) fn cost_steps(&self, source: usize, place: FloorPoint, wait_steps: u32, pose: &Pose2d) -> f32 {
        let walk_steps = place.distance_m(pose.place) * self.weights.steps_per_m;
        let loyalty_steps = if self.focus == Some(source) { self.weights.loyalty_steps } else { 0.0 };
        let vain_steps = self.weights.vain * self.sources[source].sought_steps as f32;
        walk_steps.max(wait_steps as f32) + vain_steps - loyalty_steps
    }

    /// Counts a step towards a source.
    pub(crate) fn head_for(&mut self, source: usize) {
        self.focus = Some(source);
        self.sources[source].sought_steps += 1;
    }

    /// Search without sound by the best S_search; if everything is explored, the map is cleared.
    pub(crate) fn wander(&mut self, pose: &Pose2d) -> Action {
        if let Some(step) = self.explore(pose.place, pose) {
            return step;
        }
        let goals: Vec<usize> = self.goals.active().collect();
        goals.into_iter().for_each(|goal| self.sources[goal].sought_steps += self.weights.patience_steps);
        self.map = Occupancy::default();
        Action::TurnLeft
    }

    /// Returns a step towards the frontier with the best S_search (the paper's x*), kept for several steps.
    fn explore(&mut self, heard: FloorPoint, pose: &Pose2d) -> Option<Action> {
        let kept =
            self.frontier.filter(|(place, _, steps)| *steps > 0 && place.distance_m(pose.place) > NEAR_M);
        let best = kept.map(|(place, score, _)| (place, score)).or_else(|| self.frontier(heard, pose))?;
        let steps = kept.map_or(KEPT_STEPS, |(_, _, steps)| steps) - 1;
        self.frontier = Some((best.0, best.1, steps));
        self.decision.frontier = Some(best);
        let path = self.frontier_follower.path_to(&self.map, pose.place, best.0, FRONTIER_M);
        self.motion.follow(&path, pose, &self.map)
    }

    /// Returns the frontier with the best S_search, and the score.
    fn frontier(&self, heard: FloorPoint, pose: &Pose2d) -> Option<(FloorPoint, f32)> {
        const LOOKED_AT: usize = 8;
        let sound = |place: FloorPoint| {
            self.weights.search_audio * libm::expf(-place.distance_m(heard) / self.weights.search_scale_m)
                - self.weights.search_way * place.distance_m(pose.place)
        };
        let frontiers = self.map.frontiers().into_iter().map(|(place, _)| (sound(place), place));
        let mut scored: Vec<(f32, FloorPoint)> =
            frontiers.filter(|(_, place)| place.distance_m(pose.place) > NEAR_M).collect();
        scored.sort_by(|a, b| b.0.total_cmp(&a.0));
        scored.truncate(LOOKED_AT);
        for (score, place) in &mut scored {
            *score += self.weights.search_context * self.expects(*place);
        }
        scored.into_iter().max_by(|a, b| a.0.total_cmp(&b.0)).map(|(score, place)| (place, score))
    }

    /// Returns the support from rooms and objects around a frontier for the active goals (P_room and P_obj), 0 to 1.
    fn expects(&self, place: FloorPoint) -> f32 {
        let fits = self.goals.active().map(|goal| self.context(place, goal));
        fits.fold(0.0, f32::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::weights::Weights;
    use avln_client::{DepthImage, Pose, TaskSpec};
    use avln_kit::geometry::PinholeCamera;
    use std::f32::consts::FRAC_PI_2;

    const SIDE: u32 = 64;

    fn pose(position: [f32; 3]) -> Pose2d {
        Pose2d::new(&Pose { position, heading_rad: 0.0 })
    }

    /// An agent that has seen a whole closed room, 6 m by 6 m, from the middle.
    fn agent() -> PagNav {
        let depth_m = |row: u32| match (row as f32 + 0.5 - 32.0) / 32.0 {
            down if down > 0.0 => (1.0 / down).min(3.02),
            _ => 3.02,
        };
        let metres = (0..SIDE * SIDE).map(|pixel| depth_m(pixel / SIDE)).collect();
        let depth = DepthImage { width: SIDE, height: SIDE, metres };
        let mut agent = PagNav::new(Weights::default());
        let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
        for quarter in 0..4 {
            let heading_rad = quarter as f32 * FRAC_PI_2;
            let pose = Pose2d::new(&Pose { position: [0.0; 3], heading_rad });
            (0..3).for_each(|_| agent.map.see(&PinholeCamera::new(&task), &pose, &depth));
        }
        agent
    }

    #[test]
    fn agent_explores_when_a_wall_blocks_the_path() {
        let mut agent = agent();
        let beyond = FloorPoint::new(0.0, -6.0);
        assert!(agent.go_to(beyond, false, &pose([0.0, 0.0, -1.0])).is_some());
        assert!(agent.decision.frontier.is_some());
    }

    #[test]
    fn agent_takes_known_paths() {
        let mut agent = agent();
        let ahead = FloorPoint::new(0.0, -2.0);
        assert_eq!(agent.go_to(ahead, true, &pose([0.0; 3])), Some(Action::MoveForward));
        assert!(agent.go_to(ahead, false, &pose([0.0; 3])).is_some() && agent.decision.frontier.is_none());
        assert_eq!(agent.go_to(ahead, true, &pose([0.0, 0.0, -1.8])), None);
    }
}
