//! Data set files: JSON lines, with a public and a sealed file per scene.
//!
//! ```text
//! DIR/dataset.json                  Manifest: version, recipe, splits with digests
//! DIR/SPLIT/scenes.jsonl            SceneLine: scene source, and digests for both files
//! DIR/SPLIT/missions/SCENE.jsonl    public: starts and goal cues
//! DIR/SPLIT/sealed/SCENE.jsonl      hidden: targets, success regions, picture views, reference tours
//! DIR/SPLIT/sealed/seed.json        hidden, SecretFile: secret of a split without a seed, and its recipe
//! ```

mod read;

pub use read::{File, read_manifest, read_missions, read_scene, read_scenes, read_secret};

use crate::{
    cue::{Claims, CueSpec, CueView},
    error::DatasetError,
    mission::{EpisodeSpec, GoalSpec, ReferenceTour},
    recipe::{Recipe, SplitSecret},
    split::{SceneSource, SceneSpec},
    survey::Removals,
};
use avln_episode::Modality;
use avln_geom::Pose;
use avln_truth::Target;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Layout version written and read by this code.
pub const DATASET_VERSION: u32 = 1;

/// Contents of `dataset.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Always `avln-dataset`.
    pub format: String,
    /// Version of the layout.
    pub version: u32,
    /// Name of the data set.
    pub name: String,
    /// Rule set name for regions and references.
    pub rules: String,
    /// Recipe, for data sets built by recipe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recipe: Option<Recipe>,
    /// Seed of missions that were drawn without a recipe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Splits.
    pub splits: Vec<SplitLine>,
}

/// Split entry in `dataset.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitLine {
    /// Split name; also the folder name.
    pub name: String,
    /// Scene count.
    pub scenes: usize,
    /// Mission count.
    pub missions: usize,
    /// BLAKE3 of `scenes.jsonl`, hex; covers the whole split.
    pub digest: String,
}

/// Contents of `sealed/seed.json`: everything that rebuilds a secret split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SecretFile {
    /// Always `avln-seed`.
    pub format: String,
    /// Version of the layout.
    pub version: u32,
    /// Secret of all draws.
    pub secret: SplitSecret,
    /// Recipe with this split only.
    pub recipe: Recipe,
}

/// Line in `scenes.jsonl`: source and digests for a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneLine {
    /// Scene name; also the file stem.
    pub name: String,
    /// Scene source.
    pub source: SceneSource,
    /// Content digest, checked on every open.
    pub digest: String,
    /// Size, if recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub facts: Option<SceneFacts>,
    /// Mission count.
    pub missions: usize,
    /// BLAKE3 of the missions file, hex.
    pub public: String,
    /// BLAKE3 of the sealed file, hex.
    pub sealed: String,
}

/// Scene size.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFacts {
    /// Rooms.
    pub regions: u32,
    /// Storeys.
    pub storeys: u32,
    /// Labelled objects.
    pub objects: u32,
    /// Potential targets.
    pub instances: u32,
    /// Walkable area, square metres.
    pub area_m2: f64,
    /// Removed instances of target categories, if recorded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub removed: Option<Removals>,
}

/// Public part of a mission: a line in a missions file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublicMission {
    /// Id inside the data set: scene name and number.
    pub id: String,
    /// Start pose.
    pub start: Pose,
    /// Goals in order.
    pub goals: Vec<PublicGoal>,
}

/// Public part of a goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PublicGoal {
    /// Category label.
    Category(String),
    /// A sentence.
    Description(String),
    /// Picture, rendered at episode start. The sealed file has the view.
    Image,
}

/// First line of a missions or sealed file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Header {
    /// `avln-missions` or `avln-sealed`.
    pub(super) format: String,
    pub(super) version: u32,
    pub(super) scene: String,
    pub(super) missions: usize,
    /// Target count; sealed files only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) targets: Option<usize>,
    /// BLAKE3 of the missions file, hex; sealed files only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) public: Option<String>,
}

/// Target in a sealed file. Modality and start distance belong to goals and are neutral here.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SealedTarget {
    pub(super) target: Target,
    pub(super) distractors: u8,
}

/// Hidden part of a mission: a line in a sealed file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SealedMission {
    pub(super) id: String,
    pub(super) seed: u64,
    pub(super) goals: Vec<SealedGoal>,
    pub(super) ordered: ReferenceTour,
    pub(super) unordered: ReferenceTour,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SealedGoal {
    pub(super) instance: u32,
    /// Walking distance from the start to the success region, metres.
    pub(super) start_distance_m: f64,
    /// View for the reference picture; image goals only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) view: Option<CueView>,
    /// Claims in the sentence; description goals only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) claims: Option<Claims>,
}

impl Manifest {
    /// File kind of `dataset.json`.
    pub const FORMAT: &str = "avln-dataset";
}

impl SecretFile {
    /// File kind of `sealed/seed.json`.
    pub const FORMAT: &str = "avln-seed";

    /// Returns the file for a split of `recipe`; `None` without such a split, or if it has no secret.
    pub fn of(recipe: &Recipe, split: &str) -> Option<Self> {
        let split = recipe.splits.iter().find(|recipe| recipe.name == split)?;
        Some(Self {
            format: Self::FORMAT.to_owned(),
            version: DATASET_VERSION,
            secret: split.secret.clone()?,
            recipe: Recipe { splits: vec![split.clone()], ..recipe.clone() },
        })
    }

    /// Returns the recipe with the secret: it rebuilds the split, byte for byte.
    pub fn into_recipe(self) -> Recipe {
        let Self { secret, mut recipe, .. } = self;
        recipe.splits.iter_mut().for_each(|split| split.secret = Some(secret.clone()));
        recipe
    }
}

impl Header {
    pub(super) const MISSIONS: &str = "avln-missions";
    pub(super) const SEALED: &str = "avln-sealed";
}

impl SceneLine {
    /// Returns the scene specification.
    pub fn spec(&self) -> SceneSpec {
        SceneSpec { name: self.name.clone(), source: self.source.clone(), digest: self.digest.clone() }
    }
}

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
