//! Handing out episodes and taking them back.

use super::{
    Arena, Owed, Stage, budget::Holding, episode::ArenaEpisode, now_unix_ms, refusals::refusal, secret,
};
use crate::runlog::{Entry, RunLog, SlotLog};
use avln_challenge::EpisodeOutcome;
use avln_episode::{EndReason, Order, Sensors};
use avln_grpc::{HostedEpisode, Reason, Refusal, StoredEnd, TimeSpent};
use avln_referee::{Referee, RefereeError};
use avln_scoring::{Metric, Metrics, score};
use avln_store::{AssignedEpisode, EpisodeResult, EpisodeState, Run, Scene, TimeAccount, Visibility};
use avln_truth::{EpisodeTruth, Record};
use avln_world::SceneAssets;
use std::{
    collections::BTreeMap,
    sync::{Arc, MutexGuard, PoisonError},
};

/// Episodes that were handed out and have not come back.
#[derive(Default)]
pub(super) struct Playing {
    next_ticket: u64,
    played: BTreeMap<u64, Played>,
}

/// An issued episode.
pub(super) struct Played {
    pub(super) run: String,
    pub(super) holding: Holding,
    pub(super) stage: Arc<Stage>,
    pub(super) log: Arc<RunLog>,
    pub(super) slot: u32,
    /// True if restored after a server stop.
    pub(super) taken_up: bool,
    /// True if its end is in the log.
    pub(super) ended: bool,
}

impl Playing {
    /// Memory of the open episodes of a run.
    pub(super) fn of_run(&self, run: &str) -> impl Iterator<Item = &Holding> {
        self.played.values().filter(move |played| played.run == run).map(|played| &played.holding)
    }
}

impl Arena {
    /// Hands out the next episode of a run: scene, pictures of goals and referee are made on a blocking thread.
    pub(super) async fn seat_next(
        &self,
        run: &str,
        slot: u32,
        sensors: &Sensors,
    ) -> Result<Option<HostedEpisode<ArenaEpisode>>, Refusal> {
        self.control().check_open()?;
        let row = self.store.run(run).await.map_err(refusal)?;
        let stage = self.stage(&row.phase).await?;
        check_sensors(&stage.phase.sensors, sensors)?;
        if row.sensors.as_ref() != Some(sensors) {
            self.store.set_sensors(run, sensors).await.map_err(refusal)?;
        }
        let handle = format!("ep_{}", secret::random_hex().map_err(Refusal::internal)?);
        let assigned = self.store.assign_next_episode(run, &handle, now_unix_ms()).await.map_err(refusal)?;
        let Some(assigned) = assigned else { return Ok(None) };
        let handle = assigned.handle.clone();
        let seated = self.begin(&row, &stage, (slot, assigned), sensors).await;
        if seated.is_err() {
            self.store.reopen_episode(run, &handle, now_unix_ms()).await.map_err(refusal)?;
        }
        self.look_ahead(run, &stage);
        seated.map(Some)
    }

    /// Logs the start of an episode before the preparation, and creates its slot state.
    async fn begin(
        &self,
        run: &Run,
        stage: &Arc<Stage>,
        (slot, assigned): (u32, AssignedEpisode),
        sensors: &Sensors,
    ) -> Result<HostedEpisode<ArenaEpisode>, Refusal> {
        let log = self.log_of(run, stage)?;
        let began = Entry::Began {
            slot,
            handle: assigned.handle.clone(),
            ordinal: assigned.ordinal,
            episode: assigned.episode.clone(),
            sensors: sensors.clone(),
            at_ms: now_unix_ms(),
        };
        log.write(&began).map_err(Refusal::internal)?;
        let (referee, holding) = self.seat(run, stage, assigned.episode, sensors.clone()).await?;
        let (stage, run) = (stage.clone(), run.id.clone());
        let played = Played { run, holding, stage, log, slot, taken_up: false, ended: false };
        Ok(self.seat_of(assigned.handle, referee, played))
    }

    /// The log of a run, open to be written on.
    pub(super) fn log_of(&self, run: &Run, stage: &Stage) -> Result<Arc<RunLog>, Refusal> {
        let first = || Entry::Run {
            format: Entry::FORMAT,
            run: run.id.clone(),
            phase: stage.phase.id.clone(),
            order: run.order,
            digests: run.digests.clone(),
            at_ms: now_unix_ms(),
        };
        self.logs.open(&run.id, first).map_err(Refusal::internal)
    }

    /// Slot state with logging of steps.
    pub(super) fn seat_of(
        &self,
        handle: String,
        referee: Referee,
        played: Played,
    ) -> HostedEpisode<ArenaEpisode> {
        let log = Box::new(SlotLog { log: played.log.clone(), slot: played.slot, taken_up: played.taken_up });
        let ticket = self.take_ticket(played);
        let episode = ArenaEpisode {
            referee,
            handle: handle.clone(),
            faults: self.faults.clone(),
            observer: self.observer.clone(),
        };
        HostedEpisode { handle, episode, ticket, log, time: TimeSpent::default() }
    }

    /// Creates the referee of an episode on a watched thread, within the session memory; stores the scene map
    /// if the scene was created for it.
    pub(super) async fn seat(
        &self,
        run: &Run,
        stage: &Arc<Stage>,
        episode: String,
        sensors: Sensors,
    ) -> Result<(Referee, Holding), Refusal> {
        let (stage, scenes, order, budget) = (stage.clone(), self.scenes.clone(), run.order, self.budget);
        let sees = sensors.rgb || sensors.depth;
        let make = move || {
            budget.check_file(stage.scene_file_bytes(&episode).map_err(Refusal::internal)?)?;
            let made = make_referee(&stage, &scenes, &episode, order, sensors)?;
            if sees {
                made.scene.prepare_pictures();
            }
            Ok::<_, Refusal>(made)
        };
        let made = self.control().watchdog().run(self.budget.preparation, make).await;
        let Made { referee, scene, map } =
            made.map_err(|lost| Refusal::new(Reason::SimFault, lost.to_string()))??;
        if let Some(map) = map {
            self.store.upsert_scene(&map).await.map_err(refusal)?;
        }
        let holding = Holding::of(scene, &referee);
        self.check_memory(&run.id, &holding)?;
        Ok((referee, holding))
    }

    /// Returns a hanging episode to the queue.
    pub(super) async fn lose_seat(&self, run: &str, handle: &str, ticket: u64) -> Result<(), Refusal> {
        self.return_ticket(ticket);
        self.store.reopen_episode(run, handle, now_unix_ms()).await.map_err(refusal).map(drop)
    }

    /// Scores an episode, logs it and stores it in a transaction. An episode that cannot be stored is
    /// reissued.
    pub(super) async fn conclude_seat(
        &self,
        run: &str,
        seat: HostedEpisode<ArenaEpisode>,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        let handle = seat.handle.clone();
        let concluded = self.try_conclude(run, seat).await;
        if concluded.is_err()
            && let Err(error) = self.store.reopen_episode(run, &handle, now_unix_ms()).await
        {
            tracing::error!(run, handle, %error, "cannot store an episode; it is withdrawn later");
            self.owed().insert((run.to_owned(), handle));
        }
        concluded
    }

    fn owed(&self) -> MutexGuard<'_, Owed> {
        self.owed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Retries pending returns of episodes.
    pub(super) async fn settle_debts(&self) -> Result<(), Refusal> {
        loop {
            let Some(first) = self.owed().first().cloned() else { return Ok(()) };
            let (run, handle) = &first;
            self.store.reopen_episode(run, handle, now_unix_ms()).await.map_err(refusal)?;
            self.owed().remove(&first);
        }
    }

    async fn try_conclude(
        &self,
        run: &str,
        seat: HostedEpisode<ArenaEpisode>,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        let (handle, ticket) = (seat.handle.clone(), seat.ticket);
        let unknown = || Refusal::internal(format!("episode {handle} was never handed out"));
        let Played { stage, log, slot, ended, .. } = self.return_ticket(ticket).ok_or_else(unknown)?;
        let time = account(&seat.time);
        let referee = seat.episode.referee;
        let (scoring, name) = (stage.clone(), handle.clone());
        let settled = tokio::task::spawn_blocking(move || {
            let (truth, record, metrics) = settle(referee, &scoring);
            if !ended {
                log.write(&Entry::Ended {
                    slot,
                    handle: name,
                    end: record.end,
                    metrics: Box::new(metrics.clone()),
                    at_ms: now_unix_ms(),
                })?;
            }
            log.sync().map(|()| (truth, record, metrics))
        });
        let (truth, record, metrics) =
            settled.await.map_err(Refusal::internal)?.map_err(Refusal::internal)?;
        let finished = EpisodeResult {
            run,
            handle: &handle,
            truth: &truth,
            record: &record,
            metrics: &metrics,
            time: &time,
        };
        let recorded = self.store.record_result(&finished, now_unix_ms()).await.map_err(refusal)?;
        self.sign_if_over(&recorded.run).await;
        Ok((recorded.counts && stage.shows_metrics()).then(|| outcome(&metrics)))
    }

    /// Signs the log of an ended run. An unsigned log is still valid.
    pub(super) async fn sign_if_over(&self, run: &Run) {
        if run.state.is_open() {
            return;
        }
        let (logs, key, run) = (self.logs.clone(), self.key.clone(), run.id.clone());
        let signed = tokio::task::spawn_blocking(move || logs.sign(&run, &key)).await;
        if let Err(why) = signed.map_err(|error| error.to_string()).flatten() {
            tracing::error!(why, "cannot sign the log of a run");
        }
    }

    /// End of a stored episode; a lost episode is reported as a server fault.
    pub(super) async fn stored_end(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal> {
        let Some(found) = self.store.episode_status(run, handle).await.map_err(refusal)? else {
            return Ok(None);
        };
        let reason = match (found.state, found.end) {
            (EpisodeState::Running, _) => return Ok(None),
            (_, Some(reason)) => reason,
            (_, None) => EndReason::ServerFault,
        };
        let stage = self.stage(&self.store.run(run).await.map_err(refusal)?.phase).await?;
        let metrics = found.metrics.filter(|_| stage.shows_metrics());
        let steps = metrics.as_ref().map_or(0, |metrics| metrics.steps);
        Ok(Some(StoredEnd { reason, steps, outcome: metrics.as_ref().map(outcome) }))
    }

    fn take_ticket(&self, played: Played) -> u64 {
        let mut playing = self.playing.lock().unwrap_or_else(PoisonError::into_inner);
        playing.next_ticket += 1;
        let ticket = playing.next_ticket;
        playing.played.insert(ticket, played);
        ticket
    }

    fn return_ticket(&self, ticket: u64) -> Option<Played> {
        self.playing.lock().unwrap_or_else(PoisonError::into_inner).played.remove(&ticket)
    }
}

impl Stage {
    /// Returns true if agents receive metrics. Lengths reveal target positions, so metrics are public only if
    /// replays are.
    fn shows_metrics(&self) -> bool {
        ![self.phase.scores, self.phase.replays].contains(&Visibility::Organiser)
    }
}

/// The phase's sensors are the most that an agent may ask for.
fn check_sensors(most: &Sensors, asked: &Sensors) -> Result<(), Refusal> {
    let too_large = asked.width > most.width || asked.height > most.height;
    let missing = (asked.rgb && !most.rgb) || (asked.depth && !most.depth) || (asked.audio && !most.audio);
    if !too_large && !missing {
        return Ok(());
    }
    let message = format!(
        "the phase allows pictures up to {} x {} and the sensors rgb {}, depth {}, audio {}; asked for {} x {}, rgb {}, depth {}, audio {}",
        most.width,
        most.height,
        most.rgb,
        most.depth,
        most.audio,
        asked.width,
        asked.height,
        asked.rgb,
        asked.depth,
        asked.audio,
    );
    Err(Refusal::new(Reason::SensorNotAllowed, message))
}

/// A referee, the scene that it plays in, and the scene's map when the scene was made for it.
pub(super) struct Made {
    pub(super) referee: Referee,
    scene: Arc<SceneAssets>,
    map: Option<Scene>,
}

/// Reads the mission and makes a referee for it.
pub(super) fn make_referee(
    stage: &Stage,
    scenes: &super::scenes::SceneCache,
    episode: &str,
    order: Order,
    sensors: Sensors,
) -> Result<Made, Refusal> {
    let spec = stage.episode(episode).map_err(Refusal::internal)?;
    let (assets, map) = stage.scene(&spec.scene, scenes).map_err(Refusal::internal)?;
    let mission = spec.mission(&assets, stage.rules(), order);
    let (truth, rules) = (spec.truth(order), stage.rules().clone());
    let referee = Referee::new(assets.clone(), mission, truth, rules, sensors, &stage.audio);
    let referee = referee.map_err(|error| match error {
        RefereeError::Sensors(error) => Refusal::new(Reason::BadRequest, error.to_string()),
        other => Refusal::internal(other),
    })?;
    Ok(Made { referee, scene: assets, map })
}

/// The door's measurements as they are stored.
fn account(time: &TimeSpent) -> TimeAccount {
    TimeAccount {
        simulation_s: time.simulation.as_secs_f64(),
        encoding_s: time.encoding.as_secs_f64(),
        queue_s: time.queue.as_secs_f64(),
        thinking_s: time.thinking.as_secs_f64(),
    }
}

/// Seals the record. An episode that broke down is the server's fault.
fn settle(mut referee: Referee, stage: &Stage) -> (EpisodeTruth, Record, Metrics) {
    referee.truncate(EndReason::ServerFault);
    let (truth, record) = referee.into_record();
    let metrics = score(&truth, &record, stage.rules());
    (truth, record, metrics)
}

fn outcome(metrics: &Metrics) -> EpisodeOutcome {
    let values = Metric::headlines().filter_map(|metric| Some((metric.id.to_owned(), metric.of(metrics)?)));
    EpisodeOutcome { metrics: values.collect() }
}
