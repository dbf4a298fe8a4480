//! The arena behind the simulated server. It uses real threads, so its calls block the simulation: simulated time passes only between
//! them. Faults of the simulator, the run logs and the whole server are injected at the next opportunity.

use avln_arena::{Arena, clock::Clock};
use avln_challenge::{Account, EpisodeOutcome, PhaseInfo, Quota, RunStatus};
use avln_episode::Sensors;
use avln_grpc::{
    Acted, Control, EpisodeLog, Host, HostedEpisode, Interrupted, OpenRun, Refusal, Restored, RunRequest,
    RunTicket, ServerInfo, StoredEnd, Watchdog, async_trait,
};
use std::{
    collections::BTreeMap,
    io,
    panic::resume_unwind,
    pin::pin,
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, AtomicU32, Ordering},
    },
    task::{Context, Poll, Wake, Waker},
    thread::{self, Thread},
    time::Duration,
};
use tokio::{runtime::Handle, task::coop::unconstrained, time::Instant};

type Hosted = HostedEpisode<<Arena as Host>::Episode>;

/// Runs of issued episodes, by handle.
pub(crate) type Issued = Arc<Mutex<BTreeMap<String, String>>>;

/// The border between simulated time and the arena's threads.
#[derive(Clone)]
pub(crate) struct Border {
    threads: Handle,
    clock: Clock,
    /// Age of the simulation at an instant of the simulated runtime.
    began: (Duration, Instant),
}

struct Unpark(Thread);

impl Wake for Unpark {
    fn wake(self: Arc<Self>) {
        self.0.unpark();
    }
}

impl Border {
    /// Creates the border for a runtime with simulated time, which the caller runs in.
    pub(crate) fn new(threads: Handle, clock: Clock, age: Duration) -> Self {
        Self { threads, clock, began: (age, Instant::now()) }
    }

    /// Returns the age of the simulation, and sets the clock to it.
    pub(crate) fn age(&self) -> Duration {
        let (age, began) = self.began;
        let age = age + began.elapsed();
        self.clock.set_age(age);
        age
    }

    /// Carries out work that needs real threads, at a single instant of simulated time.
    pub(crate) fn cross<T>(&self, work: impl Future<Output = T>) -> T {
        self.age();
        let _inside = self.threads.enter();
        let waker = Waker::from(Arc::new(Unpark(thread::current())));
        // Without tokio's budget, which only a return to the simulated runtime refills.
        let mut work = pin!(unconstrained(work));
        loop {
            match work.as_mut().poll(&mut Context::from_waker(&waker)) {
                Poll::Ready(done) => return done,
                Poll::Pending => thread::park(),
            }
        }
    }
}

pub(crate) struct SimulatedHost {
    pub(crate) arena: Arena,
    pub(crate) border: Border,
    pub(crate) faults: Arc<Faults>,
    pub(crate) issued: Issued,
}

impl SimulatedHost {
    /// Carries out a call, unless the server crashes before it. After a crash nothing continues.
    async fn call<T>(&self, call: impl Future<Output = T>) -> T {
        self.survive().await;
        let done = self.border.cross(call);
        self.survive().await;
        done
    }

    async fn survive(&self) {
        if self.faults.passes_crash() {
            std::future::pending().await
        }
    }

    fn issue(&self, run: &str, hosted: Hosted) -> Hosted {
        self.issued.lock().expect("no panic").insert(hosted.handle.clone(), run.to_owned());
        HostedEpisode { log: Box::new(FaultyLog { log: hosted.log, faults: self.faults.clone() }), ..hosted }
    }
}

#[async_trait]
impl Host for SimulatedHost {
    type Episode = <Arena as Host>::Episode;

    fn info(&self) -> ServerInfo {
        self.arena.info()
    }

    fn control(&self) -> Option<&Control> {
        Some(self.arena.control())
    }

    fn now_unix_ms(&self) -> i64 {
        self.border.age();
        self.arena.now_unix_ms()
    }

    async fn phases(&self, account: Option<&Account>) -> Result<Vec<PhaseInfo>, Refusal> {
        self.call(Host::phases(&self.arena, account)).await
    }

    async fn account(&self, token: &str) -> Result<Account, Refusal> {
        self.call(self.arena.account(token)).await
    }

    async fn start_run(&self, account: &Account, request: RunRequest) -> Result<RunTicket, Refusal> {
        self.call(self.arena.start_run(account, request)).await
    }

    async fn run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal> {
        self.call(self.arena.run(account, run)).await
    }

    async fn runs(&self, account: &Account) -> Result<Vec<RunStatus>, Refusal> {
        self.call(self.arena.runs(account)).await
    }

    async fn cancel_run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal> {
        self.call(self.arena.cancel_run(account, run)).await
    }

    async fn quotas(&self, account: &Account, phase: Option<&str>) -> Result<Vec<Quota>, Refusal> {
        self.call(self.arena.quotas(account, phase)).await
    }

    async fn open_run(&self, run_token: &str) -> Result<OpenRun, Refusal> {
        self.call(self.arena.open_run(run_token)).await
    }

    async fn next_episode(&self, run: &str, slot: u32, sensors: &Sensors) -> Result<Option<Hosted>, Refusal> {
        let next = async {
            let next = self.arena.next_episode(run, slot, sensors).await?;
            Ok(next.map(|hosted| self.issue(run, hosted)))
        };
        self.call(next).await
    }

    async fn conclude(&self, run: &str, hosted: Hosted) -> Result<Option<EpisodeOutcome>, Refusal> {
        self.call(self.arena.conclude(run, hosted)).await
    }

    async fn ended(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal> {
        self.call(self.arena.ended(run, handle)).await
    }

    async fn interrupted(&self) -> Result<Vec<String>, Refusal> {
        self.call(self.arena.interrupted()).await
    }

    async fn restore(&self, run: &str) -> Result<Interrupted<Self::Episode>, Refusal> {
        let interrupted = self.call(self.arena.restore(run)).await?;
        let issue = |restored: Restored<_>| Restored { hosted: self.issue(run, restored.hosted), ..restored };
        let episodes = interrupted.episodes.into_iter().map(issue).collect();
        Ok(Interrupted { episodes, ..interrupted })
    }

    async fn finish_run(&self, run: &str, abandons: bool) -> Result<RunStatus, Refusal> {
        self.call(self.arena.finish_run(run, abandons)).await
    }

    async fn lose(&self, run: &str, handle: &str, ticket: u64) -> Result<(), Refusal> {
        self.call(self.arena.lose(run, handle, ticket)).await
    }

    async fn overdue(&self) -> Result<Vec<String>, Refusal> {
        self.call(self.arena.overdue()).await
    }

    async fn expire_run(&self, run: &str) -> Result<(), Refusal> {
        self.call(self.arena.expire_run(run)).await
    }
}

/// Faults to come. The simulation is single-threaded: atomics only satisfy `Sync`.
#[derive(Debug, Default)]
pub(crate) struct Faults {
    /// Calls and log lines before the server crashes; 0 for no crash.
    fuse: AtomicU32,
    crashed: AtomicBool,
    /// Lines of run logs that fail.
    pub(crate) failing_lines: AtomicU32,
    /// Steps whose simulation panics.
    pub(crate) panicking_steps: AtomicU32,
    /// Steps whose simulation hangs.
    pub(crate) hanging_steps: AtomicU32,
    /// First observations that panic.
    pub(crate) panicking_starts: AtomicU32,
    /// First observations that hang.
    pub(crate) hanging_starts: AtomicU32,
}

impl Faults {
    /// Crashes the server at the `points`-th call or log line from now on.
    pub(crate) fn crash_after(&self, points: u32) {
        self.fuse.store(points, Ordering::Relaxed);
    }

    pub(crate) fn has_crashed(&self) -> bool {
        self.crashed.load(Ordering::Relaxed)
    }

    /// Passes a point at which the server may crash. Returns whether it has crashed, here or before.
    pub(crate) fn passes_crash(&self) -> bool {
        if self.fuse.load(Ordering::Relaxed) > 0 && self.fuse.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.crashed.store(true, Ordering::Relaxed);
        }
        self.has_crashed()
    }

    /// Forgets all faults to come.
    pub(crate) fn clear(&self) {
        self.fuse.store(0, Ordering::Relaxed);
        let counts =
            [&self.failing_lines, &self.panicking_steps, &self.hanging_steps, &self.panicking_starts];
        counts.into_iter().chain([&self.hanging_starts]).for_each(|count| count.store(0, Ordering::Relaxed));
    }

    /// Disturbs a step before it is taken.
    pub(crate) fn disturb_step(&self, watchdog: &Watchdog) {
        disturb(&self.panicking_steps, &self.hanging_steps, watchdog);
    }

    /// Disturbs a first observation.
    pub(crate) fn disturb_start(&self, watchdog: &Watchdog) {
        disturb(&self.panicking_starts, &self.hanging_starts, watchdog);
    }
}

fn disturb(panics: &AtomicU32, hangs: &AtomicU32, watchdog: &Watchdog) {
    if take(hangs) {
        watchdog.expire();
    } else if take(panics) {
        // Without the panic hook, which would print a message.
        resume_unwind(Box::new("an injected panic"));
    }
}

/// Uses up one of the faults, if any.
fn take(count: &AtomicU32) -> bool {
    count.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_ok()
}

/// A run log with faults.
pub(crate) struct FaultyLog {
    pub(crate) log: Box<dyn EpisodeLog>,
    pub(crate) faults: Arc<Faults>,
}

impl FaultyLog {
    /// Writes a line, unless the disk is full or the server crashes before it.
    fn write(&mut self, line: impl FnOnce(&mut dyn EpisodeLog) -> io::Result<()>) -> io::Result<()> {
        if self.faults.passes_crash() {
            return Err(io::Error::other("the server has crashed"));
        }
        if take(&self.faults.failing_lines) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        line(&mut *self.log)?;
        // A crash here leaves a line whose answer the agent never receives.
        self.faults.passes_crash();
        Ok(())
    }
}

impl EpisodeLog for FaultyLog {
    fn acting(&mut self, step: u32) -> io::Result<()> {
        self.write(|log| log.acting(step))
    }

    fn acted(&mut self, acted: &Acted) -> io::Result<()> {
        self.write(|log| log.acted(acted))
    }

    fn clock_restarted(&mut self, step: u32, away: Duration) -> io::Result<()> {
        self.write(|log| log.clock_restarted(step, away))
    }
}
