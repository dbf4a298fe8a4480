//! Decisions, the next action by stage (search, ground, verify), and the search: the frontier with the best S_search, and direct
//! approaches to estimated sources.

use crate::agent::PagNav;
use crate::candidate::{Candidate, Stage};
use crate::verify::{Readiness, SubmitGate, Verification, VerificationDemand};
use avln_client::Action;
use avln_kit::geometry::{FloorPoint, Pose2d};
use avln_kit::map::{Cell, FreshLook, NEUTRAL, Occupancy, SourceEstimate, range_m};
use avln_kit::path::ReachField;

impl PagNav {
    /// Returns the next action, by the stage of the paper.
    pub(crate) fn decide(&mut self, pose: &Pose2d) -> Action {
        if self.pending.is_some() {
            return Action::TurnLeft;
        }
        let candidate = self.select(pose);
        if let Some(step) = self.climb(pose, candidate.is_none()) {
            return step;
        }
        let Some(candidate) = candidate else {
            self.aim = None;
            self.decision.stage = Some(Stage::Search);
            return self.search(pose);
        };
        self.pursue(&candidate, pose)
    }

    /// Grounds or verifies a candidate; at an open gate claims it.
    fn pursue(&mut self, candidate: &Candidate, pose: &Pose2d) -> Action {
        self.aim_at(candidate, pose);
        self.focus = candidate.source;
        let (gate, stage) = (self.gate(candidate, pose), self.stage(candidate));
        self.decision.stage = Some(stage);
        (self.decision.candidate, self.decision.gate) = (Some(*candidate), Some(gate));
        let warrant = gate.warrant(&self.weights).filter(|_| stage == Stage::Verify);
        let warrant = warrant.or_else(|| gate.ungated(self.ablation, &self.weights));
        let Some(warrant) = warrant else { return self.approach(candidate, pose) };
        match self.readiness(candidate) {
            Readiness::Now => self.claim(candidate, warrant),
            Readiness::Wait => self.wait(candidate, pose),
            Readiness::Unheard => {
                self.set_aside(candidate);
                Action::TurnLeft
            }
        }
    }

    /// Returns Verify for a confirmed candidate: enough looks with a mean above the floor; otherwise Ground.
    fn stage(&self, candidate: &Candidate) -> Stage {
        let object = &self.here.objects.all()[candidate.object];
        let demand = self.demand(candidate);
        let is_confirmed = object.looks >= demand.looks && candidate.evidence.vis >= demand.floor;
        if is_confirmed { Stage::Verify } else { Stage::Ground }
    }

    fn demand(&self, candidate: &Candidate) -> VerificationDemand {
        let sought_steps = self.sought_steps(candidate.object, candidate.goal);
        let floor = self.weights.least_vis(self.is_supported(candidate));
        let demand = VerificationDemand::new(sought_steps, self.remaining_steps, floor, &self.weights);
        let has_one_look = self.ablation.no_object_memory || self.ablation.no_second_look;
        if has_one_look { demand.of_one_look() } else { demand }
    }

    /// Returns the gate of the current frame.
    fn gate(&self, candidate: &Candidate, pose: &Pose2d) -> SubmitGate {
        let best = self.best_look(candidate);
        SubmitGate {
            fresh_vis: best.map(|look| look.vis(candidate.goal)),
            verification: best.and_then(|look| self.verification(candidate, look)),
            distance_m: candidate.place.distance_m(pose.place),
            bearing_rad: pose.bearing_rad(candidate.place),
            is_in_sight: self.here.map.has_clear_line(pose.place, candidate.place),
        }
    }

    /// Returns the look of the current frame at the candidate with the highest s_vis.
    fn best_look(&self, candidate: &Candidate) -> Option<&FreshLook> {
        let goal = candidate.goal;
        let at_it = self.fresh.iter().filter(|look| look.object() == candidate.object);
        at_it.max_by(|a, b| a.vis(goal).total_cmp(&b.vis(goal)))
    }

    /// Returns V of the paper by a look of the current frame at the candidate.
    fn verification(&self, candidate: &Candidate, look: &FreshLook) -> Option<Verification> {
        let looks = self.here.objects.all()[candidate.object].looks;
        Verification::of(look, candidate.goal, looks, self.demand(candidate))
    }
}

/// Distance to an estimated source at which a path ends, metres.
const REACH_M: f32 = 0.5;
/// Distance to a frontier at which a path ends, metres.
const FRONTIER_M: f32 = 0.2;
/// Nearer frontiers are already in view, metres.
const NEAR_M: f32 = 0.4;
/// Radius around a visited frontier without another one, metres.
const SAME_M: f32 = 0.4;
/// Greatest path to a frontier, metres on open floor.
const FAR_M: f32 = 200.0;
/// Steps between searches for stairs.
const STAIRS_EVERY: u32 = 10;

impl PagNav {
    /// Cue-guided search: a step towards the best frontier, or with `direct_approach` towards an estimated source.
    pub(crate) fn search(&mut self, pose: &Pose2d) -> Action {
        self.searched_steps += 1;
        let chosen = if self.weights.switches.source_positions { self.choose_source(pose) } else { None };
        self.focus = None;
        if chosen.is_none() {
            self.seek_again();
        }
        if let Some((source, estimate)) = chosen {
            self.head_for(source);
            // A vague estimate changes from step to step, mostly around the agent: walking to it would be turning to and fro.
            let direct = self.weights.switches.direct_approach && estimate.certainty >= self.weights.vague;
            let step = if direct { self.approach_source(source, estimate, pose) } else { None };
            if let Some(step) = step {
                return step;
            }
        }
        self.explore(pose).unwrap_or_else(|| self.search_again())
    }

    /// Returns a step towards an estimated source, or a turn to look around there; `None` without a known path.
    fn approach_source(&mut self, source: usize, estimate: SourceEstimate, pose: &Pose2d) -> Option<Action> {
        /// Additional effort of a step without movement: turning in place must end soon.
        const IDLE_STEPS: u32 = 4;
        let is_there = estimate.certainty >= self.weights.certain
            && estimate.place.distance_m(pose.place) <= self.weights.arrived_m
            && self.here.map.has_clear_line(pose.place, estimate.place);
        let onward = self.path_step(estimate.place, pose);
        if !is_there {
            return onward.filter(|(_, leads_there)| *leads_there).map(|(step, _)| step);
        }
        if onward.is_none() {
            self.here.sources[source].sought_steps += IDLE_STEPS;
        }
        let facing = self.face(pose, estimate.place);
        Some(onward.map(|(step, _)| step).or(facing).unwrap_or(Action::TurnLeft))
    }

    /// Returns a step towards a point, and whether the path leads to it; `None` at the nearest position.
    pub(crate) fn path_step(&mut self, place: FloorPoint, pose: &Pose2d) -> Option<(Action, bool)> {
        let path = self.follower.path_to(&self.here.map, pose.place, place, REACH_M);
        let end = path.places.last().copied().unwrap_or(pose.place);
        let leads_there = path.left_m <= self.weights.lost_m && self.here.map.has_clear_line(end, place);
        self.motion.follow(&path, pose, &self.here.map).map(|step| (step, leads_there))
    }

    /// Begins another search after everything reachable was explored: the map is cleared, and set-aside candidates return.
    fn search_again(&mut self) -> Action {
        self.here.map = Occupancy::default();
        self.here.sought.clear();
        self.here.waited.clear();
        self.here.visited.clear();
        self.searched_steps = self.searched_steps.max(self.weights.storey_steps);
        self.frontier = None;
        Action::TurnLeft
    }

    /// Returns a step towards the frontier x* = argmax S_search, kept for several steps.
    fn explore(&mut self, pose: &Pose2d) -> Option<Action> {
        if let Some((place, ..)) = self.frontier.filter(|(place, ..)| place.distance_m(pose.place) <= NEAR_M)
        {
            self.here.visited.push(place);
            self.frontier = None;
        }
        let kept = self.frontier.filter(|(place, _, steps)| *steps > 0 && !self.is_explored(*place));
        let best = kept.map(|(place, score, _)| (place, score)).or_else(|| self.best_frontier(pose))?;
        let steps = kept.map_or(self.weights.keep_steps, |(_, _, steps)| steps) - 1;
        self.frontier = Some((best.0, best.1, steps));
        self.decision.frontier = Some(best);
        let path = self.frontier_follower.path_to(&self.here.map, pose.place, best.0, FRONTIER_M);
        let step = self.motion.follow(&path, pose, &self.here.map);
        if step.is_none() {
            // The frontier cannot be seen from nearer: another one is next.
            self.here.visited.push(best.0);
            self.frontier = None;
        }
        step.or(Some(Action::TurnLeft))
    }

    /// Returns true without unseen cells around a former frontier.
    fn is_explored(&self, place: FloorPoint) -> bool {
        const AROUND: i32 = 6;
        let cell = Cell::at(place);
        let mut around =
            (-AROUND..=AROUND).flat_map(|dc| (-AROUND..=AROUND).map(move |dr| cell.moved(dc, dr)));
        !around.any(|cell| self.here.map.is_unknown(cell))
    }

    /// Returns the reachable frontier representative with the best S_search for the first open goal, and the score; the shorter way
    /// decides ties.
    fn best_frontier(&mut self, pose: &Pose2d) -> Option<(FloorPoint, f32)> {
        let goal = self.mission.active().next()?;
        self.weigh_bearings(goal);
        let is_new =
            |place: FloorPoint| self.here.visited.iter().all(|other| other.distance_m(place) > SAME_M);
        let frontiers = self.here.map.frontiers().into_iter().map(|(place, _)| place);
        let far: Vec<FloorPoint> =
            frontiers.filter(|&place| place.distance_m(pose.place) > NEAR_M && is_new(place)).collect();
        let reachable = |through_unknown: bool| -> Vec<(FloorPoint, f32)> {
            let field = ReachField::new(&self.here.map, pose.place, FAR_M, through_unknown);
            far.iter().filter_map(|&place| Some((place, field.cost_m(place)?))).collect()
        };
        let known = reachable(false);
        let all = if known.is_empty() && !far.is_empty() { reachable(true) } else { known };
        let scored: Vec<(FloorPoint, f32, f32)> =
            all.into_iter().map(|(place, way_m)| (place, self.search_score(place, goal), way_m)).collect();
        let top = scored.iter().map(|(_, score, _)| *score).fold(f32::NEG_INFINITY, f32::max);
        let tied = scored.into_iter().filter(|(_, score, _)| *score >= top - self.weights.search_tie);
        tied.min_by(|a, b| a.2.total_cmp(&b.2)).map(|(place, score, _)| (place, score))
    }

    /// Returns S_search(x, g) = lambda_r P_room(g | r(x)) + lambda_o P_obj(g | N_obj(x)) + lambda_a s_aud(x, g).
    pub(crate) fn search_score(&self, place: FloorPoint, goal: usize) -> f32 {
        let weights = &self.weights;
        weights.search_room * self.room_prior(place, goal)
            + weights.search_object * self.object_prior(place, goal)
            + weights.search_audio * self.sound_alignment(place, goal)
    }

    /// Returns P_room(g | r(x)), 0 to 1.
    fn room_prior(&self, place: FloorPoint, goal: usize) -> f32 {
        if self.ablation.no_priors {
            return NEUTRAL;
        }
        self.priors[goal].room(&self.here.rooms.around(&self.here.map, place))
    }

    /// Returns P_obj(g | N_obj(x)), 0 to 1.
    fn object_prior(&self, place: FloorPoint, goal: usize) -> f32 {
        if self.ablation.no_priors {
            return NEUTRAL;
        }
        self.priors[goal].objects(&self.here.objects, place, None)
    }

    /// Returns s_aud(x, g), 0 to 1: the alignment with the bearing memory, or the nearness to the focused estimated source.
    fn sound_alignment(&self, place: FloorPoint, goal: usize) -> f32 {
        let estimate = self.focus.and_then(|source| self.here.sources.get(source)?.estimate);
        let is_known = |estimate: &SourceEstimate| {
            self.weights.switches.source_positions && estimate.certainty >= self.weights.vague
        };
        match estimate.filter(is_known) {
            Some(estimate) => libm::expf(-place.distance_m(estimate.place) / self.weights.search_scale_m),
            None => self.here.bearings[goal].alignment(place, self.step, self.weights.half_life_steps),
        }
    }

    /// Weights a goal's bearing memory by the present map: explored space without a candidate speaks against a beam.
    fn weigh_bearings(&mut self, goal: usize) {
        const AT_M: f32 = 1.0;
        let (map, objects, associate) = (&self.here.map, &self.here.objects, self.weights.associate);
        let candidates: Vec<FloorPoint> = objects
            .all()
            .iter()
            .filter(|object| object.wrong_submits == 0 && object.vis(goal) >= associate)
            .map(|object| object.detection.center())
            .collect();
        let is_explained = |place: FloorPoint| {
            !map.is_unknown(Cell::at(place)) && candidates.iter().all(|other| other.distance_m(place) > AT_M)
        };
        self.here.bearings[goal].weigh(range_m, is_explained);
    }

    /// Returns a step on stairs, if the agent is on some or the search on this storey took too long.
    pub(crate) fn climb(&mut self, pose: &Pose2d, may_start: bool) -> Option<Action> {
        if !self.weights.switches.stairs {
            return None;
        }
        // The search is expensive: it runs every few steps only.
        let is_wanted = may_start
            && self.remaining_steps.is_multiple_of(STAIRS_EVERY)
            && self.searched_steps as f32 >= self.storey_steps()
            && self.remaining_steps > self.weights.hurry_steps;
        self.stairs.next_action(pose, &self.motion, is_wanted)
    }

    /// Returns the steps of search before another storey: more if a source is near by its level, fewer if all are distant.
    fn storey_steps(&self) -> f32 {
        const NEAR_M: f32 = 6.0;
        const DISTANT_M: f32 = 12.0;
        let loudest = self.open_sources().map(|source| self.here.sources[source].intensity.loudest());
        let share = match range_m(loudest.fold(0.0, f32::max)) {
            _ if !self.weights.switches.source_positions => 1.0,
            near_m if near_m < NEAR_M => 2.5,
            distant_m if distant_m > DISTANT_M => 0.5,
            _ => 1.0,
        };
        share * self.weights.storey_steps as f32
    }

    /// Returns the turn that brings a point into view; `None` if it is in view.
    pub(crate) fn face(&self, pose: &Pose2d, place: FloorPoint) -> Option<Action> {
        let bearing_rad = pose.bearing_rad(place);
        self.motion.turn_toward(bearing_rad).filter(|_| bearing_rad.abs() > self.weights.submit_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::{Ablation, Preset};
    use avln_client::{Agent, DepthImage, GoalCue, Mission, Pose, TaskSpec};
    use avln_kit::geometry::PinholeCamera;
    use avln_kit::hearing::{HeardSound, itd_s};
    use std::f32::consts::FRAC_PI_2;

    const SIDE: u32 = 64;

    fn pose(position: [f32; 3], heading_rad: f32) -> Pose2d {
        Pose2d::new(&Pose::new(position, heading_rad))
    }

    /// An agent that has seen open floor ahead, and nothing to the sides and behind.
    fn agent(preset: Preset, ablation: Ablation) -> PagNav {
        let depth_m = |row: u32| match (row as f32 + 0.5 - 32.0) / 32.0 {
            down if down > 0.0 => 1.0 / down,
            _ => 9.0,
        };
        let metres = (0..SIDE * SIDE).map(|pixel| depth_m(pixel / SIDE)).collect();
        let depth = DepthImage { width: SIDE, height: SIDE, metres };
        let mut agent = PagNav::preset(preset).without(ablation);
        let task = TaskSpec { width: SIDE, height: SIDE, ..TaskSpec::default() };
        let goals = vec![GoalCue::Category("bed".to_owned()); 2];
        agent.begin(&task, &Mission { goals, ..Mission::default() });
        (0..3).for_each(|_| agent.here.map.see(&PinholeCamera::new(&task), &pose([0.0; 3], 0.0), &depth));
        agent
    }

    /// Adds a sound from the direction of a point, heard at several headings.
    fn hear(agent: &mut PagNav, from: FloorPoint) {
        for turn in 0..6 {
            let pose = pose([0.0; 3], turn as f32 * FRAC_PI_2 / 3.0);
            let heard = HeardSound { itd_s: itd_s(pose.bearing_rad(from)), level: 0.05 };
            agent.here.bearings[0].hear(&pose, &heard, turn);
        }
    }

    #[test]
    fn frontiers_in_the_direction_of_sound_win() {
        let mut agent = agent(Preset::PagNav, Ablation::default());
        for x in [-9.0, 9.0] {
            agent.here.bearings[0].clear();
            hear(&mut agent, FloorPoint::new(x, -9.0));
            let (place, _) = agent.best_frontier(&pose([0.0; 3], 0.0)).unwrap();
            assert!(place.x * x > 0.0, "{place:?} for a source at {x}");
        }
    }

    #[test]
    fn score_is_the_weighted_sum() {
        let mut agent = agent(Preset::PagNav, Ablation::default());
        (agent.weights.search_room, agent.weights.search_object, agent.weights.search_audio) =
            (0.5, 0.25, 2.0);
        hear(&mut agent, FloorPoint::new(0.0, -9.0));
        let place = FloorPoint::new(0.0, -3.0);
        let audio = agent.here.bearings[0].alignment(place, agent.step, agent.weights.half_life_steps);
        let room = agent.priors[0].room(&Default::default());
        let expected = 0.5 * room + 0.25 * NEUTRAL + 2.0 * audio;
        assert!((agent.search_score(place, 0) - expected).abs() < 1e-5 && audio > 0.5);
        agent.ablation.no_priors = true;
        assert!((agent.search_score(place, 0) - (0.75 * NEUTRAL + 2.0 * audio)).abs() < 1e-5);
    }

    #[test]
    fn search_restarts_when_all_is_explored() {
        let mut agent = agent(Preset::PagNav, Ablation::default());
        agent.here.map = Occupancy::default();
        agent.here.sought.insert((0, 0), 999);
        assert_eq!(agent.search(&pose([0.0; 3], 0.0)), Action::TurnLeft);
        assert!(agent.here.sought.is_empty());
    }

    #[test]
    fn frontiers_stay_the_target() {
        let mut agent = agent(Preset::PagNav, Ablation { no_audio: true, ..Ablation::default() });
        let here = pose([0.0; 3], 0.0);
        agent.search(&here);
        let first = agent.decision.frontier.unwrap().0;
        for _ in 0..agent.weights.keep_steps - 1 {
            agent.search(&here);
            assert_eq!(agent.decision.frontier.unwrap().0, first);
        }
    }

    /// Adds an estimated source, heard at a level from the start.
    fn locate(agent: &mut PagNav, source: usize, place: FloorPoint, certainty: f32, level: f32) {
        let memory = &mut agent.here.sources[source];
        memory.estimate = Some(SourceEstimate { place, certainty });
        memory.intensity.hear(FloorPoint::default(), level);
    }

    #[test]
    fn current_source_keeps_its_advantage() {
        let mut agent = agent(Preset::PagNavPlus, Ablation::default());
        for (source, x) in [(0, -2.0), (1, 2.1)] {
            locate(&mut agent, source, FloorPoint::new(x, -6.0), 0.9, 0.1);
        }
        let here = pose([0.0; 3], 0.0);
        for focus in [0, 1] {
            agent.focus = Some(focus);
            agent.search(&here);
            assert_eq!(agent.focus, Some(focus));
        }
    }

    #[test]
    fn vague_estimates_are_explored() {
        let here = pose([0.0; 3], 0.0);
        for (certainty, is_explored) in [(0.05, true), (0.4, false)] {
            let mut agent = agent(Preset::PagNavPlus, Ablation::default());
            locate(&mut agent, 0, FloorPoint::new(0.0, -3.0), certainty, 0.01);
            agent.search(&here);
            assert_eq!((agent.decision.frontier.is_some(), agent.focus), (is_explored, Some(0)));
        }
    }

    #[test]
    fn near_sources_keep_the_storey() {
        let mut agent = agent(Preset::PagNavPlus, Ablation::default());
        let usual_steps = agent.weights.storey_steps as f32;
        for (level, share) in [(1e-4, 0.5), (0.015, 1.0), (0.1, 2.5)] {
            locate(&mut agent, 0, FloorPoint::default(), 0.1, level);
            assert_eq!(agent.storey_steps(), share * usual_steps, "{level}");
        }
    }
}
