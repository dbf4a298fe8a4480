//! Turns of teams at the preparation of episodes.

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Limits for jobs in progress, of every team and of all together. Waiting jobs of several teams alternate.
pub(crate) struct TeamTurns {
    per_team: usize,
    by_team: Mutex<BTreeMap<String, Arc<Semaphore>>>,
    all: Arc<Semaphore>,
}

/// A job's turn, until it is dropped.
pub(crate) struct Turn {
    _team: OwnedSemaphorePermit,
    _all: OwnedSemaphorePermit,
}

impl TeamTurns {
    /// A single job at a time.
    pub(crate) fn single() -> Self {
        Self::new(1, 1)
    }

    /// Half of the processor cores per team.
    pub(crate) fn half_of_cores() -> Self {
        let cores = std::thread::available_parallelism().map_or(2, usize::from);
        // No limit for all together: a job that hangs must not delay other teams.
        Self::new(cores.div_ceil(2), Semaphore::MAX_PERMITS)
    }

    fn new(per_team: usize, all: usize) -> Self {
        Self { per_team, by_team: Mutex::default(), all: Arc::new(Semaphore::new(all)) }
    }

    /// Waits for the team's turn. It always comes, because the semaphores are never closed.
    pub(crate) async fn next(&self, team: &str) -> Option<Turn> {
        // The team's own permit first: with it, at most `per_team` of its jobs are in the queue for all.
        let own = self.of(team).acquire_owned().await.ok()?;
        let all = self.all.clone().acquire_owned().await.ok()?;
        Some(Turn { _team: own, _all: all })
    }

    fn of(&self, team: &str) -> Arc<Semaphore> {
        let mut teams = self.by_team.lock().unwrap_or_else(PoisonError::into_inner);
        let new = || Arc::new(Semaphore::new(self.per_team));
        teams.entry(team.to_owned()).or_insert_with(new).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::task::{JoinSet, yield_now};

    /// Returns the order in which the jobs of the teams ran.
    async fn order(turns: TeamTurns, busy: &str, teams: &[&'static str]) -> Vec<&'static str> {
        let (turns, order) = (Arc::new(turns), Arc::new(Mutex::new(Vec::new())));
        let first = turns.next(busy).await;
        let mut jobs = JoinSet::new();
        for &team in teams {
            let (turns, order) = (turns.clone(), order.clone());
            jobs.spawn(async move {
                let turn = turns.next(team).await;
                order.lock().expect("no panic").push(team);
                drop(turn);
            });
            yield_now().await;
        }
        drop(first);
        jobs.join_all().await;
        let order = order.lock().expect("no panic");
        order.clone()
    }

    #[tokio::test]
    async fn waiting_teams_alternate() {
        let teams = ["red", "red", "red", "blue"];
        assert_eq!(order(TeamTurns::single(), "green", &teams).await, ["red", "blue", "red", "red"]);
    }

    #[tokio::test]
    async fn busy_teams_delay_no_others() {
        let turns = TeamTurns::new(1, Semaphore::MAX_PERMITS);
        assert_eq!(order(turns, "red", &["red", "blue"]).await, ["blue", "red"]);
    }
}
