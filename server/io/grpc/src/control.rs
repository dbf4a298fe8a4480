//! Operator controls: list live runs, read step times, post announcements, drain the server.

use crate::{refusal::Refusal, shared::Shared, watchdog::Watchdog};
use avln_episode::EndReason;
use avln_proto::v1::Reason;
use parking_lot::Mutex;
use std::{
    collections::BTreeMap,
    sync::Arc,
    time::{Duration, SystemTime, UNIX_EPOCH},
};
use tokio::{
    sync::Notify,
    time::{Instant, timeout_at},
};

/// Retry delay during a drain, seconds.
const RETRY_AFTER_S: u32 = 60;

pub(crate) fn unix_ms() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as i64)
}

/// Operator controls and statistics. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Control(Arc<ControlState>);

#[derive(Debug, Default)]
struct ControlState {
    statistics: Mutex<Statistics>,
    /// Open episodes.
    busy: Shared<usize>,
    drain: Shared<Option<Drain>>,
    /// Notified when a run is added to `Statistics::cancelled`.
    cancelling: Notify,
    watchdog: Watchdog,
}

#[derive(Debug, Default)]
struct Statistics {
    slots: BTreeMap<(String, u32), SlotStatistics>,
    /// Open runs, and whether their client is connected.
    sessions: BTreeMap<String, bool>,
    steps: u64,
    parts: [Histogram; 4],
    ends: BTreeMap<&'static str, u64>,
    notice: String,
    /// Runs cancelled outside gRPC, with sessions still to end.
    cancelled: Vec<String>,
}

/// Time accounts, wall clock.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TimeSpent {
    /// Simulation: motion, vision, sound.
    pub simulation: Duration,
    /// Observation encoding.
    pub encoding: Duration,
    /// Waiting for a simulation thread.
    pub queue: Duration,
    /// The agent's thinking, from the observation's departure to the action's arrival, without the round trip.
    pub thinking: Duration,
}

#[derive(Debug, Default)]
struct SlotStatistics {
    step: u32,
    /// Time accounts up to this step.
    spent: TimeSpent,
    /// First counted step, with time.
    first: Option<(u32, Instant)>,
    /// Last reply: time, and the step's duration from reply to reply.
    last: Option<(Instant, Option<Duration>)>,
    /// Last reply by the system clock, milliseconds since 1970-01-01 UTC.
    at_unix_ms: i64,
}

impl SlotStatistics {
    /// Records the reply to a step, or the start of an episode.
    fn replied(&mut self, step: u32) {
        let now = Instant::now();
        let took = self.last.map(|(before, _)| now.saturating_duration_since(before));
        self.first.get_or_insert((step, now));
        self.last = Some((now, took));
        self.at_unix_ms = unix_ms();
    }

    fn mean_step(&self) -> Option<Duration> {
        let (first, begun) = self.first?;
        let (last, _) = self.last?;
        last.saturating_duration_since(begun).checked_div(self.step.checked_sub(first)?)
    }
}

/// An announced server stop.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drain {
    /// Reason, for people.
    pub reason: String,
    /// Time at which open episodes are cut.
    pub until: Instant,
}

/// A slot's live state.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlotState {
    /// Run id.
    pub run: String,
    /// The slot.
    pub slot: u32,
    /// Steps taken.
    pub step: u32,
    /// Last step's duration from reply to reply, including the agent's thinking.
    pub last_step: Option<Duration>,
    /// Mean step duration.
    pub mean_step: Option<Duration>,
    /// Last reply, milliseconds since 1970-01-01 UTC. The agent thinks since then.
    pub at_unix_ms: i64,
}

/// An open run's live state.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SessionState {
    /// True if the client is connected.
    pub is_there: bool,
    /// Slots with an open episode.
    pub slots: Vec<SlotState>,
}

/// Statistics since server start.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// Slots with an open episode, by run and number.
    pub slots: Vec<SlotState>,
    /// Steps taken.
    pub steps: u64,
    /// Step durations by part.
    pub parts: Vec<(&'static str, Histogram)>,
    /// Episode count by end reason.
    pub ends: BTreeMap<&'static str, u64>,
    /// Announcement; empty if none.
    pub notice: String,
}

/// A duration histogram.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// Counts per bucket of [`Histogram::LIMITS_S`]; the last bucket has no limit.
    pub counts: [u64; Histogram::LIMITS_S.len() + 1],
    /// Sum, seconds.
    pub sum_s: f64,
}

impl Histogram {
    /// Upper bucket limits, seconds.
    pub const LIMITS_S: [f64; 15] =
        [1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 1e-2, 2.5e-2, 5e-2, 0.1, 0.25, 0.5, 1.0, 10.0, 60.0];

    fn note(&mut self, took: Duration) {
        let seconds = took.as_secs_f64();
        self.counts[Self::LIMITS_S.partition_point(|limit| *limit < seconds)] += 1;
        self.sum_s += seconds;
    }
}

impl Control {
    /// Returns the watchdog over simulations.
    pub fn watchdog(&self) -> &Watchdog {
        &self.0.watchdog
    }

    /// Records a slot's step count and time accounts. Step 0 starts an episode.
    pub(crate) fn stepped(&self, run: &str, slot: u32, step: u32, spent: TimeSpent) {
        let mut statistics = self.0.statistics.lock();
        let slot = statistics.slots.entry((run.to_owned(), slot)).or_default();
        if step > slot.step || slot.first.is_none() {
            slot.replied(step);
        }
        let before = if step > slot.step { std::mem::take(&mut slot.spent) } else { spent };
        slot.step = step;
        slot.spent = spent;
        if step > 0 && spent != before {
            statistics.steps += 1;
            let after = time_parts(spent).into_iter().zip(time_parts(before));
            for (histogram, (after, before)) in statistics.parts.iter_mut().zip(after) {
                histogram.note(after.saturating_sub(before));
            }
        }
        self.0.busy.set(statistics.slots.len());
    }

    pub(crate) fn ended(&self, run: &str, slot: u32, reason: EndReason) {
        let mut statistics = self.0.statistics.lock();
        statistics.slots.remove(&(run.to_owned(), slot));
        *statistics.ends.entry(reason.as_str()).or_default() += 1;
        self.0.busy.set(statistics.slots.len());
    }

    pub(crate) fn opened(&self, run: &str, is_there: bool) {
        self.0.statistics.lock().sessions.insert(run.to_owned(), is_there);
    }

    pub(crate) fn closed(&self, run: &str) {
        self.0.statistics.lock().sessions.remove(run);
    }

    /// Returns a run's live state; `None` without a session.
    pub fn session(&self, run: &str) -> Option<SessionState> {
        let statistics = self.0.statistics.lock();
        let is_there = *statistics.sessions.get(run)?;
        let slots = statistics.slots.range((run.to_owned(), 0)..=(run.to_owned(), u32::MAX));
        Some(SessionState { is_there, slots: slots.map(slot_state).collect() })
    }

    /// Returns statistics since server start.
    pub fn snapshot(&self) -> Snapshot {
        let statistics = self.0.statistics.lock();
        let names = ["simulation", "encoding", "queue", "thinking"];
        Snapshot {
            slots: statistics.slots.iter().map(slot_state).collect(),
            steps: statistics.steps,
            parts: names.into_iter().zip(statistics.parts.iter().cloned()).collect(),
            ends: statistics.ends.clone(),
            notice: statistics.notice.clone(),
        }
    }

    /// Sets the announcement to agents; an empty text removes it.
    pub fn announce(&self, text: &str) {
        self.0.statistics.lock().notice = text.to_owned();
    }

    /// Returns the drain's reason or the announcement; empty without either.
    pub fn announcement(&self) -> String {
        self.draining().map_or_else(|| self.0.statistics.lock().notice.clone(), |drain| drain.reason)
    }

    /// Ends a run's session after a cancellation outside gRPC, which the caller must have stored.
    pub fn leave(&self, run: &str) {
        // If the session ended first, with the run's last episode, the run would count as completed.
        self.0.statistics.lock().cancelled.push(run.to_owned());
        self.0.cancelling.notify_one();
    }

    /// Waits for runs that were cancelled outside gRPC, and returns them.
    pub(crate) async fn cancelled_runs(&self) -> Vec<String> {
        loop {
            let cancelled = std::mem::take(&mut self.0.statistics.lock().cancelled);
            if !cancelled.is_empty() {
                return cancelled;
            }
            self.0.cancelling.notified().await;
        }
    }

    /// Begins a drain: no run and no episode begins, and open episodes have `patience` to end. The first call counts.
    pub fn drain(&self, reason: &str, patience: Duration) {
        let new = || Drain { reason: reason.to_owned(), until: Instant::now() + patience };
        self.0.drain.modify(|drain| {
            drain.get_or_insert_with(new);
        });
    }

    /// Returns the drain, if any.
    pub fn draining(&self) -> Option<Drain> {
        self.0.drain.read(Clone::clone)
    }

    /// Waits until a drain begins.
    pub async fn drain_begins(&self) -> Drain {
        self.0.drain.wait_for(Clone::clone).await
    }

    /// Waits until a drain has begun and no episode is open, or their time is up.
    pub async fn drained(&self) {
        let drain = self.drain_begins().await;
        if timeout_at(drain.until, self.0.busy.wait_until(|busy| *busy == 0)).await.is_err() {
            let episodes = self.0.busy.read(|busy| *busy);
            tracing::warn!(episodes, "the drain's time is up; open episodes are cut");
        }
    }

    /// Refuses new runs and episodes during a drain.
    pub fn check_open(&self) -> Result<(), Refusal> {
        let Some(Drain { reason, .. }) = self.draining() else { return Ok(()) };
        let message =
            format!("the server is about to stop ({reason}): no run and no episode begins; try again later");
        Err(Refusal::new(Reason::Draining, message).retry_after(RETRY_AFTER_S))
    }
}

fn time_parts(time: TimeSpent) -> [Duration; 4] {
    [time.simulation, time.encoding, time.queue, time.thinking]
}

fn slot_state(((run, slot), held): (&(String, u32), &SlotStatistics)) -> SlotState {
    SlotState {
        run: run.clone(),
        slot: *slot,
        step: held.step,
        last_step: held.last.and_then(|(_, took)| took),
        mean_step: held.mean_step(),
        at_unix_ms: held.at_unix_ms,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spent(simulation_ms: u64, thinking_ms: u64) -> TimeSpent {
        let ms = Duration::from_millis;
        TimeSpent { simulation: ms(simulation_ms), thinking: ms(thinking_ms), ..TimeSpent::default() }
    }

    #[test]
    fn steps_are_counted_by_duration() {
        let control = Control::default();
        control.stepped("run_a", 0, 0, spent(100, 0));
        control.stepped("run_a", 0, 1, spent(102, 700));
        control.stepped("run_a", 0, 1, spent(102, 700)); // repeated
        control.stepped("run_a", 0, 2, spent(104, 710));
        control.stepped("run_b", 1, 0, spent(0, 0));
        let seen = control.snapshot();
        assert_eq!(seen.steps, 2);
        let [(_, simulation), .., (_, thinking)] = &seen.parts[..] else { panic!("{:?}", seen.parts) };
        assert!((simulation.sum_s - 0.004).abs() < 1e-9, "the start is no step: {simulation:?}");
        assert!((thinking.sum_s - 0.71).abs() < 1e-9, "{thinking:?}");
        assert_eq!(simulation.counts[4], 2, "both took between 1 and 2.5 ms");
        assert_eq!((thinking.counts[6], thinking.counts[12]), (1, 1), "10 ms and 0.7 s: {thinking:?}");
        let slots: Vec<_> = seen.slots.iter().map(|slot| (slot.run.as_str(), slot.slot, slot.step)).collect();
        assert_eq!(slots, [("run_a", 0, 2), ("run_b", 1, 0)]);
        control.ended("run_a", 0, EndReason::Stopped);
        let seen = control.snapshot();
        assert_eq!((seen.slots.len(), seen.ends.get("stopped")), (1, Some(&1)));
    }

    #[tokio::test(start_paused = true)]
    async fn a_session_reports_connection_and_speed() {
        let control = Control::default();
        assert_eq!(control.session("run_a"), None);
        control.opened("run_a", false);
        assert_eq!(control.session("run_a"), Some(SessionState::default()));
        control.opened("run_a", true);
        for (step, ms) in [(7, 0), (8, 300), (8, 50), (9, 50)] {
            tokio::time::advance(Duration::from_millis(ms)).await;
            control.stepped("run_a", 2, step, spent(0, u64::from(step)));
        }
        control.stepped("run_b", 0, 0, spent(0, 0));
        let session = control.session("run_a").expect("it is open");
        let [slot] = &session.slots[..] else { panic!("{session:?}") };
        assert!(session.is_there && slot.at_unix_ms > 0);
        assert_eq!((slot.slot, slot.step), (2, 9));
        let ms = |time: Option<Duration>| time.map(|time| time.as_millis());
        assert_eq!(
            (ms(slot.last_step), ms(slot.mean_step)),
            (Some(100), Some(200)),
            "a repeated request is no step"
        );
        control.ended("run_a", 2, EndReason::Stopped);
        assert_eq!(control.session("run_a"), Some(SessionState { is_there: true, slots: vec![] }));
        control.closed("run_a");
        assert_eq!((control.session("run_a"), control.session("run_b")), (None, None));
    }

    #[tokio::test(start_paused = true)]
    async fn a_drain_waits_for_open_episodes_within_limit() {
        let control = Control::default();
        control.stepped("run_a", 0, 0, TimeSpent::default());
        assert_eq!(control.check_open(), Ok(()));
        control.drain("new disks", Duration::from_secs(60));
        let refused = control.check_open().unwrap_err();
        assert_eq!(refused.reason, Reason::Draining);
        assert!(refused.message.contains("new disks"), "{refused}");
        let begun = Instant::now();
        control.drained().await;
        assert_eq!(begun.elapsed(), Duration::from_secs(60));
        control.ended("run_a", 0, EndReason::Stopped);
        control.drained().await;
        assert_eq!(begun.elapsed(), Duration::from_secs(60), "no episode is open");
        assert_eq!(control.announcement(), "new disks");
    }

    #[test]
    fn empty_announcement_removes_announcement() {
        let control = Control::default();
        control.announce("maintenance on Sunday");
        assert_eq!(control.announcement(), "maintenance on Sunday");
        control.announce("");
        assert_eq!(control.announcement(), "");
    }
}
