//! What a stream is told by the clock: that the server is there, and how long the run lasts. The answers tell what the wire takes.

use crate::{
    host::OpenRun,
    outbound::{Departure, Outbound},
    wire,
};
use avln_proto::v1::{self, play_response::Frame};
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// Longest time before a run's end at which its agent is told.
const WARNING: Duration = Duration::from_secs(300);

/// The last Ping of a stream that was not answered.
#[derive(Debug, Default)]
pub(crate) struct Pulse {
    nonce: u64,
    sent: Option<Departure>,
}

impl Pulse {
    /// Sends a Ping; a stream that does not take it is noticed by itself.
    pub(crate) async fn beat(&mut self, out: &Outbound, left: &Remaining) {
        self.nonce += 1;
        let ping = v1::Ping {
            nonce: self.nonce,
            server_time_unix_ms: wire::unix_ms(),
            run_remaining_s: left.seconds(),
        };
        self.sent = out.send(Frame::Ping(ping)).await.ok();
    }

    /// A Pong has come. Its time on the wire counts up to `longest`.
    pub(crate) fn answered(&mut self, nonce: u64, out: &Outbound, longest: Duration) {
        if nonce != self.nonce {
            return;
        }
        if let Some(left) = self.sent.take().and_then(|sent| sent.at()) {
            out.measured(left.elapsed().min(longest));
        }
    }
}

/// The wall time that a run has left.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Remaining {
    /// When it ends, by this server's own clock, and when its agent is warned.
    end: Option<(Instant, Instant)>,
    deadline_unix_ms: i64,
}

impl Remaining {
    /// What is left of a run now.
    pub(crate) fn of(open: &OpenRun) -> Self {
        let deadline_unix_ms = open.deadline_unix_ms.unwrap_or_default();
        let left_ms = u64::try_from(deadline_unix_ms.saturating_sub(wire::unix_ms())).unwrap_or(0);
        let end =
            open.deadline_unix_ms.and_then(|_| Instant::now().checked_add(Duration::from_millis(left_ms)));
        let tenth = Duration::from_secs(u64::from(open.time.run_s) / 10);
        let warning = if tenth.is_zero() { WARNING } else { tenth.min(WARNING) };
        Self { end: end.map(|end| (end, end.checked_sub(warning).unwrap_or(end))), deadline_unix_ms }
    }

    fn seconds(&self) -> Option<u32> {
        let (end, _) = self.end?;
        u32::try_from(end.saturating_duration_since(Instant::now()).as_secs()).ok()
    }

    /// Waits until little is left.
    pub(crate) async fn runs_low(&self) {
        match self.end {
            Some((_, warning)) => sleep_until(warning).await,
            None => std::future::pending().await,
        }
    }

    /// Tells how little.
    pub(crate) fn notice(&self) -> v1::Notice {
        let seconds = self.seconds().unwrap_or_default();
        v1::Notice {
            kind: v1::NoticeKind::BudgetLow.into(),
            message: format!("the run's wall time is over in {seconds} s; episodes that are open then end"),
            effective_unix_ms: self.deadline_unix_ms,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outbound::outbound;
    use tokio::time::advance;
    use tokio_stream::StreamExt;

    #[tokio::test(start_paused = true)]
    async fn the_answer_to_a_ping_tells_what_the_wire_takes() {
        let (out, mut frames) = outbound(8, Duration::from_secs(30));
        let left = Remaining { end: None, deadline_unix_ms: 0 };
        let mut pulse = Pulse::default();
        let longest = Duration::from_secs(1);
        let wire = async |out: &Outbound| out.send(Frame::Ping(v1::Ping::default())).await.unwrap().wire();
        pulse.beat(&out, &left).await;
        frames.next().await.unwrap().unwrap();
        advance(Duration::from_millis(100)).await;
        pulse.answered(77, &out, longest);
        assert_eq!(wire(&out).await, Duration::ZERO, "that was not the answer");
        pulse.answered(1, &out, longest);
        assert_eq!(wire(&out).await, Duration::from_millis(100));
        pulse.answered(1, &out, longest);
        pulse.beat(&out, &left).await;
        while !frames
            .next()
            .await
            .is_some_and(|frame| matches!(frame.unwrap().frame, Some(Frame::Ping(ping)) if ping.nonce == 2))
        {
        }
        advance(Duration::from_secs(60)).await;
        pulse.answered(2, &out, longest);
        assert_eq!(wire(&out).await, Duration::from_millis(100), "the shortest counts");
        let (lone, mut frames) = outbound(8, Duration::from_secs(30));
        let mut pulse = Pulse::default();
        pulse.beat(&lone, &left).await;
        frames.next().await.unwrap().unwrap();
        advance(Duration::from_secs(60)).await;
        pulse.answered(1, &lone, longest);
        assert_eq!(wire(&lone).await, longest, "and no more than is believed");
    }
}
