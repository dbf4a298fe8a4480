//! Session: the slots of a run, as tasks, and the shared state. It outlives the connection for a limited time.

use crate::{
    attachment::StopReason,
    control::Control,
    host::{Host, HostedEpisode, Interrupted, Restored},
    limits::Limits,
    outbound::Outbound,
    refusal::{Failure, Refusal, Result},
    shared::Shared,
    sim_pool::{SimClient, SimPool},
    spans::SessionSpan,
};
use avln_episode::{EndReason, Sensors, TimeLimits};
use avln_proto::v1::{self, Reason, RunProgress};
use parking_lot::Mutex;
use playing::Audience;
use slot::{Slot, SlotCommand};
use std::{
    sync::{
        Arc,
        atomic::{AtomicU32, Ordering},
    },
    time::Duration,
};
use tokio::{
    sync::{mpsc, oneshot},
    task::JoinHandle,
    time::Instant,
};
use tracing::{Instrument, Span};

mod delivery;
mod playing;
mod slot;

pub(crate) use delivery::stored_end;
pub(crate) use playing::{SlotReply, SlotRequest};

/// Frames that may wait per slot: an action, and another sent too early.
const WAITING_FRAMES: usize = 2;

type Hosted<H> = HostedEpisode<<H as Host>::Episode>;

/// State shared by all slots.
pub(crate) struct SessionContext<H> {
    host: Arc<H>,
    simulator: SimClient,
    sensors: Sensors,
    run: String,
    frame_bytes: u64,
    time: TimeLimits,
    progress: ProgressTracker,
    span: SessionSpan,
}

/// The ending of all slots of a session, once it has begun.
type SessionEnding = Shared<Option<SlotEnding>>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SlotEnding {
    /// Open episodes end for this reason and are stored.
    Close(EndReason),
    /// Open episodes remain in the run log for the next server.
    Keep,
}

/// A run in progress. If dropped without [`Session::close`], open episodes remain in the run log.
pub(crate) struct Session<H> {
    state: Arc<SessionContext<H>>,
    slots: Vec<mpsc::Sender<SlotCommand>>,
    /// Slots granted to the present connection.
    granted: AtomicU32,
    tasks: Mutex<Vec<JoinHandle<()>>>,
    ending: Arc<SessionEnding>,
    absence: Mutex<Absence>,
}

/// Time without a client.
#[derive(Debug)]
struct Absence {
    since: Option<Instant>,
    /// Used disconnect time.
    used: Duration,
}

impl<H: Host> Session<H> {
    /// Opens the slots of a run, without a client. `run` is the run's span.
    pub(crate) fn open(
        host: Arc<H>,
        pool: SimPool,
        limits: &Limits,
        interrupted: Interrupted<H::Episode>,
        run: &Span,
    ) -> Self {
        let Interrupted { open, sensors, episodes, away } = interrupted;
        let state = Arc::new(SessionContext {
            frame_bytes: Limits::frame_bytes(&sensors, open.rules.audio_samples),
            sensors,
            run: open.run.clone(),
            time: open.time,
            simulator: SimClient::new(pool, &open, limits),
            progress: ProgressTracker::new(open.episodes, open.done, limits.timeouts_in_a_row),
            span: SessionSpan::begin(run),
            host,
        });
        let ending = Arc::<SessionEnding>::default();
        let held = episodes.iter().map(|held| held.slot.saturating_add(1)).max().unwrap_or(0);
        let count = open.slot_limit().max(held).min(Limits::MAX_SLOTS);
        let mut episodes: Vec<_> = episodes.into_iter().map(Some).collect();
        let mut slots = Vec::new();
        let mut tasks = Vec::new();
        for id in 0..count {
            let held = |episode: &&mut Option<Restored<H::Episode>>| {
                episode.as_ref().is_some_and(|held| held.slot == id)
            };
            let restored = episodes.iter_mut().find(held).and_then(Option::take);
            let (sender, commands) = mpsc::channel(WAITING_FRAMES);
            let slot = Slot::new(id, state.clone(), restored);
            tasks.push(tokio::spawn(slot.run(commands, ending.clone()).instrument(state.span.span())));
            slots.push(sender);
        }
        let session = Self {
            state,
            slots,
            granted: AtomicU32::new(count),
            tasks: Mutex::new(tasks),
            ending,
            absence: Mutex::new(Absence { since: None, used: away }),
        };
        session.report(|control, run| control.opened(run, false));
        session
    }

    pub(crate) fn slot_count(&self) -> u32 {
        self.slots.len() as u32
    }

    /// Returns the session's span, to enter it.
    pub(crate) fn span(&self) -> Span {
        self.state.span.span()
    }

    fn report(&self, change: impl FnOnce(&Control, &str)) {
        if let Some(control) = self.state.host.control() {
            change(control, &self.state.run);
        }
    }

    pub(crate) fn progress(&self) -> v1::RunProgress {
        self.state.progress.progress()
    }

    /// Refuses sensors other than those of the run's first Hello.
    pub(crate) fn check_sensors(&self, wanted: &Sensors) -> Result<(), Refusal> {
        if self.state.sensors == *wanted {
            return Ok(());
        }
        let message = format!(
            "the first Hello of the run fixed its sensors to {}; request the same ones instead of {wanted}",
            self.state.sensors
        );
        Err(Refusal::new(Reason::SensorNotAllowed, message))
    }

    /// Sends a request to a slot, which replies on the stream.
    pub(crate) fn send(&self, slot: u32, request: SlotRequest) -> Result<()> {
        // Without waiting: the reader of a stream must never block on a busy slot.
        self.sender(slot)?.try_send(SlotCommand::Handle(request, None)).map_err(|_| {
            let message =
                format!("slot {slot} has {WAITING_FRAMES} frames waiting; send one per observation");
            Failure::new(Reason::BadRequest, message)
        })
    }

    /// Sends a request to a slot and waits for the reply.
    pub(crate) async fn call(&self, slot: u32, request: SlotRequest) -> Result<SlotReply> {
        let (reply, answer) = oneshot::channel();
        let sent = self.sender(slot)?.send(SlotCommand::Handle(request, Some(reply))).await;
        match (sent, answer.await) {
            (Ok(()), Ok(answer)) => answer,
            _ => Err(Failure::new(Reason::EpisodeOver, "the session ended meanwhile; call Reset again")),
        }
    }

    fn sender(&self, slot: u32) -> Result<&mpsc::Sender<SlotCommand>> {
        let granted = self.granted.load(Ordering::Relaxed);
        let known = (slot < granted).then(|| self.slots.get(slot as usize)).flatten();
        known.ok_or_else(|| {
            let message = format!("slot {slot} does not exist; use 0 to {}", granted.saturating_sub(1));
            Failure::new(Reason::SlotUnknown, message)
        })
    }

    /// Returns the positions of open episodes, after all earlier requests.
    pub(crate) async fn positions(&self) -> Vec<v1::SlotPosition> {
        let mut positions = Vec::new();
        for slot in &self.slots {
            let (reply, position) = oneshot::channel();
            let sent = slot.send(SlotCommand::Position(reply)).await;
            if let (Ok(()), Ok(Some(position))) = (sent, position.await) {
                positions.push(position);
            }
        }
        positions
    }

    /// Attaches a stream and sends missed frames. `known` are the positions that the client received last.
    pub(crate) async fn attach_stream(&self, out: &Outbound, slots: u32, known: &[v1::SlotPosition]) {
        self.report(|control, run| control.opened(run, true));
        self.granted.store(slots, Ordering::Relaxed);
        let away = self.absence.lock().since.map(|since| since.elapsed()).unwrap_or_default();
        let mut restarted = false;
        for (id, slot) in (0..).zip(&self.slots) {
            let known = known.iter().find(|known| known.slot == id).cloned();
            restarted |= switch(slot, Audience::Stream(out.clone()), known, away).await;
        }
        let mut absence = self.absence.lock();
        absence.since = None;
        // Only an absence that restarted a clock gave the agent time to think, so only that is charged.
        absence.used += if restarted { away } else { Duration::ZERO };
    }

    pub(crate) async fn attach_unary(&self) {
        self.report(|control, run| control.opened(run, true));
        self.granted.store(1, Ordering::Relaxed);
        for slot in &self.slots {
            switch(slot, Audience::Callers, None, Duration::ZERO).await;
        }
        self.absence.lock().since = None;
    }

    /// Detaches the client. Returns the time in which it may come back.
    pub(crate) async fn detach(&self) -> Duration {
        self.report(|control, run| control.opened(run, false));
        for slot in &self.slots {
            switch(slot, Audience::Nobody, None, Duration::ZERO).await;
        }
        let single = Duration::from_secs(u64::from(self.state.time.disconnect_s));
        let total = Duration::from_secs(u64::from(self.state.time.disconnect_total_s));
        let mut absence = self.absence.lock();
        absence.since = Some(Instant::now());
        single.min(total.saturating_sub(absence.used))
    }

    /// Waits until no episode is left, or the agent let too many time out.
    pub(crate) async fn over(&self) -> StopReason {
        self.state.progress.over().await
    }

    /// Ends open episodes for `end` and waits until they are stored.
    pub(crate) async fn close(&self, end: EndReason, reason: StopReason) {
        self.end(SlotEnding::Close(end), reason).await;
    }

    /// Ends the session and leaves open episodes in the run log, after all earlier requests.
    pub(crate) async fn leave(&self) {
        self.end(SlotEnding::Keep, StopReason::Draining).await;
    }

    async fn end(&self, ending: SlotEnding, reason: StopReason) {
        self.ending.set(Some(ending));
        let tasks = std::mem::take(&mut *self.tasks.lock());
        for task in tasks {
            if let Err(broken) = task.await {
                Failure::server("end a slot", broken);
            }
        }
        self.report(Control::closed);
        self.state.span.end(reason.as_str());
    }
}

/// Changes a slot's audience. Returns whether the clock restarted.
async fn switch(
    slot: &mpsc::Sender<SlotCommand>,
    audience: Audience,
    known: Option<v1::SlotPosition>,
    away: Duration,
) -> bool {
    let (reply, restarted) = oneshot::channel();
    let sent = slot.send(SlotCommand::Switch { audience, known, away, reply }).await;
    sent.is_ok() && restarted.await.unwrap_or(false)
}

/// Event that lets a waiting slot request an episode.
#[derive(Clone, Copy, Debug)]
enum WaitingFor {
    /// More than `seen` episodes were returned to the host.
    Return { seen: u32 },
    /// More than `seen` episodes are over, and their memory is free.
    End { seen: u32 },
}

/// A run's progress, counted over all slots.
struct ProgressTracker {
    tally: Shared<Tally>,
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
    /// Episodes that are over, with the returned ones.
    ended: u32,
    /// Slots whose episode waits for the end of another.
    parked: u32,
    timeouts_in_a_row: u32,
}

impl ProgressTracker {
    fn new(total: u32, done_before: u32, timeouts_allowed: u32) -> Self {
        Self { tally: Shared::default(), total, done_before, opened: Instant::now(), timeouts_allowed }
    }

    fn requested(&self) {
        self.tally.modify(|tally| tally.busy += 1);
    }

    fn returned_and_ended(&self) -> (u32, u32) {
        self.tally.read(|tally| (tally.returned, tally.ended))
    }

    async fn wait(&self, event: WaitingFor) {
        let has_happened = |tally: &Tally| match event {
            WaitingFor::Return { seen } => tally.returned > seen,
            WaitingFor::End { seen } => tally.ended > seen,
        };
        self.tally.wait_until(has_happened).await;
    }

    /// Counts a request that got no episode.
    fn refused(&self, is_dry: bool) {
        self.tally.modify(|tally| {
            tally.busy -= 1;
            tally.is_dry |= is_dry;
        });
    }

    /// Counts a request whose episode waits for the end of another.
    fn parked(&self) {
        self.tally.modify(|tally| {
            tally.busy -= 1;
            tally.is_dry = false;
            tally.parked += 1;
        });
    }

    /// Counts another request of a parked slot, after [`Self::requested`].
    fn unparked(&self) {
        self.tally.modify(|tally| tally.parked -= 1);
    }

    /// Counts an episode that began. Returns the number in the run, from 1.
    fn started(&self) -> u32 {
        self.tally.modify(|tally| tally.started += 1);
        self.done_before + self.tally.read(|tally| tally.started)
    }

    fn ended(&self, reason: EndReason) {
        self.tally.modify(|tally| {
            tally.busy -= 1;
            tally.ended += 1;
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

    fn progress(&self) -> RunProgress {
        let tally = self.tally.read(|tally| *tally);
        let done = (self.done_before + tally.done).min(self.total);
        let left = f64::from(self.total - done);
        let eta_s = (tally.done > 0)
            .then(|| self.opened.elapsed().as_secs_f64() * left / f64::from(tally.done))
            .map(|seconds| seconds.round() as u32);
        RunProgress { total: self.total, done, in_flight: tally.busy, eta_s }
    }

    async fn over(&self) -> StopReason {
        self.tally.wait_for(|tally| self.judge(tally)).await
    }

    fn judge(&self, tally: &Tally) -> Option<StopReason> {
        if tally.timeouts_in_a_row >= self.timeouts_allowed {
            return Some(StopReason::AgentHangs);
        }
        // Not before the last busy slot is done: a server fault there would return an episode that must be played.
        // Nor while an episode waits for memory: meanwhile the host may have had none for another slot.
        let is_over = tally.is_dry && tally.busy == 0 && tally.parked == 0;
        is_over.then_some(StopReason::NothingLeft)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[tokio::test(start_paused = true)]
    async fn runs_end_with_their_last_busy_slot() {
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
        let (seen, _) = tracker.returned_and_ended();
        tracker.requested();
        tracker.refused(true);
        tracker.ended(EndReason::ServerFault);
        tracker.wait(WaitingFor::Return { seen }).await;
        assert_eq!(tracker.tally.read(|tally| tracker.judge(tally)), None, "a slot must ask again first");
        assert_eq!(tracker.progress().done, 0);
    }

    #[tokio::test]
    async fn parked_episodes_wait_for_any_end() {
        let tracker = ProgressTracker::new(2, 0, 20);
        tracker.requested();
        tracker.requested();
        tracker.refused(true);
        let (_, seen) = tracker.returned_and_ended();
        tracker.requested();
        tracker.parked();
        let early = tokio::time::timeout(Duration::from_millis(20), tracker.wait(WaitingFor::End { seen }));
        assert!(early.await.is_err(), "the first slot still plays");
        tracker.ended(EndReason::Stopped);
        tracker.wait(WaitingFor::End { seen }).await;
        tracker.requested();
        tracker.refused(true);
        assert_eq!(tracker.tally.read(|tally| tracker.judge(tally)), None, "the parked episode is left");
        tracker.requested();
        tracker.unparked();
        tracker.ended(EndReason::Stopped);
        assert_eq!(tracker.over().await, StopReason::NothingLeft);
    }

    #[tokio::test]
    async fn only_consecutive_timeouts_count() {
        let tracker = ProgressTracker::new(9, 0, 2);
        for reason in [EndReason::TimeBudget, EndReason::Stopped, EndReason::TimeBudget] {
            tracker.requested();
            tracker.ended(reason);
        }
        assert_eq!(tracker.tally.read(|tally| tracker.judge(tally)), None);
        tracker.requested();
        tracker.ended(EndReason::TimeBudget);
        assert_eq!(tracker.over().await, StopReason::AgentHangs);
    }
}
