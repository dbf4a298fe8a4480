use crate::attachment::StopReason;
use avln_episode::EndReason;
use avln_proto::v1::RunProgress;
use tokio::{sync::watch, time::Instant};

/// A run's progress, counted over all slots.
pub(super) struct ProgressTracker {
    tally: watch::Sender<Tally>,
    total: u32,
    done_before: u32,
    opened: Instant,
    timeouts_allowed: u32,
}

#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    started: u32,
    done: u32,
    /// Slots with an episode or a pending request.
    busy: u32,
    /// True if the host has no further episode.
    is_dry: bool,
    /// Episodes returned to the host.
    returned: u32,
    timeouts_in_a_row: u32,
}

impl ProgressTracker {
    pub(super) fn new(total: u32, done_before: u32, timeouts_allowed: u32) -> Self {
        Self { tally: watch::Sender::default(), total, done_before, opened: Instant::now(), timeouts_allowed }
    }

    /// Counts a request for an episode.
    pub(super) fn requested(&self) {
        self.tally.send_modify(|tally| tally.busy += 1);
    }

    /// Counts episodes returned to the host.
    pub(super) fn returned(&self) -> u32 {
        self.tally.borrow().returned
    }

    /// Waits until more than `seen` episodes were returned.
    pub(super) async fn refilled(&self, seen: u32) {
        // The sender lives in self, so waiting cannot fail.
        let _ = self.tally.subscribe().wait_for(|tally| tally.returned > seen).await;
    }

    /// Counts a request that got no episode.
    pub(super) fn refused(&self, is_dry: bool) {
        self.tally.send_modify(|tally| {
            tally.busy -= 1;
            tally.is_dry |= is_dry;
        });
    }

    /// Counts an episode that began. Returns the number in the run, from 1.
    pub(super) fn started(&self) -> u32 {
        self.tally.send_modify(|tally| tally.started += 1);
        self.done_before + self.tally.borrow().started
    }

    /// Counts an episode that ended and was stored.
    pub(super) fn ended(&self, reason: EndReason) {
        self.tally.send_modify(|tally| {
            tally.busy -= 1;
            match reason {
                EndReason::ServerFault => {
                    tally.returned += 1;
                    tally.is_dry = false;
                }
                EndReason::TimeBudget => {
                    tally.done += 1;
                    tally.timeouts_in_a_row += 1;
                }
                _ => {
                    tally.done += 1;
                    tally.timeouts_in_a_row = 0;
                }
            }
        });
    }

    pub(super) fn progress(&self) -> RunProgress {
        let tally = *self.tally.borrow();
        let done = (self.done_before + tally.done).min(self.total);
        let left = f64::from(self.total - done);
        let eta_s = (tally.done > 0)
            .then(|| self.opened.elapsed().as_secs_f64() * left / f64::from(tally.done))
            .map(|seconds| seconds.round() as u32);
        RunProgress { total: self.total, done, in_flight: tally.busy, eta_s }
    }

    /// Waits until no episode is left, or the agent let too many time out.
    pub(super) async fn over(&self) -> StopReason {
        let mut tallies = self.tally.subscribe();
        // The sender lives in self, so waiting cannot fail.
        let settled = tallies.wait_for(|tally| self.judge(tally).is_some()).await.map(|tally| *tally);
        settled.ok().and_then(|tally| self.judge(&tally)).unwrap_or(StopReason::NothingLeft)
    }

    fn judge(&self, tally: &Tally) -> Option<StopReason> {
        if tally.timeouts_in_a_row >= self.timeouts_allowed {
            return Some(StopReason::AgentHangs);
        }
        // Not before the last busy slot is done: a server fault there would return an episode that must be played.
        (tally.is_dry && tally.busy == 0).then_some(StopReason::NothingLeft)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[tokio::test(start_paused = true)]
    async fn a_run_is_over_when_its_last_slot_is_idle() {
        let tracker = ProgressTracker::new(5, 2, 20);
        tracker.requested();
        assert_eq!(tracker.started(), 3);
        tracker.requested();
        tracker.refused(true);
        let open = tokio::time::timeout(Duration::from_secs(1), tracker.over()).await;
        assert!(open.is_err(), "one slot still plays");
        tracker.ended(EndReason::Stopped);
        assert_eq!(tracker.over().await, StopReason::NothingLeft);
        let progress = tracker.progress();
        assert_eq!((progress.total, progress.done, progress.in_flight), (5, 3, 0));
        assert_eq!(progress.eta_s, Some(2), "one episode took one second; two are left");
    }

    #[tokio::test]
    async fn failed_episodes_are_played_again() {
        let tracker = ProgressTracker::new(2, 0, 20);
        tracker.requested();
        let seen = tracker.returned();
        tracker.requested();
        tracker.refused(true);
        tracker.ended(EndReason::ServerFault);
        tracker.refilled(seen).await;
        assert_eq!(tracker.judge(&tracker.tally.borrow()), None, "a slot must ask again first");
        assert_eq!(tracker.progress().done, 0);
    }

    #[tokio::test]
    async fn only_consecutive_timeouts_count() {
        let tracker = ProgressTracker::new(9, 0, 2);
        for reason in [EndReason::TimeBudget, EndReason::Stopped, EndReason::TimeBudget] {
            tracker.requested();
            tracker.ended(reason);
        }
        assert_eq!(tracker.judge(&tracker.tally.borrow()), None);
        tracker.requested();
        tracker.ended(EndReason::TimeBudget);
        assert_eq!(tracker.over().await, StopReason::AgentHangs);
    }
}
