//! Runs of the baseline suite.

use super::{
    AgentVariant, ResultLine, Results, SuiteSize,
    causes::causes,
    host::{Batch, HostedSuite, SuiteFolder},
    live_episodes::TrueHints,
    results::EpisodeKey,
};
use avln_arena::{Failure, FailureKind};
use avln_client::{Action, Play, RunOptions};
use avln_episode::{EndReason, Order};
use avln_scoring::score;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    sync::{Arc, Mutex, PoisonError},
    time::{Duration, Instant},
};
use tokio::task::{JoinSet, block_in_place};

/// Interval between progress messages, seconds.
const TELL_EVERY: Duration = Duration::from_secs(5);

/// Settings of a suite run.
#[derive(Clone, Debug)]
pub struct SuiteOptions {
    /// Agents, in playing order.
    pub agents: Vec<AgentVariant>,
    /// Orders of goals.
    pub orders: Vec<Order>,
    /// Largest number of missions, spread evenly over the houses.
    pub episodes: usize,
    /// Number of parallel episodes.
    pub slots: u32,
    /// Seed of random agents.
    pub seed: u64,
    /// Side of pictures, pixels.
    pub side: u32,
    /// Repeats finished episodes if `true`.
    pub again: bool,
    /// Size of the split.
    pub size: SuiteSize,
    /// Folder for traces of PAG-Nav and its variants.
    pub trace: Option<PathBuf>,
}

impl Default for SuiteOptions {
    /// All agents on the whole split in both orders.
    fn default() -> Self {
        Self {
            agents: AgentVariant::ALL.to_vec(),
            orders: vec![Order::Ordered, Order::Unordered],
            episodes: usize::MAX,
            slots: 2,
            seed: 0,
            side: 128,
            again: false,
            size: SuiteSize::default(),
            trace: None,
        }
    }
}

/// Plays the missions without results in `folder` and returns their number. An interrupted call can be repeated.
///
/// # Errors
/// If the folder cannot be used or a run fails. Finished episodes remain.
pub async fn run(folder: &Path, plan: &SuiteOptions) -> Result<usize, Failure> {
    let (path, size) = (folder.to_owned(), plan.size);
    let ground = tokio::task::spawn_blocking(move || SuiteFolder::open(&path, size)).await;
    let ground = ground.map_err(|error| Failure::new(FailureKind::Internal, error))??;
    let results = Results::open(&ground.results())?;
    let todo = todo(&ground, &results, plan)?;
    if todo.is_empty() {
        eprintln!("nothing is left to play");
        return Ok(0);
    }
    let batches: Vec<Batch> = todo.iter().map(|(_, _, batch)| batch.copy()).collect();
    let hosted = ground.host(&batches).await?;
    let progress = SuiteProgress::new(results, batches.iter().map(|batch| batch.episodes.len()).sum());
    let table = Arc::new(SuiteRun { ground, hosted, plan: plan.clone(), progress: Mutex::new(progress) });
    let mut played = Ok(());
    for (variant, order, batch) in todo {
        played = table.play(variant, order, batch).await;
        if played.is_err() {
            break;
        }
    }
    let count = table.progress().played;
    if let Ok(SuiteRun { hosted, .. }) = Arc::try_unwrap(table).map_err(|_| ()) {
        hosted.servers.close().await?;
        hosted.store.close().await;
    }
    played.map(|()| count)
}

/// Returns the missing missions per agent and order.
fn todo(
    ground: &SuiteFolder,
    results: &Results,
    plan: &SuiteOptions,
) -> Result<Vec<(AgentVariant, Order, Batch)>, Failure> {
    let mut all = ground.episodes()?;
    all.truncate(plan.episodes);
    let mut todo = Vec::new();
    for &variant in &plan.agents {
        for &order in &plan.orders {
            let is_left = |episode: &str| {
                plan.again || !results.has(&ground.key(variant.name(), order, episode, plan.seed))
            };
            let episodes: Vec<_> = all.iter().filter(|episode| is_left(&episode.episode)).cloned().collect();
            if !episodes.is_empty() {
                let phase = format!("{}-{}", variant.name(), order.as_str());
                todo.push((variant, order, Batch { phase, episodes }));
            }
        }
    }
    Ok(todo)
}

impl Batch {
    fn copy(&self) -> Self {
        Self { phase: self.phase.clone(), episodes: self.episodes.clone() }
    }
}

/// The state shared by all runs.
struct SuiteRun {
    ground: SuiteFolder,
    hosted: HostedSuite,
    plan: SuiteOptions,
    progress: Mutex<SuiteProgress>,
}

/// A running run.
struct VariantRun {
    variant: AgentVariant,
    order: Order,
    batch: Batch,
    id: String,
}

impl SuiteRun {
    async fn play(
        self: &Arc<Self>,
        variant: AgentVariant,
        order: Order,
        batch: Batch,
    ) -> Result<(), Failure> {
        let url = self.hosted.servers.grpc_url();
        let arena =
            avln_client::Client::connect(url, self.hosted.token.as_str()).await.map_err(Failure::run)?;
        let method = RunOptions::new(&batch.phase, variant.name()).method_version(env!("CARGO_PKG_VERSION"));
        let run = arena.start_run(method.order(client_order(order))).await.map_err(Failure::run)?;
        let plays = arena
            .play_slots(&run, variant.sensors(self.plan.side), self.plan.slots)
            .await
            .map_err(Failure::run)?;
        let here = Arc::new(VariantRun { variant, order, batch, id: run.id.clone() });
        let mut slots = JoinSet::new();
        for play in plays {
            let (table, run) = (self.clone(), here.clone());
            slots.spawn(async move { table.play_slot(&run, play).await });
        }
        let mut last = None;
        while let Some(joined) = slots.join_next().await {
            last = Some(joined.map_err(|error| Failure::new(FailureKind::Internal, error))??);
        }
        match last {
            Some(play) => play.finish().await.map(drop).map_err(Failure::run),
            None => Ok(()),
        }
    }

    async fn play_slot(&self, run: &VariantRun, mut play: Play) -> Result<Play, Failure> {
        let task = play.task().clone();
        let hints = Arc::new(TrueHints::new(self.hosted.live.clone(), self.ground.rules.clone()));
        while let Some(mut episode) = play.next_episode().await.map_err(Failure::run)? {
            let (began, handle) = (Instant::now(), episode.id().to_owned());
            let id = self.episode_of(run, &handle).await?;
            let spec = self.ground.split.episode(&id)?.ok_or_else(|| unknown(&id))?;
            hints.follow(&handle, spec.truth(run.order));
            let traces = self.plan.trace.as_ref().map(|folder| folder.join(&run.batch.phase));
            let mut agent = run.variant.agent(seed_of(self.plan.seed, &id), &hints, traces.as_deref())?;
            let mut thought = Duration::ZERO;
            agent.enter(&id);
            timed(&mut thought, || agent.begin(&task, episode.mission()));
            while !episode.is_over() {
                let action: Action = timed(&mut thought, || agent.act(episode.observation()));
                episode.step(action).await.map_err(Failure::run)?;
            }
            self.hosted.live.forget(&handle);
            self.keep(run, &id, thought, began.elapsed()).await?;
        }
        Ok(play)
    }

    /// Returns the mission of a handle.
    async fn episode_of(&self, run: &VariantRun, handle: &str) -> Result<String, Failure> {
        let open = self.hosted.store.running_episodes().await?;
        let found = open.into_iter().find(|open| open.run == run.id && open.handle == handle);
        found.map(|open| open.episode).ok_or_else(|| unknown(handle))
    }

    /// Stores the result of an episode. A lost episode is repeated by the server or by the next call.
    async fn keep(
        &self,
        run: &VariantRun,
        id: &str,
        thought: Duration,
        wall: Duration,
    ) -> Result<(), Failure> {
        let place = run.batch.episodes.iter().position(|episode| episode.episode == id);
        let facts = match place {
            Some(place) => self.hosted.store.facts(&run.id, place as u32).await?,
            None => None,
        };
        let Some(facts) = facts else { return Ok(()) };
        if matches!(facts.record.end, EndReason::ServerFault | EndReason::Disconnected | EndReason::Abandoned)
        {
            eprintln!("{id} was lost: {}", facts.record.end.as_str());
            return Ok(());
        }
        let mut wrong = BTreeMap::new();
        for cause in causes(&facts.truth, &facts.record, &self.ground.rules) {
            *wrong.entry(cause).or_default() += 1;
        }
        let metrics = score(&facts.truth, &facts.record, &self.ground.rules);
        let line = ResultLine {
            key: self.key(run, id),
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

    fn key(&self, run: &VariantRun, id: &str) -> EpisodeKey {
        self.ground.key(run.variant.name(), run.order, id, self.plan.seed)
    }

    fn progress(&self) -> std::sync::MutexGuard<'_, SuiteProgress> {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The results file and the progress messages.
struct SuiteProgress {
    results: Results,
    played: usize,
    to_play: usize,
    began: Instant,
    told: Option<Instant>,
}

impl SuiteProgress {
    fn new(results: Results, to_play: usize) -> Self {
        Self { results, played: 0, to_play, began: Instant::now(), told: None }
    }

    fn add(&mut self, line: ResultLine) -> Result<(), Failure> {
        self.played += 1;
        let is_last = self.played == self.to_play;
        if is_last || self.told.is_none_or(|told| told.elapsed() >= TELL_EVERY) {
            self.told = Some(Instant::now());
            self.tell(&line);
        }
        self.results.add(line)
    }

    fn tell(&self, line: &ResultLine) {
        let rest =
            self.began.elapsed().as_secs_f64() / self.played as f64 * (self.to_play - self.played) as f64;
        let (minutes, EpisodeKey { agent, order, .. }) = ((rest / 60.0).ceil(), &line.key);
        eprintln!(
            "{} of {} episodes, about {minutes} min left: {agent} {order}, {} of {} goals in {} steps, {:.0} ms each to think",
            self.played,
            self.to_play,
            line.metrics.found,
            line.metrics.goals,
            line.metrics.steps,
            line.think_ms
        );
    }
}

/// Returns the seed of an agent in an episode.
fn seed_of(seed: u64, episode: &str) -> u64 {
    let hash = blake3::Hasher::new().update(&seed.to_le_bytes()).update(episode.as_bytes()).finalize();
    let mut first = [0; 8];
    first.copy_from_slice(&hash.as_bytes()[..8]);
    u64::from_le_bytes(first)
}

pub(super) fn client_order(order: Order) -> avln_client::Order {
    match order {
        Order::Ordered => avln_client::Order::Ordered,
        Order::Unordered => avln_client::Order::Unordered,
    }
}

/// Lets other tasks go on while an agent thinks, and adds up how long it takes.
fn timed<T>(sum: &mut Duration, think: impl FnOnce() -> T) -> T {
    let began = Instant::now();
    let thought = block_in_place(think);
    *sum += began.elapsed();
    thought
}

fn unknown(episode: &str) -> Failure {
    Failure::new(FailureKind::Internal, format!("episode {episode} was played and is not in the split"))
}
