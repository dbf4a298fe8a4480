//! Attachment states, stop reasons and endings, and the client of unary calls. The transition table is in the crate documentation.

use avln_episode::EndReason;
use avln_proto::v1;
use std::{sync::Arc, time::Duration};
use tokio::{
    sync::watch,
    time::{Instant, sleep_until},
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Attachment {
    /// The server opens, resumes or restores the session; no client is attached yet.
    Admitted,
    Streaming,
    Unary,
    /// No client is attached. The session waits for a Hello with `resume`.
    Detached {
        until: Instant,
    },
    /// The session ends; open episodes are being stored, kept or handed over.
    Closing(StopReason),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum AttachmentEvent {
    StreamAttached,
    UnaryAttached,
    Detached { until: Instant },
    Stopped(StopReason),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StopReason {
    /// Another connection starts over with new episodes.
    Superseded,
    Resumed,
    Draining,
    /// The team cancelled the run.
    Cancelled,
    Expired,
    /// The stream broke, ended without Goodbye, or was not read.
    ConnectionLost,
    /// The client sent Goodbye with `pause`.
    Paused,
    /// The client sent Goodbye without `pause`, on the stream or by a unary call.
    Goodbye,
    /// No episode remains and none is open.
    NothingLeft,
    /// Too many episodes in a row ran out of time.
    AgentHangs,
    /// No unary call came for too long.
    Idle,
    /// A detached session was not resumed in time.
    AwayTooLong,
}

/// Treatment of a session after the attachment's end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Ending {
    /// End and store open episodes.
    Close(EndReason),
    /// Pass the session to the connection that resumes it.
    HandOver,
    /// Leave open episodes as they are in the run log, for the next server.
    KeepForRestart,
    /// Wait for the client, if the run's time limits allow it.
    Detach,
}

impl Attachment {
    pub(crate) fn next(self, event: AttachmentEvent) -> Self {
        match (self, event) {
            // The first reason wins, because the ending may already be under way (drain during attach). A client that attaches now
            // learns the reason from `SessionGuard::stopped`, which all loops poll first.
            (Self::Closing(reason), _) => Self::Closing(reason),
            (_, AttachmentEvent::Stopped(reason)) => Self::Closing(reason),
            (_, AttachmentEvent::StreamAttached) => Self::Streaming,
            (_, AttachmentEvent::UnaryAttached) => Self::Unary,
            (_, AttachmentEvent::Detached { until }) => Self::Detached { until },
        }
    }

    pub(crate) fn stop_reason(self) -> Option<StopReason> {
        match self {
            Self::Closing(reason) => Some(reason),
            _ => None,
        }
    }
}

impl StopReason {
    /// Returns the name in logs.
    pub(crate) fn as_str(self) -> &'static str {
        match self {
            Self::Superseded => "superseded",
            Self::Resumed => "resumed",
            Self::Draining => "draining",
            Self::Cancelled => "cancelled",
            Self::Expired => "expired",
            Self::ConnectionLost => "connection_lost",
            Self::Paused => "paused",
            Self::Goodbye => "goodbye",
            Self::NothingLeft => "nothing_left",
            Self::AgentHangs => "agent_hangs",
            Self::Idle => "idle",
            Self::AwayTooLong => "away_too_long",
        }
    }

    pub(crate) fn ending(self) -> Ending {
        match self {
            // The client of the new connection never saw the open episodes, so it cannot continue them.
            Self::Superseded => Ending::Close(EndReason::Disconnected),
            Self::Resumed => Ending::HandOver,
            Self::Draining => Ending::KeepForRestart,
            Self::Cancelled | Self::Goodbye | Self::NothingLeft => Ending::Close(EndReason::Abandoned),
            Self::Expired | Self::AgentHangs => Ending::Close(EndReason::TimeBudget),
            Self::ConnectionLost | Self::Paused => Ending::Detach,
            // Unary clients have no connection to lose: silence is their disconnect.
            Self::Idle | Self::AwayTooLong => Ending::Close(EndReason::Disconnected),
        }
    }

    pub(crate) fn finishes_run(self) -> bool {
        matches!(self, Self::Goodbye | Self::NothingLeft | Self::AgentHangs | Self::Expired)
    }

    /// Returns whether the agent leaves the run, which then ends even if episodes are left.
    pub(crate) fn abandons_run(self) -> bool {
        matches!(self, Self::Goodbye | Self::AgentHangs)
    }

    /// Returns whether the client may have stopped reading, so that frames must not wait for it.
    pub(crate) fn cuts_stream(self) -> bool {
        !matches!(self, Self::Goodbye | Self::Paused | Self::NothingLeft | Self::AgentHangs)
    }
}

/// A client of unary calls: its session, and the calls in progress.
pub(crate) struct UnaryClient<S> {
    pub(crate) session: Arc<S>,
    pub(crate) welcome: v1::Welcome,
    pub(crate) calls: watch::Sender<CallTimes>,
}

/// Calls of a unary client.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CallTimes {
    /// Calls in progress.
    pub(crate) open: u32,
    /// Time of the last beginning or end.
    pub(crate) last: Instant,
}

impl<S> UnaryClient<S> {
    /// Counts a call in progress until the guard is dropped, with the call if its client cancels it.
    pub(crate) fn begin_call(&self) -> impl Drop + '_ {
        self.calls.send_modify(|calls| *calls = CallTimes { open: calls.open + 1, last: Instant::now() });
        CallInProgress(&self.calls)
    }

    /// Waits until no call has been in progress for `limit`.
    pub(crate) async fn idle(&self, limit: Duration) {
        let mut calls = self.calls.subscribe();
        loop {
            // The sender lives as long as this client.
            let Ok(CallTimes { last, .. }) =
                calls.wait_for(|calls| calls.open == 0).await.map(|calls| *calls)
            else {
                return;
            };
            let end = last + limit;
            if end <= Instant::now() {
                return;
            }
            sleep_until(end).await;
        }
    }
}

struct CallInProgress<'a>(&'a watch::Sender<CallTimes>);

impl Drop for CallInProgress<'_> {
    fn drop(&mut self) {
        self.0.send_modify(|calls| {
            *calls = CallTimes { open: calls.open.saturating_sub(1), last: Instant::now() };
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn every_transition_follows_the_table() {
        use AttachmentEvent::{Detached as Detach, Stopped, StreamAttached, UnaryAttached};
        use StopReason::{Cancelled, Draining, Expired, Resumed, Superseded};
        let until = Instant::now();
        let stops = [Superseded, Resumed, Draining, Cancelled, Expired];
        let open =
            [Attachment::Admitted, Attachment::Streaming, Attachment::Unary, Attachment::Detached { until }];
        for state in open {
            assert_eq!(state.stop_reason(), None);
            assert_eq!(state.next(StreamAttached), Attachment::Streaming);
            assert_eq!(state.next(UnaryAttached), Attachment::Unary);
            assert_eq!(state.next(Detach { until }), Attachment::Detached { until });
            for reason in stops {
                assert_eq!(state.next(Stopped(reason)), Attachment::Closing(reason));
            }
        }
        for first in stops {
            let closing = Attachment::Closing(first);
            assert_eq!(closing.stop_reason(), Some(first));
            for event in [StreamAttached, UnaryAttached, Detach { until }] {
                assert_eq!(closing.next(event), closing, "{event:?} cannot reopen a session");
            }
            for second in stops {
                assert_eq!(closing.next(Stopped(second)), closing, "{first:?} before {second:?}");
            }
        }
    }

    #[test]
    fn every_stop_reason_has_its_ending() {
        use Ending::{Close, Detach, HandOver, KeepForRestart};
        let table = [
            (StopReason::Superseded, Close(EndReason::Disconnected), false, false, true),
            (StopReason::Resumed, HandOver, false, false, true),
            (StopReason::Draining, KeepForRestart, false, false, true),
            (StopReason::Cancelled, Close(EndReason::Abandoned), false, false, true),
            (StopReason::Expired, Close(EndReason::TimeBudget), true, false, true),
            (StopReason::ConnectionLost, Detach, false, false, true),
            (StopReason::Paused, Detach, false, false, false),
            (StopReason::Goodbye, Close(EndReason::Abandoned), true, true, false),
            (StopReason::NothingLeft, Close(EndReason::Abandoned), true, false, false),
            (StopReason::AgentHangs, Close(EndReason::TimeBudget), true, true, false),
            (StopReason::Idle, Close(EndReason::Disconnected), false, false, true),
            (StopReason::AwayTooLong, Close(EndReason::Disconnected), false, false, true),
        ];
        for (reason, ending, finishes, abandons, cuts) in table {
            assert_eq!(
                (reason.ending(), reason.finishes_run(), reason.abandons_run(), reason.cuts_stream()),
                (ending, finishes, abandons, cuts),
                "{reason:?}"
            );
        }
    }
}
