//! Watchdog for work that may hang. The work runs on system threads outside the async runtime, with a time limit. A thread cannot
//! be stopped from outside, so a thread that hangs is abandoned and counted.

use parking_lot::{Condvar, Mutex};
use std::{
    any::Any,
    collections::BTreeMap,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc,
        atomic::{AtomicU8, AtomicU64, AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};
use tokio::sync::{Notify, oneshot};
use tracing::Span;

/// A watchdog over threads. Clones share it; the watchdog thread ends with the last clone.
#[derive(Clone, Debug, Default)]
pub struct Watchdog(Arc<WatchdogOwner>);

/// Stops the thread when the last clone is dropped.
#[derive(Debug, Default)]
struct WatchdogOwner(Arc<WatchdogState>);

#[derive(Debug, Default)]
struct WatchdogState {
    jobs: Mutex<WatchedJobs>,
    changed: Condvar,
    hanging: AtomicUsize,
    given_up: AtomicU64,
}

#[derive(Debug, Default)]
struct WatchedJobs {
    /// Jobs by their deadline and number.
    watched: BTreeMap<(Instant, u64), WatchedJob>,
    next: u64,
    is_running: bool,
    is_closed: bool,
}

struct WatchedJob {
    token: Arc<CancelToken>,
    /// Called when the job is abandoned.
    then: Box<dyn FnOnce() + Send>,
}

impl std::fmt::Debug for WatchedJob {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("WatchedJob")
    }
}

/// Error: a job has no result.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Lost {
    /// The job exceeded its limit and may never end.
    #[error("it took longer than {0:?} and was given up")]
    Hangs(Duration),
    /// The job panicked.
    #[error("it panicked: {0}")]
    Panicked(String),
}

#[derive(Debug, Default)]
pub(crate) struct CancelToken {
    state: AtomicU8,
    given_up: Notify,
}

const RUNNING: u8 = 0;
const COMMITTED: u8 = 1;
const ABANDONED: u8 = 2;

impl CancelToken {
    /// Commits the job: the result counts, regardless of the time limit. Returns false if the job was abandoned before.
    // Visible effects must come after this call.
    #[must_use]
    pub(crate) fn commit(&self) -> bool {
        // A single atomic exchange decides the race between job and watchdog, so exactly one side wins.
        let before = self.state.compare_exchange(RUNNING, COMMITTED, Ordering::AcqRel, Ordering::Acquire);
        matches!(before, Ok(_) | Err(COMMITTED))
    }

    fn give_up(&self) -> bool {
        let done =
            self.state.compare_exchange(RUNNING, ABANDONED, Ordering::AcqRel, Ordering::Acquire).is_ok();
        if done {
            self.given_up.notify_one();
        }
        done
    }

    fn is_given_up(&self) -> bool {
        self.state.load(Ordering::Acquire) == ABANDONED
    }

    pub(crate) async fn given_up(&self) {
        self.given_up.notified().await;
    }
}

impl Watchdog {
    /// Counts abandoned threads that still run.
    pub fn hanging(&self) -> usize {
        self.state().hanging.load(Ordering::Relaxed)
    }

    /// Counts abandoned jobs.
    pub fn given_up(&self) -> u64 {
        self.state().given_up.load(Ordering::Relaxed)
    }

    /// Abandons all work that it watches, as if the time limits had passed. For tests.
    pub fn expire(&self) {
        let watched = std::mem::take(&mut self.state().jobs.lock().watched);
        for job in watched.into_values() {
            self.state().give_up(job);
        }
    }

    /// Runs `work` on a new thread and waits up to `limit` for the result. Fails if the work hangs or panics.
    pub async fn run<T: Send + 'static>(
        &self,
        limit: Duration,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Lost> {
        let token = Arc::new(CancelToken::default());
        let (done, result) = oneshot::channel();
        let watchdog = self.clone();
        let held = token.clone();
        let span = Span::current();
        let body = move || {
            let work = || {
                let worked = span.in_scope(|| catch_unwind(AssertUnwindSafe(work)));
                if held.commit() {
                    let _ = done.send(worked.map_err(|panic| Lost::Panicked(panic_message(&*panic))));
                }
            };
            watchdog.watched(limit, &held, || {}, work);
        };
        if let Err(error) = thread::Builder::new().name("avln-work".to_owned()).spawn(body) {
            return Err(Lost::Panicked(format!("cannot start a thread: {error}")));
        }
        settle(limit, &token, result).await
    }

    /// Runs `work` on this thread. Returns false if it did not commit within `limit`; `then` was called on another thread.
    pub(crate) fn watched(
        &self,
        limit: Duration,
        token: &Arc<CancelToken>,
        then: impl FnOnce() + Send + 'static,
        work: impl FnOnce(),
    ) -> bool {
        let key =
            self.enter(Instant::now() + limit, WatchedJob { token: token.clone(), then: Box::new(then) });
        work();
        self.state().jobs.lock().watched.remove(&key);
        let was_abandoned = token.is_given_up();
        if was_abandoned {
            self.state().hanging.fetch_sub(1, Ordering::Relaxed);
            tracing::warn!("an abandoned job has ended");
        }
        !was_abandoned
    }

    fn state(&self) -> &Arc<WatchdogState> {
        &self.0.0
    }

    fn enter(&self, due: Instant, job: WatchedJob) -> (Instant, u64) {
        let mut jobs = self.state().jobs.lock();
        jobs.next += 1;
        let key = (due, jobs.next);
        jobs.watched.insert(key, job);
        if !jobs.is_running {
            let state = self.state().clone();
            let watch = thread::Builder::new().name("avln-watchdog".to_owned()).spawn(move || state.watch());
            jobs.is_running = watch.inspect_err(|error| tracing::error!(%error, "no watchdog")).is_ok();
        }
        self.state().changed.notify_one();
        key
    }
}

impl WatchdogState {
    /// Abandons overdue jobs until the last clone of the watchdog is dropped.
    fn watch(&self) {
        let mut jobs = self.jobs.lock();
        while !jobs.is_closed {
            let now = Instant::now();
            match jobs.watched.first_key_value().map(|(&(due, _), _)| due) {
                Some(due) if due <= now => {
                    if let Some((_, job)) = jobs.watched.pop_first() {
                        // `then` runs without the lock: it may take long and use the watchdog itself.
                        drop(jobs);
                        self.give_up(job);
                        jobs = self.jobs.lock();
                    }
                }
                Some(due) => {
                    self.changed.wait_until(&mut jobs, due);
                }
                None => self.changed.wait(&mut jobs),
            }
        }
    }

    fn give_up(&self, watched: WatchedJob) {
        // Counted first: afterwards the waiter reads the counters, and the job may end at once and subtract itself.
        self.hanging.fetch_add(1, Ordering::Relaxed);
        self.given_up.fetch_add(1, Ordering::Relaxed);
        if watched.token.give_up() {
            (watched.then)();
        } else {
            self.hanging.fetch_sub(1, Ordering::Relaxed);
            self.given_up.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

impl Drop for WatchdogOwner {
    fn drop(&mut self) {
        self.0.jobs.lock().is_closed = true;
        self.0.changed.notify_one();
    }
}

/// Waits for a job's result, or until the job is abandoned.
pub(crate) async fn settle<T>(
    limit: Duration,
    token: &CancelToken,
    result: oneshot::Receiver<Result<T, Lost>>,
) -> Result<T, Lost> {
    tokio::select! {
        biased;
        result = result => result.unwrap_or(Err(Lost::Hangs(limit))),
        () = token.given_up() => Err(Lost::Hangs(limit)),
    }
}

pub(crate) fn panic_message(panic: &(dyn Any + Send)) -> String {
    let message = panic.downcast_ref::<&str>().copied();
    let message = message.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    message.unwrap_or("panic without a message").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    const SOON: Duration = Duration::from_millis(40);

    /// Waits until no thread hangs.
    fn wait_until_none_hangs(watchdog: &Watchdog) {
        for _ in 0..500 {
            if watchdog.hanging() == 0 {
                return;
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("{} threads still hang", watchdog.hanging());
    }

    #[tokio::test]
    async fn hanging_work_is_counted() {
        let watchdog = Watchdog::default();
        let (release, wait) = mpsc::channel::<()>();
        let lost = watchdog.run(SOON, move || wait.recv().is_ok()).await;
        assert_eq!(lost, Err(Lost::Hangs(SOON)));
        assert_eq!((watchdog.hanging(), watchdog.given_up()), (1, 1));
        assert_eq!(watchdog.run(SOON * 100, || 7).await, Ok(7), "other work continues");
        release.send(()).unwrap();
        wait_until_none_hangs(&watchdog);
        assert_eq!(watchdog.given_up(), 1);
    }

    #[tokio::test]
    async fn a_panic_is_returned_as_an_error() {
        let watchdog = Watchdog::default();
        let lost = watchdog.run(SOON * 100, || panic!("the roof")).await;
        assert_eq!(lost, Err::<(), _>(Lost::Panicked("the roof".to_owned())));
        assert_eq!((watchdog.hanging(), watchdog.given_up()), (0, 0));
    }

    #[test]
    fn a_job_is_committed_or_abandoned_never_both() {
        let token = CancelToken::default();
        assert!(token.commit() && token.commit() && !token.give_up());
        let token = CancelToken::default();
        assert!(token.give_up() && !token.give_up() && !token.commit());
    }

    #[tokio::test]
    async fn expired_work_is_abandoned_at_once() {
        let watchdog = Watchdog::default();
        let token = Arc::new(CancelToken::default());
        let in_time = watchdog.watched(SOON * 1000, &token, || (), || watchdog.expire());
        assert!(!in_time && !token.commit());
        assert_eq!((watchdog.hanging(), watchdog.given_up()), (0, 1));
    }

    #[tokio::test]
    async fn committed_work_has_no_limit() {
        let watchdog = Watchdog::default();
        let token = Arc::new(CancelToken::default());
        let held = token.clone();
        let in_time = watchdog.watched(
            SOON,
            &token,
            || panic!("abandoned"),
            || {
                assert!(held.commit());
                thread::sleep(SOON * 3);
            },
        );
        assert!(in_time);
        assert_eq!((watchdog.hanging(), watchdog.given_up()), (0, 0));
    }
}
