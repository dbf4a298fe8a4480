//! The agent's memory: of a storey, of a sound source, of the present aim and of an open Submit.

use crate::weights::Weights;
use avln_kit::geometry::FloorPoint;
use avln_kit::map::{
    BearingMemory, IntensityMemory, ObjectMemory, Occupancy, RoomMemory, SourceBelief, SourceEstimate,
    range_m,
};
use avln_kit::outcome::SubmitOutcome;
use std::collections::BTreeMap;

/// The paper's memory M_t = (R_t, O_t, A_t) for one storey, with the map.
#[derive(Default)]
pub(crate) struct StoreyMemory {
    pub(crate) map: Occupancy,
    /// R_t.
    pub(crate) rooms: RoomMemory,
    /// O_t.
    pub(crate) objects: ObjectMemory,
    /// A_int.
    pub(crate) intensity: IntensityMemory,
    /// A_bear by goal.
    pub(crate) bearings: Vec<BearingMemory>,
    /// Estimated sources, with `source_positions`.
    pub(crate) sources: Vec<SourceMemory>,
    /// Steps towards a candidate, and of waiting at it, by object and goal.
    pub(crate) sought: BTreeMap<(usize, usize), u32>,
    pub(crate) waited: BTreeMap<(usize, usize), u32>,
    /// Visited frontiers: unseen cells behind furniture remain.
    pub(crate) visited: Vec<FloorPoint>,
}

impl StoreyMemory {
    pub(crate) fn new(goals: usize, sources: usize) -> Self {
        Self {
            objects: ObjectMemory::new(goals),
            bearings: vec![BearingMemory::default(); goals],
            sources: (0..sources).map(|_| SourceMemory::default()).collect(),
            ..Self::default()
        }
    }
}

/// A source's memory on one storey.
#[derive(Default)]
pub(crate) struct SourceMemory {
    pub(crate) belief: SourceBelief,
    pub(crate) estimate: Option<SourceEstimate>,
    pub(crate) intensity: IntensityMemory,
    /// Number of near views at the estimate, and the first viewed position.
    pub(crate) looks: u32,
    pub(crate) looked_at: FloorPoint,
    /// Positions after unsuccessful Submits.
    pub(crate) missed: Vec<FloorPoint>,
    /// Steps spent heading for the source.
    pub(crate) sought_steps: u32,
}

impl SourceMemory {
    /// Forgets all sounds and the estimate; views, effort and failed Submits stay.
    pub(crate) fn forget_sounds(&mut self) {
        (self.belief, self.estimate, self.intensity) = Default::default();
    }

    /// Sets the estimate. Returns true, and resets the looks, if it left the viewed position.
    pub(crate) fn locate(&mut self, estimate: Option<SourceEstimate>) -> bool {
        const SAME_M: f32 = 1.0;
        self.estimate = estimate;
        let is_there = estimate.is_some_and(|estimate| estimate.place.distance_m(self.looked_at) <= SAME_M);
        let is_elsewhere = self.looks > 0 && !is_there;
        if is_elsewhere {
            self.looks = 0;
        }
        is_elsewhere
    }

    /// Forgets past effort if the source is louder than ever before: the agent comes nearer.
    pub(crate) fn approach(&mut self, level: f32) {
        const LOUDER: f32 = 1.3;
        if level > LOUDER * self.intensity.loudest() {
            self.sought_steps = 0;
        }
    }

    /// Returns true if the estimate is certain and the source was heard within visual range.
    pub(crate) fn is_located(&self, weights: &Weights) -> bool {
        let heard_m = range_m(self.intensity.loudest());
        let certainty = self.estimate.map(|estimate| estimate.certainty);
        certainty.is_some_and(|certainty| certainty >= weights.certain) && heard_m <= weights.look_range_m
    }

    pub(crate) fn look_at(&mut self, place: FloorPoint) {
        if self.looks == 0 {
            self.looked_at = place;
        }
        self.looks += 1;
    }
}

/// The candidate that the agent heads for, and its viewpoint.
#[derive(Clone, Debug)]
pub(crate) struct Aim {
    pub(crate) object: usize,
    pub(crate) goal: usize,
    pub(crate) viewpoint: Option<FloorPoint>,
    pub(crate) steps_left: u32,
    /// Reached viewpoints.
    pub(crate) tried: Vec<FloorPoint>,
}

/// A Submit with an open outcome.
#[derive(Clone, Copy)]
pub(crate) struct PendingSubmit {
    /// `None` once it is forgotten.
    pub(crate) object: Option<usize>,
    pub(crate) goal: usize,
    /// The target's source, if known.
    pub(crate) source: Option<usize>,
    /// The outcome inferred from the source; `None` if the next observation decides.
    pub(crate) heard: Option<SubmitOutcome>,
}
