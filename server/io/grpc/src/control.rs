//! The operator's hold on the door: what is being played, how long steps take, what is announced, and when to stop.

use crate::{refusal::Refusal, seat::TimeSpent, watchdog::Watchdog, wire};
use avln_episode::EndReason;
use avln_proto::v1::Reason;
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::Duration,
};
use tokio::{
    sync::{Notify, watch},
    time::{Instant, timeout_at},
};

/// Seconds that agents are told to wait for when the server is about to stop.
const COME_BACK_S: u32 = 60;

/// What the operator sees and says. Clones share it.
#[derive(Clone, Debug, Default)]
pub struct Control(Arc<Inner>);

#[derive(Debug, Default)]
struct Inner {
    book: Mutex<Book>,
    /// How many slots hold an episode.
    busy: watch::Sender<usize>,
    drain: watch::Sender<Option<Drain>>,
    /// Rung when there are more runs in the book that were left.
    leaving: Notify,
    watchdog: Watchdog,
}

#[derive(Debug, Default)]
struct Book {
    slots: BTreeMap<(String, u32), Held>,
    /// Runs that are open to be played, and whether somebody listens.
    sessions: BTreeMap<String, bool>,
    steps: u64,
    parts: [Histogram; 4],
    ends: BTreeMap<&'static str, u64>,
    notice: String,
    /// Runs that their teams left by another door, whose sessions are still to end.
    left: Vec<String>,
}

#[derive(Debug, Default)]
struct Held {
    step: u32,
    /// What the episode took until this step.
    spent: TimeSpent,
    /// The step at which it was seen first, and when that was.
    first: Option<(u32, Instant)>,
    /// When it was seen last, and how long the step before took, from answer to answer.
    last: Option<(Instant, Option<Duration>)>,
    /// The same moment by the clock.
    at_unix_ms: i64,
}

impl Held {
    /// Another step was answered, or an episode begins.
    fn mark(&mut self, step: u32) {
        let now = Instant::now();
        let took = self.last.map(|(before, _)| now.saturating_duration_since(before));
        self.first.get_or_insert((step, now));
        (self.last, self.at_unix_ms) = (Some((now, took)), wire::unix_ms());
    }

    /// What a step took in the mean, from answer to answer.
    fn mean_step(&self) -> Option<Duration> {
        let ((first, begun), (last, _)) = (self.first?, self.last?);
        last.saturating_duration_since(begun).checked_div(self.step.checked_sub(first)?)
    }
}

/// A server that is about to stop.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Drain {
    /// Why, for people.
    pub reason: String,
    /// When episodes that are still open are cut.
    pub until: Instant,
}

/// A slot that holds an episode.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlotState {
    /// Id of the run.
    pub run: String,
    /// The slot.
    pub slot: u32,
    /// Steps taken.
    pub step: u32,
    /// How long the last of them took, from answer to answer, the agent's thinking included.
    pub last_step: Option<Duration>,
    /// How long a step took in the mean.
    pub mean_step: Option<Duration>,
    /// When the last answer was given, milliseconds since 1970-01-01 UTC. The agent has the word since then.
    pub at_unix_ms: i64,
}

/// A run that is open to be played.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SessionState {
    /// Whether its agent is connected.
    pub is_there: bool,
    /// Its slots that hold an episode.
    pub slots: Vec<SlotState>,
}

/// What happened since the server started.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// Slots that hold an episode, by run and number.
    pub slots: Vec<SlotState>,
    /// Steps taken.
    pub steps: u64,
    /// How long each part of a step took, by name.
    pub parts: Vec<(&'static str, Histogram)>,
    /// Episodes by the word of their end reason.
    pub ends: BTreeMap<&'static str, u64>,
    /// What is announced; empty: nothing.
    pub notice: String,
}

/// How often something took how long.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Histogram {
    /// How many took no longer than [`Histogram::LIMITS_S`] and longer than the limit before; the last took longer.
    pub counts: [u64; Histogram::LIMITS_S.len() + 1],
    /// What all took together, seconds.
    pub sum_s: f64,
}

impl Histogram {
    /// Upper ends of the buckets, seconds.
    pub const LIMITS_S: [f64; 15] =
        [1e-4, 2.5e-4, 5e-4, 1e-3, 2.5e-3, 5e-3, 1e-2, 2.5e-2, 5e-2, 0.1, 0.25, 0.5, 1.0, 10.0, 60.0];

    fn note(&mut self, took: Duration) {
        let seconds = took.as_secs_f64();
        self.counts[Self::LIMITS_S.partition_point(|limit| *limit < seconds)] += 1;
        self.sum_s += seconds;
    }
}

impl Control {
    fn book(&self) -> MutexGuard<'_, Book> {
        self.0.book.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Who watches over work that may hang.
    pub fn watchdog(&self) -> &Watchdog {
        &self.0.watchdog
    }

    /// A slot has taken so many steps, which took `spent` in all; at step 0 its episode begins.
    pub(crate) fn stepped(&self, run: &str, slot: u32, step: u32, spent: TimeSpent) {
        let mut book = self.book();
        let held = book.slots.entry((run.to_owned(), slot)).or_default();
        if step > held.step || held.first.is_none() {
            held.mark(step);
        }
        let before = if step > held.step { std::mem::take(&mut held.spent) } else { spent };
        (held.step, held.spent) = (step, spent);
        if step > 0 && spent != before {
            book.steps += 1;
            let parts = |time: TimeSpent| [time.simulation, time.encoding, time.queue, time.thinking];
            for (histogram, (now, before)) in
                book.parts.iter_mut().zip(parts(spent).into_iter().zip(parts(before)))
            {
                histogram.note(now.saturating_sub(before));
            }
        }
        self.0.busy.send_replace(book.slots.len());
    }

    /// The episode of a slot is over.
    pub(crate) fn ended(&self, run: &str, slot: u32, reason: EndReason) {
        let mut book = self.book();
        book.slots.remove(&(run.to_owned(), slot));
        *book.ends.entry(reason.as_str()).or_default() += 1;
        self.0.busy.send_replace(book.slots.len());
    }

    /// A run is open to be played, and somebody listens or not.
    pub(crate) fn opened(&self, run: &str, is_there: bool) {
        self.book().sessions.insert(run.to_owned(), is_there);
    }

    /// Nobody plays a run any more.
    pub(crate) fn closed(&self, run: &str) {
        self.book().sessions.remove(run);
    }

    /// How a run is played; `None` while it is not open to be.
    pub fn session(&self, run: &str) -> Option<SessionState> {
        let book = self.book();
        let is_there = *book.sessions.get(run)?;
        let slots = book.slots.range((run.to_owned(), 0)..=(run.to_owned(), u32::MAX));
        Some(SessionState { is_there, slots: slots.map(slot_state).collect() })
    }

    /// What happened since the server started.
    pub fn snapshot(&self) -> Snapshot {
        let book = self.book();
        let names = ["simulation", "encoding", "queue", "thinking"];
        Snapshot {
            slots: book.slots.iter().map(slot_state).collect(),
            steps: book.steps,
            parts: names.into_iter().zip(book.parts.iter().cloned()).collect(),
            ends: book.ends.clone(),
            notice: book.notice.clone(),
        }
    }

    /// Announces something to agents; an empty text takes it back.
    pub fn announce(&self, text: &str) {
        self.book().notice = text.to_owned();
    }

    /// What is announced: why the server stops, where it does, else the notice; empty: nothing.
    pub fn announcement(&self) -> String {
        self.draining().map_or_else(|| self.book().notice.clone(), |drain| drain.reason)
    }

    /// The team left a run by another door than the agents': the session that plays it ends. The run is over by then, or one
    /// whose last episode ends with its session would be completed.
    pub fn leave(&self, run: &str) {
        self.book().left.push(run.to_owned());
        self.0.leaving.notify_one();
    }

    /// Waits until runs were left, and gives them out.
    pub(crate) async fn left(&self) -> Vec<String> {
        loop {
            let left = std::mem::take(&mut self.book().left);
            if !left.is_empty() {
                return left;
            }
            self.0.leaving.notified().await;
        }
    }

    /// From now on no run and no episode begins. Open episodes have `patience` to come to their end. The first call counts.
    pub fn drain(&self, reason: &str, patience: Duration) {
        self.0.drain.send_if_modified(|drain| {
            let first = drain.is_none();
            drain
                .get_or_insert_with(|| Drain { reason: reason.to_owned(), until: Instant::now() + patience });
            first
        });
    }

    /// Whether the server is about to stop, and why.
    pub fn draining(&self) -> Option<Drain> {
        self.0.drain.borrow().clone()
    }

    /// Waits until the server is about to stop.
    pub async fn drain_begins(&self) -> Drain {
        let mut drains = self.0.drain.subscribe();
        let begun = drains.wait_for(Option::is_some).await.ok().and_then(|drain| drain.clone());
        match begun {
            Some(drain) => drain,
            // The sender lives in self, so waiting cannot fail.
            None => std::future::pending().await,
        }
    }

    /// Waits until the server is about to stop and no episode is open any more, or their time is up.
    pub async fn drained(&self) {
        let drain = self.drain_begins().await;
        let mut busy = self.0.busy.subscribe();
        if timeout_at(drain.until, busy.wait_for(|busy| *busy == 0)).await.is_err() {
            tracing::warn!(episodes = *busy.borrow(), "the drain's time is up; open episodes are cut");
        }
    }

    /// Refuses what would begin while the server is about to stop.
    ///
    /// # Errors
    /// When it is.
    pub fn check_open(&self) -> Result<(), Refusal> {
        match self.draining() {
            None => Ok(()),
            Some(drain) => {
                let message = format!(
                    "the server is about to stop ({}); nothing new begins, come back later",
                    drain.reason
                );
                Err(Refusal::new(Reason::Draining, message).retry_after(COME_BACK_S))
            }
        }
    }
}

fn slot_state(((run, slot), held): (&(String, u32), &Held)) -> SlotState {
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
    fn steps_are_counted_by_what_each_took() {
        let control = Control::default();
        control.stepped("run_a", 0, 0, spent(100, 0));
        control.stepped("run_a", 0, 1, spent(102, 700));
        control.stepped("run_a", 0, 1, spent(102, 700)); // asked for again
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
    async fn a_session_tells_who_is_there_and_how_fast_its_slots_are() {
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
            "asked for again is no step"
        );
        control.ended("run_a", 2, EndReason::Stopped);
        assert_eq!(control.session("run_a"), Some(SessionState { is_there: true, slots: vec![] }));
        control.closed("run_a");
        assert_eq!((control.session("run_a"), control.session("run_b")), (None, None));
    }

    #[tokio::test(start_paused = true)]
    async fn a_drain_waits_for_open_episodes_and_for_no_longer_than_it_may() {
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
        assert_eq!(begun.elapsed(), Duration::from_secs(60), "nothing is open any more");
        assert_eq!(control.announcement(), "new disks");
    }

    #[test]
    fn an_announcement_is_taken_back_by_an_empty_one() {
        let control = Control::default();
        control.announce("maintenance on Sunday");
        assert_eq!(control.announcement(), "maintenance on Sunday");
        control.announce("");
        assert_eq!(control.announcement(), "");
    }
}
