//! Episodes without a result: returned, so that they are reissued, or restored from run logs after a server stop.

use crate::{
    Arena,
    episodes::{ArenaEpisode, IssuedEpisode, ReturnCause},
    failure::refusal,
    lock,
    phases::HostedPhase,
    runlog::{Entry, EpisodeHistory, History},
};
use avln_episode::{Action, Observation, Sensors};
use avln_grpc::{Interrupted, Refusal, Restored};
use avln_referee::Referee;
use avln_store::{Run, RunningEpisode, StoreError};
use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
    time::Duration,
};
use tokio::task::spawn_blocking;

/// Server crashes in a restoration before the episode is reissued.
const MAX_CRASHES: u32 = 5;

impl Arena {
    /// Returns an episode without a result, so that it is reissued; later, if the database fails.
    pub(crate) async fn return_episode(&self, run: &str, handle: &str, cause: ReturnCause) {
        let Err(error) = self.try_return_episode(run, handle, cause).await else { return };
        // Without another attempt the run would wait for this episode until the next server start.
        tracing::error!(run, handle, %error, "cannot reissue an episode; it is reissued later");
        if cause == ReturnCause::Server {
            self.log_loss(run, handle).await;
        }
        lock(&self.pending_returns).insert((run.to_owned(), handle.to_owned()), cause);
    }

    async fn try_return_episode(
        &self,
        run: &str,
        handle: &str,
        cause: ReturnCause,
    ) -> Result<(), StoreError> {
        let now_unix_ms = self.clock.now_unix_ms();
        match cause {
            ReturnCause::Agent => self.store.return_episode(run, handle).await.map(drop),
            ReturnCause::Server => self.store.reopen_episode(run, handle, now_unix_ms).await.map(drop),
        }
    }

    /// Logs a loss that the database does not contain: otherwise, a restarted server would continue or score an attempt that the
    /// agent was told is lost.
    async fn log_loss(&self, run: &str, handle: &str) {
        let (logs, at_ms) = (self.logs.clone(), self.clock.now_unix_ms());
        let (run, handle) = (run.to_owned(), handle.to_owned());
        let logged = spawn_blocking(move || logs.write_loss(&run, handle, at_ms)).await;
        if let Err(error) = logged.map_err(|error| error.to_string()).flatten() {
            tracing::error!(error, "cannot log the loss of an episode");
        }
    }

    /// Returns the episodes from earlier failed attempts.
    pub(crate) async fn flush_pending_returns(&self) -> Result<(), Refusal> {
        loop {
            let first =
                lock(&self.pending_returns).first_key_value().map(|(key, cause)| (key.clone(), *cause));
            let Some((key, cause)) = first else { return Ok(()) };
            let (run, handle) = &key;
            self.try_return_episode(run, handle, cause).await.map_err(refusal)?;
            self.sign_if_over(&self.store.run(run).await.map_err(refusal)?).await;
            lock(&self.pending_returns).remove(&key);
        }
    }

    /// Returns the resumable runs. Other runs' episodes are reissued.
    pub(crate) async fn interrupted_runs(&self) -> Result<Vec<String>, Refusal> {
        let mut runs = BTreeSet::new();
        for lost in self.store.running_episodes().await.map_err(refusal)? {
            let phase = self.store.run(&lost.run).await.map_err(refusal)?.phase;
            if !self.phases.selects(&phase) {
                continue;
            }
            match self.history(&lost.run).await {
                Ok(_) => drop(runs.insert(lost.run)),
                Err(why) => self.reissue(&lost, &why.message).await,
            }
        }
        Ok(runs.into_iter().collect())
    }

    async fn history(&self, run: &str) -> Result<(History, BTreeMap<String, EpisodeHistory>), Refusal> {
        let (logs, run) = (self.logs.clone(), run.to_owned());
        let read = spawn_blocking(move || {
            let history = logs.history(&run).map_err(Refusal::internal)?.unwrap_or_default();
            let wrong = |(line, problem)| Refusal::internal(format!("line {line}: {problem}"));
            let episodes = history.episodes().map_err(wrong)?;
            Ok((history, episodes))
        });
        read.await.map_err(Refusal::internal)?
    }

    async fn reissue(&self, lost: &RunningEpisode, why: &str) {
        tracing::warn!(run = lost.run, episode = lost.handle, why, "an interrupted episode restarts");
        self.return_episode(&lost.run, &lost.handle, ReturnCause::Server).await;
    }

    #[tracing::instrument(level = "debug", name = "restore", skip_all)]
    pub(crate) async fn restore_run(&self, run: &str) -> Result<Interrupted<ArenaEpisode>, Refusal> {
        let row = self.store.run(run).await.map_err(refusal)?;
        let phase = self.phase(&row.phase).await?;
        let (history, mut histories) = self.history(run).await?;
        let mut episodes = Vec::new();
        let running = self.store.running_episodes().await.map_err(refusal)?;
        for lost in running.into_iter().filter(|lost| lost.run == run) {
            let restored = match histories.remove(&lost.handle) {
                Some(history) if history.is_lost => {
                    Err(Refusal::internal("the server lost it before it stopped"))
                }
                Some(history) => self.restore_episode(&row, &phase, &lost, history).await,
                None => Err(Refusal::internal("the log has no entry of its start")),
            };
            match restored {
                Ok(restored) => episodes.push(restored),
                Err(why) => self.reissue(&lost, &why.message).await,
            }
        }
        let open = self.describe(run).await?;
        let most = &phase.settings.sensors;
        let sensors = row.sensors.unwrap_or_else(|| Sensors::all(most.width, most.height));
        Ok(Interrupted { open, sensors, episodes, away: history.away() })
    }

    async fn restore_episode(
        &self,
        run: &Run,
        phase: &Arc<HostedPhase>,
        lost: &RunningEpisode,
        history: EpisodeHistory,
    ) -> Result<Restored<ArenaEpisode>, Refusal> {
        if history.crashes() >= MAX_CRASHES {
            let message = format!(
                "the server crashed {MAX_CRASHES} times during the restoration or the first step after it"
            );
            return Err(Refusal::internal(message));
        }
        let (slot, ended) = (history.slot, history.ended.is_some());
        let log = self.log_of(run, phase)?;
        let handle = lost.handle.clone();
        // On disk before the attempt, so that a crash in it is counted.
        let started = Entry::RestoreStarted { slot, handle: handle.clone(), at_ms: self.clock.now_unix_ms() };
        log.write(&started).and_then(|()| log.sync()).map_err(Refusal::internal)?;
        let (referee, memory) =
            self.prepare_episode(run, phase, lost.episode.clone(), history.sensors.clone()).await?;
        let bank = history.bank_left.unwrap_or(Duration::from_millis(u64::from(phase.settings.time.bank_ms)));
        let replayed =
            self.control().watchdog().run(self.budget.preparation, move || replay(referee, &history));
        let (referee, last) = replayed.await.map_err(Refusal::internal)??;
        log.write(&Entry::RestoreDone { slot, at_ms: self.clock.now_unix_ms() })
            .map_err(Refusal::internal)?;
        let (phase, run) = (phase.clone(), run.id.clone());
        let issued = IssuedEpisode { run, memory, phase, log, slot, restored: true, ended };
        let hosted = self.host_episode(handle, referee, issued);
        Ok(Restored { slot, hosted, last, bank_left: bank })
    }
}

/// Replays a log; returns the referee, the last observation and the last action.
fn replay(
    mut referee: Referee,
    history: &EpisodeHistory,
) -> Result<(Referee, (Observation, Option<Action>)), Refusal> {
    let first = referee.start();
    let outcome = referee.replay(&history.actions).map_err(Refusal::internal)?;
    let last = match (outcome, history.actions.last()) {
        (Some(outcome), Some(&(action, _))) => (outcome.observation, Some(action)),
        _ => (first, None),
    };
    if let Some((end, _)) = history.ended {
        referee.truncate(end);
    }
    Ok((referee, last))
}
