//! Episodes in play: issue, hosting, scoring and storage.

use crate::{
    Arena, Failure,
    budget::{Budget, MemoryUse},
    failure::refusal,
    ids, lock,
    phases::{HostedPhase, SceneCache},
    runlog::{Entry, RunLog, SlotLog},
};
use avln_challenge::EpisodeOutcome;
use avln_episode::{Action, EndReason, Mission, Observation, Order, Rules, Sensors};
use avln_grpc::{Episode, HostedEpisode, Reason, Refusal, StoredEnd, TimeSpent};
use avln_referee::{Referee, RefereeError, StepOutcome, episode_sources};
use avln_scoring::{Metric, Metrics, score};
use avln_store::{AssignedEpisode, EpisodeResult, EpisodeState, Run, Scene, TimeAccount};
use avln_truth::{EpisodeTruth, Record};
use avln_world::SceneAssets;
use std::{
    collections::BTreeMap,
    fmt,
    sync::{Arc, MutexGuard},
};
use tokio::task::spawn_blocking;
use tracing::Instrument;

/// Issued episodes without a result, by ticket.
#[derive(Default)]
pub(crate) struct OpenEpisodes {
    next_ticket: u64,
    pub(crate) issued: BTreeMap<u64, IssuedEpisode>,
}

pub(crate) struct IssuedEpisode {
    pub(crate) run: String,
    pub(crate) memory: MemoryUse,
    pub(crate) phase: Arc<HostedPhase>,
    pub(crate) log: Arc<RunLog>,
    pub(crate) slot: u32,
    /// True if restored after a server stop.
    pub(crate) restored: bool,
    /// True if the log contains the end.
    pub(crate) ended: bool,
}

/// Cause of an episode's return without a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ReturnCause {
    /// The agent's slots or sensors: no fault.
    Agent,
    /// The server lost the attempt.
    Server,
}

impl OpenEpisodes {
    pub(crate) fn memory_of(&self, run: &str) -> impl Iterator<Item = &MemoryUse> {
        self.issued.values().filter(move |issued| issued.run == run).map(|issued| &issued.memory)
    }
}

impl Arena {
    /// Issues a run's next episode; `None` if no episode is pending.
    pub(crate) async fn issue_next(
        &self,
        run: &str,
        slot: u32,
        sensors: &Sensors,
    ) -> Result<Option<HostedEpisode<ArenaEpisode>>, Refusal> {
        self.control().check_open()?;
        let row = self.store.run(run).await.map_err(refusal)?;
        let phase = self.phase(&row.phase).await?;
        check_sensors(&phase.settings.sensors, sensors)?;
        if row.sensors.as_ref() != Some(sensors) {
            self.store.set_sensors(run, sensors).await.map_err(refusal)?;
        }
        let handle = format!("ep_{}", ids::random_hex().map_err(Refusal::internal)?);
        let time = self.settled_time().await?;
        let assigned = self.store.assign_next_episode(run, &handle, time.unix_ms()).await.map_err(refusal)?;
        drop(time);
        let Some(assigned) = assigned else { return Ok(None) };
        let handle = assigned.handle.clone();
        let begun = self.begin(&row, &phase, slot, assigned, sensors).await;
        if let Err(refused) = &begun {
            // No fault: otherwise, an agent could make its runs free of charge.
            let is_agents_choice = Budget::is_agents_choice(refused);
            let cause = if is_agents_choice { ReturnCause::Agent } else { ReturnCause::Server };
            self.return_episode(run, &handle, cause).await;
        }
        self.prefetch(&row, &phase);
        begun.map(Some)
    }

    /// Logs an episode's start and prepares it.
    async fn begin(
        &self,
        run: &Run,
        phase: &Arc<HostedPhase>,
        slot: u32,
        assigned: AssignedEpisode,
        sensors: &Sensors,
    ) -> Result<HostedEpisode<ArenaEpisode>, Refusal> {
        let log = self.log_of(run, phase)?;
        // Before the preparation: after a server crash in it, the log must contain the episode.
        let began = Entry::Began {
            slot,
            handle: assigned.handle.clone(),
            ordinal: assigned.ordinal,
            episode: assigned.episode.clone(),
            sensors: sensors.clone(),
            at_ms: self.clock.now_unix_ms(),
        };
        log.write(&began).map_err(Refusal::internal)?;
        let (referee, memory) = self.prepare_episode(run, phase, assigned.episode, sensors.clone()).await?;
        let (phase, run) = (phase.clone(), run.id.clone());
        let issued = IssuedEpisode { run, memory, phase, log, slot, restored: false, ended: false };
        Ok(self.host_episode(assigned.handle, referee, issued))
    }

    pub(crate) fn log_of(&self, run: &Run, phase: &HostedPhase) -> Result<Arc<RunLog>, Refusal> {
        let first = || Entry::Run {
            format: Entry::FORMAT,
            run: run.id.clone(),
            phase: phase.settings.id.clone(),
            order: run.order,
            digests: run.digests.clone(),
            at_ms: self.clock.now_unix_ms(),
        };
        self.logs.open(&run.id, first).map_err(Refusal::internal)
    }

    /// Registers an issued episode; returns it with a step log.
    pub(crate) fn host_episode(
        &self,
        handle: String,
        referee: Referee,
        issued: IssuedEpisode,
    ) -> HostedEpisode<ArenaEpisode> {
        let log = Box::new(SlotLog {
            log: issued.log.clone(),
            slot: issued.slot,
            restored: issued.restored,
            clock: self.clock.clone(),
        });
        let mut open = self.open_episodes();
        open.next_ticket += 1;
        let ticket = open.next_ticket;
        open.issued.insert(ticket, issued);
        let episode = ArenaEpisode {
            referee,
            handle: handle.clone(),
            faults: self.faults.clone(),
            observer: self.observer.clone(),
        };
        HostedEpisode { handle, episode, ticket, log, time: TimeSpent::default() }
    }

    /// Creates a referee on a watched thread, within the session memory. Stores a new scene's map.
    #[tracing::instrument(level = "debug", name = "prepare", skip_all)]
    pub(crate) async fn prepare_episode(
        &self,
        run: &Run,
        phase: &Arc<HostedPhase>,
        episode: String,
        sensors: Sensors,
    ) -> Result<(Referee, MemoryUse), Refusal> {
        let (phase, scenes, order, budget) = (phase.clone(), self.scenes.clone(), run.order, self.budget);
        let needs_pictures = sensors.rgb || sensors.depth;
        let charged_bytes = budget.charge(phase.scene_allowance, &sensors);
        let work = move || {
            // First by file size: a scene beyond the limit must not be loaded.
            budget.check_file(phase.scene_file_bytes(&episode).map_err(Refusal::internal)?)?;
            let prepared = prepare_referee(&phase, &scenes, &episode, order, sensors)?;
            if needs_pictures {
                prepared.scene.prepare_pictures();
            }
            prepared.referee.world().prepare_sound();
            Ok::<_, Refusal>(prepared)
        };
        let turn = self.preparing.next(&run.team).await;
        let prepared = self.control().watchdog().run(self.budget.preparation, work).await;
        drop(turn);
        let PreparedReferee { referee, scene, map } =
            prepared.map_err(|lost| Refusal::new(Reason::SimFault, lost.to_string()))??;
        if let Some(map) = map {
            self.store.upsert_scene(&map).await.map_err(refusal)?;
        }
        let memory = MemoryUse::of(scene, &referee, charged_bytes);
        self.check_memory(&run.id, &memory)?;
        Ok((referee, memory))
    }

    /// Scores, logs and stores an episode. An episode without a stored result is reissued.
    pub(crate) async fn store_result(
        &self,
        run: &str,
        hosted: HostedEpisode<ArenaEpisode>,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        let handle = hosted.handle.clone();
        let stored = self.try_store_result(run, hosted).await;
        if stored.is_err() {
            self.return_episode(run, &handle, ReturnCause::Server).await;
        }
        stored
    }

    #[tracing::instrument(level = "debug", name = "store", skip_all)]
    async fn try_store_result(
        &self,
        run: &str,
        hosted: HostedEpisode<ArenaEpisode>,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        let HostedEpisode { handle, ticket, time, episode, .. } = hosted;
        let issued = self.open_episodes().issued.remove(&ticket);
        let unknown = || Refusal::internal(format!("episode {handle} was never issued"));
        let IssuedEpisode { phase, log, slot, ended, .. } = issued.ok_or_else(unknown)?;
        let (scoring, name, clock) = (phase.clone(), handle.clone(), self.clock.clone());
        let scored = spawn_blocking(move || {
            let (truth, record, metrics) = seal_and_score(episode.referee, &scoring);
            // The log before the database: the restart compares the two and continues from the log.
            if !ended {
                log.write(&Entry::Ended {
                    slot,
                    handle: name,
                    end: record.end,
                    metrics: Box::new(metrics.clone()),
                    at_ms: clock.now_unix_ms(),
                })?;
            }
            log.sync().map(|()| (truth, record, metrics))
        });
        let (truth, record, metrics) = scored.await.map_err(Refusal::internal)?.map_err(Refusal::internal)?;
        let result = EpisodeResult {
            run,
            handle: &handle,
            truth: &truth,
            record: &record,
            metrics: &metrics,
            time: &time_account(&time),
        };
        let recorded = self.store.record_result(&result, self.clock.now_unix_ms()).await.map_err(refusal)?;
        self.sign_if_over(&recorded.run).await;
        Ok((recorded.counts && phase.shows_metrics()).then(|| outcome(&metrics)))
    }

    pub(crate) async fn sign_if_over(&self, run: &Run) {
        if run.state.is_open() {
            return;
        }
        let (logs, key, run) = (self.logs.clone(), self.key.clone(), run.id.clone());
        let signed = spawn_blocking(move || logs.sign(&run, &key)).await;
        // The result is stored already, and an unsigned log is still valid.
        if let Err(error) = signed.map_err(|error| error.to_string()).flatten() {
            tracing::error!(error, "cannot sign a run log");
        }
    }

    /// Returns a stored episode's end; a lost episode counts as a server fault.
    pub(crate) async fn stored_end(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal> {
        let Some(found) = self.store.episode_status(run, handle).await.map_err(refusal)? else {
            return Ok(None);
        };
        let reason = match (found.state, found.end) {
            (EpisodeState::Running, _) => return Ok(None),
            (_, Some(reason)) => reason,
            (_, None) => EndReason::ServerFault,
        };
        let phase = self.phase(&self.store.run(run).await.map_err(refusal)?.phase).await?;
        // Before the filter: agents know their own steps in every phase.
        let steps = found.metrics.as_ref().map_or(0, |metrics| metrics.steps);
        let metrics = found.metrics.filter(|_| phase.shows_metrics());
        Ok(Some(StoredEnd { reason, steps, outcome: metrics.as_ref().map(outcome) }))
    }

    /// Prepares the next episode for `run` in the background.
    pub(crate) fn prefetch(&self, run: &Run, phase: &Arc<HostedPhase>) {
        let (team, run) = (run.team.clone(), run.id.clone());
        let (phase, store) = (phase.clone(), self.store.clone());
        let (scenes, turns) = (self.scenes.clone(), self.prefetching.clone());
        let (watchdog, limit) = (self.control().watchdog().clone(), self.budget.preparation);
        let span = tracing::debug_span!(parent: None, "prefetch", run);
        let work = async move {
            // One episode at a time, because running episodes have priority on the processors; the teams in turn, because one of
            // them may start hundreds of runs.
            let _turn = turns.next(&team).await;
            let next = store.next_pending(&run).await;
            let work = move || next?.map_or(Ok(None), |episode| prepare(&phase, &scenes, &episode));
            let stored = match watchdog.run(limit, work).await {
                Ok(Ok(Some(map))) => store.upsert_scene(&map).await.map_err(Failure::from),
                Ok(Ok(None)) => Ok(()),
                Ok(Err(error)) => Err(error),
                Err(error) => Err(Failure::internal(error)),
            };
            if let Err(error) = stored {
                tracing::warn!(run, %error, "cannot prepare the next episode in advance; it is prepared on request");
            }
        };
        tokio::spawn(work.instrument(span));
    }

    pub(crate) fn open_episodes(&self) -> MutexGuard<'_, OpenEpisodes> {
        lock(&self.open_episodes)
    }
}

fn check_sensors(most: &Sensors, requested: &Sensors) -> Result<(), Refusal> {
    if requested.is_within(most) {
        return Ok(());
    }
    let message = format!("the phase allows at most {most}; requested: {requested}");
    Err(Refusal::new(Reason::SensorNotAllowed, message))
}

/// Prepares an episode's expensive parts; returns a new scene's map.
fn prepare(phase: &HostedPhase, scenes: &SceneCache, episode: &str) -> Result<Option<Scene>, Failure> {
    let spec = phase.episode(episode)?;
    let (assets, map) = phase.scene(&spec.scene, scenes)?;
    let sensors = &phase.settings.sensors;
    if sensors.rgb || sensors.depth {
        assets.prepare_pictures();
    }
    if sensors.audio {
        phase.audio.head.prepare();
        // Both orders have equal sources.
        let truth = phase.truth(&spec, Order::Ordered, &assets)?;
        for position in &episode_sources(phase.rules(), &truth) {
            assets.prepare_sound(position);
        }
    }
    Ok(map)
}

/// A referee with scene, and a new scene's map.
pub(crate) struct PreparedReferee {
    pub(crate) referee: Referee,
    scene: Arc<SceneAssets>,
    map: Option<Scene>,
}

pub(crate) fn prepare_referee(
    phase: &HostedPhase,
    scenes: &SceneCache,
    episode: &str,
    order: Order,
    sensors: Sensors,
) -> Result<PreparedReferee, Refusal> {
    let spec = phase.episode(episode).map_err(Refusal::internal)?;
    let (scene, map) = phase.scene(&spec.scene, scenes).map_err(Refusal::internal)?;
    let mission = spec.mission(&scene, phase.rules(), order);
    let truth = phase.truth(&spec, order, &scene).map_err(Refusal::internal)?;
    let rules = phase.rules().clone();
    let referee = Referee::new(scene.clone(), mission, truth, rules, sensors, &phase.audio);
    let referee = referee.map_err(|error| match error {
        RefereeError::Sensors(error) => Refusal::new(Reason::BadRequest, error.to_string()),
        other => Refusal::internal(other),
    })?;
    Ok(PreparedReferee { referee, scene, map })
}

fn time_account(time: &TimeSpent) -> TimeAccount {
    TimeAccount {
        simulation_s: time.simulation.as_secs_f64(),
        encoding_s: time.encoding.as_secs_f64(),
        queue_s: time.queue.as_secs_f64(),
        thinking_s: time.thinking.as_secs_f64(),
    }
}

fn seal_and_score(mut referee: Referee, phase: &HostedPhase) -> (EpisodeTruth, Record, Metrics) {
    // No effect on an ended episode. An episode without an end failed inside the server.
    referee.truncate(EndReason::ServerFault);
    let (truth, record) = referee.into_record();
    let metrics = score(&truth, &record, phase.rules());
    (truth, record, metrics)
}

fn outcome(metrics: &Metrics) -> EpisodeOutcome {
    let values = Metric::headlines().filter_map(|metric| Some((metric.id.to_owned(), metric.of(metrics)?)));
    EpisodeOutcome { metrics: values.collect() }
}

/// Fault injection: called on the simulation thread before each step, with the step count.
pub(crate) type FaultInjection = Arc<dyn Fn(u32) + Send + Sync>;

/// Observer: called on the simulation thread before an observation is sent, with episode handle and referee.
pub(crate) type Observer = Arc<dyn Fn(&str, &Referee) + Send + Sync>;

/// A referee with optional hooks for fault injection and observation.
pub struct ArenaEpisode {
    referee: Referee,
    handle: String,
    faults: Option<FaultInjection>,
    observer: Option<Observer>,
}

impl ArenaEpisode {
    fn observe(&self) {
        if let Some(observer) = &self.observer {
            observer(&self.handle, &self.referee);
        }
    }
}

impl Episode for ArenaEpisode {
    fn mission(&self) -> &Mission {
        self.referee.mission()
    }
    fn rules(&self) -> &Rules {
        self.referee.rules()
    }
    fn start(&mut self) -> Observation {
        let first = self.referee.start();
        self.observe();
        first
    }
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        if let Some(inject) = &self.faults {
            inject(self.referee.steps());
        }
        let outcome = self.referee.step(action)?;
        self.observe();
        Ok(outcome)
    }
    fn truncate(&mut self, reason: EndReason) {
        self.referee.truncate(reason);
    }
    fn end(&self) -> Option<EndReason> {
        self.referee.end()
    }
    fn steps(&self) -> u32 {
        self.referee.steps()
    }
    fn state_hash(&self) -> u64 {
        self.referee.state_hash()
    }
}

impl fmt::Debug for ArenaEpisode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ArenaEpisode").field("handle", &self.handle).finish_non_exhaustive()
    }
}
