//! Restoration of open episodes from run logs after a server stop.

use super::{Arena, episode::ArenaEpisode, now_unix_ms, play::Played, refusals::refusal, stages::Stage};
use crate::runlog::{Entry, EpisodeHistory, History};
use avln_episode::{Action, Observation, Sensors};
use avln_grpc::{Interrupted, Refusal, Restored};
use avln_referee::Referee;
use avln_store::{Run, RunningEpisode};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};
use tokio::task::spawn_blocking;

/// Server crashes during an episode before it is reissued.
const MOST_DEATHS: u32 = 5;

impl Arena {
    /// Resumable runs. Episodes of other runs are reissued.
    pub(super) async fn interrupted_runs(&self) -> Result<Vec<String>, Refusal> {
        let mut runs = BTreeSet::new();
        for lost in self.store.running_episodes().await.map_err(refusal)? {
            match self.history(&lost.run).await {
                Ok(_) => drop(runs.insert(lost.run)),
                Err(why) => self.play_anew(&lost, &why.message).await?,
            }
        }
        Ok(runs.into_iter().collect())
    }

    /// History of a run from its log.
    async fn history(&self, run: &str) -> Result<(History, BTreeMap<String, EpisodeHistory>), Refusal> {
        let (logs, run) = (self.logs.clone(), run.to_owned());
        let read = spawn_blocking(move || {
            let history = logs.history(&run).map_err(Refusal::internal)?.unwrap_or_default();
            let episodes = history.episodes();
            let episodes =
                episodes.map_err(|(line, what)| Refusal::internal(format!("line {line}: {what}")))?;
            Ok((history, episodes))
        });
        read.await.map_err(Refusal::internal)?
    }

    async fn play_anew(&self, lost: &RunningEpisode, why: &str) -> Result<(), Refusal> {
        tracing::warn!(run = lost.run, episode = lost.handle, why, "an interrupted episode restarts");
        self.store.reopen_episode(&lost.run, &lost.handle, now_unix_ms()).await.map_err(refusal).map(drop)
    }

    /// Restores the episodes of a run.
    pub(super) async fn restore_run(&self, run: &str) -> Result<Interrupted<ArenaEpisode>, Refusal> {
        let row = self.store.run(run).await.map_err(refusal)?;
        let stage = self.stage(&row.phase).await?;
        let (history, mut histories) = self.history(run).await?;
        let mut episodes = Vec::new();
        for lost in
            self.store.running_episodes().await.map_err(refusal)?.into_iter().filter(|lost| lost.run == run)
        {
            let restored = match histories.remove(&lost.handle) {
                Some(history) => self.restore_episode(&row, &stage, &lost, history).await,
                None => Err(Refusal::internal("its beginning was not written down")),
            };
            match restored {
                Ok(restored) => episodes.push(restored),
                Err(why) => self.play_anew(&lost, &why.message).await?,
            }
        }
        let open = self.describe(&self.store.run(run).await.map_err(refusal)?).await?;
        let most = &stage.phase.sensors;
        let sensors = row.sensors.unwrap_or_else(|| Sensors::all(most.width, most.height));
        Ok(Interrupted { open, sensors, episodes, away: history.away() })
    }

    async fn restore_episode(
        &self,
        run: &Run,
        stage: &Arc<Stage>,
        lost: &RunningEpisode,
        history: EpisodeHistory,
    ) -> Result<Restored<ArenaEpisode>, Refusal> {
        if history.deaths() >= MOST_DEATHS {
            let message =
                format!("the server died {MOST_DEATHS} times while it was brought back or took a step");
            return Err(Refusal::internal(message));
        }
        let (slot, ended) = (history.slot, history.ended.is_some());
        let log = self.log_of(run, stage)?;
        let handle = lost.handle.clone();
        let taken_up = Entry::TakenUp { slot, handle: handle.clone(), at_ms: now_unix_ms() };
        log.write(&taken_up).and_then(|()| log.sync()).map_err(Refusal::internal)?;
        let (referee, holding) = self.seat(run, stage, lost.episode.clone(), history.sensors.clone()).await?;
        let bank = history.bank_left.unwrap_or(Duration::from_millis(u64::from(stage.phase.time.bank_ms)));
        let replayed =
            self.control().watchdog().run(self.budget.preparation, move || replay(referee, &history));
        let (referee, last) = replayed.await.map_err(Refusal::internal)??;
        log.write(&Entry::Stands { slot, at_ms: now_unix_ms() }).map_err(Refusal::internal)?;
        let (stage, run) = (stage.clone(), run.id.clone());
        let played = Played { run, holding, stage, log, slot, taken_up: true, ended };
        let seat = self.seat_of(handle, referee, played);
        Ok(Restored { slot, hosted: seat, last, bank_left: bank })
    }
}

/// Replays a log; returns the referee and the last observation.
fn replay(
    mut referee: Referee,
    history: &EpisodeHistory,
) -> Result<(Referee, (Observation, Option<Action>)), Refusal> {
    let first = referee.start();
    let outcome = referee.replay(&history.taken).map_err(Refusal::internal)?;
    let last = match (outcome, history.taken.last()) {
        (Some(outcome), Some(&(action, _))) => (outcome.observation, Some(action)),
        _ => (first, None),
    };
    if let Some((end, _)) = history.ended {
        referee.truncate(end);
    }
    Ok((referee, last))
}
