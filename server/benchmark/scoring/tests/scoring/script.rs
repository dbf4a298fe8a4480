//! Scripted episodes: a fact per action.

use avln_episode::{Action, EndReason, Order, Point3, Pose};
use avln_truth::{EpisodeTruth, Record, StepFacts, SubmitFacts};
use serde_json::json;

/// A truth with `goals` identical targets and a reference tour of `reference_m`.
pub(crate) fn truth(
    episode: &str,
    scene: &str,
    order: Order,
    goals: usize,
    reference_m: f64,
) -> EpisodeTruth {
    let target = json!({
        "instance": 1, "category": "chair", "modality": "category",
        "bounds": { "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0] },
        "source": [0.0, 0.0, 0.0], "floor_y_m": 0.0, "region": [], "viewpoints": [], "start_distance_m": 1.0,
    });
    let mut truth: EpisodeTruth = serde_json::from_value(json!({
        "episode": episode, "scene": scene, "seed": 1, "order": order,
        "start": { "position": [0.0, 0.0, 0.0], "heading_rad": 0.0 },
        "targets": vec![target; goals], "reference_m": 0.0, "reference_path": [],
    }))
    .expect("a truth in JSON");
    truth.reference_m = reference_m;
    truth
}

/// Facts of one scripted action.
#[derive(Clone, Copy)]
pub(crate) struct Did {
    pub(crate) action: Action,
    pub(crate) moved_m: f32,
    pub(crate) collided: bool,
    pub(crate) in_region: u8,
    pub(crate) completed: Option<u8>,
    pub(crate) wrong_instance: Option<u8>,
}

impl Did {
    pub(crate) fn plain(action: Action) -> Self {
        let moved_m = if action == Action::MoveForward { 0.25 } else { 0.0 };
        Self { action, moved_m, collided: false, in_region: 0, completed: None, wrong_instance: None }
    }
    pub(crate) fn claim(action: Action, completed: Option<u8>) -> Self {
        Self { completed, ..Self::plain(action) }
    }
}

/// The record of a script: a walk along -Z.
pub(crate) fn record(script: &[Did], in_region_at_start: Vec<bool>, end: EndReason) -> Record {
    let start = Pose::new(Point3::origin(), 0.0);
    let (mut steps, mut submits, mut at) = (Vec::new(), Vec::new(), start);
    for (index, did) in script.iter().enumerate() {
        at.position.z -= did.moved_m;
        if matches!(did.action, Action::Submit | Action::Stop) {
            submits.push(SubmitFacts {
                step: index as u32 + 1,
                completed: did.completed,
                skipped: None,
                wrong_instance: did.wrong_instance,
            });
        }
        let Did { action, collided, in_region, .. } = *did;
        steps.push(StepFacts { action, pose: at, collided, in_region, sounding: None, state_hash: 0 });
    }
    let final_distance_m = vec![Some(1.0); in_region_at_start.len()];
    Record {
        rules: "lh-avln-v1".to_owned(),
        start,
        steps,
        submits,
        in_region_at_start,
        final_distance_m,
        end,
    }
}
