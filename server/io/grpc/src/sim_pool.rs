//! Thread pool for simulation.

use crate::{
    host::{Episode, HostedEpisode, OpenRun},
    limits::Limits,
    refusal::{Failure, Result},
    watchdog::{CancelToken, Lost, Watchdog, panic_message, settle},
};
use avln_episode::EndReason;
use parking_lot::{Condvar, Mutex};
use std::{
    collections::{BTreeMap, VecDeque},
    panic::{AssertUnwindSafe, catch_unwind},
    sync::Arc,
    thread,
    time::{Duration, Instant},
};
use tokio::sync::oneshot;
use tracing::Span;

/// Nice value of sealed work, on top of the server's: a tenth of a contested processor core.
const SEALED_NICE: i32 = 10;

/// Thread pools, scheduled fairly between teams. Hanging threads are replaced. All threads end with the last clone.
#[derive(Clone)]
pub(crate) struct SimPool(Arc<PoolOwner>);

/// Closes the pools when the last clone is dropped.
struct PoolOwner {
    ordinary: Arc<PoolState>,
    /// For sealed runs: their agents compute on this machine too, and must not delay the steps of others.
    sealed: Arc<PoolState>,
}

struct PoolState {
    /// False if jobs run on the calling thread.
    has_threads: bool,
    is_sealed: bool,
    queue: Mutex<JobQueue>,
    changed: Condvar,
    watchdog: Watchdog,
}

#[derive(Default)]
struct JobQueue {
    jobs: FairQueue<Job>,
    is_closed: bool,
}

struct Job {
    limit: Duration,
    token: Arc<CancelToken>,
    body: Box<dyn FnOnce(&CancelToken) + Send>,
}

impl SimPool {
    /// Starts `threads` threads, and almost as many for sealed runs. Without threads, jobs run on the calling thread.
    pub(crate) fn new(threads: usize, watchdog: Watchdog) -> Self {
        let sealed_threads = if threads > 2 { threads - 1 } else { threads.min(1) };
        let ordinary = PoolState::start(threads, false, watchdog.clone());
        let sealed = PoolState::start(sealed_threads, true, watchdog);
        Self(Arc::new(PoolOwner { ordinary, sealed }))
    }

    /// Runs a team's job in turn. Fails if the job panics, or does not commit within `limit` after the start.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        team: &str,
        is_sealed: bool,
        limit: Duration,
        work: impl FnOnce(&CancelToken) -> T + Send + 'static,
    ) -> Result<T, Lost> {
        let (done, result) = oneshot::channel();
        let span = Span::current();
        let body = move |token: &CancelToken| {
            let worked = span.in_scope(|| catch_unwind(AssertUnwindSafe(|| work(token))));
            if token.commit() {
                let _ = done.send(worked.map_err(|panic| Lost::Panicked(panic_message(&*panic))));
            }
        };
        let token = Arc::new(CancelToken::default());
        let job = Job { limit, token: token.clone(), body: Box::new(body) };
        let state = if is_sealed { &self.0.sealed } else { &self.0.ordinary };
        if state.has_threads {
            state.queue.lock().jobs.push(team, job);
            state.changed.notify_one();
        } else {
            let Job { limit, token, body } = job;
            state.watchdog.watched(limit, &token, || (), || body(&token));
        }
        settle(limit, &token, result).await
    }
}

impl PoolState {
    fn start(threads: usize, is_sealed: bool, watchdog: Watchdog) -> Arc<Self> {
        let queue = Mutex::default();
        let state = Self { has_threads: threads > 0, is_sealed, queue, changed: Condvar::new(), watchdog };
        let state = Arc::new(state);
        (0..threads).for_each(|_| state.spawn_worker());
        state
    }

    fn spawn_worker(self: &Arc<Self>) {
        let state = self.clone();
        let spawned = thread::Builder::new().name("avln-simulate".to_owned()).spawn(move || {
            if state.is_sealed {
                lower_thread();
            }
            state.work();
        });
        if let Err(error) = spawned {
            tracing::error!(%error, "cannot start a simulation thread");
        }
    }

    /// Runs jobs until the pool closes or this thread is abandoned.
    fn work(self: Arc<Self>) {
        while let Some((team, Job { limit, token, body })) = self.next() {
            let begun = Instant::now();
            let state = self.clone();
            let abandoned_team = team.clone();
            let replace = move || {
                state.queue.lock().jobs.done(&abandoned_team, limit);
                state.spawn_worker();
            };
            // An abandoned thread was already replaced: it must not take another job.
            if !self.watchdog.watched(limit, &token, replace, || body(&token)) {
                return;
            }
            self.queue.lock().jobs.done(&team, begun.elapsed());
        }
    }

    fn next(&self) -> Option<(String, Job)> {
        let mut queue = self.queue.lock();
        loop {
            if queue.is_closed {
                return None;
            }
            match queue.jobs.take() {
                Some(next) => return Some(next),
                None => self.changed.wait(&mut queue),
            }
        }
    }
}

impl Drop for PoolOwner {
    fn drop(&mut self) {
        for state in [&self.ordinary, &self.sealed] {
            state.queue.lock().is_closed = true;
            state.changed.notify_all();
        }
    }
}

/// Lowers the priority of the calling thread for good: raising it again needs a privilege.
fn lower_thread() {
    // Elsewhere, the priority of a thread is that of its process.
    #[cfg(target_os = "linux")]
    if let Err(error) = rustix::process::nice(SEALED_NICE) {
        tracing::warn!(%error, "cannot lower the priority of a simulation thread for sealed runs");
    }
}

/// A team's access to the pool.
pub(crate) struct SimClient {
    pool: SimPool,
    team: String,
    is_sealed: bool,
    /// Limit of the first observation, which may have to prepare the scene.
    pub(crate) longest_start: Duration,
    pub(crate) longest_step: Duration,
}

impl SimClient {
    pub(crate) fn new(pool: SimPool, run: &OpenRun, limits: &Limits) -> Self {
        let (team, is_sealed) = (run.team.clone(), run.sealed);
        Self { pool, team, is_sealed, longest_start: limits.preparation, longest_step: limits.step }
    }

    /// Runs simulator work on an episode, and encodes the result. Returns the episode even after a panic, but not if the work hangs.
    // Both count as the team's processor time: an image takes half as long to encode as to render.
    pub(crate) async fn run<E: Episode, T, F: Send + 'static>(
        &self,
        mut hosted: HostedEpisode<E>,
        limit: Duration,
        work: impl FnOnce(&mut HostedEpisode<E>, &CancelToken) -> T + Send + 'static,
        encode: impl FnOnce(&HostedEpisode<E>, T) -> F + Send + 'static,
    ) -> Result<(HostedEpisode<E>, Result<F>)> {
        let queued = Instant::now();
        let done = self.pool.run(&self.team, self.is_sealed, limit, move |token| {
            let begun = Instant::now();
            hosted.time.queue += begun - queued;
            // Caught here and not in the pool, so that the episode survives: it must be stored as a server fault.
            let result = catch_unwind(AssertUnwindSafe(|| {
                let worked = work(&mut hosted, token);
                let simulated = Instant::now();
                hosted.time.simulation += simulated - begun;
                let encoded = encode(&hosted, worked);
                hosted.time.encoding += simulated.elapsed();
                encoded
            }));
            let result = result.map_err(|panic| Failure::simulator("simulate", panic_message(&*panic)));
            (hosted, result)
        });
        done.await.map_err(|lost| Failure::simulator("simulate", lost))
    }
}

pub(crate) fn truncate<E: Episode>(hosted: &mut HostedEpisode<E>, reason: EndReason) {
    // After an earlier panic the simulator may be in any state, and this call may panic too.
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| hosted.episode.truncate(reason))) {
        Failure::simulator("truncate", panic_message(&*panic));
    }
}

/// Fair job queue: the team with the least processor time is first, so busy teams get equal time at any queue length.
#[derive(Debug)]
struct FairQueue<J> {
    teams: BTreeMap<String, TeamQueue<J>>,
    /// Account of the team that was served last. New and idle teams start here, so that idleness earns no credit.
    level: Duration,
}

#[derive(Debug)]
struct TeamQueue<J> {
    waiting: VecDeque<J>,
    /// Counted processor time.
    used: Duration,
    /// Jobs in progress and their expected duration.
    running: u32,
    expected: Duration,
}

impl<J> TeamQueue<J> {
    fn is_idle(&self) -> bool {
        self.waiting.is_empty() && self.running == 0
    }
}

impl<J> Default for FairQueue<J> {
    fn default() -> Self {
        Self { teams: BTreeMap::new(), level: Duration::ZERO }
    }
}

impl<J> FairQueue<J> {
    fn push(&mut self, team: &str, job: J) {
        let level = self.level;
        let queue = self.teams.entry(team.to_owned()).or_insert_with(|| TeamQueue {
            waiting: VecDeque::new(),
            used: level,
            running: 0,
            expected: Duration::ZERO,
        });
        if queue.is_idle() {
            queue.used = queue.used.max(level);
        }
        queue.waiting.push_back(job);
    }

    /// Takes the next job.
    fn take(&mut self) -> Option<(String, J)> {
        let waiting = self.teams.iter_mut().filter(|(_, queue)| !queue.waiting.is_empty());
        let (team, queue) = waiting.min_by_key(|(_, queue)| queue.used)?;
        let job = queue.waiting.pop_front()?;
        self.level = self.level.max(queue.used);
        queue.running += 1;
        // Charged in advance, so that other threads do not all serve the same team meanwhile.
        queue.used += queue.expected;
        Some((team.clone(), job))
    }

    fn done(&mut self, team: &str, took: Duration) {
        let Some(queue) = self.teams.get_mut(team) else { return };
        queue.running = queue.running.saturating_sub(1);
        queue.used = (queue.used + took).saturating_sub(queue.expected);
        // Not while others run: each of them must be refunded the amount that it was charged.
        if queue.running == 0 {
            queue.expected = took;
        }
        if self.teams.values().all(TeamQueue::is_idle) {
            // No team competes: earlier use no longer counts.
            return self.teams.clear();
        }
        let level = self.level;
        self.teams.retain(|_, queue| !queue.is_idle() || queue.used > level);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    const SOON: Duration = Duration::from_millis(40);
    const LONG: Duration = Duration::from_secs(60);

    #[tokio::test]
    async fn a_hanging_thread_costs_one_job() {
        let watchdog = Watchdog::default();
        let pool = SimPool::new(1, watchdog.clone());
        let (release, wait) = mpsc::channel::<()>();
        let lost = pool.run("red", false, SOON, move |token| wait.recv().is_ok() && token.commit()).await;
        assert_eq!(lost, Err(Lost::Hangs(SOON)));
        assert_eq!(watchdog.hanging(), 1);
        assert_eq!(pool.run("red", false, LONG, |_| 7).await, Ok(7), "another thread replaced it");
        let lost = pool.run("red", false, LONG, |_| panic!("the roof")).await;
        assert_eq!(lost, Err::<(), _>(Lost::Panicked("the roof".to_owned())));
        assert_eq!(pool.run("red", false, LONG, |_| 8).await, Ok(8), "a panic costs no thread");
        release.send(()).unwrap();
        for _ in 0..500 {
            if watchdog.hanging() == 0 {
                return;
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("the released thread still counts as hanging");
    }

    #[tokio::test]
    async fn pool_without_threads_works_at_once() {
        let watchdog = Watchdog::default();
        let pool = SimPool::new(0, watchdog.clone());
        let caller = thread::current().id();
        assert_eq!(pool.run("red", false, LONG, |_| thread::current().id()).await, Ok(caller));
        let lost = pool.run("red", false, LONG, move |_| watchdog.expire()).await;
        assert_eq!(lost, Err(Lost::Hangs(LONG)));
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn teams_share_threads_fairly() {
        let pool = SimPool::new(1, Watchdog::default());
        let work = |_: &CancelToken| thread::sleep(Duration::from_millis(2));
        let player = |team: &'static str| {
            let pool = pool.clone();
            tokio::spawn(async move {
                let begun = Instant::now();
                let mut steps = 0;
                while begun.elapsed() < Duration::from_millis(800) {
                    pool.run(team, false, LONG, work).await.unwrap();
                    steps += 1;
                }
                steps
            })
        };
        let modest = player("modest");
        let greedy: Vec<_> = (0..16).map(|_| player("greedy")).collect();
        let modest = modest.await.unwrap();
        let mut all = 0;
        for slot in greedy {
            all += slot.await.unwrap();
        }
        assert!(modest * 3 >= all, "{modest} steps for one slot, {all} for sixteen");
    }

    const MS: Duration = Duration::from_millis(1);

    /// Simulates a thread for some turns; all teams keep their slots busy. Returns turns and time per team.
    fn serve(teams: &[(&'static str, u32, Duration)], turns: u32) -> BTreeMap<String, (u32, Duration)> {
        let mut fair = FairQueue::default();
        for (team, slots, _) in teams {
            (0..*slots).for_each(|_| fair.push(team, ()));
        }
        let mut had: BTreeMap<String, (u32, Duration)> = BTreeMap::new();
        for _ in 0..turns {
            let (team, ()) = fair.take().unwrap();
            let took = teams.iter().find(|(name, ..)| *name == team).unwrap().2;
            let so_far = had.entry(team.clone()).or_default();
            *so_far = (so_far.0 + 1, so_far.1 + took);
            fair.done(&team, took);
            fair.push(&team, ());
        }
        had
    }

    #[test]
    fn one_slot_gets_as_much_as_sixteen() {
        let had = serve(&[("greedy", 16, 5 * MS), ("modest", 1, 5 * MS)], 1000);
        assert!(had["modest"].0.abs_diff(had["greedy"].0) <= 1, "{had:?}");
    }

    #[test]
    fn teams_share_time_rather_than_turns() {
        let had = serve(&[("large pictures", 4, 20 * MS), ("blind", 4, 2 * MS)], 2200);
        let (large, blind) = (had["large pictures"].1, had["blind"].1);
        assert!(large.abs_diff(blind) <= 20 * MS, "{had:?}");
    }

    #[test]
    fn idle_teams_earn_no_credit() {
        let mut fair = FairQueue::default();
        for _ in 0..100 {
            fair.push("early", ());
            let (team, ()) = fair.take().unwrap();
            fair.done(&team, 10 * MS);
        }
        for _ in 0..20 {
            fair.push("early", ());
            fair.push("late", ());
        }
        let first: Vec<_> = (0..20)
            .map(|_| {
                let (team, ()) = fair.take().unwrap();
                fair.done(&team, 10 * MS);
                team
            })
            .collect();
        let early = first.iter().filter(|team| *team == "early").count();
        assert!((9..=11).contains(&early), "{first:?}");
    }

    #[test]
    fn several_threads_share_fairly() {
        let mut fair = FairQueue::default();
        (0..50).for_each(|_| fair.push("greedy", ()));
        (0..50).for_each(|_| fair.push("other", ()));
        let mut taken = BTreeMap::new();
        for _ in 0..10 {
            let round: Vec<_> = (0..4).map(|_| fair.take().unwrap().0).collect();
            for team in round {
                *taken.entry(team.clone()).or_insert(0) += 1;
                fair.done(&team, 3 * MS);
            }
        }
        let waiting: usize = fair.teams.values().map(|queue| queue.waiting.len()).sum();
        assert_eq!(waiting, 60);
        assert!(taken["greedy"] >= 17 && taken["other"] >= 17, "{taken:?}");
    }

    #[tokio::test]
    async fn sealed_jobs_never_delay_others() {
        let pool = SimPool::new(1, Watchdog::default());
        let (release, wait) = mpsc::channel::<()>();
        let sealed = pool.clone();
        let sealed =
            tokio::spawn(async move { sealed.run("sealed", true, LONG, move |_| wait.recv()).await });
        assert_eq!(pool.run("remote", false, LONG, |_| 7).await, Ok(7));
        release.send(()).unwrap();
        assert_eq!(sealed.await.unwrap(), Ok(Ok(())));
    }

    #[cfg(target_os = "linux")]
    #[tokio::test]
    async fn sealed_jobs_have_low_priority() {
        let pool = SimPool::new(2, Watchdog::default());
        let nice = |is_sealed| pool.run("team", is_sealed, LONG, |_| rustix::process::nice(0).unwrap());
        let (ordinary, sealed) = (nice(false).await.unwrap(), nice(true).await.unwrap());
        assert_eq!(sealed, (ordinary + SEALED_NICE).min(19));
    }

    #[test]
    fn idle_teams_are_forgotten() {
        let mut fair = FairQueue::default();
        for team in 0..50 {
            fair.push(&team.to_string(), ());
            let (team, ()) = fair.take().unwrap();
            fair.done(&team, MS);
        }
        assert!(fair.teams.len() <= 2, "{:?}", fair.teams);
    }
}
