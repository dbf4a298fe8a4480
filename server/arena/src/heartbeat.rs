//! Server heartbeat, and deadlines after clock changes.

use crate::{Arena, conversion::refusal};
use avln_grpc::Refusal;
use std::{
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

/// Heartbeat interval; also the precision for measured downtime.
const INTERVAL: Duration = Duration::from_secs(10);
/// Largest clock deviation that counts as drift, milliseconds.
const MAX_DRIFT_MS: i64 = 2000;

pub(crate) struct Heartbeat {
    pub(crate) started: Instant,
    last: Mutex<Option<ClockReading>>,
}

#[derive(Clone, Copy, Debug)]
struct ClockReading {
    now_unix_ms: i64,
    /// Uptime by the monotonic clock, which is never set.
    age: Duration,
    /// Uptime at the last stored heartbeat.
    recorded: Duration,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct DueActions {
    record_alive: bool,
    /// Clock change, milliseconds.
    clock_set_by_ms: i64,
}

impl Heartbeat {
    pub(crate) fn new() -> Self {
        Self { started: Instant::now(), last: Mutex::default() }
    }

    fn read(&self, now_unix_ms: i64, age: Duration) -> DueActions {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(before) = *last else {
            *last = Some(ClockReading { now_unix_ms, age, recorded: age });
            return DueActions { record_alive: true, ..DueActions::default() };
        };
        let passed_ms = i64::try_from(age.saturating_sub(before.age).as_millis()).unwrap_or(i64::MAX);
        let set_by_ms = (now_unix_ms - before.now_unix_ms).saturating_sub(passed_ms);
        let clock_set_by_ms = if set_by_ms.abs() > MAX_DRIFT_MS { set_by_ms } else { 0 };
        let record_alive = clock_set_by_ms != 0 || age.saturating_sub(before.recorded) >= INTERVAL;
        let recorded = if record_alive { age } else { before.recorded };
        *last = Some(ClockReading { now_unix_ms, age, recorded });
        DueActions { record_alive, clock_set_by_ms }
    }
}

impl Arena {
    /// Returns the runs past their deadline at uptime `age`. Deadlines follow changes of the wall clock.
    pub async fn overdue_at(&self, now_unix_ms: i64, age: Duration) -> Result<Vec<String>, Refusal> {
        let due = self.heartbeat.read(now_unix_ms, age);
        if due.clock_set_by_ms != 0 {
            let runs = self.store.follow_clock(due.clock_set_by_ms, now_unix_ms).await.map_err(refusal)?;
            tracing::warn!(
                by_ms = due.clock_set_by_ms,
                runs,
                "the system clock was set; deadlines of open runs moved with it"
            );
        }
        // Before the heartbeat: after a failure here, the next call retries both.
        self.flush_pending_returns().await?;
        if due.record_alive {
            self.store.record_heartbeat(now_unix_ms).await.map_err(refusal)?;
        }
        self.store.overdue(now_unix_ms).await.map_err(refusal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heartbeat_is_due_initially_and_every_ten_seconds() {
        let heartbeat = Heartbeat::new();
        let recorded = (0..31).filter(|&second| {
            heartbeat.read(1_000_000 + second * 1000, Duration::from_secs(second as u64)).record_alive
        });
        assert_eq!(recorded.collect::<Vec<_>>(), [0, 10, 20, 30]);
    }

    #[test]
    fn set_clock_is_detected_and_drift_is_not() {
        let heartbeat = Heartbeat::new();
        let read = |now_ms, age_ms| heartbeat.read(now_ms, Duration::from_millis(age_ms)).clock_set_by_ms;
        assert_eq!(read(1_000_000, 0), 0);
        assert_eq!(read(1_001_900, 1000), 0);
        assert_eq!(read(4_602_900, 2000), 3_600_000);
        assert_eq!(read(4_603_900, 3000), 0, "once");
        assert_eq!(read(1_004_900, 4000), -3_600_000);
    }
}
