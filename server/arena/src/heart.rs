//! Heartbeat of the server, and correction of deadlines after clock changes.

use super::{Arena, now_unix_ms, refusals::refusal};
use avln_grpc::Refusal;
use std::{
    sync::{Mutex, PoisonError},
    time::{Duration, Instant},
};

/// Heartbeat interval: the precision of downtime.
const EVERY: Duration = Duration::from_secs(10);
/// Tolerance between wall clock and elapsed time before a clock change is assumed, milliseconds.
const SLACK_MS: i64 = 2000;

/// Last clock reading.
pub(super) struct Heart {
    born: Instant,
    last: Mutex<Option<Beat>>,
}

#[derive(Clone, Copy, Debug)]
struct Beat {
    now_unix_ms: i64,
    /// Time since the server started, which no clock can change.
    age: Duration,
    /// Time of the last heartbeat.
    noted: Duration,
}

/// Actions due at a heartbeat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Due {
    note_alive: bool,
    /// Clock change, milliseconds.
    clock_set_by_ms: i64,
}

impl Heart {
    pub(super) fn new() -> Self {
        Self { born: Instant::now(), last: Mutex::default() }
    }

    fn beat(&self, now_unix_ms: i64, age: Duration) -> Due {
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(before) = *last else {
            *last = Some(Beat { now_unix_ms, age, noted: age });
            return Due { note_alive: true, ..Due::default() };
        };
        let passed_ms = i64::try_from(age.saturating_sub(before.age).as_millis()).unwrap_or(i64::MAX);
        let set_by_ms = (now_unix_ms - before.now_unix_ms).saturating_sub(passed_ms);
        let clock_set_by_ms = if set_by_ms.abs() > SLACK_MS { set_by_ms } else { 0 };
        let note_alive = clock_set_by_ms != 0 || age.saturating_sub(before.noted) >= EVERY;
        *last = Some(Beat { now_unix_ms, age, noted: if note_alive { age } else { before.noted } });
        Due { note_alive, clock_set_by_ms }
    }
}

impl Arena {
    /// Open runs past their deadline.
    pub(super) async fn overdue_now(&self) -> Result<Vec<String>, Refusal> {
        self.overdue_at(now_unix_ms(), self.heart.born.elapsed()).await
    }

    /// Open runs past their deadline at wall clock `now_unix_ms` and uptime `age`. Deadlines follow a clock
    /// change since the last call.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn overdue_at(&self, now_unix_ms: i64, age: Duration) -> Result<Vec<String>, Refusal> {
        let due = self.heart.beat(now_unix_ms, age);
        if due.clock_set_by_ms != 0 {
            let runs = self.store.follow_clock(due.clock_set_by_ms, now_unix_ms).await.map_err(refusal)?;
            tracing::warn!(
                by_ms = due.clock_set_by_ms,
                runs,
                "the clock was set; open runs keep what they had left"
            );
        }
        self.settle_debts().await?;
        if due.note_alive {
            self.store.record_heartbeat(now_unix_ms).await.map_err(refusal)?;
        }
        self.store.overdue(now_unix_ms).await.map_err(refusal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sign_of_life_is_given_at_first_and_every_ten_seconds() {
        let heart = Heart::new();
        let noted = (0..31).filter(|&second| {
            heart.beat(1_000_000 + second * 1000, Duration::from_secs(second as u64)).note_alive
        });
        assert_eq!(noted.collect::<Vec<_>>(), [0, 10, 20, 30]);
    }

    #[test]
    fn a_clock_that_is_set_is_seen_and_one_that_drifts_is_not() {
        let heart = Heart::new();
        let beat = |now_ms, age_ms| heart.beat(now_ms, Duration::from_millis(age_ms)).clock_set_by_ms;
        assert_eq!(beat(1_000_000, 0), 0);
        assert_eq!(beat(1_001_900, 1000), 0);
        assert_eq!(beat(4_602_900, 2000), 3_600_000);
        assert_eq!(beat(4_603_900, 3000), 0, "once");
        assert_eq!(beat(1_004_900, 4000), -3_600_000);
    }
}
