//! The suite's runs.

use super::hints::TrueHints;
use super::host::{Batch, HostedSuite, SuiteFolder, client_order, mission_of};
use super::results::causes;
use super::variant::{AgentSetup, EpisodeAgent};
use super::{AgentVariant, ResultLine, Results, SuiteShard, SuiteSize, Track};
use crate::internal;
use avln_arena::Failure;
use avln_client::{Client, Play, RunOptions};
use avln_dataset::EpisodeSpec;
use avln_episode::{EndReason, FeedbackRule, Order};
use avln_scoring::score;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::task::{JoinSet, block_in_place};

/// Suite settings.
#[derive(Clone, Debug)]
pub struct SuiteOptions {
    /// Split and rules.
    pub track: Track,
    /// Agents, in playing order.
    pub agents: Vec<AgentVariant>,
    /// Goal orders.
    pub orders: Vec<Order>,
    /// Missions per agent and order, spread evenly over the houses; [`Track::missions`] by default.
    pub episodes: Option<usize>,
    /// Part of the missions.
    pub shard: SuiteShard,
    /// Parallel episodes.
    pub slots: u32,
    /// Random agents' seed.
    pub seed: u64,
    /// Image side, pixels.
    pub side: u32,
    /// Feedback to Submits; the rule set's by default.
    pub feedback: Option<FeedbackRule>,
    /// `true` to repeat finished episodes.
    pub again: bool,
    /// Split size.
    pub size: SuiteSize,
    /// Trace folder for PAG-Nav and ablations.
    pub trace: Option<PathBuf>,
    /// File of ONNX models for [`AgentVariant::PagNavModels`].
    pub models: Option<PathBuf>,
}

impl Default for SuiteOptions {
    /// Returns all rows of the main track in both orders.
    fn default() -> Self {
        Self {
            track: Track::Main,
            agents: Track::Main.rows(None),
            orders: vec![Order::Ordered, Order::Unordered],
            episodes: None,
            shard: SuiteShard::default(),
            slots: 2,
            seed: 0,
            side: 128,
            feedback: None,
            again: false,
            size: Track::Main.size(),
            trace: None,
            models: None,
        }
    }
}

/// Plays the missions without results in `folder` and returns their count. An interrupted call can be repeated.
///
/// # Errors
/// If the folder cannot be used or a run fails. Finished episodes remain.
pub async fn run(folder: &Path, plan: &SuiteOptions) -> Result<usize, Failure> {
    let (path, options) = (folder.to_owned(), plan.clone());
    let opened = tokio::task::spawn_blocking(move || SuiteFolder::open(&path, &options));
    let folder = opened.await.map_err(internal)??;
    let results = Results::open(&folder.results())?;
    let batches = missing(&folder, &results, plan)?;
    if batches.is_empty() {
        eprintln!("every mission has a result; repeat missions with --again");
        return Ok(0);
    }
    let hosted = folder.host(&batches).await?;
    let row = |batch: &Batch| (batch.variant.name(), batch.order.as_str().to_owned());
    let left = batches.iter().map(|batch| (row(batch), batch.episodes.len()));
    let progress = SuiteProgress::new(results, &folder.edition.track, left.collect(), plan.slots);
    let suite = Arc::new(SuiteRun { folder, hosted, plan: plan.clone(), progress: Mutex::new(progress) });
    let mut played = Ok(());
    for batch in batches {
        played = suite.play(batch).await;
        if played.is_err() {
            break;
        }
    }
    let count = suite.progress().played;
    if let Ok(SuiteRun { hosted, .. }) = Arc::try_unwrap(suite).map_err(|_| ()) {
        hosted.servers.close().await?;
        hosted.store.close().await;
    }
    played.map(|()| count)
}

/// Returns the missions without results, by row; both orders of a row follow each other.
fn missing(folder: &SuiteFolder, results: &Results, plan: &SuiteOptions) -> Result<Vec<Batch>, Failure> {
    let all = folder.episodes()?;
    let mut batches = Vec::new();
    for &variant in &plan.agents {
        let name = variant.name();
        let planned = plan.episodes.unwrap_or_else(|| plan.track.missions(variant, plan.size, plan.feedback));
        for &order in &plan.orders {
            let is_missing = |episode: &str| plan.again || !results.has(&folder.key(&name, order, episode));
            let own = all.iter().take(planned).enumerate().filter(|(index, _)| plan.shard.includes(*index));
            let episodes: Vec<_> =
                own.filter(|(_, own)| is_missing(&own.episode)).map(|(_, own)| own.clone()).collect();
            if !episodes.is_empty() {
                let phase = format!("{name}-{}", order.as_str());
                batches.push(Batch { variant, order, phase, episodes });
            }
        }
    }
    Ok(batches)
}

struct SuiteRun {
    folder: SuiteFolder,
    hosted: HostedSuite,
    plan: SuiteOptions,
    progress: Mutex<SuiteProgress>,
}

impl SuiteRun {
    async fn play(self: &Arc<Self>, batch: Batch) -> Result<(), Failure> {
        let url = self.hosted.servers.grpc_url();
        let client = Client::connect(url, self.hosted.token.as_str()).await.map_err(Failure::run)?;
        let options = RunOptions::new(&batch.phase, batch.variant.name());
        let options = options.method_version(env!("CARGO_PKG_VERSION")).order(client_order(batch.order));
        let options = options.method_type(batch.variant.method_type());
        let run = client.start_run(options).await.map_err(Failure::run)?;
        let sensors = batch.variant.sensors(self.plan.side);
        let plays = client.play_slots(&run, sensors, self.plan.slots).await.map_err(Failure::run)?;
        let (batch, run) = (Arc::new(batch), Arc::new(run));
        let mut slots = JoinSet::new();
        for play in plays {
            let (suite, batch, run) = (self.clone(), batch.clone(), run.clone());
            slots.spawn(async move { suite.play_slot(&batch, &run.id, play).await });
        }
        let mut last = None;
        while let Some(joined) = slots.join_next().await {
            last = Some(joined.map_err(internal)??);
        }
        match last {
            Some(play) => play.finish().await.map(drop).map_err(Failure::run),
            None => Ok(()),
        }
    }

    async fn play_slot(&self, batch: &Batch, run: &str, mut play: Play) -> Result<Play, Failure> {
        let task = play.task().clone();
        let hints = Arc::new(TrueHints::new(self.hosted.live.clone(), self.folder.rules.clone()));
        while let Some(mut episode) = play.next_episode().await.map_err(Failure::run)? {
            let (began, handle) = (Instant::now(), episode.id().to_owned());
            let spec = mission_of(&self.hosted.store, &self.folder.split, run, &handle).await?;
            hints.follow(&handle, spec.truth(batch.order));
            let traces = self.plan.trace.as_ref().map(|folder| folder.join(&batch.phase));
            let seed = agent_seed(self.plan.seed, &spec.id);
            let setup = AgentSetup {
                seed,
                hints: &hints,
                models: self.plan.models.as_deref(),
                traces: traces.as_deref(),
            };
            let EpisodeAgent { mut agent, failure } = batch.variant.agent(&setup)?;
            let mut thought = Duration::ZERO;
            agent.enter(&spec.id);
            timed(&mut thought, || agent.begin(&task, episode.mission()));
            while !episode.is_over() {
                let action = timed(&mut thought, || agent.act(episode.observation()));
                episode.step(action).await.map_err(Failure::run)?;
            }
            self.hosted.live.forget(&handle);
            if let Some(error) = failure.as_ref().and_then(|failure| failure.get()) {
                return Err(Failure::data(format!("a model failed in {}: {error}", spec.id)));
            }
            self.record(batch, run, &spec, [thought, began.elapsed()]).await?;
        }
        Ok(play)
    }

    /// Stores an episode's result. A lost episode is repeated by the server or by the next call.
    async fn record(
        &self,
        batch: &Batch,
        run: &str,
        spec: &EpisodeSpec,
        [thought, wall]: [Duration; 2],
    ) -> Result<(), Failure> {
        let id = spec.id.as_str();
        let index = batch.episodes.iter().position(|episode| episode.episode == id);
        let Some(index) = index else { return Ok(()) };
        let Some(facts) = self.hosted.store.facts(run, index as u32).await? else { return Ok(()) };
        if is_lost(facts.record.end) {
            let end = facts.record.end.as_str();
            eprintln!(
                "episode {id} was lost: {end}; repeat the command, with fewer --slots on a busy machine"
            );
            return Ok(());
        }
        let mut wrong = BTreeMap::new();
        for cause in causes(&facts.truth, &facts.record, &self.folder.rules) {
            *wrong.entry(cause).or_default() += 1;
        }
        let metrics = score(&facts.truth, &facts.record, &self.folder.rules);
        let line = ResultLine {
            key: self.folder.key(&batch.variant.name(), batch.order, id),
            mission: self.folder.facts(&facts.truth.scene, spec, batch.order),
            scene: facts.truth.scene,
            modalities: facts.truth.targets.iter().map(|target| target.modality).collect(),
            end: facts.record.end,
            think_ms: thought.as_secs_f64() * 1e3 / f64::from(metrics.steps.max(1)),
            wall_s: wall.as_secs_f64(),
            metrics,
            wrong,
        };
        self.progress().add(line)
    }

    fn progress(&self) -> MutexGuard<'_, SuiteProgress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns true if an episode ended for a reason outside of the agent. The time budget depends on the load of the machine.
fn is_lost(end: EndReason) -> bool {
    use EndReason::{Abandoned, Disconnected, ServerFault, TimeBudget};
    matches!(end, ServerFault | Disconnected | Abandoned | TimeBudget)
}

/// Derives an agent's seed for an episode.
fn agent_seed(seed: u64, episode: &str) -> u64 {
    let hash = blake3::Hasher::new().update(&seed.to_le_bytes()).update(episode.as_bytes()).finalize();
    let mut first = [0; 8];
    first.copy_from_slice(&hash.as_bytes()[..8]);
    u64::from_le_bytes(first)
}

/// Runs `think` and adds the duration to `sum`.
fn timed<T>(sum: &mut Duration, think: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    // Agents compute for milliseconds: without block_in_place they would delay the server's tasks.
    let thought = block_in_place(think);
    *sum += began.elapsed();
    thought
}

const REPORT_INTERVAL: Duration = Duration::from_secs(5);
/// Assumed episode duration before the first measurement, seconds.
const UNMEASURED_S: f64 = 30.0;

/// An agent's name and a goal order, as in [`EpisodeKey`](super::EpisodeKey).
pub(super) type SuiteRow = (String, String);

/// The results file and the progress messages.
pub(super) struct SuiteProgress {
    results: Results,
    durations: EpisodeDurations,
    /// Missions without results by row.
    left: BTreeMap<SuiteRow, usize>,
    slots: u32,
    played: usize,
    to_play: usize,
    reported: Option<Instant>,
}

impl SuiteProgress {
    /// Begins with results of a track and the missing missions by row.
    pub(super) fn new(results: Results, track: &str, left: BTreeMap<SuiteRow, usize>, slots: u32) -> Self {
        let mut durations = EpisodeDurations::default();
        results.lines().filter(|line| line.key.track == track).for_each(|line| durations.add(line));
        let to_play = left.values().sum();
        Self { results, durations, left, slots, played: 0, to_play, reported: None }
    }

    /// Stores a result, and reports at intervals.
    pub(super) fn add(&mut self, line: ResultLine) -> Result<(), Failure> {
        self.played += 1;
        self.durations.add(&line);
        if let Some(left) = self.left.get_mut(&(line.key.agent.clone(), line.key.order.clone())) {
            *left = left.saturating_sub(1);
        }
        let is_last = self.played == self.to_play;
        if is_last || self.reported.is_none_or(|reported| reported.elapsed() >= REPORT_INTERVAL) {
            self.reported = Some(Instant::now());
            self.report(&line);
        }
        self.results.add(line)
    }

    fn report(&self, line: &ResultLine) {
        let (agent, order) = (&line.key.agent, &line.key.order);
        let left = self.left.get(&(agent.clone(), order.clone())).copied().unwrap_or(0);
        let time = shown(self.durations.remaining_s(&self.left) / f64::from(self.slots.max(1)));
        let (metrics, think_ms) = (&line.metrics, line.think_ms);
        eprintln!(
            "{} of {} episodes, about {time} left: {agent} {order}, {left} missions left; {} of {} goals in {} steps, {think_ms:.0} ms per action",
            self.played, self.to_play, metrics.found, metrics.goals, metrics.steps
        );
    }
}

/// Measured episode durations by row.
#[derive(Default)]
struct EpisodeDurations(BTreeMap<SuiteRow, (f64, usize)>);

impl EpisodeDurations {
    fn add(&mut self, line: &ResultLine) {
        let (sum_s, count) = self.0.entry((line.key.agent.clone(), line.key.order.clone())).or_default();
        *sum_s += line.wall_s;
        *count += 1;
    }

    fn remaining_s(&self, left: &BTreeMap<SuiteRow, usize>) -> f64 {
        left.iter().map(|(row, &count)| count as f64 * self.episode_s(row)).sum()
    }

    /// Returns a row's mean duration, or that of the agent, of its relatives or of all agents.
    fn episode_s(&self, row: &SuiteRow) -> f64 {
        let family = |name: &str| name.starts_with("pag-nav");
        let tests: [&dyn Fn(&SuiteRow) -> bool; 4] = [
            &|other| other == row,
            &|other| other.0 == row.0,
            &|other| family(&other.0) && family(&row.0),
            &|_| true,
        ];
        tests.iter().find_map(|is_alike| self.mean_s(*is_alike)).unwrap_or(UNMEASURED_S)
    }

    fn mean_s(&self, is_alike: &dyn Fn(&SuiteRow) -> bool) -> Option<f64> {
        let alike = self.0.iter().filter(|(row, _)| is_alike(row));
        let (sum_s, count) = alike.fold((0.0, 0), |(sum_s, count), (_, (s, n))| (sum_s + s, count + n));
        (count > 0).then(|| sum_s / count as f64)
    }
}

/// Formats a duration: minutes, or hours and minutes.
fn shown(seconds: f64) -> String {
    let minutes = (seconds / 60.0).ceil() as u64;
    if minutes < 60 { format!("{minutes} min") } else { format!("{} h {} min", minutes / 60, minutes % 60) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, order: &str) -> SuiteRow {
        (name.to_owned(), order.to_owned())
    }

    #[test]
    fn remaining_time_is_estimated_by_row() {
        let mut durations = EpisodeDurations::default();
        let left = BTreeMap::from([(row("pag-nav-no-map", "ordered"), 10)]);
        assert_eq!(durations.remaining_s(&left), 10.0 * UNMEASURED_S);
        durations.0.insert(row("random", "ordered"), (2.0, 2));
        assert_eq!(durations.remaining_s(&left), 10.0);
        durations.0.insert(row("pag-nav", "ordered"), (40.0, 2));
        assert_eq!(durations.remaining_s(&left), 200.0);
        durations.0.insert(row("pag-nav-no-map", "unordered"), (30.0, 1));
        assert_eq!(durations.remaining_s(&left), 300.0);
        durations.0.insert(row("pag-nav-no-map", "ordered"), (50.0, 1));
        assert_eq!(durations.remaining_s(&left), 500.0);
    }

    #[test]
    fn results_do_not_depend_on_load() {
        let kept = EndReason::ALL.into_iter().filter(|end| !is_lost(*end));
        let wanted = [EndReason::Stopped, EndReason::FinalSubmit, EndReason::StepLimit];
        assert_eq!(kept.collect::<Vec<_>>(), wanted);
    }

    #[test]
    fn durations_are_shown_in_hours_and_minutes() {
        assert_eq!(
            (shown(59.0), shown(61.0), shown(7260.0)),
            ("1 min".into(), "2 min".into(), "2 h 1 min".into())
        );
    }
}
