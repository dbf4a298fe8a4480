//! Work that may hang: it runs on threads of the system, outside of the async runtime, and whoever waits for it waits no longer
//! than a limit. A thread cannot be stopped from outside, so one that hangs is left behind and counted.

use std::{
    any::Any,
    collections::BTreeMap,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Condvar, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU8, AtomicU64, AtomicUsize, Ordering},
    },
    thread,
    time::{Duration, Instant},
};
use tokio::sync::{Notify, oneshot};
use tracing::Span;

/// Watches work on threads. Clones share it; its own thread ends with the last of them.
#[derive(Clone, Debug, Default)]
pub struct Watchdog(Arc<Kennel>);

/// Stops the thread when the last clone goes.
#[derive(Debug, Default)]
struct Kennel(Arc<Inner>);

#[derive(Debug, Default)]
struct Inner {
    state: Mutex<State>,
    changed: Condvar,
    hanging: AtomicUsize,
    given_up: AtomicU64,
}

#[derive(Debug, Default)]
struct State {
    /// Work by the moment when it is given up, and its number.
    watched: BTreeMap<(Instant, u64), Watched>,
    next: u64,
    is_running: bool,
    is_closed: bool,
}

struct Watched {
    leash: Arc<Leash>,
    /// Done when the work is given up.
    then: Box<dyn FnOnce() + Send>,
}

impl std::fmt::Debug for Watched {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Watched")
    }
}

/// Why work came to nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Lost {
    /// It took longer than it may, and may go on for ever.
    #[error("it took longer than {0:?} and was given up")]
    Hangs(Duration),
    /// It panicked.
    #[error("it panicked: {0}")]
    Panicked(String),
}

/// Whether somebody still waits for the work.
#[derive(Debug, Default)]
pub(crate) struct Leash {
    state: AtomicU8,
    given_up: Notify,
}

const RUNNING: u8 = 0;
const KEPT: u8 = 1;
const GIVEN_UP: u8 = 2;

impl Leash {
    /// From now on the result counts, however long the rest takes; false when the work was given up before. What others see of
    /// the work may be written after it and not before.
    #[must_use]
    pub(crate) fn keep(&self) -> bool {
        let before = self.state.compare_exchange(RUNNING, KEPT, Ordering::AcqRel, Ordering::Acquire);
        matches!(before, Ok(_) | Err(KEPT))
    }

    fn give_up(&self) -> bool {
        let done =
            self.state.compare_exchange(RUNNING, GIVEN_UP, Ordering::AcqRel, Ordering::Acquire).is_ok();
        if done {
            self.given_up.notify_one();
        }
        done
    }

    fn is_given_up(&self) -> bool {
        self.state.load(Ordering::Acquire) == GIVEN_UP
    }

    /// Waits until the work is given up.
    pub(crate) async fn given_up(&self) {
        self.given_up.notified().await;
    }
}

impl Watchdog {
    /// Threads that were given up and still run.
    pub fn hanging(&self) -> usize {
        self.inner().hanging.load(Ordering::Relaxed)
    }

    /// How often work was given up.
    pub fn given_up(&self) -> u64 {
        self.inner().given_up.load(Ordering::Relaxed)
    }

    /// Does `work` on a thread of its own and waits for it, for `limit` at most.
    ///
    /// # Errors
    /// When it hangs or panics.
    pub async fn run<T: Send + 'static>(
        &self,
        limit: Duration,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Lost> {
        let leash = Arc::new(Leash::default());
        let (done, result) = oneshot::channel();
        let (watchdog, held, span) = (self.clone(), leash.clone(), Span::current());
        let body = move || {
            watchdog.watched(
                limit,
                &held,
                || {},
                || {
                    let worked = span.in_scope(|| catch_unwind(AssertUnwindSafe(work)));
                    if held.keep() {
                        let _ = done.send(worked.map_err(|panic| Lost::Panicked(words(&*panic))));
                    }
                },
            );
        };
        if let Err(error) = thread::Builder::new().name("avln-work".to_owned()).spawn(body) {
            return Err(Lost::Panicked(format!("the system has no thread for it: {error}")));
        }
        settle(limit, &leash, result).await
    }

    /// Does `work` on this thread. If that takes longer than `limit` before it is kept, `leash` is given up, which is followed
    /// by `then` on another thread. False when it was given up: then nobody waits for this thread any more.
    pub(crate) fn watched(
        &self,
        limit: Duration,
        leash: &Arc<Leash>,
        then: impl FnOnce() + Send + 'static,
        work: impl FnOnce(),
    ) -> bool {
        let ticket =
            self.enter(Instant::now() + limit, Watched { leash: leash.clone(), then: Box::new(then) });
        work();
        self.inner().state().watched.remove(&ticket);
        let is_alone = leash.is_given_up();
        if is_alone {
            self.inner().hanging.fetch_sub(1, Ordering::Relaxed);
            tracing::warn!("work that had been given up came to its end");
        }
        !is_alone
    }

    fn inner(&self) -> &Arc<Inner> {
        &self.0.0
    }

    fn enter(&self, due: Instant, watched: Watched) -> (Instant, u64) {
        let mut state = self.inner().state();
        state.next += 1;
        let ticket = (due, state.next);
        state.watched.insert(ticket, watched);
        if !state.is_running {
            let inner = self.inner().clone();
            let watch = thread::Builder::new().name("avln-watchdog".to_owned()).spawn(move || inner.watch());
            state.is_running = watch.inspect_err(|error| tracing::error!(%error, "no watchdog")).is_ok();
        }
        self.inner().changed.notify_one();
        ticket
    }
}

impl Inner {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Gives up what is due, until nobody has the watchdog any more.
    fn watch(&self) {
        let mut state = self.state();
        while !state.is_closed {
            let now = Instant::now();
            match state.watched.first_key_value().map(|(&(due, _), _)| due) {
                Some(due) if due <= now => {
                    if let Some((_, watched)) = state.watched.pop_first() {
                        drop(state);
                        self.give_up(watched);
                        state = self.state();
                    }
                }
                Some(due) => {
                    let waited = self.changed.wait_timeout(state, due - now);
                    state = waited.unwrap_or_else(PoisonError::into_inner).0;
                }
                None => state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }

    fn give_up(&self, watched: Watched) {
        // Counted first: the work may come to its end at once.
        self.hanging.fetch_add(1, Ordering::Relaxed);
        if watched.leash.give_up() {
            self.given_up.fetch_add(1, Ordering::Relaxed);
            (watched.then)();
        } else {
            self.hanging.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

impl Drop for Kennel {
    fn drop(&mut self) {
        self.0.state().is_closed = true;
        self.0.changed.notify_one();
    }
}

/// Waits for the result, or until it is given up.
pub(crate) async fn settle<T>(
    limit: Duration,
    leash: &Leash,
    result: oneshot::Receiver<Result<T, Lost>>,
) -> Result<T, Lost> {
    tokio::select! {
        biased;
        result = result => result.unwrap_or(Err(Lost::Hangs(limit))),
        () = leash.given_up() => Err(Lost::Hangs(limit)),
    }
}

/// What a panic says.
pub(crate) fn words(panic: &(dyn Any + Send)) -> String {
    let words = panic.downcast_ref::<&str>().copied();
    let words = words.or_else(|| panic.downcast_ref::<String>().map(String::as_str));
    words.unwrap_or("panic without words").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    const SOON: Duration = Duration::from_millis(40);

    /// Waits until no thread hangs any more.
    fn all_quiet(watchdog: &Watchdog) {
        for _ in 0..500 {
            if watchdog.hanging() == 0 {
                return;
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("{} threads still hang", watchdog.hanging());
    }

    #[tokio::test]
    async fn work_that_hangs_is_left_behind_and_counted_until_it_ends() {
        let watchdog = Watchdog::default();
        let (go_on, wait) = mpsc::channel::<()>();
        let lost = watchdog.run(SOON, move || wait.recv().is_ok()).await;
        assert_eq!(lost, Err(Lost::Hangs(SOON)));
        assert_eq!((watchdog.hanging(), watchdog.given_up()), (1, 1));
        assert_eq!(watchdog.run(SOON * 100, || 7).await, Ok(7), "others go on");
        go_on.send(()).unwrap();
        all_quiet(&watchdog);
        assert_eq!(watchdog.given_up(), 1);
    }

    #[tokio::test]
    async fn a_panic_is_told_to_whoever_waits() {
        let watchdog = Watchdog::default();
        let lost = watchdog.run(SOON * 100, || panic!("the roof")).await;
        assert_eq!(lost, Err::<(), _>(Lost::Panicked("the roof".to_owned())));
        assert_eq!((watchdog.hanging(), watchdog.given_up()), (0, 0));
    }

    #[test]
    fn a_result_is_kept_or_given_up_and_never_both() {
        let leash = Leash::default();
        assert!(leash.keep() && leash.keep() && !leash.give_up());
        let leash = Leash::default();
        assert!(leash.give_up() && !leash.give_up() && !leash.keep());
    }

    #[tokio::test]
    async fn what_is_kept_may_take_its_time() {
        let watchdog = Watchdog::default();
        let leash = Arc::new(Leash::default());
        let held = leash.clone();
        let in_time = watchdog.watched(
            SOON,
            &leash,
            || panic!("given up"),
            || {
                assert!(held.keep());
                thread::sleep(SOON * 3);
            },
        );
        assert!(in_time);
        assert_eq!((watchdog.hanging(), watchdog.given_up()), (0, 0));
    }
}
