use avln_episode::EndReason;
use avln_proto::v1::RunProgress;
use tokio::{sync::watch, time::Instant};

/// Why a run has nothing more to play.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Over {
    /// No episode is left and none is being played.
    NothingLeft,
    /// Too many episodes in a row ran out of time.
    AgentHangs,
}

/// How far a run is, as its slots see it.
pub(super) struct Board {
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
    /// Slots that hold an episode or are about to.
    busy: u32,
    /// The host has no further episode.
    dry: bool,
    /// Episodes that may have gone back to the host, to be played again.
    returned: u32,
    timeouts_in_a_row: u32,
}

impl Board {
    pub(super) fn new(total: u32, done_before: u32, timeouts_allowed: u32) -> Self {
        Self { tally: watch::Sender::default(), total, done_before, opened: Instant::now(), timeouts_allowed }
    }

    /// A slot asks for an episode.
    pub(super) fn asking(&self) {
        self.tally.send_modify(|tally| tally.busy += 1);
    }

    /// How many episodes may have gone back to the host so far.
    pub(super) fn returned(&self) -> u32 {
        self.tally.borrow().returned
    }

    /// Waits until more than `seen` episodes have gone back.
    pub(super) async fn refilled(&self, seen: u32) {
        // The sender lives in self, so waiting cannot fail.
        let _ = self.tally.subscribe().wait_for(|tally| tally.returned > seen).await;
    }

    /// It got none.
    pub(super) fn refused(&self, dry: bool) {
        self.tally.send_modify(|tally| {
            tally.busy -= 1;
            tally.dry |= dry;
        });
    }

    /// It got one. Returns which one of the run it is, counted from 1.
    pub(super) fn started(&self) -> u32 {
        self.tally.send_modify(|tally| tally.started += 1);
        self.done_before + self.tally.borrow().started
    }

    /// The episode of a slot is over and stored.
    pub(super) fn ended(&self, reason: EndReason) {
        self.tally.send_modify(|tally| {
            tally.busy -= 1;
            match reason {
                EndReason::ServerFault => {
                    tally.returned += 1;
                    tally.dry = false;
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

    pub(super) async fn over(&self) -> Over {
        let mut tallies = self.tally.subscribe();
        // The sender lives in self, so waiting cannot fail.
        let settled = tallies.wait_for(|tally| self.judge(tally).is_some()).await.map(|tally| *tally);
        settled.ok().and_then(|tally| self.judge(&tally)).unwrap_or(Over::NothingLeft)
    }

    fn judge(&self, tally: &Tally) -> Option<Over> {
        if tally.timeouts_in_a_row >= self.timeouts_allowed {
            return Some(Over::AgentHangs);
        }
        (tally.dry && tally.busy == 0).then_some(Over::NothingLeft)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[tokio::test(start_paused = true)]
    async fn the_run_is_over_when_the_last_slot_is_idle() {
        let board = Board::new(5, 2, 20);
        board.asking();
        assert_eq!(board.started(), 3);
        board.asking();
        board.refused(true);
        let open = tokio::time::timeout(Duration::from_secs(1), board.over()).await;
        assert!(open.is_err(), "one slot is still playing");
        board.ended(EndReason::Stopped);
        assert_eq!(board.over().await, Over::NothingLeft);
        let progress = board.progress();
        assert_eq!((progress.total, progress.done, progress.in_flight), (5, 3, 0));
        assert_eq!(progress.eta_s, Some(2), "one episode took the second that passed; two are left");
    }

    #[tokio::test]
    async fn an_episode_that_failed_may_be_had_again() {
        let board = Board::new(2, 0, 20);
        board.asking();
        let seen = board.returned();
        board.asking();
        board.refused(true);
        board.ended(EndReason::ServerFault);
        board.refilled(seen).await;
        assert_eq!(board.judge(&board.tally.borrow()), None, "somebody has to ask again first");
        assert_eq!(board.progress().done, 0);
    }

    #[tokio::test]
    async fn only_timeouts_in_a_row_count() {
        let board = Board::new(9, 0, 2);
        for reason in [EndReason::TimeBudget, EndReason::Stopped, EndReason::TimeBudget] {
            board.asking();
            board.ended(reason);
        }
        assert_eq!(board.judge(&board.tally.borrow()), None);
        board.asking();
        board.ended(EndReason::TimeBudget);
        assert_eq!(board.over().await, Over::AgentHangs);
    }
}
