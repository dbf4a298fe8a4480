use crate::outbound::Departure;
use avln_episode::TimeLimits;
use avln_proto::v1;
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

/// The chess clock of one episode: each action has its time, and what it takes beyond comes off the episode's bank.
#[derive(Clone, Debug)]
pub(super) struct Clock {
    /// Time of one action; `None` for any.
    step: Option<Duration>,
    bank: Duration,
    thinking: Thinking,
}

/// Since when the agent thinks.
#[derive(Clone, Debug)]
enum Thinking {
    /// Its observation is not on its way.
    NotYet,
    /// Its observation was queued, and may have left.
    Sent(Departure),
    /// Its observation was handed over.
    Since(Instant),
}

impl Clock {
    /// A clock that stands, with a whole bank.
    pub(super) fn new(limits: &TimeLimits) -> Self {
        let step = (limits.step_ms > 0).then(|| millis(limits.step_ms));
        Self { step, bank: millis(limits.bank_ms), thinking: Thinking::NotYet }
    }

    /// The same with this much left in the bank.
    pub(super) fn with_bank(self, bank: Duration) -> Self {
        Self { bank, ..self }
    }

    pub(super) fn bank(&self) -> Duration {
        self.bank
    }

    /// The observation was queued: time runs from the moment when it leaves.
    pub(super) fn sent(&mut self, departure: Departure) {
        self.thinking = Thinking::Sent(departure);
    }

    /// The observation is handed over now, unless it was before.
    pub(super) fn handed_over(&mut self) {
        if self.since().is_none() {
            self.thinking = Thinking::Since(Instant::now());
        }
    }

    /// Whether time runs.
    pub(super) fn runs(&self) -> bool {
        self.since().is_some()
    }

    /// What of the time since then the wire takes.
    fn wire(&self) -> Duration {
        match &self.thinking {
            Thinking::Sent(departure) => departure.wire(),
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

    /// The agent has answered: stops the clock, charges the bank and says for how long the agent thought, without the wire.
    pub(super) fn stop(&mut self) -> Duration {
        let thought =
            self.since().map(|since| since.elapsed()).unwrap_or_default().saturating_sub(self.wire());
        self.thinking = Thinking::NotYet;
        let beyond = self.step.map(|step| thought.saturating_sub(step)).unwrap_or_default();
        self.bank = self.bank.saturating_sub(beyond);
        thought
    }

    /// Waits until the time of the action and the bank are used up.
    pub(super) async fn expired(self) {
        let wire = self.wire();
        let since = match self.thinking {
            Thinking::NotYet => std::future::pending().await,
            Thinking::Sent(departure) => departure.left().await,
            Thinking::Since(since) => since,
        };
        match self.step {
            Some(step) => sleep_until(since + step + self.bank + wire).await,
            None => std::future::pending().await,
        }
    }

    /// What an agent is told of it.
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

    async fn think(clock: &mut Clock, seconds: u64) -> Duration {
        clock.handed_over();
        advance(Duration::from_secs(seconds)).await;
        clock.stop()
    }

    #[tokio::test(start_paused = true)]
    async fn only_what_goes_beyond_the_step_comes_off_the_bank() {
        let mut clock = Clock::new(&LIMITS);
        assert_eq!(think(&mut clock, 4).await, Duration::from_secs(4));
        assert_eq!(clock.account(), v1::TimeAccount { step_ms: 5000, bank_ms: 60_000 });
        think(&mut clock, 15).await;
        assert_eq!(clock.bank(), Duration::from_secs(50));
        assert_eq!(clock.stop(), Duration::ZERO, "it stands");
    }

    #[tokio::test(start_paused = true)]
    async fn it_expires_when_step_and_bank_are_used_up_and_not_while_it_stands() {
        let mut clock = Clock::new(&LIMITS).with_bank(Duration::from_secs(2));
        assert!(timeout(Duration::from_secs(600), clock.clone().expired()).await.is_err());
        clock.handed_over();
        let before = Instant::now();
        clock.expired().await;
        assert_eq!(before.elapsed(), Duration::from_secs(7));
    }

    #[tokio::test(start_paused = true)]
    async fn the_wire_is_not_charged() {
        let (out, mut frames) = outbound(4, Duration::from_secs(30));
        out.measured(Duration::from_millis(900));
        out.measured(Duration::from_millis(100));
        out.measured(Duration::from_millis(300));
        let mut clock = Clock::new(&LIMITS);
        clock.sent(out.send(Frame::Ping(v1::Ping::default())).await.unwrap());
        frames.next().await.unwrap().unwrap();
        advance(Duration::from_millis(7_100)).await;
        assert_eq!(clock.stop(), Duration::from_secs(7), "the shortest of what was measured is the wire's");
        assert_eq!(clock.bank(), Duration::from_secs(58));
        clock.sent(out.send(Frame::Ping(v1::Ping::default())).await.unwrap());
        frames.next().await.unwrap().unwrap();
        let before = Instant::now();
        clock.expired().await;
        assert_eq!(before.elapsed(), Duration::from_millis(63_100));
    }

    #[tokio::test(start_paused = true)]
    async fn no_step_time_means_any() {
        let mut clock = Clock::new(&TimeLimits { step_ms: 0, ..LIMITS });
        clock.handed_over();
        assert!(timeout(Duration::from_secs(1_000_000), clock.clone().expired()).await.is_err());
        clock.stop();
        assert_eq!(clock.account(), v1::TimeAccount { step_ms: 0, bank_ms: 60_000 });
    }
}
