//! Server heartbeat, and deadlines after clock changes.

use crate::{
    Arena,
    clock::{Clock, ClockReading},
    conversion::refusal,
};
use avln_grpc::Refusal;
use std::{
    sync::{Mutex, PoisonError},
    time::Duration,
};

/// Heartbeat interval; also the precision for measured downtime.
const INTERVAL: Duration = Duration::from_secs(10);

pub(crate) struct Heartbeat {
    /// Last reading with deadlines that follow it. Locked while deadlines move, because no other call may use them meanwhile.
    last: tokio::sync::Mutex<ClockReading>,
    recorded: RecordedAge,
}

/// Age at the last stored heartbeat; `None` before the first.
#[derive(Default)]
struct RecordedAge(Mutex<Option<Duration>>);

impl RecordedAge {
    fn is_due(&self, age: Duration) -> bool {
        let recorded = *self.0.lock().unwrap_or_else(PoisonError::into_inner);
        recorded.is_none_or(|recorded| age.saturating_sub(recorded) >= INTERVAL)
    }

    fn set(&self, age: Duration) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(age);
    }
}

impl Heartbeat {
    pub(crate) fn new(clock: &Clock) -> Self {
        Self { last: tokio::sync::Mutex::new(clock.read()), recorded: RecordedAge::default() }
    }
}

impl Arena {
    /// Returns the wall clock, after deadlines of open runs have followed a change of it. Decisions about deadlines need this
    /// time: a run must neither expire nor gain time between a change and the next look for expired runs.
    pub(crate) async fn settled_now(&self) -> Result<i64, Refusal> {
        Ok(self.settled_reading().await?.now_unix_ms)
    }

    async fn settled_reading(&self) -> Result<ClockReading, Refusal> {
        let mut last = self.heartbeat.last.lock().await;
        let reading = self.clock.read();
        let by_ms = reading.set_by_ms(&last);
        if by_ms != 0 {
            // On an error the last reading stays, so that the next call moves the deadlines.
            let runs = self.store.follow_clock(by_ms, reading.now_unix_ms).await.map_err(refusal)?;
            tracing::warn!(by_ms, runs, "the system clock was set; deadlines of open runs moved with it");
        }
        *last = reading;
        Ok(reading)
    }

    /// Returns the runs past their deadline, and records that the server is alive.
    pub(crate) async fn overdue_runs(&self) -> Result<Vec<String>, Refusal> {
        let ClockReading { now_unix_ms, age } = self.settled_reading().await?;
        // Before the heartbeat: after a failure here, the next call retries both.
        self.flush_pending_returns().await?;
        if self.heartbeat.recorded.is_due(age) {
            self.store.record_heartbeat(now_unix_ms).await.map_err(refusal)?;
            self.heartbeat.recorded.set(age);
        }
        self.store.overdue(now_unix_ms).await.map_err(refusal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heartbeat_is_due_initially_and_every_ten_seconds() {
        let recorded = RecordedAge::default();
        let due = (0..31).map(Duration::from_secs).filter(|&age| {
            let is_due = recorded.is_due(age);
            if is_due {
                recorded.set(age);
            }
            is_due
        });
        assert_eq!(due.map(|age| age.as_secs()).collect::<Vec<_>>(), [0, 10, 20, 30]);
    }
}
