//! Instance verification: the visual floor, the Submit gate, and the only place that creates Submit and Stop.

use crate::mission::MissionState;
use crate::preset::Ablation;
use crate::weights::Weights;
use avln_client::Action;
use avln_kit::map::FreshLook;
use serde::Serialize;

/// The state of an open gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Readiness {
    /// The outcome will be known or does not matter, or a located source supports the candidate.
    Now,
    /// The target should sound first.
    Wait,
    /// No source near the candidate sounded in a whole cycle.
    Unheard,
}

/// The looks that a verification demands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct VerificationDemand {
    /// Near views from different positions.
    pub(crate) looks: u32,
    /// Least s_vis of the fresh look. Neither patience nor hurry lowers it.
    pub(crate) floor: f32,
}

impl VerificationDemand {
    /// Creates the demand. Patience with a candidate, or hurry near the end, lowers only the number of looks.
    pub(crate) fn new(sought_steps: u32, remaining_steps: u32, floor: f32, weights: &Weights) -> Self {
        let share = patience(sought_steps, remaining_steps, weights);
        let looks = (share * weights.verify_looks as f32).ceil() as u32;
        Self { looks: looks.max(1), floor: floor.max(weights.verify_floor) }
    }

    /// Reduces the demand to one look.
    pub(crate) fn of_one_look(self) -> Self {
        Self { looks: 1, ..self }
    }
}

/// Returns the share of the looks, 1 to 0: falls after `patience_steps`, 0 in the last `hurry_steps`.
fn patience(sought_steps: u32, remaining_steps: u32, weights: &Weights) -> f32 {
    if remaining_steps < weights.hurry_steps {
        return 0.0;
    }
    let beyond = sought_steps.saturating_sub(weights.patience_steps) as f32;
    (1.0 - beyond / weights.patience_steps.max(1) as f32).max(0.0)
}

/// V of the paper: a look of the current frame shows the object, with s_vis at or above the floor, after enough looks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Verification {
    goal: usize,
    object: usize,
    /// s_vis of the fresh look.
    vis: f32,
    floor: f32,
    looks: u32,
}

impl Verification {
    /// Verifies an object with `looks` near views for a goal by a look of the current frame; `None` below the demand.
    pub(crate) fn of(look: &FreshLook, goal: usize, looks: u32, demand: VerificationDemand) -> Option<Self> {
        let vis = look.vis(goal);
        // A comparison with NaN is false: such a look never verifies.
        (vis >= demand.floor && looks >= demand.looks).then_some(Self {
            goal,
            object: look.object(),
            vis,
            floor: demand.floor,
            looks,
        })
    }
}

/// The Submit gate of the paper.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct SubmitGate {
    /// s_vis of the best look of the current frame; `None` without a look.
    pub(crate) fresh_vis: Option<f32>,
    /// V(o*, g); `None` if the current frame does not verify the candidate.
    pub(crate) verification: Option<Verification>,
    /// Distance to the candidate, metres: |p - p(o*)|.
    pub(crate) distance_m: f32,
    /// Bearing of the candidate, radians.
    pub(crate) bearing_rad: f32,
    /// No wall between body and candidate.
    pub(crate) is_in_sight: bool,
}

impl SubmitGate {
    /// Returns the warrant for a claim if the gate is open: V, distance within `submit_m` and bearing within `submit_rad`.
    pub(crate) fn warrant(&self, weights: &Weights) -> Option<Warrant> {
        (self.verification.is_some() && self.is_at_pose(weights)).then_some(Warrant(()))
    }

    /// Returns the warrant of the ablation `no_gate`, at the same pose without V; `None` with all other ablations.
    pub(crate) fn ungated(&self, ablation: Ablation, weights: &Weights) -> Option<Warrant> {
        (ablation.no_gate && self.is_at_pose(weights)).then_some(Warrant(()))
    }

    /// Returns true at a proper pose for a Submit.
    pub(crate) fn is_at_pose(&self, weights: &Weights) -> bool {
        self.is_in_sight
            && self.distance_m <= weights.submit_m
            && self.bearing_rad.abs() <= weights.submit_rad
    }
}

/// The permission for one claim. Only an open [`SubmitGate`] creates it.
#[derive(Debug)]
pub(crate) struct Warrant(());

impl Warrant {
    /// Claims a goal: Stop for the last open goal or without a remaining Submit, otherwise Submit.
    ///
    /// No other code of the agent creates these actions.
    pub(crate) fn claim(self, mission: &MissionState) -> Action {
        if mission.is_last_claim() { Action::Stop } else { Action::Submit }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_kit::geometry::Pose2d;
    use avln_kit::map::ObjectMemory;
    use avln_kit::perception::DetectedObject;

    fn weights() -> Weights {
        Weights {
            verify_looks: 3,
            verify_floor: 0.4,
            patience_steps: 100,
            hurry_steps: 150,
            submit_m: 1.2,
            submit_rad: 0.6,
            ..Weights::default()
        }
    }

    fn look(vis: f32) -> FreshLook {
        let seen = vec![DetectedObject { views: 1, ..DetectedObject::default() }];
        ObjectMemory::new(2)
            .recognise(&Pose2d::default(), seen, |_, goal| if goal == 1 { vis } else { 0.0 })
            .remove(0)
    }

    #[test]
    fn patience_and_hurry_lower_only_looks() {
        let demand = |sought, remaining| VerificationDemand::new(sought, remaining, 0.4, &weights());
        let looks = [(0, 800), (100, 800), (150, 800), (500, 800), (0, 149)].map(|(s, r)| demand(s, r).looks);
        assert_eq!(looks, [3, 3, 2, 1, 1]);
        for (sought, remaining) in [(0, 800), (150, 800), (9999, 800), (9999, 0)] {
            assert_eq!(demand(sought, remaining).floor, 0.4);
        }
        assert_eq!(demand(0, 800).of_one_look(), VerificationDemand { looks: 1, floor: 0.4 });
    }

    #[test]
    fn verification_needs_floor_and_looks() {
        let demand = VerificationDemand::new(0, 800, 0.4, &weights());
        let verified = |vis, looks| Verification::of(&look(vis), 1, looks, demand).is_some();
        assert!(verified(0.4, 3) && !verified(0.39, 99) && !verified(0.9, 2) && !verified(f32::NAN, 9));
        assert!(Verification::of(&look(0.9), 0, 3, demand).is_none(), "the fit with the other goal counts");
    }

    #[test]
    fn gate_needs_all_conditions() {
        let demand = VerificationDemand::new(0, 800, 0.4, &weights());
        for case in 0..16 {
            let right = |bit: u32| case >> bit & 1 == 1;
            let gate = SubmitGate {
                fresh_vis: None,
                verification: Verification::of(&look(if right(0) { 0.5 } else { 0.3 }), 1, 3, demand),
                distance_m: if right(1) { 1.2 } else { 1.3 },
                bearing_rad: if right(2) { -0.5 } else { -0.7 },
                is_in_sight: right(3),
            };
            assert_eq!(gate.warrant(&weights()).is_some(), case == 15, "{gate:?}");
            let none = Ablation::default();
            assert!(gate.ungated(none, &weights()).is_none());
            let ungated = gate.ungated(Ablation { no_gate: true, ..none }, &weights());
            assert_eq!(ungated.is_some(), case >= 14, "{gate:?}");
        }
    }
}
