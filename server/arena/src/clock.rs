//! The wall clock and the monotonic clock of an arena; the heartbeat, and deadlines after clock changes.

use crate::{Arena, failure::refusal, lock, now_unix_ms};
use avln_grpc::Refusal;
use std::{
    sync::{
        Arc, Mutex,
        atomic::{AtomicI64, AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};
use tokio::sync::MutexGuard;

/// The system's clocks, or simulated ones. Clones share an adjustment of the wall clock, zero except in tests.
#[derive(Clone, Debug)]
pub struct Clock {
    source: ClockSource,
    set_by_ms: Arc<AtomicI64>,
}

#[derive(Clone, Debug)]
enum ClockSource {
    /// The system's clocks, and the monotonic time at the start.
    System(Instant),
    /// The age of a simulation, whose wall clock starts at `from_unix_ms`.
    Simulated { from_unix_ms: i64, age_ms: Arc<AtomicU64> },
}

impl Default for Clock {
    fn default() -> Self {
        Self { source: ClockSource::System(Instant::now()), set_by_ms: Arc::default() }
    }
}

impl Clock {
    /// Returns a clock that stands still at `from_unix_ms` until [`Clock::set_age`], for simulations.
    pub fn simulated(from_unix_ms: i64) -> Self {
        let source = ClockSource::Simulated { from_unix_ms, age_ms: Arc::default() };
        Self { source, set_by_ms: Arc::default() }
    }

    /// Sets the monotonic time of a simulated clock, and its wall clock with it. The system's clocks are not changed.
    pub fn set_age(&self, age: Duration) {
        if let ClockSource::Simulated { age_ms, .. } = &self.source {
            age_ms.store(u64::try_from(age.as_millis()).unwrap_or(u64::MAX), Ordering::SeqCst);
        }
    }

    /// Sets the wall clock forwards or back, for tests. The monotonic clock continues.
    pub fn set_by(&self, by_ms: i64) {
        self.set_by_ms.fetch_add(by_ms, Ordering::SeqCst);
    }

    /// Returns the wall clock, milliseconds since 1970-01-01 UTC.
    pub fn now_unix_ms(&self) -> i64 {
        let unix_ms = match &self.source {
            ClockSource::System(_) => now_unix_ms(),
            ClockSource::Simulated { from_unix_ms, .. } => {
                from_unix_ms.saturating_add(i64::try_from(self.age().as_millis()).unwrap_or(i64::MAX))
            }
        };
        unix_ms.saturating_add(self.set_by_ms.load(Ordering::SeqCst))
    }

    /// Returns the monotonic time since the clock's creation.
    fn age(&self) -> Duration {
        match &self.source {
            ClockSource::System(started) => started.elapsed(),
            ClockSource::Simulated { age_ms, .. } => Duration::from_millis(age_ms.load(Ordering::SeqCst)),
        }
    }

    /// Returns the wall clock, and the monotonic time since the clock's creation.
    pub(crate) fn read(&self) -> ClockReading {
        ClockReading { now_unix_ms: self.now_unix_ms(), age: self.age() }
    }
}

/// Both clocks at the same moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ClockReading {
    pub(crate) now_unix_ms: i64,
    /// Monotonic time, which is never set.
    pub(crate) age: Duration,
}

impl ClockReading {
    /// Largest deviation of the wall clock that counts as drift, milliseconds.
    const MAX_DRIFT_MS: i64 = 2000;

    /// Returns the change of the wall clock since an earlier reading, milliseconds; 0 for drift.
    pub(crate) fn set_by_ms(&self, before: &Self) -> i64 {
        let passed_ms = self.age.saturating_sub(before.age).as_millis();
        let passed_ms = i64::try_from(passed_ms).unwrap_or(i64::MAX);
        let set_by_ms = (self.now_unix_ms - before.now_unix_ms).saturating_sub(passed_ms);
        if set_by_ms.abs() > Self::MAX_DRIFT_MS { set_by_ms } else { 0 }
    }
}

/// Heartbeat interval; also the precision for measured downtime.
const INTERVAL: Duration = Duration::from_secs(10);

pub(crate) struct Heartbeat {
    /// Last reading with deadlines that follow it. Locked while deadlines move, because no other call may use them meanwhile.
    last: tokio::sync::Mutex<ClockReading>,
    /// Age at the last stored heartbeat; `None` before the first.
    recorded: Mutex<Option<Duration>>,
}

impl Heartbeat {
    pub(crate) fn new(clock: &Clock) -> Self {
        Self { last: tokio::sync::Mutex::new(clock.read()), recorded: Mutex::default() }
    }

    fn is_due(&self, age: Duration) -> bool {
        lock(&self.recorded).is_none_or(|recorded| age.saturating_sub(recorded) >= INTERVAL)
    }
}

/// A reading of the wall clock that agrees with all stored deadlines. Hold it during the database statement that compares or stores a
/// deadline: otherwise another call could move the deadlines after a change of the clock, and the reading would be out of date.
pub(crate) struct SettledTime<'a>(MutexGuard<'a, ClockReading>);

impl SettledTime<'_> {
    /// Returns the wall clock, milliseconds since 1970-01-01 UTC.
    pub(crate) fn unix_ms(&self) -> i64 {
        self.0.now_unix_ms
    }
}

impl Arena {
    /// Returns the wall clock, after deadlines of open runs have followed a change of it. Decisions about deadlines need this
    /// time: a run must neither expire nor gain time between a change and the next look for expired runs.
    pub(crate) async fn settled_time(&self) -> Result<SettledTime<'_>, Refusal> {
        let mut last = self.heartbeat.last.lock().await;
        let reading = self.clock.read();
        let by_ms = reading.set_by_ms(&last);
        if by_ms != 0 {
            // On an error the last reading stays, so that the next call moves the deadlines.
            let runs = self.store.follow_clock(by_ms, reading.now_unix_ms).await.map_err(refusal)?;
            tracing::warn!(by_ms, runs, "the system clock was set; deadlines of open runs moved with it");
        }
        *last = reading;
        Ok(SettledTime(last))
    }

    /// Returns the runs past their deadline, and records that the server is alive.
    pub(crate) async fn overdue_runs(&self) -> Result<Vec<String>, Refusal> {
        // Before the heartbeat: after a failure here, the next call retries both.
        self.flush_pending_returns().await?;
        let time = self.settled_time().await?;
        if self.heartbeat.is_due(time.0.age) {
            self.store.record_heartbeat(time.unix_ms()).await.map_err(refusal)?;
            *lock(&self.heartbeat.recorded) = Some(time.0.age);
        }
        self.store.overdue(time.unix_ms()).await.map_err(refusal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::DataFolder;

    #[tokio::test]
    async fn deadlines_stay_while_a_time_is_used() {
        let folder = tempfile::tempdir().unwrap();
        let data = DataFolder::open(folder.path()).unwrap();
        let store = data.store().await.unwrap();
        let arena = Arena::open(&data, store, 64).await.unwrap();
        let time = arena.settled_time().await.unwrap();
        arena.clock.set_by(-86_400_000);
        let looked = tokio::time::timeout(Duration::from_millis(50), arena.overdue_runs()).await;
        assert!(looked.is_err(), "a look for expired runs waits");
        let before_ms = time.unix_ms();
        drop(time);
        assert_eq!(arena.overdue_runs().await.unwrap(), Vec::<String>::new());
        assert!(arena.settled_time().await.unwrap().unix_ms() < before_ms - 80_000_000);
    }

    #[test]
    fn set_clock_is_detected_and_drift_is_not() {
        let read = |now_unix_ms, age_ms| ClockReading { now_unix_ms, age: Duration::from_millis(age_ms) };
        let readings = [
            read(1_000_000, 0),
            read(1_001_900, 1000),
            read(4_602_900, 2000),
            read(4_603_900, 3000),
            read(1_004_900, 4000),
        ];
        let changes: Vec<_> = readings.windows(2).map(|pair| pair[1].set_by_ms(&pair[0])).collect();
        assert_eq!(changes, [0, 3_600_000, 0, -3_600_000]);
    }

    #[test]
    fn simulated_clocks_stand_still() {
        let clock = Clock::simulated(1_000_000);
        let before = clock.read();
        clock.clone().set_age(Duration::from_secs(3600));
        assert_eq!((before.now_unix_ms, clock.now_unix_ms()), (1_000_000, 4_600_000));
        assert_eq!(clock.read().set_by_ms(&before), 0);
        clock.set_by(-3_600_000);
        assert_eq!(clock.read().set_by_ms(&before), -3_600_000);
    }

    #[test]
    fn clones_share_the_wall_clock() {
        let clock = Clock::default();
        let before = clock.read();
        clock.clone().set_by(-86_400_000);
        let set_by_ms = clock.read().set_by_ms(&before);
        assert!((-86_400_000 - set_by_ms).abs() < 1000, "{set_by_ms}");
    }

    #[test]
    fn heartbeat_is_due_initially_and_every_ten_seconds() {
        let heartbeat = Heartbeat::new(&Clock::default());
        let due = (0..31).map(Duration::from_secs).filter(|&age| {
            let is_due = heartbeat.is_due(age);
            if is_due {
                *lock(&heartbeat.recorded) = Some(age);
            }
            is_due
        });
        assert_eq!(due.map(|age| age.as_secs()).collect::<Vec<_>>(), [0, 10, 20, 30]);
    }
}
