//! One run that is being played: its slots, each a task of its own, and what they have in common.

mod board;
mod simulate;
mod slot;

pub(crate) use board::Over;
pub(crate) use slot::{Answer, Order};

use crate::{
    door::Terms,
    host::{Host, OpenRun},
    limits::Limits,
    outbound::Outbound,
    refusal::{Failure, ServerFault},
};
use avln_episode::{EndReason, Sensors};
use avln_proto::v1::Reason;
use board::Board;
use simulate::Crew;
use slot::{Command, Slot};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::{
    sync::{Semaphore, mpsc, oneshot, watch},
    task::JoinHandle,
};

/// Frames that may wait for one slot: an action, and one sent too early.
const WAITING_FRAMES: usize = 2;

/// What all slots of a run share.
pub(crate) struct Shared {
    host: Arc<dyn Host>,
    limits: Arc<Limits>,
    crew: Crew,
    sensors: Sensors,
    run: String,
    frame_bytes: u64,
    board: Board,
}

/// A run that is being played. When it is dropped without [`Session::close`], its episodes are server faults.
pub(crate) struct Session {
    shared: Arc<Shared>,
    slots: Vec<mpsc::Sender<Command>>,
    tasks: Mutex<Vec<JoinHandle<()>>>,
    leave: watch::Sender<Option<EndReason>>,
}

impl Session {
    /// Opens idle slots, as many as the terms grant. Without `out` they answer unary calls alone.
    pub(crate) fn open(
        host: Arc<dyn Host>,
        limits: Arc<Limits>,
        simulations: Arc<Semaphore>,
        open: &OpenRun,
        terms: &Terms,
        out: Option<&Outbound>,
    ) -> Self {
        let shared = Arc::new(Shared {
            frame_bytes: Limits::frame_bytes(&terms.sensors, open.rules.audio_samples),
            sensors: terms.sensors.clone(),
            board: Board::new(open.episodes, open.done, limits.timeouts_in_a_row),
            run: open.run.clone(),
            crew: Crew(simulations),
            host,
            limits,
        });
        let leave = watch::Sender::new(None);
        let mut senders = Vec::new();
        let mut tasks = Vec::new();
        for id in 0..terms.slots {
            let (sender, commands) = mpsc::channel(WAITING_FRAMES);
            let slot = Slot::new(id, shared.clone(), out.cloned());
            tasks.push(tokio::spawn(slot.run(commands, leave.subscribe())));
            senders.push(sender);
        }
        Self { shared, slots: senders, tasks: Mutex::new(tasks), leave }
    }

    /// How far the run is.
    pub(crate) fn progress(&self) -> avln_proto::v1::RunProgress {
        self.shared.board.progress()
    }

    /// Hands an order to a slot, whose answer goes to the stream.
    pub(crate) fn order(&self, slot: u32, order: Order) -> Result<(), Failure> {
        self.sender(slot)?.try_send(Command { order, reply: None }).map_err(|_| {
            let message =
                format!("slot {slot} has {WAITING_FRAMES} frames waiting; send one per observation");
            Failure::new(Reason::BadRequest, message)
        })
    }

    /// Hands an order to a slot and waits for its answer.
    pub(crate) async fn ask(&self, slot: u32, order: Order) -> Result<Answer, Failure> {
        let (reply, answer) = oneshot::channel();
        let sent = self.sender(slot)?.send(Command { order, reply: Some(reply) }).await;
        match (sent, answer.await) {
            (Ok(()), Ok(answer)) => answer,
            _ => Err(Failure::new(Reason::EpisodeOver, "the session ended meanwhile; Reset begins another")),
        }
    }

    fn sender(&self, slot: u32) -> Result<&mpsc::Sender<Command>, Failure> {
        let known = usize::try_from(slot).ok().and_then(|index| self.slots.get(index));
        known.ok_or_else(|| {
            let message =
                format!("slot {slot} does not exist; use 0 to {}", self.slots.len().saturating_sub(1));
            Failure::new(Reason::SlotUnknown, message)
        })
    }

    /// Waits until there is nothing left to play, or the agent let too many episodes time out.
    pub(crate) async fn over(&self) -> Over {
        self.shared.board.over().await
    }

    /// Ends open episodes for `reason`, stores them, and waits until that is done.
    pub(crate) async fn close(&self, reason: EndReason) {
        self.leave.send_replace(Some(reason));
        let tasks = std::mem::take(&mut *self.tasks.lock().unwrap_or_else(PoisonError::into_inner));
        for task in tasks {
            if let Err(broken) = task.await {
                ServerFault::log("put a slot away", broken);
            }
        }
    }
}
