//! Slot requests, replies, and episodes, open or finished, with their clocks.

use super::SessionContext;
use crate::{
    host::{Episode, HostedEpisode},
    limits::Limits,
    outbound::{Departure, Outbound},
    refusal::{Failure, FaultSubject, Result},
    wire,
};
use avln_episode::{Action, TimeLimits};
use avln_proto::v1::{self, Reason};
use std::time::Duration;
use tokio::time::{Instant, sleep_until};

#[derive(Clone, Debug)]
pub(crate) enum SlotRequest {
    Ready,
    /// Continue the open episode of a unary caller, or begin the next.
    Resume,
    Act(v1::Act),
    Abandon(v1::Abandon),
}

#[derive(Clone, Debug)]
pub(crate) enum SlotReply {
    Start(Box<v1::EpisodeStart>),
    NothingLeft,
    /// An episode follows unasked when another has ended.
    NothingYet,
    Step(Box<v1::StepResponse>),
    Ended(Box<v1::EpisodeEnd>),
}

impl SlotReply {
    pub(super) fn step(observation: Option<v1::Observation>, episode_end: Option<v1::EpisodeEnd>) -> Self {
        Self::Step(Box::new(v1::StepResponse { observation, episode_end }))
    }
}

#[derive(Clone, Debug)]
pub(crate) enum Audience {
    Stream(Outbound),
    /// Unary calls that wait for replies.
    Callers,
    /// No client is attached; the last observation is kept.
    Nobody,
}

pub(super) struct OpenEpisode<E> {
    pub(super) hosted: HostedEpisode<E>,
    /// Number in the run, from 1.
    pub(super) ordinal: u32,
    pub(super) last: LastStep,
    pub(super) clock: ChessClock,
}

/// Last observation and the action before it, kept to answer repeated requests.
#[derive(Clone)]
pub(super) struct LastStep {
    pub(super) action: Option<i32>,
    pub(super) observation: v1::Observation,
}

pub(super) struct FinishedEpisode {
    pub(super) last: LastStep,
    pub(super) end: v1::EpisodeEnd,
}

impl LastStep {
    /// Returns the action to carry out; `None` if `act` is a repetition.
    pub(super) fn due(&self, act: &v1::Act) -> Result<Option<Action>> {
        let action = wire::action(act.action).ok_or_else(|| unknown_action(act.action))?;
        let taken = self.observation.step;
        not_ahead(act.step, taken + 1)?;
        if act.step == taken + 1 {
            return Ok(Some(action));
        }
        if act.step == taken && self.action == Some(act.action) {
            return Ok(None);
        }
        Err(self.conflict(act.step))
    }

    /// Refuses a step that was taken: a repetition must have the action of the last step.
    fn conflict(&self, step: u32) -> Failure {
        let taken = self.observation.step;
        let next = taken + 1;
        let message = match self.action {
            Some(action) if step == taken => {
                format!("step {step} was taken with action {action}; repeat that action or send step {next}")
            }
            Some(_) => format!("step {step} is past; only step {taken} can be repeated; send step {next}"),
            None => format!("step {step} is the start of the episode; send step {next}"),
        };
        Failure::new(Reason::StepConflict, message)
    }

    pub(super) fn is_last(&self) -> bool {
        self.observation.terminated || self.observation.truncated
    }
}

impl<E: Episode> OpenEpisode<E> {
    /// Stops the clock and accounts for the thinking time.
    pub(super) fn stop_clock(&mut self) -> std::time::Duration {
        let thought = self.clock.stop();
        self.hosted.time.thinking += thought;
        thought
    }

    /// Builds an EpisodeStart with the last observation instead of the first.
    pub(super) fn start_frame<H>(&self, slot: u32, session: &SessionContext<H>) -> v1::EpisodeStart {
        v1::EpisodeStart {
            slot,
            episode: self.hosted.handle.clone(),
            mission: Some(wire::mission(self.hosted.episode.mission())),
            observation: Some(self.last.observation.clone()),
            ordinal: self.ordinal,
            progress: Some(session.progress.progress()),
        }
    }
}

impl FinishedEpisode {
    /// Repeats the last reply to a repeated action, and refuses any other.
    pub(super) fn act(&self, act: &v1::Act, is_unary: bool) -> Result<SlotReply> {
        same_episode(&self.end.episode, &act.episode)?;
        let taken = &self.last.observation;
        let end = Some(self.end.clone());
        let again = act.step == taken.step && self.last.action == Some(act.action);
        if again && self.last.is_last() {
            return Ok(SlotReply::step(Some(taken.clone()), end));
        }
        // An episode that ended while the agent was thinking: a stream has received the end, a unary caller learns it only here.
        let cut_short = !self.last.is_last();
        if is_unary && cut_short && self.end.reason() != v1::EndReason::Abandoned {
            return Ok(SlotReply::step(None, end));
        }
        let ended = self.end.reason().as_str_name();
        let message =
            format!("the episode ended after {} steps ({ended}); send Ready for the next", taken.step);
        Err(Failure::new(Reason::EpisodeOver, message))
    }

    /// Returns the frames that a client with this last position has missed.
    pub(super) fn missed(&self, known: &v1::SlotPosition) -> SlotReply {
        let unseen = self.last.is_last() && known.step < self.last.observation.step;
        SlotReply::step(unseen.then(|| self.last.observation.clone()), Some(self.end.clone()))
    }
}

impl SlotRequest {
    pub(crate) fn subject(&self, slot: u32) -> FaultSubject<'_> {
        let (episode, step) = match self {
            Self::Ready | Self::Resume => ("", 0),
            Self::Act(act) => (act.episode.as_str(), act.step),
            Self::Abandon(abandon) => (abandon.episode.as_str(), abandon.step),
        };
        FaultSubject { slot: Some(slot), episode: Limits::shorten(episode), step }
    }
}

pub(super) fn same_episode(held: &str, named: &str) -> Result<()> {
    if held == named {
        return Ok(());
    }
    let message = format!("episode '{}' is not in this slot; '{held}' is", Limits::shorten(named));
    Err(Failure::new(Reason::EpisodeUnknown, message))
}

pub(super) fn not_ahead(step: u32, latest: u32) -> Result<()> {
    if step <= latest {
        return Ok(());
    }
    let message = format!("step {step} lies ahead; {latest} is the latest possible");
    Err(Failure::new(Reason::StepAhead, message))
}

fn unknown_action(number: i32) -> Failure {
    let message = format!(
        "action {number} does not exist; use 1 MOVE_FORWARD, 2 TURN_LEFT, 3 TURN_RIGHT, 4 SUBMIT or 5 STOP"
    );
    Failure::new(Reason::ActionOutOfRange, message)
}

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

    #[test]
    fn conflicts_name_the_repeatable_step() {
        let conflict = |taken, action, step, number| {
            let observation = v1::Observation { step: taken, ..v1::Observation::default() };
            let act = v1::Act { step, action: number, ..v1::Act::default() };
            LastStep { action, observation }.due(&act).unwrap_err().message
        };
        let last = "step 2 was taken with action 2; repeat that action or send step 3";
        assert_eq!(conflict(2, Some(2), 2, 1), last);
        let earlier = "step 1 is past; only step 2 can be repeated; send step 3";
        assert_eq!(conflict(2, Some(2), 1, 2), earlier);
        assert_eq!(conflict(0, None, 0, 1), "step 0 is the start of the episode; send step 1");
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
