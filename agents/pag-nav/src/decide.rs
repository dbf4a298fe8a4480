use crate::agent::PagNav;
use crate::planner::{Candidate, Demand, Evidence, Gate, HeardThere, Stage, best};
use avln_client::Action;
use avln_kit::{
    map::{Object, range_m},
    perception::{Place, Stand},
};

/// Submits at one hypothesis after which it is no candidate any more.
const MOST_WRONG: i32 = 3;

impl PagNav {
    /// The next action, by the stage that the grounding of the goals has reached.
    pub(crate) fn decide(&mut self, stand: &Stand) -> Action {
        if self.remaining_steps <= 1 {
            return Action::Stop;
        }
        if self.claim.is_some() {
            return Action::TurnLeft;
        }
        if let Some(step) = self.take_stairs(stand) {
            return step;
        }
        let candidate = self.candidate(stand);
        let stage = Stage::of(candidate.as_ref().map(|candidate| self.is_verified(candidate)));
        (self.thought.stage, self.thought.candidate) = (Some(stage), candidate);
        let Some(candidate) = candidate.filter(|_| stage != Stage::Search) else {
            return if self.ablation.no_audio { self.wander(stand) } else { self.search(stand) };
        };
        self.head_for(candidate.source);
        let gate = self.gate(&candidate, stage, stand);
        self.thought.gate = Some(gate);
        let nearer = self.weights.nearer.powi(self.object(&candidate).wrong_submits);
        if gate.is_open(nearer * self.weights.submit_m, self.weights.submit_rad)
            && let Some(submit) = self.submit(&candidate, stand)
        {
            return submit;
        }
        let is_near = gate.distance_m <= nearer * self.weights.submit_m && gate.is_verified;
        self.approach(&candidate, is_near, stand)
    }

    /// o*: of each goal that may be next the candidate with the best S_ground, and of these the one that can be
    /// submitted first.
    fn candidate(&self, stand: &Stand) -> Option<Candidate> {
        let supported: Vec<(usize, Option<usize>, f32)> =
            if self.ablation.no_audio { self.seen() } else { self.supported() };
        let of_goals = self.goals.active().filter_map(|goal| {
            let candidates = supported.iter().map(|&(object, source, sound)| {
                let evidence = self.evidence(object, goal, sound);
                let place = self.place(object, source, stand);
                Candidate { object, goal, source: source.unwrap_or(goal), evidence, place }
            });
            best(candidates.filter(|candidate| !self.is_set_aside(candidate)), &self.weights)
        });
        let cost = |candidate: &Candidate| {
            let wait_steps = if self.ablation.no_audio { 0 } else { self.turns.wait_steps(candidate.source) };
            self.cost_steps(candidate.source, candidate.place, wait_steps, stand)
        };
        of_goals.min_by(|a, b| cost(a).total_cmp(&cost(b)))
    }

    /// The hypotheses at which a source may be: object, source, consistency with its sound.
    fn supported(&self) -> Vec<(usize, Option<usize>, f32)> {
        const LEAST: f32 = 0.05;
        let open = || (0..self.sources.len()).filter(|&source| !self.turns.is_silent(source));
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

    /// The hypotheses at which nothing was submitted, for an agent that hears no sources.
    fn seen(&self) -> Vec<(usize, Option<usize>, f32)> {
        let all = self.objects.all().iter().enumerate();
        let open = all.filter(|(_, object)| object.wrong_submits == 0 && object.looks > 0);
        open.map(|(index, _)| (index, None, 0.0)).collect()
    }

    /// Consistency of a hypothesis with the audio memories of a source (s_int of the paper), 0 to 1: how near it is to
    /// where the source is believed to be, how certain that is, and how well it explains where the sound was loud.
    fn sound(&self, object: &Object, source: usize) -> f32 {
        let known = &self.sources[source];
        let Some(estimate) = &known.estimate else { return 0.0 };
        let place = object.thing.nearest(estimate.place);
        let heard = HeardThere {
            off_m: place.distance_m(estimate.place),
            certainty: estimate.certainty,
            loudest_range_m: range_m(known.intensity.loudest()),
            explained: known.intensity.supports(|listener| listener.distance_m(place)),
        };
        heard.consistency(&self.weights)
    }

    /// p(o): the place of a hypothesis that is nearest to where its sound is believed to come from, since what was seen
    /// as one thing may be a whole row of furniture; without a sound the nearest to the body.
    fn place(&self, object: usize, source: Option<usize>, stand: &Stand) -> Place {
        let thing = &self.objects.all()[object].thing;
        let Some(source) = source else { return thing.nearest(stand.place) };
        let heard = self.sources[source].estimate.map(|estimate| thing.nearest(estimate.place));
        heard.unwrap_or_else(|| thing.center())
    }

    fn evidence(&self, object: usize, goal: usize, sound: f32) -> Evidence {
        let known = &self.objects.all()[object];
        let context = self.context(known.thing.center(), goal);
        Evidence { vis: known.vis(goal), context, sound }
    }

    /// Whether a candidate has been looked at in vain: others, and search, come first until the demand relaxes.
    fn is_set_aside(&self, candidate: &Candidate) -> bool {
        let enough = self.object(candidate).looks >= self.weights.verify_looks;
        let settled = !self.ablation.no_audio && self.is_settled(candidate.source);
        (enough || settled) && !self.is_verified(candidate)
    }

    /// V of the paper: looked at from near, seen to fit the goal, and no other goal has a better claim to its sound.
    fn is_verified(&self, candidate: &Candidate) -> bool {
        if self.ablation.no_gate {
            return true;
        }
        let demand = self.demand(candidate);
        let certainty = self.sources[candidate.source].estimate.map_or(0.0, |estimate| estimate.certainty);
        demand.is_met(self.object(candidate).looks, candidate.evidence.vis, certainty)
            && self.is_right_goal(candidate.source)
    }

    /// What verification asks of a candidate now.
    fn demand(&self, candidate: &Candidate) -> Demand {
        if self.ablation.no_audio {
            return self.demand_of_sight(candidate);
        }
        let demand = if self.goals.is_ordered() {
            self.demand_of_sight(candidate)
        } else {
            let sought_steps = self.sources[candidate.source].sought_steps;
            Demand::of_any(sought_steps, self.remaining_steps, &self.weights)
        };
        if self.goals.is_last() { demand.of_last(self.remaining_steps, &self.weights) } else { demand }
    }

    fn demand_of_sight(&self, candidate: &Candidate) -> Demand {
        let sought_steps = self.sources[candidate.source].sought_steps;
        let demand = Demand::after(sought_steps, self.remaining_steps, &self.weights);
        if self.ablation.no_memory { Demand { looks: 1, ..demand } } else { demand }
    }

    /// The gate here and now; a wall between body and candidate takes its verification away.
    fn gate(&self, candidate: &Candidate, stage: Stage, stand: &Stand) -> Gate {
        let in_sight = self.map.hears(stand.place, candidate.place);
        Gate {
            is_verified: stage == Stage::Verify && in_sight,
            distance_m: candidate.place.distance_m(stand.place),
            bearing_rad: stand.bearing_rad(candidate.place),
        }
    }

    /// A step towards a viewpoint of a candidate, or the turn that faces it.
    fn approach(&mut self, candidate: &Candidate, is_near: bool, stand: &Stand) -> Action {
        let facing = self.face(stand, candidate.place);
        if is_near && let Some(turn) = facing {
            return turn;
        }
        let is_seen = self.map.hears(stand.place, candidate.place);
        self.go_to(candidate.place, is_seen, stand).or(facing).unwrap_or(Action::TurnLeft)
    }

    /// The turn that brings a place into view; `None` when it is.
    pub(crate) fn face(&self, stand: &Stand, place: Place) -> Option<Action> {
        let bearing_rad = stand.bearing_rad(place);
        self.motion.toward(bearing_rad).filter(|_| bearing_rad.abs() > self.weights.submit_rad)
    }

    /// Whether a source is likely to be a goal that may be submitted now, as far as that can still be found out by
    /// comparing what stands at all sources with all goals.
    pub(crate) fn is_right_goal(&self, source: usize) -> bool {
        if self.ablation.no_audio {
            return true;
        }
        let right = self.goals.right(source);
        let open = || (0..self.sources.len()).filter(|&other| !self.turns.is_silent(other));
        let no_better = || open().all(|other| self.goals.right(other) <= right);
        let is_hurry = self.remaining_steps < self.weights.hurry_steps;
        let all_settled = is_hurry || open().all(|other| self.is_settled(other));
        right >= self.weights.commit || (all_settled && no_better())
    }

    /// Whether a source has been looked at often enough, or sought for so long that it will not be.
    pub(crate) fn is_settled(&self, source: usize) -> bool {
        self.is_looked_at(source) || self.sources[source].sought_steps >= self.weights.patience_steps
    }

    /// Whether what stands where a source is believed to be has been looked at often enough.
    pub(crate) fn is_looked_at(&self, source: usize) -> bool {
        self.sources[source].looks >= self.weights.verify_looks
    }

    fn object(&self, candidate: &Candidate) -> &Object {
        &self.objects.all()[candidate.object]
    }
}
