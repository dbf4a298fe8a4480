//! Calibration: reference agents in three procedural houses and a verified data set, compared with published values to the last bit. A
//! server with equal observations and scores simulates and scores like the published build.

use crate::dataset::{build::Builder, verifier::VerifierChoice};
use crate::internal;
use avln_arena::setup::{NewPhase, NewSplit, make_split, open_phase};
use avln_arena::{BENCHMARK_VERSION, Failure, FailureKind, data::DataFolder, dataset::DatasetFiles};
use avln_baselines::RandomAgent;
use avln_client::{
    Action, Agent, Client, ConnectOptions, EpisodeEnd, GoalCue, Mission, Observation, Order, RunOptions,
    Sensors, TaskSpec, evaluate_with,
};
use avln_dataset::{Recipe, Seed};
use avln_episode::Rules;
use avln_pag_nav::{PagNav, Preset};
use avln_store::Store;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

/// A phase of reference agents, and its split.
#[derive(Clone, Copy, Debug)]
pub struct CalibrationPhase {
    /// Phase and split id.
    pub id: &'static str,
    title: &'static str,
    rules: &'static str,
    houses: u32,
    missions: usize,
}

/// All phases: the paper's rules, and the hard track's sensor noise and distractor sources in the first house.
pub const PHASES: [CalibrationPhase; 2] = [
    CalibrationPhase { id: "calibration", title: "Calibration", rules: Rules::PAPER, houses: 3, missions: 4 },
    CalibrationPhase {
        id: "calibration-hard",
        title: "Calibration, hard track",
        rules: Rules::HARD,
        houses: 1,
        missions: 2,
    },
];

const PUBLISHED: &str = include_str!("published.json");
const SIDE: u32 = 128;
const SEED: u64 = 1;
/// Most actions per episode: few, because a test plays all episodes.
const MOST_STEPS: u32 = 150;

/// The reference agents' observations and scores.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Benchmark version.
    pub benchmark: String,
    /// Digest of the data set `mini`, built here with the network as verifier; `None` for a remote server or a single agent.
    pub dataset: Option<String>,
    /// A run per reference agent and phase.
    pub runs: Vec<CalibrationRun>,
}

/// A reference agent's run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationRun {
    /// Agent name.
    pub agent: String,
    /// Phase id.
    pub phase: String,
    /// Goal order.
    pub order: String,
    /// Episodes, in playing order.
    pub episodes: Vec<CalibrationEpisode>,
    /// Mean metrics.
    pub means: BTreeMap<String, f64>,
}

/// A reference agent's episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationEpisode {
    /// Hexadecimal BLAKE3 hash over mission, observations and actions.
    pub sensed: String,
    /// End reason.
    pub end: String,
    /// Steps taken.
    pub steps: u32,
    /// Metrics.
    pub metrics: BTreeMap<String, f64>,
}

/// A reference agent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum ReferenceAgent {
    /// Walks at random.
    Random,
    /// PAG-Nav.
    PagNav,
    /// PAG-Nav with all extensions and other weights.
    PagNavPlus,
}

impl ReferenceAgent {
    /// All reference agents.
    pub const ALL: [Self; 3] = [Self::Random, Self::PagNav, Self::PagNavPlus];

    fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::PagNav => "PAG-Nav",
            Self::PagNavPlus => "PAG-Nav+",
        }
    }

    fn order(self) -> Order {
        if self == Self::PagNav { Order::Unordered } else { Order::Ordered }
    }

    fn agent(self) -> DigestingAgent {
        let agent: Box<dyn Agent + Send> = match self {
            Self::Random => Box::new(RandomAgent::new(0)),
            Self::PagNav => Box::new(PagNav::preset(Preset::PagNav)),
            Self::PagNavPlus => Box::new(PagNav::preset(Preset::PagNavPlus)),
        };
        DigestingAgent { agent, episodes: Vec::new() }
    }
}

/// A server with an account.
#[derive(Clone, Debug)]
pub struct CalibrationServer {
    /// gRPC server URL.
    pub url: String,
    /// PEM file with trusted authorities, instead of the system's.
    pub ca: Option<PathBuf>,
    /// Account token.
    pub token: String,
}

/// Returns the published values in this build.
///
/// # Errors
/// If the values are malformed, which a test excludes.
pub fn published() -> Result<Calibration, Failure> {
    serde_json::from_str(PUBLISHED).map_err(internal)
}

/// Creates the calibration splits and opens the calibration phases, unless they exist.
///
/// # Errors
/// If the data folder cannot be written, or has another phase with one of the names.
pub async fn open(data: &DataFolder, store: &Store) -> Result<(), Failure> {
    for phase in PHASES {
        open_one(data, store, phase).await?;
    }
    Ok(())
}

async fn open_one(data: &DataFolder, store: &Store, phase: CalibrationPhase) -> Result<(), Failure> {
    let CalibrationPhase { id, title, rules, houses, missions } = phase;
    let (name, rules) = (id.to_owned(), rules.to_owned());
    let make = NewSplit { name, houses, scenes: vec![], missions, seed: Seed::Number(SEED), rules };
    make_split(data, store, make, |_| ()).await?;
    if store.phases().await?.iter().any(|phase| phase.id == id) {
        return Ok(());
    }
    let open = NewPhase { title: Some(title.to_owned()), max_side: 256, ..NewPhase::public(id, id) };
    open_phase(data, store, &open).await.map(drop)
}

/// Builds the data set `mini` in `folder` with the network as verifier; returns the digest of its only split.
///
/// # Errors
/// If the folder has another data set or cannot be written.
pub fn build_dataset(folder: &Path) -> Result<String, Failure> {
    let files = DatasetFiles::at(folder);
    let text = Recipe::embedded("mini").ok_or_else(|| Failure::internal("no recipe mini"))?;
    let recipe = Recipe::from_json(text)?;
    Builder::open_with(files.clone(), recipe, VerifierChoice::Network.load()?)?.run(None, None, |_| ())?;
    let only = files.manifest()?.splits.into_iter().next();
    Ok(only.ok_or_else(|| Failure::internal("the recipe mini has no split"))?.digest)
}

/// Receives agent, phase and end of each episode.
pub type OnEnd<'a> = dyn FnMut(ReferenceAgent, &str, &EpisodeEnd) + Send + 'a;

/// Plays the calibration phases on a server with reference agents; calls `on_end` after every episode.
///
/// # Errors
/// If the server does not host a phase, hides metrics, or a run fails.
pub async fn play(
    server: &CalibrationServer,
    agents: &[ReferenceAgent],
    on_end: &mut OnEnd<'_>,
) -> Result<Calibration, Failure> {
    let link = ConnectOptions { ca: server.ca.clone(), ..ConnectOptions::default() };
    let client =
        Client::connect_with(&server.url, server.token.as_str(), &link).await.map_err(Failure::run)?;
    let benchmark = client.server_info().await.map_err(Failure::run)?.benchmark;
    let hosted = client.phases().await.map_err(Failure::run)?;
    if let Some(missing) = PHASES.iter().find(|phase| hosted.iter().all(|known| known.id != phase.id)) {
        return Err(not_open(format!("the server does not host the phase {}", missing.id)));
    }
    let mut runs = Vec::with_capacity(agents.len());
    for &agent in agents {
        for phase in PHASES {
            runs.push(play_one(&client, agent, phase.id, on_end).await?);
        }
    }
    Ok(Calibration { benchmark, dataset: None, runs })
}

async fn play_one(
    client: &Client,
    reference: ReferenceAgent,
    phase: &str,
    on_end: &mut OnEnd<'_>,
) -> Result<CalibrationRun, Failure> {
    let options = RunOptions::new(phase, format!("{} (calibration)", reference.name()));
    let options = options.method_version(env!("CARGO_PKG_VERSION")).order(reference.order());
    let run = client.start_run(options).await.map_err(Failure::run)?;
    let mut agent = reference.agent();
    let mut ends = Vec::new();
    let mut collect = |end: &EpisodeEnd| {
        on_end(reference, phase, end);
        ends.push(end.clone());
    };
    evaluate_with(client, &run, Sensors::square(SIDE), &mut agent, &mut collect)
        .await
        .map_err(Failure::run)?;
    let episodes: Vec<CalibrationEpisode> = ends.iter().zip(agent.digests()).map(episode).collect();
    if episodes.iter().any(|episode| episode.metrics.is_empty()) {
        return Err(not_open("the server does not return metrics of episodes"));
    }
    let means = means(&episodes);
    let (agent, order) = (reference.name().to_owned(), reference.order().to_string());
    Ok(CalibrationRun { agent, phase: phase.to_owned(), order, episodes, means })
}

fn not_open(message: impl std::fmt::Display) -> Failure {
    let hint = "the organiser can open the calibration phases with: avln lab calibrate --open";
    Failure::new(FailureKind::Run, message).hinted(hint)
}

fn episode((end, sensed): (&EpisodeEnd, String)) -> CalibrationEpisode {
    let metrics = end.metrics.iter().flatten().map(|metric| (metric.name.clone(), metric.value)).collect();
    CalibrationEpisode { sensed, end: end.reason.to_string(), steps: end.steps, metrics }
}

fn means(episodes: &[CalibrationEpisode]) -> BTreeMap<String, f64> {
    let mut sums: BTreeMap<String, f64> = BTreeMap::new();
    for (name, value) in episodes.iter().flat_map(|episode| &episode.metrics) {
        *sums.entry(name.clone()).or_default() += value;
    }
    sums.into_iter().map(|(name, sum)| (name, sum / episodes.len() as f64)).collect()
}

/// Lists the differences from the published values; empty if all bits agree.
pub fn differences(found: &Calibration, published: &Calibration) -> Vec<String> {
    let mut lines = Vec::new();
    if found.benchmark != published.benchmark {
        let (own, other) = (&found.benchmark, &published.benchmark);
        lines.push(format!("the server has benchmark {own}, published is {other}"));
    }
    if let Some(own) = &found.dataset
        && published.dataset.as_ref() != Some(own)
    {
        let other = published.dataset.as_deref().unwrap_or("none");
        lines.push(format!(
            "the data set mini, verified by the network, has digest {own}, published is {other}"
        ));
    }
    for run in &found.runs {
        let name = format!("{} {}, phase {}", run.agent, run.order, run.phase);
        let is_same = |other: &&CalibrationRun| (&other.agent, &other.phase) == (&run.agent, &run.phase);
        let Some(expected) = published.runs.iter().find(is_same) else {
            lines.push(format!("{name}: no values are published"));
            continue;
        };
        let (count, expected_count) = (run.episodes.len(), expected.episodes.len());
        if count != expected_count {
            lines.push(format!("{name}: {count} episodes, published are {expected_count}"));
        }
        for (number, (found, expected)) in (1..).zip(run.episodes.iter().zip(&expected.episodes)) {
            let difference = difference(found, expected);
            lines.extend(difference.map(|text| format!("{name}, episode {number}: {text}")));
        }
    }
    lines
}

fn difference(found: &CalibrationEpisode, expected: &CalibrationEpisode) -> Option<String> {
    if (&found.end, found.steps) != (&expected.end, expected.steps) {
        return Some(format!(
            "{} after {} steps, published is {} after {}",
            found.end, found.steps, expected.end, expected.steps
        ));
    }
    // f64 equality would accept -0 for 0.
    let bits = |metrics: &BTreeMap<String, f64>| {
        metrics.iter().map(|(name, value)| (name.clone(), value.to_bits())).collect::<Vec<_>>()
    };
    if bits(&found.metrics) != bits(&expected.metrics) {
        return Some(format!("metrics {:?}, published are {:?}", found.metrics, expected.metrics));
    }
    (found.sensed != expected.sensed).then(|| "equal metrics, but different observations".to_owned())
}

/// Returns `true` if the published values belong to this build's benchmark version.
pub fn is_current(published: &Calibration) -> bool {
    published.benchmark == BENCHMARK_VERSION
}

/// An agent that hashes missions, observations and actions, and stops after [`MOST_STEPS`].
struct DigestingAgent {
    agent: Box<dyn Agent + Send>,
    episodes: Vec<blake3::Hasher>,
}

impl DigestingAgent {
    /// Returns the hexadecimal hashes by episode.
    fn digests(&self) -> Vec<String> {
        self.episodes.iter().map(|hasher| hasher.finalize().to_hex().to_string()).collect()
    }
}

impl Agent for DigestingAgent {
    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        let mut hasher = blake3::Hasher::new();
        for goal in &mission.goals {
            match goal {
                GoalCue::Category(text) | GoalCue::Description(text) => hasher.update(text.as_bytes()),
                GoalCue::Image(image) => hasher.update(&image.pixels),
            };
            hasher.update(b"\n");
        }
        self.episodes.push(hasher);
        self.agent.begin(task, mission);
    }

    fn act(&mut self, observation: &Observation) -> Action {
        let action = match self.agent.act(observation) {
            _ if observation.step + 1 >= MOST_STEPS => Action::Stop,
            action => action,
        };
        if let Some(hasher) = self.episodes.last_mut() {
            observe(hasher, observation);
            hasher.update(format!("{action:?}\n").as_bytes());
        }
        action
    }
}

/// Hashes the bytes in the machine's order: those of little-endian machines are published.
fn observe(hasher: &mut blake3::Hasher, seen: &Observation) {
    let [x, y, z] = seen.pose.position();
    hasher.update(bytemuck::cast_slice(&[x, y, z, seen.pose.heading_rad()]));
    if let Some(image) = &seen.rgb {
        hasher.update(&image.pixels);
    }
    if let Some(depth) = &seen.depth {
        hasher.update(bytemuck::cast_slice(&depth.metres));
    }
    if let Some(audio) = &seen.audio {
        hasher.update(bytemuck::cast_slice(&audio.left)).update(bytemuck::cast_slice(&audio.right));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_values_are_current_and_complete() {
        let published = published().unwrap();
        assert!(is_current(&published), "publish again: AVLN_BLESS=1 cargo test -p avln-tests calibration");
        let runs = published.runs.iter();
        let runs: Vec<_> =
            runs.map(|run| (run.agent.as_str(), run.phase.as_str(), run.episodes.len())).collect();
        let wanted = ReferenceAgent::ALL.iter().flat_map(|agent| {
            PHASES.iter().map(|phase| (agent.name(), phase.id, phase.houses as usize * phase.missions))
        });
        assert_eq!(runs, wanted.collect::<Vec<_>>());
        assert!(published.dataset.is_some());
        assert_eq!(differences(&published, &published), Vec::<String>::new());
    }

    #[test]
    fn a_single_bit_is_a_difference() {
        let published = published().unwrap();
        let mut other = published.clone();
        let value = other.runs[2].episodes[3].metrics.get_mut("soft_spl").unwrap();
        *value = f64::from_bits(value.to_bits() + 1);
        let lines = differences(&other, &published);
        assert!(
            lines.len() == 1
                && lines[0].starts_with("PAG-Nav unordered, phase calibration, episode 4: metrics"),
            "{lines:?}"
        );
        let mut other = published.clone();
        other.runs[0].episodes[0].sensed.replace_range(..1, "x");
        assert!(differences(&other, &published)[0].contains("different observations"));
        let mut other = published.clone();
        other.runs[0].episodes.pop();
        other.benchmark = "0.0.1".to_owned();
        other.dataset = Some("0".to_owned());
        assert_eq!(differences(&other, &published).len(), 3);
        other.dataset = None;
        assert_eq!(differences(&other, &published).len(), 2);
    }
}
