//! Options as JSON.

use avln_episode::{Order, Rules, Sensors};
use avln_referee::{Audio, made_bank};
use avln_training::{
    AutoReset, CheapSenses, Curriculum, Detail, EnvOptions, Goals, ProgressReward, RewardRule, SourceChoice,
    SourceOptions, Teacher,
};
use avln_world::{Bank, ClipPool};
use pyo3::PyResult;
use pyo3::exceptions::PyValueError;
use serde::Deserialize;
use std::path::PathBuf;

/// The options of `avln.sim.VectorEnv`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct VectorOptions {
    pub(crate) num_envs: usize,
    pub(crate) threads: usize,
    source: SourceJson,
    seed: u64,
    order: Option<String>,
    goals: [usize; 2],
    distance_m: [f64; 2],
    rooms: Option<[u8; 2]>,
    storeys: Option<[u8; 2]>,
    scenes: usize,
    episodes_per_scene: u64,
    rules: String,
    max_steps: Option<u32>,
    size: [u32; 2],
    hfov_rad: f32,
    detail: String,
    rgb: bool,
    depth: bool,
    audio: bool,
    lidar: bool,
    ears: bool,
    map: bool,
    goal_side: u32,
    goal_cues: bool,
    reward: RewardJson,
    privileged: bool,
    teacher: String,
    ids: bool,
    top_down: bool,
    added_submits: u32,
    autoreset: String,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
enum SourceJson {
    Recipe(String),
    Folder { path: PathBuf, split: String, training: bool },
    Scan { path: PathBuf, training: bool },
}

/// A rule's name, or coefficients of `progress`.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum RewardJson {
    Name(String),
    Progress { slack: f64, per_m: f64, submit: f64, stop: f64, found: f64, complete: f64 },
}

impl RewardJson {
    fn rule(&self) -> PyResult<RewardRule> {
        match *self {
            Self::Name(ref name) => named("reward", name, &REWARDS),
            Self::Progress { slack, per_m, submit, stop, found, complete } => {
                Ok(RewardRule::Progress(ProgressReward { slack, per_m, submit, stop, found, complete }))
            }
        }
    }
}

fn invalid(message: impl ToString) -> pyo3::PyErr {
    PyValueError::new_err(message.to_string())
}

impl VectorOptions {
    pub(crate) fn from_json(text: &str) -> PyResult<Self> {
        let options = &mut serde_json::Deserializer::from_str(text);
        // The path names the option.
        serde_path_to_error::deserialize(options)
            .map_err(|error| invalid(format!("`{}` cannot be used: {}", error.path(), error.inner())))
    }

    pub(crate) fn source(&self) -> PyResult<SourceOptions> {
        let choice = match &self.source {
            SourceJson::Recipe(name) => SourceChoice::Recipe(name.clone()),
            SourceJson::Scan { path, training } => {
                SourceChoice::Scan { path: path.clone(), is_training: *training }
            }
            SourceJson::Folder { path, split, training } => {
                SourceChoice::Folder { path: path.clone(), split: split.clone(), is_training: *training }
            }
        };
        let goals = match &self.order {
            None => Goals::Drawn,
            Some(order) => Goals::Fixed(order.parse::<Order>().map_err(invalid)?),
        };
        let (rooms, storeys) = (self.rooms, self.storeys);
        let curriculum = Curriculum { goals: self.goals, distance_m: self.distance_m, rooms, storeys };
        let base = SourceOptions::new(choice, self.seed);
        let (scenes, episodes_per_scene) = (self.scenes, self.episodes_per_scene);
        Ok(SourceOptions { goals, curriculum, scenes, episodes_per_scene, ..base })
    }

    pub(crate) fn env(&self) -> PyResult<EnvOptions> {
        let rules = Rules::named(&self.rules).map_err(invalid)?;
        let max_steps = self.max_steps.unwrap_or(rules.max_steps);
        let sensors = Sensors::all(self.size[0], self.size[1]);
        Ok(EnvOptions {
            rules: Rules { max_steps, ..rules },
            sensors: Sensors {
                rgb: self.rgb,
                depth: self.depth,
                audio: self.audio,
                hfov_rad: self.hfov_rad,
                ..sensors
            },
            detail: named("detail", &self.detail, &DETAILS)?,
            cheap: CheapSenses { lidar: self.lidar, ears: self.ears, map: self.map },
            goal_side: self.goal_side,
            goal_cues: self.goal_cues,
            reward: self.reward.rule()?,
            privileged: self.privileged,
            teacher: named("teacher", &self.teacher, &TEACHERS)?,
            ids: self.ids,
            top_down: self.top_down,
            added_submits: self.added_submits,
            autoreset: named("autoreset_mode", &self.autoreset, &AUTORESETS)?,
        })
    }

    /// Returns the clips of the rules; training clips, where the rules leave the choice open.
    pub(crate) fn audio(&self) -> PyResult<Audio> {
        let rules = Rules::named(&self.rules).map_err(invalid)?;
        let bank = match rules.sounds {
            avln_episode::Sounds::All => Bank::of(ClipPool::Train),
            sounds => {
                made_bank(&sounds).ok_or_else(|| invalid("rules with own recordings are not supported"))?
            }
        };
        Ok(Audio::from(bank))
    }
}

const REWARDS: [(&str, RewardRule); 3] = [
    ("progress", RewardRule::Progress(ProgressReward::AUTHORS)),
    ("sparse", RewardRule::Sparse),
    ("none", RewardRule::None),
];
const DETAILS: [(&str, Detail); 2] = [("exact", Detail::Exact), ("half_pixel", Detail::HalfPixel)];
const TEACHERS: [(&str, Teacher); 2] = [("path", Teacher::Path), ("explore", Teacher::Explore)];
const AUTORESETS: [(&str, AutoReset); 3] =
    [("NextStep", AutoReset::NextStep), ("SameStep", AutoReset::SameStep), ("Disabled", AutoReset::Disabled)];

fn named<T: Copy>(option: &str, value: &str, known: &[(&str, T)]) -> PyResult<T> {
    let found = known.iter().find(|(name, _)| *name == value).map(|(_, value)| *value);
    let names = || known.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    found.ok_or_else(|| invalid(format!("`{option}` is '{value}'; use one of: {}", names())))
}
