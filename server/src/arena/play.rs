//! Handing out episodes and taking them back.

use super::{Arena, Stage, now_unix_ms, refusals::refusal, secret};
use avln_episode::{EndReason, Order, Sensors};
use avln_grpc::{EpisodeOutcome, Reason, Refusal, Seat, TimeSpent};
use avln_referee::{Referee, RefereeError};
use avln_scoring::{Metrics, score};
use avln_store::{Finished, Scene, TimeAccount, Visibility};
use avln_truth::{EpisodeTruth, Record};
use std::{
    collections::BTreeMap,
    sync::{Arc, PoisonError},
};

/// Episodes that were handed out and have not come back.
#[derive(Default)]
pub(super) struct Playing {
    next_ticket: u64,
    stages: BTreeMap<u64, Arc<Stage>>,
}

impl Arena {
    /// Hands out the next episode of a run: scene, pictures of goals and referee are made on a blocking thread.
    pub(super) async fn seat_next(&self, run: &str, sensors: &Sensors) -> Result<Option<Seat>, Refusal> {
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
        let handle = assigned.handle;
        let seated = self.seat(&stage, assigned.episode, row.order, sensors.clone()).await;
        match seated {
            Ok(referee) => {
                let ticket = self.take_ticket(&stage);
                self.look_ahead(run, &stage);
                Ok(Some(Seat { handle, referee: Box::new(referee), ticket, time: TimeSpent::default() }))
            }
            Err(refused) => {
                self.store.take_back(run, &handle, now_unix_ms()).await.map_err(refusal)?;
                Err(refused)
            }
        }
    }

    /// A referee for an episode, made on a blocking thread; stores the scene's map when the scene was made for it.
    async fn seat(
        &self,
        stage: &Arc<Stage>,
        episode: String,
        order: Order,
        sensors: Sensors,
    ) -> Result<Referee, Refusal> {
        let (stage, scenes) = (stage.clone(), self.scenes.clone());
        let make = move || make_referee(&stage, &scenes, &episode, order, sensors);
        let (referee, map) = tokio::task::spawn_blocking(make).await.map_err(Refusal::internal)??;
        if let Some(map) = map {
            self.store.upsert_scene(&map).await.map_err(refusal)?;
        }
        Ok(referee)
    }

    /// Scores what happened and stores it in one transaction.
    pub(super) async fn conclude_seat(
        &self,
        run: &str,
        seat: Seat,
    ) -> Result<Option<EpisodeOutcome>, Refusal> {
        let handle = seat.handle.clone();
        let stage = self.return_ticket(seat.ticket);
        let stage =
            stage.ok_or_else(|| Refusal::internal(format!("episode {handle} was never handed out")))?;
        let time = account(&seat.time);
        let referee = seat.into_referee().ok_or_else(|| Refusal::internal("a seat without our referee"))?;
        let broken = referee.end().is_none();
        let scoring = stage.clone();
        let sealed = tokio::task::spawn_blocking(move || settle(*referee, broken, &scoring)).await;
        let (truth, record, metrics) = sealed.map_err(Refusal::internal)?;
        let finished =
            Finished { run, handle: &handle, truth: &truth, record: &record, metrics: &metrics, time: &time };
        let recorded = self.store.record_result(&finished, now_unix_ms()).await.map_err(refusal)?;
        // An episode's lengths tell where its targets are, so its numbers are shown where its replay is.
        let hidden = [stage.phase.scores, stage.phase.replays].contains(&Visibility::Organiser);
        let shown = recorded.counts && !hidden;
        Ok(shown.then(|| outcome(&metrics)))
    }

    fn take_ticket(&self, stage: &Arc<Stage>) -> u64 {
        let mut playing = self.playing.lock().unwrap_or_else(PoisonError::into_inner);
        playing.next_ticket += 1;
        let ticket = playing.next_ticket;
        playing.stages.insert(ticket, stage.clone());
        ticket
    }

    fn return_ticket(&self, ticket: u64) -> Option<Arc<Stage>> {
        self.playing.lock().unwrap_or_else(PoisonError::into_inner).stages.remove(&ticket)
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

/// Reads the mission and makes a referee for it; and the scene's map, when the scene was made for it.
fn make_referee(
    stage: &Stage,
    scenes: &super::scenes::SceneCache,
    episode: &str,
    order: Order,
    sensors: Sensors,
) -> Result<(Referee, Option<Scene>), Refusal> {
    let spec = stage.episode(episode).map_err(Refusal::internal)?;
    let (assets, map) = stage.scene(&spec.scene, scenes).map_err(Refusal::internal)?;
    let mission = spec.mission(&assets, stage.rules(), order);
    let (truth, rules) = (spec.truth(order), stage.rules().clone());
    let referee = Referee::new(assets, mission, truth, rules, sensors, &stage.audio);
    let referee = referee.map_err(|error| match error {
        RefereeError::Sensors(error) => Refusal::new(Reason::BadRequest, error.to_string()),
        other => Refusal::internal(other),
    })?;
    Ok((referee, map))
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
fn settle(mut referee: Referee, broken: bool, stage: &Stage) -> (EpisodeTruth, Record, Metrics) {
    if broken {
        referee.truncate(EndReason::ServerFault);
    }
    let (truth, record) = referee.into_record();
    let metrics = score(&truth, &record, stage.rules());
    (truth, record, metrics)
}

fn outcome(metrics: &Metrics) -> EpisodeOutcome {
    let values = [
        ("sr", metrics.sr),
        ("isr", metrics.isr),
        ("osr", metrics.osr),
        ("spl", metrics.spl),
        ("soft_spl", metrics.soft_spl),
    ];
    EpisodeOutcome { metrics: values.into_iter().map(|(name, value)| (name.to_owned(), value)).collect() }
}
