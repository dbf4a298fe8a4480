//! Lines and errors of data set files.

use crate::{
    build::Recipe,
    cue::View,
    describe::Claims,
    mission::ReferenceTour,
    split::{SceneSource, SceneSpec},
};
use avln_geom::Pose;
use avln_truth::Target;
use serde::{Deserialize, Serialize};

/// Version of the layout that this code writes and reads.
pub const DATASET_VERSION: u32 = 1;

/// `dataset.json`: what the data set is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Always `avln-dataset`.
    pub format: String,
    /// Version of the layout.
    pub version: u32,
    /// Name of the data set.
    pub name: String,
    /// Name of the rule set under which regions and references were computed.
    pub rules: String,
    /// What it was made of, when it was made by recipe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recipe: Option<Recipe>,
    /// Its splits.
    pub splits: Vec<SplitLine>,
}

/// A split as `dataset.json` lists it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitLine {
    /// Its name, and that of its folder.
    pub name: String,
    /// Scenes in it.
    pub scenes: usize,
    /// Missions in it.
    pub missions: usize,
    /// BLAKE3 of its `scenes.jsonl`, hex; with it, of everything in the split.
    pub digest: String,
}

/// A line of `scenes.jsonl`: one scene, what it takes to make it again, and its files.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneLine {
    /// Its name, and that of its files.
    pub name: String,
    /// Where it comes from.
    pub source: SceneSource,
    /// Digest of its content; checked when it is opened again.
    pub digest: String,
    /// How large it is, when that was noted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub facts: Option<SceneFacts>,
    /// Missions in it.
    pub missions: usize,
    /// BLAKE3 of its missions file, hex.
    pub public: String,
    /// BLAKE3 of its sealed file, hex.
    pub sealed: String,
}

/// How large a scene is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneFacts {
    /// Rooms.
    pub regions: u32,
    /// Storeys.
    pub storeys: u32,
    /// Labelled objects.
    pub objects: u32,
    /// Objects that can be targets.
    pub instances: u32,
    /// Walkable area, square metres.
    pub area_m2: f64,
}

/// What an agent may know of a mission: a line of a missions file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PublicMission {
    /// Id inside the data set: the scene's name and a number.
    pub id: String,
    /// Where the body starts.
    pub start: Pose,
    /// The goals, in their order.
    pub goals: Vec<PublicGoal>,
}

/// A goal as its agent sees it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PublicGoal {
    /// The label of a category.
    Category(String),
    /// A sentence.
    Description(String),
    /// A picture; it is rendered when the episode starts, and where from is sealed.
    Image,
}

/// First line of a missions or a sealed file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Header {
    /// `avln-missions` or `avln-sealed`.
    pub(super) format: String,
    pub(super) version: u32,
    pub(super) scene: String,
    pub(super) missions: usize,
    /// Targets that follow; sealed files only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) targets: Option<usize>,
    /// BLAKE3 of the missions file, hex; sealed files only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) public: Option<String>,
}

/// A target that missions of a sealed file name: modality and start distance are those of no mission.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SealedTarget {
    pub(super) target: Target,
    pub(super) distractors: u8,
}

/// What an agent may not know of a mission: a line of a sealed file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SealedMission {
    pub(super) id: String,
    pub(super) seed: u64,
    pub(super) goals: Vec<SealedGoal>,
    pub(super) ordered: ReferenceTour,
    pub(super) unordered: ReferenceTour,
}

/// The hidden side of a goal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SealedGoal {
    /// Instance id of the target.
    pub(super) instance: u32,
    /// Walking distance from the start to its success region, metres.
    pub(super) start_distance_m: f64,
    /// Where the reference picture is taken; image goals only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) view: Option<View>,
    /// What the sentence claims of the target; description goals only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) claims: Option<Claims>,
}

impl SceneLine {
    /// What it takes to make the scene again.
    pub fn spec(&self) -> SceneSpec {
        SceneSpec { name: self.name.clone(), source: self.source.clone(), digest: self.digest.clone() }
    }
}

/// A file of a data set that cannot be used: which, where and why.
#[derive(Debug, PartialEq, thiserror::Error)]
#[error("{file}{}: {cause}", line.map(|line| format!(", line {line}")).unwrap_or_default())]
pub struct FormatError {
    /// Name of the file.
    pub file: String,
    /// The line, from 1; none when the whole file is meant.
    pub line: Option<usize>,
    /// What is wrong.
    pub cause: FormatCause,
}

/// What is wrong with a file of a data set.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum FormatCause {
    /// The line is not what belongs there.
    #[error("{0}")]
    Json(String),
    /// The file belongs to another layout.
    #[error(
        "it has version {found}, this program reads version {read}; build the data set again or update the program"
    )]
    Version {
        /// What it says.
        found: u32,
        /// What is read.
        read: u32,
    },
    /// The file is of another kind or scene.
    #[error("it says {found} where {expected} belongs; was a file renamed?")]
    Other {
        /// What it says.
        found: String,
        /// What belongs there.
        expected: String,
    },
    /// The file ends early, or goes on.
    #[error(
        "it holds {found} {what}, its first line promises {promised}; the file is truncated or was put together"
    )]
    Count {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        promised: usize,
    },
    /// A list is longer than anything sensible.
    #[error("{found} {what} are more than the {limit} that are read")]
    TooMany {
        /// What is counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many are read.
        limit: usize,
    },
    /// Two entries have one id.
    #[error("{what} {id} occurs twice")]
    Duplicate {
        /// What is named.
        what: &'static str,
        /// The id.
        id: String,
    },
    /// An entry names one that is not there.
    #[error("mission {mission} names {what} {id}, which is not in the file")]
    Unknown {
        /// The mission.
        mission: String,
        /// What is named.
        what: &'static str,
        /// The id.
        id: String,
    },
    /// Public and sealed part of a mission do not fit together.
    #[error("mission {mission}: {what}")]
    Mismatch {
        /// The mission.
        mission: String,
        /// What does not fit.
        what: &'static str,
    },
    /// A number is no number.
    #[error("{what} is not a finite number")]
    NotFinite {
        /// Which.
        what: &'static str,
    },
    /// The content is not what the list of files says.
    #[error("its digest is {found}, the list of scenes says {expected}; restore the file or build it again")]
    Digest {
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
    },
}
