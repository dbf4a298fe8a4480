//! Client trials: a run with one injected fault per episode, and the client's behaviour.

use crate::checks::{Check, Outcome};
use crate::scenario::{InjectedFault, Trial};
use avln_proto::v1;
use std::collections::{BTreeMap, BTreeSet};
use std::time::{SystemTime, UNIX_EPOCH};

/// Episode length without a Stop, steps.
pub(crate) const STEPS: u32 = 6;
pub(crate) const FAULT_STEP: u32 = 2;
/// Nonce sent by [`InjectedFault::NoticeAndPing`].
pub(crate) const NONCE: u64 = 41;
/// Most slots of a run.
pub(crate) const MAX_SLOTS: u32 = 2;

const TWO_SLOTS: &str = "two slots are resumed together";

/// Kind of calls in a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transport {
    Stream,
    Unary,
}

/// A unary call, compared with its repetition after a lost answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum UnaryCall {
    Reset { slot: u32 },
    Step(v1::Act),
    End,
}

/// The client's run from the server's perspective.
#[derive(Debug, Default)]
pub(crate) struct TrialRun {
    trials: &'static [Trial],
    /// Next trial to hand out.
    next: usize,
    /// Started episodes.
    started: u32,
    /// Ended episodes.
    pub(crate) ended: u32,
    pub(crate) open: BTreeMap<u32, OpenEpisode>,
    /// Dropped episodes, whose trials their slots start again.
    reissued: BTreeMap<u32, OpenEpisode>,
    /// Episodes that ended while the client was disconnected.
    pub(crate) cut: BTreeMap<u32, OpenEpisode>,
    /// Slots with an unanswered Ready.
    waiting: BTreeSet<u32>,
    /// Trials played to their end.
    done: BTreeSet<usize>,
    /// Trials cut by a fault of another slot.
    skipped: BTreeSet<usize>,
    violations: Vec<(usize, String)>,
    /// Resumptions with two slots in play.
    pairs_resumed: u32,
    /// Wrong positions in these resumptions.
    unpaired: Vec<String>,
    pub(crate) transport: Option<Transport>,
    /// The server closed the last stream.
    lost: bool,
    /// Unary call without an answer.
    pub(crate) lost_call: Option<UnaryCall>,
    greeted: bool,
    pub(crate) refuse: u32,
    /// Granted slots; 0 before the first Hello.
    pub(crate) slots: u32,
    pub(crate) sensors: v1::SensorSubscription,
    pub(crate) request: v1::StartRunRequest,
    /// End of the run, milliseconds since 1970 UTC; 0: not ended.
    pub(crate) ended_unix_ms: i64,
    /// The client has received the last frame of the run.
    pub(crate) is_done: bool,
    /// The client made a call afterwards.
    pub(crate) is_disturbed: bool,
}

#[derive(Clone, Debug, Default)]
pub(crate) struct OpenEpisode {
    pub(crate) slot: u32,
    trial: usize,
    pub(crate) handle: String,
    pub(crate) ordinal: u32,
    actions: Vec<i32>,
    /// Step of the last sent observation; `None` before EpisodeStart.
    pub(crate) sent_step: Option<u32>,
    pub(crate) over: Option<v1::EndReason>,
    fault_injected: bool,
    awaits_pong: bool,
    /// The client was told that the episode is lost.
    loss_reported: bool,
    /// An action crossed this report.
    is_crossed: bool,
}

impl OpenEpisode {
    pub(crate) fn step(&self) -> u32 {
        self.actions.len() as u32
    }
}

/// Returns the present time, milliseconds since 1970 UTC.
pub(crate) fn unix_ms() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as i64)
}

impl TrialRun {
    pub(crate) fn new(trials: &'static [Trial]) -> Self {
        Self { trials, ..Self::default() }
    }

    /// Returns the number of episodes.
    pub(crate) fn total(&self) -> u32 {
        self.trials.len() as u32
    }

    pub(crate) fn is_unary(&self) -> bool {
        self.transport == Some(Transport::Unary)
    }

    pub(crate) fn is_over(&self) -> bool {
        self.ended_unix_ms > 0
    }

    /// Returns true if no episode is left or in play.
    pub(crate) fn is_complete(&self) -> bool {
        let lists = [&self.open, &self.reissued, &self.cut];
        self.next >= self.trials.len() && lists.iter().all(|episodes| episodes.is_empty())
    }

    /// Returns the fault of the episode in `slot`.
    pub(crate) fn fault(&self, slot: u32) -> InjectedFault {
        self.open.get(&slot).map_or(InjectedFault::None, |open| self.fault_of(open.trial))
    }

    fn fault_of(&self, trial: usize) -> InjectedFault {
        let fault = self.trials.get(trial).map_or(InjectedFault::None, |(fault, _)| *fault);
        if self.is_unary() && fault.needs_stream() { InjectedFault::None } else { fault }
    }

    fn episode(&self, slot: u32) -> Option<&OpenEpisode> {
        [&self.open, &self.reissued, &self.cut].into_iter().find_map(|episodes| episodes.get(&slot))
    }

    /// Files a violation under the trial of `slot`, otherwise of the lowest playing slot.
    pub(crate) fn violation(&mut self, slot: Option<u32>, message: impl Into<String>) {
        let of_slot = slot.and_then(|slot| self.episode(slot));
        let trial = of_slot.or_else(|| self.open.values().next()).map(|open| open.trial);
        // A violation after the last episode would otherwise be missing from the results.
        let trial = trial.unwrap_or_else(|| self.next.min(self.trials.len().saturating_sub(1)));
        self.violations.push((trial, message.into()));
    }

    /// Selects slots and sensors. Tensors keep their shape during a run, so only the first Hello counts.
    pub(crate) fn agree(&mut self, hello: &v1::Hello) {
        if self.greeted {
            return;
        }
        let most = if self.is_unary() { 1 } else { MAX_SLOTS };
        self.slots = hello.slots.clamp(1, most);
        self.sensors = hello.sensors.clone().unwrap_or_default();
        self.greeted = true;
    }

    pub(crate) fn hello(&mut self, hello: &v1::Hello) {
        let lost = std::mem::take(&mut self.lost);
        match (lost, hello.resume) {
            (true, false) => self.violation(None, "the client reconnected without Hello.resume"),
            // Every stream in this run ends by an injected fault or by RunEnd.
            (false, false) if self.greeted => self.violation(None, "the client left an intact stream"),
            _ => {}
        }
        self.agree(hello);
        if hello.resume {
            self.compare_known(&hello.known);
        }
    }

    fn compare_known(&mut self, known: &[v1::SlotPosition]) {
        let mut wrong = Vec::new();
        let mut playing = 0;
        for slot in 0..self.slots {
            let expected = self.position(slot);
            playing += u32::from(expected.is_some());
            let known = known.iter().find(|known| known.slot == slot);
            let known = known.map(|known| (known.episode.clone(), known.step));
            if known == expected || known.is_none() && self.is_loss_reported(slot) {
                continue;
            }
            let message = format!("Hello.known of slot {slot}: expected {expected:?}, got {known:?}");
            self.violation(Some(slot), message.clone());
            wrong.push(message);
        }
        if playing > 1 {
            self.pairs_resumed += 1;
            self.unpaired.extend(wrong);
        }
    }

    /// Returns handle and step of the last frame that the client received in `slot`.
    fn position(&self, slot: u32) -> Option<(String, u32)> {
        let open = self.episode(slot)?;
        Some((open.handle.clone(), open.sent_step?))
    }

    fn is_loss_reported(&self, slot: u32) -> bool {
        self.reissued.get(&slot).is_some_and(|lost| lost.loss_reported)
    }

    /// Takes a Ready; returns the Fault's reason for an invalid one.
    pub(crate) fn ready(&mut self, slot: u32) -> Result<(), v1::Reason> {
        let (reason, problem) = match self.open.contains_key(&slot) {
            _ if slot >= self.slots => (v1::Reason::SlotUnknown, "the slot does not exist"),
            true => (v1::Reason::SlotBusy, "the slot is busy"),
            false => return Ok(()),
        };
        self.violation(Some(slot), format!("Ready for slot {slot}: {problem}"));
        Err(reason)
    }

    pub(crate) fn has_next(&self, slot: u32) -> bool {
        self.reissued.contains_key(&slot) || self.next < self.trials.len()
    }

    /// Records a Ready that is answered after the last slot has finished.
    pub(crate) fn wait(&mut self, slot: u32) {
        self.waiting.insert(slot);
    }

    pub(crate) fn has_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }

    pub(crate) fn begin(&mut self, slot: u32) {
        let dropped = self.reissued.remove(&slot);
        let trial = dropped.as_ref().map_or(self.next, |dropped| dropped.trial);
        self.next += usize::from(dropped.is_none());
        self.started += 1;
        let ordinal = self.started;
        let handle = format!("ep_{ordinal:032x}");
        // A reissued episode has had its fault.
        let fault_injected = dropped.is_some();
        let open = OpenEpisode { slot, trial, handle, ordinal, fault_injected, ..OpenEpisode::default() };
        self.open.insert(slot, open);
    }

    /// Returns true once, when the fault of the trial in `slot` is due at `step`.
    pub(crate) fn inject_at(&mut self, slot: u32, step: u32) -> bool {
        let open = self.open.get_mut(&slot);
        let Some(open) = open.filter(|open| !open.fault_injected && open.step() == step) else {
            return false;
        };
        open.fault_injected = true;
        true
    }

    /// Takes an action; returns the Fault's reason for an invalid one.
    pub(crate) fn act(&mut self, act: &v1::Act) -> Result<(), v1::Reason> {
        self.take_action(act).map_err(|(reason, message)| {
            self.violation(Some(act.slot), message);
            reason
        })
    }

    fn take_action(&mut self, act: &v1::Act) -> Result<(), (v1::Reason, String)> {
        let Some(open) = self.open.get_mut(&act.slot).filter(|open| open.handle == act.episode) else {
            let message = format!("episode '{}' is not open in slot {}", act.episode, act.slot);
            return Err((v1::Reason::EpisodeUnknown, message));
        };
        if !(1..=5).contains(&act.action) {
            let message = format!("action: expected 1 to 5, got {}", act.action);
            return Err((v1::Reason::ActionOutOfRange, message));
        }
        let latest = open.step();
        match open.actions.last() {
            Some(taken) if act.step == latest && *taken != act.action => {
                let message = format!("resent action of step {latest}: expected {taken}, got {}", act.action);
                Err((v1::Reason::StepConflict, message))
            }
            // After a lost stream the client cannot know if the server received the action, so it may resend it.
            Some(_) if act.step == latest => Ok(()),
            _ if act.step == latest + 1 && open.over.is_none() => {
                open.actions.push(act.action);
                if act.action == v1::Action::Stop as i32 {
                    open.over = Some(v1::EndReason::Stopped);
                } else if open.step() >= STEPS {
                    open.over = Some(v1::EndReason::StepLimit);
                }
                Ok(())
            }
            _ => Err((v1::Reason::StepAhead, format!("step: expected {}, got {}", latest + 1, act.step))),
        }
    }

    pub(crate) fn ping_sent(&mut self, slot: u32) {
        if let Some(open) = self.open.get_mut(&slot) {
            open.awaits_pong = true;
        }
    }

    pub(crate) fn pong(&mut self, nonce: u64) {
        let asked = self.open.values_mut().find(|open| open.awaits_pong && nonce == NONCE);
        if asked.map(|open| open.awaits_pong = false).is_none() {
            self.violation(None, format!("Pong {nonce} does not match a Ping"));
        }
    }

    pub(crate) fn observation_sent(&mut self, slot: u32) {
        if let Some(open) = self.open.get_mut(&slot) {
            open.sent_step = Some(open.step());
        }
    }

    pub(crate) fn lose_stream(&mut self) {
        self.lost = true;
        // The client repeats an unanswered Ready.
        self.waiting.clear();
        // A Pong that was on its way is lost with the stream.
        self.open.values_mut().for_each(|open| open.awaits_pong = false);
    }

    /// Drops an episode as a server does that cannot restore it.
    pub(crate) fn drop_episode(&mut self, slot: u32) {
        self.reissued.extend(self.open.remove(&slot).map(|open| (slot, open)));
    }

    /// Takes the report of a lost episode that the client has not received yet.
    pub(crate) fn report_loss(&mut self, slot: u32, handle: &str) -> bool {
        let lost = self.reissued.get_mut(&slot).filter(|lost| lost.handle == handle);
        lost.is_some_and(|lost| !std::mem::replace(&mut lost.loss_reported, true))
    }

    /// Returns true once, for an action that may have crossed the report of the lost episode.
    pub(crate) fn is_crossing(&mut self, act: &v1::Act) -> bool {
        let lost = self.reissued.get_mut(&act.slot).filter(|lost| lost.handle == act.episode);
        let next = lost.filter(|lost| lost.loss_reported && act.step == lost.step() + 1);
        next.is_some_and(|lost| !std::mem::replace(&mut lost.is_crossed, true))
    }

    /// Returns the dropped episodes among the `known` ones.
    pub(crate) fn dropped(&self, known: &[v1::SlotPosition]) -> Vec<OpenEpisode> {
        let is_known = |lost: &&OpenEpisode| {
            known.iter().any(|known| known.slot == lost.slot && known.episode == lost.handle)
        };
        self.reissued.values().filter(is_known).cloned().collect()
    }

    /// Ends the run and its open episodes while the client is disconnected. The fault belongs to `slot`.
    pub(crate) fn end_away(&mut self, slot: u32) {
        self.interrupt(slot);
        self.ended += self.open.len() as u32;
        self.cut = std::mem::take(&mut self.open);
        self.ended_unix_ms = unix_ms();
    }

    /// Leaves the run to another connection. The fault belongs to `slot`.
    pub(crate) fn supersede(&mut self, slot: u32) {
        self.interrupt(slot);
        self.open.clear();
        self.is_done = true;
    }

    fn interrupt(&mut self, slot: u32) {
        for open in self.open.values() {
            let trials = if open.slot == slot { &mut self.done } else { &mut self.skipped };
            trials.insert(open.trial);
        }
    }

    /// Ends the run.
    pub(crate) fn finish(&mut self) {
        if !self.is_over() {
            self.ended_unix_ms = unix_ms();
        }
        self.is_done = true;
    }

    /// Ends the episode in `slot`.
    pub(crate) fn close(&mut self, slot: u32) -> Option<OpenEpisode> {
        let open = self.open.remove(&slot)?;
        let fault = self.fault_of(open.trial);
        let mut file = |message: String| self.violations.push((open.trial, message));
        // Several observations follow the Ping, so a Pong still missing here was never sent.
        if open.awaits_pong {
            file(format!("the client did not answer Ping {NONCE}"));
        }
        // An agent that stops early would pass the trial without the fault.
        if fault.needs_steps() && !open.fault_injected {
            file(format!("the episode ended before the fault at step {FAULT_STEP}"));
        }
        self.done.insert(open.trial);
        self.ended += 1;
        Some(open)
    }

    /// Returns all trials' results. `late` describes a missing answer.
    pub(crate) fn checks(&self, late: Option<&str>) -> Vec<Check> {
        let check =
            |(number, (_, rule)): (usize, &Trial)| Check { rule, outcome: self.outcome(number, late) };
        self.trials.iter().enumerate().map(check).chain(self.two_slots()).collect()
    }

    fn outcome(&self, number: usize, late: Option<&str>) -> Outcome {
        let own = self.violations.iter().filter(|(trial, _)| *trial == number);
        let mut broken: Vec<_> = own.map(|(_, message)| message.as_str()).collect();
        let ended = self.done.contains(&number) || self.skipped.contains(&number);
        match late.filter(|_| self.is_current(number)) {
            Some(late) => broken.push(late),
            None if number >= self.next => broken.push("the client did not reach this episode"),
            None if !ended && broken.is_empty() => broken.push("the client did not finish this episode"),
            None => {}
        }
        let (fault, _) = self.trials[number];
        let is_unmet = self.skipped.contains(&number) || self.is_unary() && fault.needs_stream();
        match broken.as_slice() {
            [] if is_unmet => Outcome::NotOffered,
            [] => Outcome::Kept,
            broken => Outcome::Broken(broken.join("; ")),
        }
    }

    /// Returns true for a trial in play, or for the next one if none is.
    fn is_current(&self, number: usize) -> bool {
        let lists = [&self.open, &self.reissued, &self.cut];
        let mut playing = lists.into_iter().flat_map(BTreeMap::values).map(|open| open.trial).peekable();
        match playing.peek() {
            Some(_) => playing.any(|trial| trial == number),
            None => number == self.next.min(self.trials.len().saturating_sub(1)),
        }
    }

    fn two_slots(&self) -> Option<Check> {
        let can_resume = self.trials.iter().any(|(fault, _)| fault.needs_resume());
        let outcome = match self.unpaired.as_slice() {
            [] if self.pairs_resumed == 0 => Outcome::NotOffered,
            [] => Outcome::Kept,
            wrong => Outcome::Broken(wrong.join("; ")),
        };
        can_resume.then_some(Check { rule: TWO_SLOTS, outcome })
    }
}
