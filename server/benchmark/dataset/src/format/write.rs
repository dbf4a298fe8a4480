//! Data set files written, with digests.

use crate::{
    cue::CueSpec,
    format::{
        DATASET_VERSION, Header, Manifest, PublicGoal, PublicMission, SceneFacts, SceneLine, SealedGoal,
        SealedMission, SealedTarget,
    },
    mission::{EpisodeSpec, GoalSpec},
    split::{DatasetError, SceneSpec},
};
use avln_episode::Modality;
use avln_truth::Target;
use serde::Serialize;
use std::collections::BTreeMap;

/// Files of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct WrittenScene {
    /// Line in the scene list.
    pub line: SceneLine,
    /// The public file.
    pub missions: Vec<u8>,
    /// The sealed file.
    pub sealed: Vec<u8>,
}

/// Returns the BLAKE3 digest, hex.
pub fn digest_of(bytes: &[u8]) -> String {
    blake3::hash(bytes).to_hex().to_string()
}

/// Encodes missions in a scene: public file, sealed file, and a line with both digests; numbers must be finite.
pub fn write_scene(
    spec: &SceneSpec,
    facts: Option<SceneFacts>,
    episodes: &[EpisodeSpec],
) -> Result<WrittenScene, DatasetError> {
    let missions = public_bytes(spec, episodes)?;
    let public = digest_of(&missions);
    let sealed = sealed_bytes(spec, &public, episodes)?;
    let line = SceneLine {
        name: spec.name.clone(),
        source: spec.source.clone(),
        digest: spec.digest.clone(),
        facts,
        missions: episodes.len(),
        public,
        sealed: digest_of(&sealed),
    };
    Ok(WrittenScene { line, missions, sealed })
}

/// Encodes `scenes.jsonl`.
pub fn scenes_bytes(scenes: &[SceneLine]) -> Result<Vec<u8>, DatasetError> {
    let mut bytes = Vec::new();
    scenes.iter().try_for_each(|line| push(&mut bytes, line))?;
    Ok(bytes)
}

/// Encodes `dataset.json`.
pub fn manifest_bytes(manifest: &Manifest) -> Result<Vec<u8>, DatasetError> {
    let mut bytes = serde_json::to_vec_pretty(manifest).map_err(unwritable)?;
    bytes.push(b'\n');
    Ok(bytes)
}

fn public_bytes(spec: &SceneSpec, episodes: &[EpisodeSpec]) -> Result<Vec<u8>, DatasetError> {
    let mut bytes = Vec::new();
    let header = Header {
        format: Header::MISSIONS.to_owned(),
        version: DATASET_VERSION,
        scene: spec.name.clone(),
        missions: episodes.len(),
        targets: None,
        public: None,
    };
    push(&mut bytes, &header)?;
    episodes.iter().try_for_each(|episode| push(&mut bytes, &episode.public()))?;
    Ok(bytes)
}

impl EpisodeSpec {
    /// Returns the public part.
    pub fn public(&self) -> PublicMission {
        let goals = self.goals.iter().map(public_goal).collect();
        PublicMission { id: self.id.clone(), start: self.start, goals }
    }
}

fn sealed_bytes(spec: &SceneSpec, public: &str, episodes: &[EpisodeSpec]) -> Result<Vec<u8>, DatasetError> {
    // Missions share targets, and success regions are most of the bytes: every target is written once, sorted by
    // instance.
    let mut targets: BTreeMap<u32, &GoalSpec> = BTreeMap::new();
    let goals = episodes.iter().flat_map(|episode| &episode.goals);
    targets.extend(goals.map(|goal| (goal.target.instance, goal)));
    let mut bytes = Vec::new();
    let header = Header {
        format: Header::SEALED.to_owned(),
        version: DATASET_VERSION,
        scene: spec.name.clone(),
        missions: episodes.len(),
        targets: Some(targets.len()),
        public: Some(public.to_owned()),
    };
    push(&mut bytes, &header)?;
    for goal in targets.into_values() {
        // These two fields belong to goals; fixed values keep the target independent of the mission that is written
        // first.
        let target = Target { modality: Modality::Category, start_distance_m: 0.0, ..goal.target.clone() };
        push(&mut bytes, &SealedTarget { target, distractors: goal.distractors })?;
    }
    for episode in episodes {
        let sealed = SealedMission {
            id: episode.id.clone(),
            seed: episode.seed,
            goals: episode.goals.iter().map(sealed_goal).collect(),
            ordered: episode.ordered.clone(),
            unordered: episode.unordered.clone(),
        };
        push(&mut bytes, &sealed)?;
    }
    Ok(bytes)
}

fn public_goal(goal: &GoalSpec) -> PublicGoal {
    match &goal.cue {
        CueSpec::Category => PublicGoal::Category(goal.target.category.clone()),
        CueSpec::Description(sentence) => PublicGoal::Description(sentence.text.clone()),
        CueSpec::Image(_) => PublicGoal::Image,
    }
}

fn sealed_goal(goal: &GoalSpec) -> SealedGoal {
    let (view, claims) = match &goal.cue {
        CueSpec::Category => (None, None),
        CueSpec::Description(sentence) => (None, sentence.claims.clone()),
        CueSpec::Image(view) => (Some(*view), None),
    };
    let Target { instance, start_distance_m, .. } = goal.target;
    SealedGoal { instance, start_distance_m, view, claims }
}

fn push(bytes: &mut Vec<u8>, line: &impl Serialize) -> Result<(), DatasetError> {
    serde_json::to_writer(&mut *bytes, line).map_err(unwritable)?;
    bytes.push(b'\n');
    Ok(())
}

fn unwritable(error: serde_json::Error) -> DatasetError {
    DatasetError::Malformed(error.to_string())
}
