use crate::outbound::Departure;
use avln_episode::TimeLimits;
use avln_proto::v1;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// Chess clock of an episode: time per action, plus a bank for slower actions.
#[derive(Clone, Debug)]
pub(super) struct ChessClock {
    /// Time per action; `None` if unlimited.
    step: Option<Duration>,
    bank: Duration,
    thinking: Thinking,
}

/// Start of the agent's thinking time.
#[derive(Clone, Debug)]
enum Thinking {
    /// No observation was sent.
    NotYet,
    /// The observation was queued, and may have left.
    Sent(Departure),
    /// The observation was returned to a unary caller.
    Since(Instant),
}

impl ChessClock {
    /// Creates a stopped clock with a full bank.
    pub(super) fn new(limits: &TimeLimits) -> Self {
        let step = (limits.step_ms > 0).then(|| millis(limits.step_ms));
        Self { step, bank: millis(limits.bank_ms), thinking: Thinking::NotYet }
    }

    /// Sets the rest of the bank.
    pub(super) fn with_bank(self, bank: Duration) -> Self {
        Self { bank, ..self }
    }

    pub(super) fn bank(&self) -> Duration {
        self.bank
    }

    /// Starts the clock at the departure of a queued observation.
    pub(super) fn sent(&mut self, departure: Departure) {
        self.thinking = Thinking::Sent(departure);
    }

    /// Starts the clock now, unless it runs.
    pub(super) fn handed_over(&mut self) {
        if self.since().is_none() {
            self.thinking = Thinking::Since(Instant::now());
        }
    }

    /// Returns whether the clock runs.
    pub(super) fn runs(&self) -> bool {
        self.since().is_some()
    }

    /// Returns the round-trip time in the time since then.
    fn round_trip(&self) -> Duration {
        match &self.thinking {
            Thinking::Sent(departure) => departure.round_trip(),
            Thinking::NotYet | Thinking::Since(_) => Duration::ZERO,
        }
    }

    fn since(&self) -> Option<Instant> {
        match &self.thinking {
            Thinking::NotYet => None,
            Thinking::Sent(departure) => departure.at(),
            Thinking::Since(since) => Some(*since),
        }
    }

    /// Stops the clock and charges the bank. Returns the thinking time without the round trip.
    pub(super) fn stop(&mut self) -> Duration {
        let thought =
            self.since().map(|since| since.elapsed()).unwrap_or_default().saturating_sub(self.round_trip());
        self.thinking = Thinking::NotYet;
        let beyond = self.step.map(|step| thought.saturating_sub(step)).unwrap_or_default();
        self.bank = self.bank.saturating_sub(beyond);
        thought
    }

    /// Waits until the time of the action and the bank are used.
    pub(super) async fn expired(self) {
        let round_trip = self.round_trip();
        let since = match self.thinking {
            Thinking::NotYet => std::future::pending().await,
            Thinking::Sent(departure) => departure.left().await,
            Thinking::Since(since) => since,
        };
        match self.step {
            Some(step) => sleep_until(since + step + self.bank + round_trip).await,
            None => std::future::pending().await,
        }
    }

    /// Returns the account that agents receive.
    pub(super) fn account(&self) -> v1::TimeAccount {
        let whole = |time: Duration| u32::try_from(time.as_millis()).unwrap_or(u32::MAX);
        v1::TimeAccount { step_ms: self.step.map(whole).unwrap_or_default(), bank_ms: whole(self.bank) }
    }
}

fn millis(ms: u32) -> Duration {
    Duration::from_millis(u64::from(ms))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::outbound::outbound;
    use avln_proto::v1::play_response::Frame;
    use tokio::time::{advance, timeout};
    use tokio_stream::StreamExt;

    const LIMITS: TimeLimits =
        TimeLimits { step_ms: 5000, bank_ms: 60_000, run_s: 0, disconnect_s: 0, disconnect_total_s: 0 };

    async fn think(clock: &mut ChessClock, seconds: u64) -> Duration {
        clock.handed_over();
        advance(Duration::from_secs(seconds)).await;
        clock.stop()
    }

    #[tokio::test(start_paused = true)]
    async fn only_time_beyond_the_step_is_charged() {
        let mut clock = ChessClock::new(&LIMITS);
        assert_eq!(think(&mut clock, 4).await, Duration::from_secs(4));
        assert_eq!(clock.account(), v1::TimeAccount { step_ms: 5000, bank_ms: 60_000 });
        think(&mut clock, 15).await;
        assert_eq!(clock.bank(), Duration::from_secs(50));
        assert_eq!(clock.stop(), Duration::ZERO, "it is stopped");
    }

    #[tokio::test(start_paused = true)]
    async fn a_running_clock_expires_after_step_and_bank() {
        let mut clock = ChessClock::new(&LIMITS).with_bank(Duration::from_secs(2));
        assert!(timeout(Duration::from_secs(600), clock.clone().expired()).await.is_err());
        clock.handed_over();
        let before = Instant::now();
        clock.expired().await;
        assert_eq!(before.elapsed(), Duration::from_secs(7));
    }

    #[tokio::test(start_paused = true)]
    async fn the_round_trip_is_not_charged() {
        let (out, mut frames) = outbound(4, Duration::from_secs(30));
        out.measured(Duration::from_millis(900));
        out.measured(Duration::from_millis(100));
        out.measured(Duration::from_millis(300));
        let mut clock = ChessClock::new(&LIMITS);
        clock.sent(out.send(Frame::Ping(v1::Ping::default())).await.unwrap());
        frames.next().await.unwrap().unwrap();
        advance(Duration::from_millis(7_100)).await;
        assert_eq!(clock.stop(), Duration::from_secs(7), "the shortest measured round trip is deducted");
        assert_eq!(clock.bank(), Duration::from_secs(58));
        clock.sent(out.send(Frame::Ping(v1::Ping::default())).await.unwrap());
        frames.next().await.unwrap().unwrap();
        let before = Instant::now();
        clock.expired().await;
        assert_eq!(before.elapsed(), Duration::from_millis(63_100));
    }

    #[tokio::test(start_paused = true)]
    async fn no_step_time_means_unlimited() {
        let mut clock = ChessClock::new(&TimeLimits { step_ms: 0, ..LIMITS });
        clock.handed_over();
        assert!(timeout(Duration::from_secs(1_000_000), clock.clone().expired()).await.is_err());
        clock.stop();
        assert_eq!(clock.account(), v1::TimeAccount { step_ms: 0, bank_ms: 60_000 });
    }
}
