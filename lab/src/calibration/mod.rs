//! Calibration: three procedural houses that every build can grow, missions in them, and what the reference agents sense and
//! reach there, to the last bit. A server where they sense and reach the same scores as the published one does.

mod digesting_agent;

use avln_arena::{BENCHMARK_VERSION, Failure, FailureKind, data::DataFolder, setup::{NewPhase, NewSplit, make_split, open_phase}};
use avln_baselines::RandomAgent;
use avln_client::{Agent, Client, ConnectOptions, EpisodeEnd, Order, RunOptions, Sensors, evaluate_with};
use avln_episode::Rules;
use avln_pag_nav::PagNav;
use avln_store::Store;
use digesting_agent::DigestingAgent;
use serde::{Deserialize, Serialize};
use std::{collections::BTreeMap, path::PathBuf};

/// Id of the calibration phase and of its split.
pub const PHASE: &str = "calibration";
/// Published values of the repository.
const PUBLISHED: &str = include_str!("published.json");
/// Pixels a side of the pictures.
const SIDE: u32 = 128;
const HOUSES: u32 = 3;
/// In each house.
const MISSIONS: usize = 4;
const SEED: u64 = 1;
/// Actions after which the random agent stops.
const RANDOM_STEPS: u32 = 100;

/// Observations and scores of the reference agents.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// Version of the benchmark.
    pub benchmark: String,
    /// The runs of the reference agents.
    pub runs: Vec<CalibrationRun>,
}

/// A run of a reference agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationRun {
    /// The agent.
    pub agent: String,
    /// Success criterion.
    pub order: String,
    /// Its episodes, in playing order.
    pub episodes: Vec<CalibrationEpisode>,
    /// Means over them.
    pub means: BTreeMap<String, f64>,
}

/// An episode of a reference agent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationEpisode {
    /// BLAKE3 of mission, observations and actions, hexadecimal.
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
    /// Walks at random for 100 steps.
    Random,
    /// PAG-Nav.
    PagNav,
}

impl ReferenceAgent {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Random, Self::PagNav];

    fn name(self) -> &'static str {
        match self {
            Self::Random => "random",
            Self::PagNav => "PAG-Nav",
        }
    }

    fn order(self) -> Order {
        match self {
            Self::Random => Order::Ordered,
            Self::PagNav => Order::Unordered,
        }
    }

    fn agent(self) -> (Box<dyn Agent + Send>, u32) {
        match self {
            Self::Random => (Box::new(RandomAgent::new(0)), RANDOM_STEPS),
            Self::PagNav => (Box::<PagNav>::default(), u32::MAX),
        }
    }
}

/// Server and account of the runs.
#[derive(Clone, Debug)]
pub struct CalibrationServer {
    /// URL of the gRPC server.
    pub url: String,
    /// File of trusted authorities, instead of those of the system.
    pub ca: Option<PathBuf>,
    /// Token of an account.
    pub token: String,
}

/// Published values of this program's repository.
///
/// # Errors
/// When the published file is damaged.
pub fn published() -> Result<Calibration, Failure> {
    serde_json::from_str(PUBLISHED).map_err(|error| Failure::new(FailureKind::Internal, error))
}

/// Makes the calibration split and opens the calibration phase in a data folder, unless it is there.
///
/// # Errors
/// When the data folder cannot be written, or has another phase of that name.
pub async fn open(data: &DataFolder, store: &Store) -> Result<(), Failure> {
    let make = NewSplit {
        name: PHASE.to_owned(),
        houses: HOUSES,
        scenes: vec![],
        missions: MISSIONS,
        seed: SEED,
        rules: Rules::PAPER.to_owned(),
    };
    make_split(data, store, make, |_| ()).await?;
    if store.phases().await?.iter().any(|phase| phase.id == PHASE) {
        return Ok(());
    }
    let open =
        NewPhase { title: Some("Calibration".to_owned()), max_side: 256, ..NewPhase::public(PHASE, PHASE) };
    open_phase(data, store, &open).await.map(drop)
}

/// Lets reference agents play the calibration phase of a server; `tell` hears of each episode.
///
/// # Errors
/// When the server does not host it, does not tell metrics, or a run fails.
pub async fn play(
    server: &CalibrationServer,
    agents: &[ReferenceAgent],
    tell: &mut (dyn FnMut(ReferenceAgent, &EpisodeEnd) + Send),
) -> Result<Calibration, Failure> {
    let link = ConnectOptions { ca: server.ca.clone(), ..ConnectOptions::default() };
    let arena =
        Client::connect_with(&server.url, server.token.as_str(), &link).await.map_err(Failure::run)?;
    let benchmark = arena.server_info().await.map_err(Failure::run)?.benchmark;
    let mut runs = Vec::with_capacity(agents.len());
    for &agent in agents {
        runs.push(play_one(&arena, agent, tell).await?);
    }
    Ok(Calibration { benchmark, runs })
}

async fn play_one(
    arena: &Client,
    reference: ReferenceAgent,
    tell: &mut (dyn FnMut(ReferenceAgent, &EpisodeEnd) + Send),
) -> Result<CalibrationRun, Failure> {
    let options = RunOptions::new(PHASE, format!("{} (calibration)", reference.name()));
    let options = options.method_version(env!("CARGO_PKG_VERSION")).order(reference.order());
    let run = arena.start_run(options).await.map_err(Failure::run)?;
    let (agent, most_steps) = reference.agent();
    let mut digesting_agent = DigestingAgent::new(agent, most_steps);
    let mut ends = Vec::new();
    let mut on_end = |end: &EpisodeEnd| {
        tell(reference, end);
        ends.push(end.clone());
    };
    evaluate_with(arena, &run, Sensors::square(SIDE), &mut digesting_agent, &mut on_end)
        .await
        .map_err(Failure::run)?;
    let episodes: Vec<CalibrationEpisode> = ends.iter().zip(digesting_agent.digests()).map(episode).collect();
    if episodes.iter().any(|episode| episode.metrics.is_empty()) {
        let message = "the server does not tell what episodes were worth";
        return Err(Failure::new(FailureKind::Run, message)
            .hinted("its organiser can open the phase as it is published: avln lab calibrate --open"));
    }
    let means = means(&episodes);
    Ok(CalibrationRun {
        agent: reference.name().to_owned(),
        order: reference.order().to_string(),
        episodes,
        means,
    })
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

/// Differences between `found` and the published values, one per line; empty when all bits agree.
pub fn differences(found: &Calibration, published: &Calibration) -> Vec<String> {
    let mut lines = Vec::new();
    if found.benchmark != published.benchmark {
        lines.push(format!(
            "the server has benchmark {}, published is {}",
            found.benchmark, published.benchmark
        ));
    }
    for run in &found.runs {
        let who = format!("{} {}", run.agent, run.order);
        let Some(expected) =
            published.runs.iter().find(|other| (&other.agent, &other.order) == (&run.agent, &run.order))
        else {
            lines.push(format!("{who}: nothing is published"));
            continue;
        };
        if run.episodes.len() != expected.episodes.len() {
            lines.push(format!(
                "{who}: {} episodes, published are {}",
                run.episodes.len(),
                expected.episodes.len()
            ));
        }
        for (number, (found, expected)) in (1..).zip(run.episodes.iter().zip(&expected.episodes)) {
            lines.extend(difference(found, expected).map(|what| format!("{who}, episode {number}: {what}")));
        }
    }
    lines
}

/// The first thing in which an episode differs.
fn difference(found: &CalibrationEpisode, expected: &CalibrationEpisode) -> Option<String> {
    let bits = |metrics: &BTreeMap<String, f64>| {
        metrics.iter().map(|(name, value)| (name.clone(), value.to_bits())).collect::<Vec<_>>()
    };
    if (&found.end, found.steps) != (&expected.end, expected.steps) {
        return Some(format!(
            "{} after {} steps, published is {} after {}",
            found.end, found.steps, expected.end, expected.steps
        ));
    }
    if bits(&found.metrics) != bits(&expected.metrics) {
        return Some(format!("worth {:?}, published is {:?}", found.metrics, expected.metrics));
    }
    (found.sensed != expected.sensed)
        .then(|| "worth the same, but the agent was told or sensed something else".to_owned())
}

/// Compares the benchmark of this build with the published one.
pub fn is_current(published: &Calibration) -> bool {
    published.benchmark == BENCHMARK_VERSION
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_published_is_of_this_benchmark_and_of_every_reference_agent() {
        let published = published().unwrap();
        assert!(
            is_current(&published),
            "publish anew: AVLN_BLESS=1 cargo test -p avln-tests --test calibration"
        );
        let agents: Vec<_> = published.runs.iter().map(|run| run.agent.as_str()).collect();
        assert_eq!(agents, ReferenceAgent::ALL.map(ReferenceAgent::name));
        assert!(published.runs.iter().all(|run| run.episodes.len() == HOUSES as usize * MISSIONS));
        assert_eq!(differences(&published, &published), Vec::<String>::new());
    }

    #[test]
    fn the_last_bit_of_one_number_is_a_difference() {
        let published = published().unwrap();
        let mut other = published.clone();
        let value = other.runs[1].episodes[3].metrics.get_mut("soft_spl").unwrap();
        *value = f64::from_bits(value.to_bits() + 1);
        let lines = differences(&other, &published);
        assert!(lines.len() == 1 && lines[0].starts_with("PAG-Nav unordered, episode 4: worth"), "{lines:?}");
        let mut other = published.clone();
        other.runs[0].episodes[0].sensed.replace_range(..1, "x");
        assert!(differences(&other, &published)[0].contains("sensed something else"));
        let mut other = published.clone();
        other.runs[0].episodes.pop();
        other.benchmark = "0.0.1".to_owned();
        assert_eq!(differences(&other, &published).len(), 2);
    }
}
