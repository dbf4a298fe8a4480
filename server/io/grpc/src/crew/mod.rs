//! The threads that simulate.

mod fair;

use crate::watchdog::{Leash, Lost, Watchdog, settle};
use fair::Fair;
use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError},
    thread,
    time::{Duration, Instant},
};
use tokio::sync::oneshot;
use tracing::Span;

/// A number of threads that all runs share, in fair turns of their teams. One that hangs is left behind, and another takes its
/// place. Clones share the threads, which end with the last clone.
#[derive(Clone)]
pub(crate) struct Crew(Arc<Owner>);

struct Owner(Arc<Yard>);

struct Yard {
    bench: Mutex<Bench>,
    changed: Condvar,
    watchdog: Watchdog,
}

#[derive(Default)]
struct Bench {
    work: Fair<Job>,
    is_closed: bool,
}

struct Job {
    limit: Duration,
    leash: Arc<Leash>,
    body: Box<dyn FnOnce(&Leash) + Send>,
}

impl Crew {
    /// A crew of so many threads, one at least.
    pub(crate) fn new(threads: usize, watchdog: Watchdog) -> Self {
        let yard = Arc::new(Yard { bench: Mutex::default(), changed: Condvar::new(), watchdog });
        for _ in 0..threads.max(1) {
            yard.hire();
        }
        Self(Arc::new(Owner(yard)))
    }

    /// Does `work` of a team when it is its turn, and waits for it. Time counts from its turn.
    ///
    /// # Errors
    /// When it takes longer than `limit` before it is kept, or panics.
    pub(crate) async fn run<T: Send + 'static>(
        &self,
        team: &str,
        limit: Duration,
        work: impl FnOnce(&Leash) -> T + Send + 'static,
    ) -> Result<T, Lost> {
        let (done, result) = oneshot::channel();
        let span = Span::current();
        let body = move |leash: &Leash| {
            let worked = span.in_scope(|| catch_unwind(AssertUnwindSafe(|| work(leash))));
            if leash.keep() {
                let _ = done.send(worked.map_err(|panic| Lost::Panicked(crate::watchdog::words(&*panic))));
            }
        };
        let leash = Arc::new(Leash::default());
        let job = Job { limit, leash: leash.clone(), body: Box::new(body) };
        let Owner(yard) = &*self.0;
        yard.bench().work.push(team, job);
        yard.changed.notify_one();
        settle(limit, &leash, result).await
    }
}

impl Yard {
    fn bench(&self) -> MutexGuard<'_, Bench> {
        self.bench.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// One more thread.
    fn hire(self: &Arc<Self>) {
        let yard = self.clone();
        let hired = thread::Builder::new().name("avln-simulate".to_owned()).spawn(move || yard.serve());
        if let Err(error) = hired {
            tracing::error!(%error, "the system has no thread to simulate with");
        }
    }

    /// Works until the yard closes, or this thread was given up.
    fn serve(self: Arc<Self>) {
        while let Some((team, Job { limit, leash, body })) = self.next() {
            let begun = Instant::now();
            let (yard, given_up) = (self.clone(), team.clone());
            let replace = move || {
                yard.bench().work.done(&given_up, limit);
                yard.hire();
            };
            if !self.watchdog.watched(limit, &leash, replace, || body(&leash)) {
                return;
            }
            self.bench().work.done(&team, begun.elapsed());
        }
    }

    fn next(&self) -> Option<(String, Job)> {
        let mut bench = self.bench();
        loop {
            if bench.is_closed {
                return None;
            }
            match bench.work.take() {
                Some(next) => return Some(next),
                None => bench = self.changed.wait(bench).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }
}

impl Drop for Owner {
    fn drop(&mut self) {
        self.0.bench().is_closed = true;
        self.0.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    const SOON: Duration = Duration::from_millis(40);
    const LONG: Duration = Duration::from_secs(60);

    #[tokio::test]
    async fn one_thread_that_hangs_costs_one_job() {
        let watchdog = Watchdog::default();
        let crew = Crew::new(1, watchdog.clone());
        let (go_on, wait) = mpsc::channel::<()>();
        let lost = crew.run("red", SOON, move |leash| wait.recv().is_ok() && leash.keep()).await;
        assert_eq!(lost, Err(Lost::Hangs(SOON)));
        assert_eq!(watchdog.hanging(), 1);
        assert_eq!(crew.run("red", LONG, |_| 7).await, Ok(7), "another thread took its place");
        let lost = crew.run("red", LONG, |_| panic!("the roof")).await;
        assert_eq!(lost, Err::<(), _>(Lost::Panicked("the roof".to_owned())));
        assert_eq!(crew.run("red", LONG, |_| 8).await, Ok(8), "and a panic costs no thread");
        go_on.send(()).unwrap();
        for _ in 0..500 {
            if watchdog.hanging() == 0 {
                return;
            }
            thread::sleep(Duration::from_millis(10));
        }
        panic!("the thread that went on is still counted");
    }

    #[tokio::test(flavor = "multi_thread")]
    async fn teams_share_threads_whatever_they_ask_for() {
        let crew = Crew::new(1, Watchdog::default());
        let work = |_: &Leash| thread::sleep(Duration::from_millis(2));
        let player = |team: &'static str| {
            let crew = crew.clone();
            tokio::spawn(async move {
                let (begun, mut steps) = (Instant::now(), 0);
                while begun.elapsed() < Duration::from_millis(800) {
                    crew.run(team, LONG, work).await.unwrap();
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
}
