//! Agents: streams, and unary calls, of a run token; a run as its agent knows it, where every frame must agree with those before.

use super::{
    server::{AT_ONCE, Life, authorised},
    setting::SLOTS,
};
use avln_proto::v1::{
    self, EndReason, PlayRequest, PlayResponse, Reason, play_request::Frame as Up,
    play_response::Frame as Down,
};
use std::{
    collections::BTreeMap,
    pin::Pin,
    task::{Context, Poll, Waker},
    time::Duration,
};
use tokio::{sync::mpsc, time::timeout};
use tokio_stream::{Stream, wrappers::ReceiverStream};
use tonic::{Status, Streaming};

/// Frames of an agent that may wait for the server.
const WAITING_FRAMES: usize = 16;
/// Simulated time in which a server answers a frame.
const PATIENCE: Duration = Duration::from_secs(3);
/// Simulated time in which a server answers a stream without a Hello.
const HELLO: Duration = Duration::from_secs(12);

/// A program with a run token.
pub(crate) struct Agent {
    /// Index of the run.
    pub(crate) run: usize,
    pub(crate) token: String,
    /// Open streams, the newest last.
    pub(crate) streams: Vec<Connection>,
    /// Episode and step of unary calls.
    pub(crate) unary: Option<(String, u32)>,
    /// Attachment of the unary calls to the run.
    pub(crate) attachment: u32,
    /// True while a unary call waits for its answer.
    pub(crate) is_calling: bool,
    /// True after the end of the run.
    pub(crate) is_done: bool,
}

/// A Play stream.
pub(crate) struct Connection {
    up: Option<mpsc::Sender<PlayRequest>>,
    down: Streaming<PlayResponse>,
    /// Attachment to the run, and whether every frame was read at once.
    pub(crate) attachment: u32,
    pub(crate) is_prompt: bool,
    /// Granted slots; 0 before the welcome.
    pub(crate) slots: u32,
    /// Age at the Hello, at the welcome, or when the agent began to read again.
    greeted: Duration,
    /// Episode and step by slot.
    pub(crate) playing: BTreeMap<u32, (String, u32)>,
    /// Unanswered frames: slot, whether it is an action, and when it was sent.
    owed: BTreeMap<u32, (bool, Duration)>,
    /// Age until which the agent reads nothing.
    pub(crate) deaf_until: Duration,
}

/// Sensors of all agents: the pose.
pub(crate) fn sensors() -> v1::SensorSubscription {
    v1::SensorSubscription { wishes: vec![], width: 64, height: 64, hfov_rad: 1.5 }
}

impl Agent {
    pub(crate) fn new(run: usize, token: String) -> Self {
        Self { run, token, streams: vec![], unary: None, attachment: 0, is_calling: false, is_done: false }
    }

    /// Returns whether an episode waits for the agent's action.
    pub(crate) fn has_episode(&self) -> bool {
        match self.streams.last() {
            Some(stream) => !stream.playing.is_empty(),
            None => self.unary.is_some(),
        }
    }

    /// Loses everything that a crash of the server takes away.
    pub(crate) fn disconnect(&mut self) {
        self.streams.clear();
        self.is_calling = false;
    }

    /// Returns the positions that the agent reports when it resumes.
    pub(crate) fn known(facts: &RunFacts) -> Vec<v1::SlotPosition> {
        let open = facts.episodes.iter().filter(|(_, episode)| episode.end.is_none());
        let by_slot: BTreeMap<_, _> =
            open.map(|(name, episode)| (episode.slot, (name, episode.seen))).collect();
        let position = |(slot, (name, step)): (u32, (&String, u32))| v1::SlotPosition {
            slot,
            episode: name.clone(),
            step,
        };
        by_slot.into_iter().map(position).collect()
    }
}

impl Connection {
    /// Opens a stream. Returns `None` if the server has crashed.
    pub(crate) async fn open(
        life: &Life,
        token: &str,
        first: Option<v1::Hello>,
    ) -> Option<Result<Self, Status>> {
        let (up, queue) = mpsc::channel(WAITING_FRAMES);
        if let Some(hello) = first {
            let _ = up.try_send(PlayRequest { frame: Some(Up::Hello(hello)) });
        }
        let mut play = life.play();
        let opened = play.play(authorised(ReceiverStream::new(queue), token));
        let opened = timeout(AT_ONCE, opened).await.ok()?;
        Some(opened.map(|opened| Self {
            up: Some(up),
            down: opened.into_inner(),
            attachment: 0,
            is_prompt: true,
            slots: 0,
            greeted: life.age(),
            playing: BTreeMap::new(),
            owed: BTreeMap::new(),
            deaf_until: Duration::ZERO,
        }))
    }

    /// Sends a frame, if the server takes it.
    pub(crate) fn send(&mut self, frame: Up, age: Duration) {
        let owed = match &frame {
            Up::Ready(ready) => Some((ready.slot, false)),
            Up::Act(act) => Some((act.slot, true)),
            Up::Abandon(abandon) => Some((abandon.slot, true)),
            _ => None,
        };
        let sent = self.up.as_ref().is_some_and(|up| up.try_send(PlayRequest { frame: Some(frame) }).is_ok());
        if let Some((slot, is_act)) = owed.filter(|_| sent) {
            self.owed.entry(slot).or_insert((is_act, age));
        }
    }

    /// Closes the agent's direction.
    pub(crate) fn close_half(&mut self) {
        self.up = None;
    }

    pub(crate) fn is_half_closed(&self) -> bool {
        self.up.is_none()
    }

    /// Returns whether the agent reads. Its frames are owed from the moment when it reads again.
    pub(crate) fn reads(&mut self, age: Duration) -> bool {
        if self.deaf_until > age {
            return false;
        }
        if !std::mem::take(&mut self.deaf_until).is_zero() {
            self.greeted = age;
        }
        true
    }

    /// Returns the next frame that has arrived; `Some(None)` at the end of the stream.
    pub(crate) fn next(&mut self) -> Option<Option<Result<Down, Status>>> {
        loop {
            let mut now = Context::from_waker(Waker::noop());
            match Pin::new(&mut self.down).poll_next(&mut now) {
                Poll::Pending => return None,
                Poll::Ready(None) => return Some(None),
                Poll::Ready(Some(Ok(PlayResponse { frame: Some(frame) }))) => return Some(Some(Ok(frame))),
                Poll::Ready(Some(Ok(PlayResponse { frame: None }))) => {}
                Poll::Ready(Some(Err(status))) => return Some(Some(Err(status))),
            }
        }
    }

    /// Follows a frame from the server.
    pub(crate) fn follow(&mut self, frame: &Down, age: Duration) {
        if !self.is_prompt && !matches!(frame, Down::Ping(_)) {
            // An agent that did not read for a while receives the waiting frames first.
            self.greeted = age;
        }
        match frame {
            Down::Welcome(welcome) => {
                (self.slots, self.greeted) = (welcome.slots, age);
                let place = |at: &v1::SlotPosition| (at.slot, (at.episode.clone(), at.step));
                self.playing = welcome.resumed.iter().map(place).collect();
            }
            Down::EpisodeStart(start) => {
                let step = start.observation.as_ref().map_or(0, |seen| seen.step);
                self.playing.insert(start.slot, (start.episode.clone(), step));
                self.owed.remove(&start.slot);
            }
            Down::Observation(seen) => {
                self.playing.insert(seen.slot, (seen.episode.clone(), seen.step));
                self.owed.remove(&seen.slot);
            }
            Down::EpisodeEnd(end) => {
                self.playing.remove(&end.slot);
                self.owed.remove(&end.slot);
            }
            Down::Fault(fault) => {
                if let Some(slot) = fault.slot {
                    self.owed.remove(&slot);
                }
            }
            Down::Notice(_) | Down::Ping(_) | Down::RunEnd(_) => {}
        }
    }

    /// Fails if a frame has no answer for too long. A slot may wait for an episode as long as another one plays.
    pub(crate) fn check_answers(&self, age: Duration) -> Result<(), String> {
        if self.slots == 0 {
            let is_late = age.saturating_sub(self.greeted) > HELLO;
            return if is_late { Err(format!("no Welcome since {:?}", self.greeted)) } else { Ok(()) };
        }
        for (slot, (is_act, since)) in &self.owed {
            let may_wait = !is_act && !self.playing.is_empty();
            let is_late = age.saturating_sub((*since).max(self.greeted)) > PATIENCE;
            if is_late && !may_wait {
                return Err(format!("slot {slot} has no answer since {since:?}, {:?} play", self.playing));
            }
        }
        Ok(())
    }
}

/// Returns a status's reason.
pub(crate) fn reason(status: &Status) -> Option<Reason> {
    Reason::from_word(status.metadata().get(avln_proto::REASON_KEY)?.to_str().ok()?)
}

/// An observation's content.
type Sight = ([u32; 4], [u32; 2], i32, bool, bool);

/// An episode, by the frames about it.
#[derive(Debug, Default)]
pub(crate) struct EpisodeFacts {
    pub(crate) slot: u32,
    /// Last step that the agent observed.
    pub(crate) seen: u32,
    /// Last step that the agent requested.
    pub(crate) sent: u32,
    /// Reason of the last observation, if it ended the episode.
    last: Option<EndReason>,
    observations: BTreeMap<u32, Sight>,
    pub(crate) end: Option<v1::EpisodeEnd>,
}

/// A run, by the answers about it.
#[derive(Debug)]
pub(crate) struct RunFacts {
    pub(crate) id: String,
    pub(crate) team: usize,
    pub(crate) phase: usize,
    pub(crate) request_id: String,
    /// Uptime of the servers at the start.
    pub(crate) started: Duration,
    /// Number of streams and of unary clients that have connected. Earlier ones may read old frames.
    pub(crate) attachments: u32,
    pub(crate) episodes: BTreeMap<String, EpisodeFacts>,
    /// True if the server reported that every episode was played.
    pub(crate) is_complete: bool,
}

pub(crate) type Checked = Result<(), String>;

pub(crate) fn check(holds: bool, violation: impl FnOnce() -> String) -> Checked {
    if holds { Ok(()) } else { Err(violation()) }
}

impl EpisodeFacts {
    /// Returns whether the server announced a result.
    pub(crate) fn has_result(&self) -> bool {
        self.end.as_ref().is_some_and(|end| end.reason() != EndReason::ServerFault)
    }

    /// Takes the position of a resumed episode.
    fn resume(&mut self, at: &v1::SlotPosition) -> Checked {
        check(!self.has_result(), || format!("{at:?} goes on after its end: {:?}", self.end))?;
        check(at.step >= self.seen, || format!("{at:?} lost steps: the agent saw step {}", self.seen))?;
        check(at.step <= self.sent, || format!("{at:?} is ahead of the last action, {}", self.sent))
    }

    fn observe(&mut self, seen: &v1::Observation) -> Checked {
        let step = seen.step;
        check(step <= self.sent, || format!("step {step} without an action: {seen:?}"))?;
        let pose = seen.pose.unwrap_or_default();
        let sight = (
            [pose.x_m, pose.y_m, pose.z_m, pose.heading_rad].map(f32::to_bits),
            [seen.remaining_steps, seen.remaining_submits],
            seen.feedback,
            seen.terminated,
            seen.truncated,
        );
        let before = *self.observations.entry(step).or_insert(sight);
        // A lost step may be repeated only before its observation was sent.
        check(before == sight, || format!("step {step} was {before:?} and is now {seen:?}"))?;
        self.seen = self.seen.max(step);
        if seen.terminated || seen.truncated {
            self.last = Some(seen.reason());
        }
        Ok(())
    }

    fn finish(&mut self, end: &v1::EpisodeEnd) -> Checked {
        let is_fault = end.reason() == EndReason::ServerFault;
        if let Some(before) = &self.end {
            let is_same = (before.reason, before.step) == (end.reason, end.step)
                && (before.metrics == end.metrics || before.metrics.is_none() || end.metrics.is_none());
            // A lost attempt has no steps when a client asks for it later.
            let is_same = is_same || is_fault && before.reason == end.reason;
            return check(is_same, || format!("the end was {before:?} and is now {end:?}"));
        }
        if !is_fault {
            let steps = self.seen..=self.sent;
            check(steps.contains(&end.step), || format!("{end:?} but {steps:?} steps were seen and sent"))?;
            check(self.last.is_none_or(|last| last == end.reason()), || {
                format!("{end:?} after an observation with {:?}", self.last)
            })?;
        }
        self.end = Some(end.clone());
        Ok(())
    }
}

impl RunFacts {
    pub(crate) fn new(
        id: String,
        (team, phase): (usize, usize),
        request_id: String,
        started: Duration,
    ) -> Self {
        let episodes = BTreeMap::new();
        Self { id, team, phase, request_id, started, attachments: 0, episodes, is_complete: false }
    }

    pub(crate) fn episode(&mut self, handle: &str) -> &mut EpisodeFacts {
        self.episodes.entry(handle.to_owned()).or_default()
    }

    /// Takes a frame. Fails if it contradicts the frames before. Frames that are not `fresh` may be older than others.
    pub(crate) fn take(&mut self, frame: &Down, fresh: bool) -> Checked {
        match frame {
            Down::Welcome(welcome) if fresh => self.take_welcome(welcome),
            Down::Welcome(_) => Ok(()),
            Down::EpisodeStart(start) => self.start(start, fresh),
            Down::Observation(seen) => self.episode(&seen.episode).observe(seen),
            Down::EpisodeEnd(end) => self.episode(&end.episode).finish(end),
            Down::RunEnd(end) => self.finish(end),
            Down::Fault(_) | Down::Notice(_) | Down::Ping(_) => Ok(()),
        }
    }

    pub(crate) fn take_welcome(&mut self, welcome: &v1::Welcome) -> Checked {
        check(welcome.run == self.id, || format!("welcome of another run: {welcome:?}"))?;
        check((1..=SLOTS).contains(&welcome.slots), || format!("{welcome:?}"))?;
        welcome.resumed.iter().try_for_each(|at| self.episode(&at.episode).resume(at))
    }

    pub(crate) fn start(&mut self, start: &v1::EpisodeStart, fresh: bool) -> Checked {
        let Some(seen) = &start.observation else { return Err(format!("nothing to see in {start:?}")) };
        let at = v1::SlotPosition { slot: start.slot, episode: start.episode.clone(), step: seen.step };
        let episode = self.episode(&start.episode);
        if fresh {
            episode.slot = start.slot;
            episode.resume(&at)?;
        }
        episode.observe(seen)
    }

    pub(crate) fn finish(&mut self, end: &v1::RunEnd) -> Checked {
        check(end.run == self.id, || format!("the end of another run: {end:?}"))?;
        check(!self.is_complete || end.complete, || format!("the run is no longer complete: {end:?}"))?;
        self.is_complete |= end.complete;
        Ok(())
    }
}
