//! One run that is being played: its slots, each a task of its own, and what they have in common.
//!
//! A session outlives its connection: while nobody listens, its slots keep what they have, for a while.

mod board;
mod clock;
mod ending;
mod listening;
mod playing;
mod simulate;
mod slot;

pub(crate) use board::Over;
pub(crate) use slot::{Answer, Audience, Order};

use crate::{
    control::Control,
    crew::Crew,
    host::{Host, OpenRun},
    limits::Limits,
    outbound::Outbound,
    refusal::{Failure, Refusal, ServerFault},
    seat::Restored,
};
use avln_episode::{EndReason, Sensors, TimeLimits};
use avln_proto::v1::{self, Reason};
use board::Board;
use simulate::Share;
use slot::{Command, Slot};
use std::{
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU32, Ordering},
    },
    time::Duration,
};
use tokio::{
    sync::{mpsc, oneshot, watch},
    task::JoinHandle,
    time::Instant,
};
use tracing::Instrument;

/// Frames that may wait for one slot: an action, and one sent too early.
const WAITING_FRAMES: usize = 2;

/// What all slots of a run share.
pub(crate) struct Shared {
    host: Arc<dyn Host>,
    share: Share,
    sensors: Sensors,
    run: String,
    frame_bytes: u64,
    time: TimeLimits,
    board: Board,
}

/// How the slots of a session end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Leave {
    /// Open episodes end for this reason and are stored.
    End(EndReason),
    /// Open episodes stay as they were written down, for the next server to go on with.
    AsItIs,
}

/// A run that is being played. When it is dropped without [`Session::close`], its episodes stay as they are.
pub(crate) struct Session {
    shared: Arc<Shared>,
    slots: Vec<mpsc::Sender<Command>>,
    /// Slots that the present connection was granted.
    granted: AtomicU32,
    tasks: Mutex<Vec<JoinHandle<()>>>,
    leave: watch::Sender<Option<Leave>>,
    absence: Mutex<Absence>,
}

/// For how long nobody listened.
#[derive(Debug)]
struct Absence {
    since: Option<Instant>,
    /// What lost connections took so far of the time that they may be away.
    used: Duration,
}

/// What a session is opened with.
pub(crate) struct Opening<'a> {
    pub(crate) host: Arc<dyn Host>,
    pub(crate) crew: Crew,
    pub(crate) limits: &'a Limits,
    pub(crate) open: &'a OpenRun,
    pub(crate) sensors: &'a Sensors,
    /// Episodes that are taken up again.
    pub(crate) episodes: Vec<Restored>,
    /// What earlier connections took of the time that they may be away.
    pub(crate) away: Duration,
}

impl Session {
    /// Opens the run's slots, with nobody listening.
    pub(crate) fn open(opening: Opening<'_>) -> Self {
        let Opening { host, crew, limits, open, sensors, episodes, away } = opening;
        let board = Board::new(open.episodes, open.done, limits.timeouts_in_a_row);
        let shared = Arc::new(Shared {
            frame_bytes: Limits::frame_bytes(sensors, open.rules.audio_samples),
            sensors: sensors.clone(),
            run: open.run.clone(),
            time: open.time,
            share: Share::new(crew, &open.team, limits),
            board,
            host,
        });
        let leave = watch::Sender::new(None);
        let count = open.max_slots.clamp(1, Limits::MAX_SLOTS);
        let mut episodes: Vec<_> = episodes.into_iter().map(Some).collect();
        let (mut senders, mut tasks) = (Vec::new(), Vec::new());
        for id in 0..count {
            let held = |episode: &&mut Option<Restored>| episode.as_ref().is_some_and(|held| held.slot == id);
            let restored = episodes.iter_mut().find(held).and_then(Option::take);
            let (sender, commands) = mpsc::channel(WAITING_FRAMES);
            let slot = Slot::new(id, shared.clone(), restored);
            let span = tracing::error_span!("slot", run = open.run, slot = id);
            tasks.push(tokio::spawn(slot.run(commands, leave.subscribe()).instrument(span)));
            senders.push(sender);
        }
        let absence = Mutex::new(Absence { since: None, used: away });
        let session = Self {
            shared,
            slots: senders,
            granted: AtomicU32::new(count),
            tasks: Mutex::new(tasks),
            leave,
            absence,
        };
        session.tell(|control, run| control.opened(run, false));
        session
    }

    /// Lets the operator see how the run is played.
    fn tell(&self, news: impl FnOnce(&Control, &str)) {
        if let Some(control) = self.shared.host.control() {
            news(control, &self.shared.run);
        }
    }

    /// How far the run is.
    pub(crate) fn progress(&self) -> v1::RunProgress {
        self.shared.board.progress()
    }

    /// The sensors of a run are those of its first Hello.
    pub(crate) fn check_sensors(&self, wanted: &Sensors) -> Result<(), Refusal> {
        if self.shared.sensors == *wanted {
            return Ok(());
        }
        let message = "the sensors of a run are fixed by its first Hello; ask for the same ones";
        Err(Refusal::new(Reason::SensorNotAllowed, message))
    }

    /// Hands an order to a slot, whose answer goes to the stream.
    pub(crate) fn order(&self, slot: u32, order: Order) -> Result<(), Failure> {
        self.sender(slot)?.try_send(Command::Obey(order, None)).map_err(|_| {
            let message =
                format!("slot {slot} has {WAITING_FRAMES} frames waiting; send one per observation");
            Failure::new(Reason::BadRequest, message)
        })
    }

    /// Hands an order to a slot and waits for its answer.
    pub(crate) async fn ask(&self, slot: u32, order: Order) -> Result<Answer, Failure> {
        let (reply, answer) = oneshot::channel();
        let sent = self.sender(slot)?.send(Command::Obey(order, Some(reply))).await;
        match (sent, answer.await) {
            (Ok(()), Ok(answer)) => answer,
            _ => Err(Failure::new(Reason::EpisodeOver, "the session ended meanwhile; Reset begins another")),
        }
    }

    fn sender(&self, slot: u32) -> Result<&mpsc::Sender<Command>, Failure> {
        let granted = self.granted.load(Ordering::Relaxed);
        let known = (slot < granted).then(|| self.slots.get(slot as usize)).flatten();
        known.ok_or_else(|| {
            let message = format!("slot {slot} does not exist; use 0 to {}", granted.saturating_sub(1));
            Failure::new(Reason::SlotUnknown, message)
        })
    }

    /// The slots that hold an episode, and the step of the last observation of each, once they are done with what they
    /// were asked before.
    pub(crate) async fn positions(&self) -> Vec<v1::SlotPosition> {
        let mut positions = Vec::new();
        for slot in &self.slots {
            let (reply, position) = oneshot::channel();
            let sent = slot.send(Command::Tell(reply)).await;
            if let (Ok(()), Ok(Some(position))) = (sent, position.await) {
                positions.push(position);
            }
        }
        positions
    }

    /// From now on this stream, of so many slots, listens: it is sent what it has missed. `known` is what its client
    /// says it received last.
    pub(crate) async fn attach(&self, out: &Outbound, slots: u32, known: &[v1::SlotPosition]) {
        self.tell(|control, run| control.opened(run, true));
        self.granted.store(slots, Ordering::Relaxed);
        let away = self.absence().since.map(|since| since.elapsed()).unwrap_or_default();
        let mut restarted = false;
        for (id, slot) in (0..).zip(&self.slots) {
            let known = known.iter().find(|known| known.slot == id).cloned();
            restarted |= switch(slot, Audience::Stream(out.clone()), known, away).await;
        }
        let mut absence = self.absence();
        absence.since = None;
        absence.used += if restarted { away } else { Duration::ZERO };
    }

    /// From now on unary calls, of one slot, are answered.
    pub(crate) async fn answer_calls(&self) {
        self.tell(|control, run| control.opened(run, true));
        self.granted.store(1, Ordering::Relaxed);
        for slot in &self.slots {
            switch(slot, Audience::Callers, None, Duration::ZERO).await;
        }
        self.absence().since = None;
    }

    /// From now on nobody listens; says for how long that may last.
    pub(crate) async fn detach(&self) -> Duration {
        self.tell(|control, run| control.opened(run, false));
        for slot in &self.slots {
            switch(slot, Audience::Nobody, None, Duration::ZERO).await;
        }
        let seconds = |s: u32| Duration::from_secs(u64::from(s));
        let time = self.shared.time;
        let mut absence = self.absence();
        absence.since = Some(Instant::now());
        seconds(time.disconnect_s).min(seconds(time.disconnect_total_s).saturating_sub(absence.used))
    }

    fn absence(&self) -> MutexGuard<'_, Absence> {
        self.absence.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until there is nothing left to play, or the agent let too many episodes time out.
    pub(crate) async fn over(&self) -> Over {
        self.shared.board.over().await
    }

    /// Ends open episodes for `reason`, stores them, and waits until that is done.
    pub(crate) async fn close(&self, reason: EndReason) {
        self.end(Leave::End(reason)).await;
    }

    /// Leaves open episodes as they were written down, once the slots are done with what they were asked before.
    pub(crate) async fn leave(&self) {
        self.end(Leave::AsItIs).await;
    }

    async fn end(&self, how: Leave) {
        self.leave.send_replace(Some(how));
        let tasks = std::mem::take(&mut *self.tasks.lock().unwrap_or_else(PoisonError::into_inner));
        for task in tasks {
            if let Err(broken) = task.await {
                ServerFault::log("put a slot away", broken);
            }
        }
        self.tell(Control::closed);
    }
}

impl std::fmt::Debug for Session {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Session").field("run", &self.shared.run).finish_non_exhaustive()
    }
}

/// Gives a slot another audience; says whether its clock started again.
async fn switch(
    slot: &mpsc::Sender<Command>,
    audience: Audience,
    known: Option<v1::SlotPosition>,
    away: Duration,
) -> bool {
    let (reply, restarted) = oneshot::channel();
    let sent = slot.send(Command::Switch { audience, known, away, reply }).await;
    sent.is_ok() && restarted.await.unwrap_or(false)
}
