//! Decisions: the next action by stage (search, ground, verify).

use crate::agent::PagNav;
use crate::candidate::{Candidate, Stage};
use crate::outcome::Readiness;
use crate::verify::{SubmitGate, Verification, VerificationDemand};
use avln_client::Action;
use avln_kit::geometry::Pose2d;
use avln_kit::map::FreshLook;

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
        if self.ablation.no_object_memory { demand.of_one_look() } else { demand }
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
