//! A run's connection: a task reads the stream, answers Pings, passes frames to slots, and reconnects.

use crate::calls::{Backoff, Greeting, greet};
use crate::error::Error;
use crate::summary::Notice;
use crate::welcome::Agreement;
use avln_proto::v1;
use avln_proto::v1::play_request::Frame as Sent;
use avln_proto::v1::play_response::Frame as Arrived;
use std::mem;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::{Instant, sleep};
use tonic::transport::Channel;
use tonic::{Status, Streaming};

const MAX_NOTICES: usize = 64;
// A slot has a single observation in flight, so a full queue indicates a server fault.
const SLOT_QUEUE: usize = 8;
// A restarting server has to load scenes before it answers.
const MIN_RECONNECTION_TIME: Duration = Duration::from_secs(180);

#[derive(Debug)]
pub(crate) enum Event {
    Start(Box<v1::EpisodeStart>),
    Observation(Box<v1::Observation>),
    End(v1::EpisodeEnd),
    Fault(v1::Fault),
    RunEnd(v1::RunEnd),
    /// The end of the stream, and the last event.
    Closed(Option<Error>),
}

/// The connection shared by a run's slots. It closes without a Goodbye after the last drop.
#[derive(Debug)]
pub(crate) struct Connection {
    pub(crate) agreement: Agreement,
    state: Arc<Mutex<State>>,
    reader: JoinHandle<()>,
}

#[derive(Debug)]
struct State {
    requests: mpsc::Sender<v1::PlayRequest>,
    buffer: ResendBuffer,
    notices: Vec<Notice>,
}

#[derive(Debug)]
pub(crate) struct Reconnector {
    pub(crate) channel: Channel,
    pub(crate) patience: Option<Duration>,
    pub(crate) token: String,
    /// The first Hello.
    pub(crate) hello: v1::Hello,
}

impl Drop for Connection {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

impl Connection {
    /// Starts to read `responses`; returns a receiver per slot.
    pub(crate) fn open(
        agreement: Agreement,
        requests: mpsc::Sender<v1::PlayRequest>,
        responses: Streaming<v1::PlayResponse>,
        reconnector: Reconnector,
    ) -> (Arc<Self>, Vec<mpsc::Receiver<Event>>) {
        let (slots, receivers) = (0..agreement.slots).map(|_| mpsc::channel(SLOT_QUEUE)).unzip();
        let buffer = ResendBuffer::new(agreement.slots);
        let state = Arc::new(Mutex::new(State { requests, buffer, notices: Vec::new() }));
        // A disconnection limit of zero means that the server ends episodes at once.
        let wanted = reconnector.patience;
        let patience = (!agreement.may_be_away.is_zero())
            .then(|| wanted.unwrap_or_else(|| agreement.may_be_away.max(MIN_RECONNECTION_TIME)));
        let reader = Reader { state: state.clone(), slots, reconnector, patience };
        let reader = tokio::spawn(reader.run(responses));
        (Arc::new(Self { agreement, state, reader }), receivers)
    }

    /// Sends a frame, after a loss on the next stream.
    pub(crate) async fn send(&self, frame: Sent) {
        // Buffered before it is sent, and under the lock that a reconnection takes: a frame is then either in the
        // buffer and resent, or sent on the new stream. A final loss reaches the caller as `Event::Closed`.
        let requests = {
            let mut state = lock(&self.state);
            state.buffer.sending(&frame);
            state.requests.clone()
        };
        let _ = requests.send(v1::PlayRequest { frame: Some(frame) }).await;
    }

    pub(crate) fn take_notices(&self) -> Vec<Notice> {
        mem::take(&mut lock(&self.state).notices)
    }
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

struct Reader {
    state: Arc<Mutex<State>>,
    slots: Vec<mpsc::Sender<Event>>,
    reconnector: Reconnector,
    /// Longest reconnection; `None` disables it.
    patience: Option<Duration>,
}

impl Reader {
    async fn run(self, mut responses: Streaming<v1::PlayResponse>) {
        loop {
            let end = self.read(&mut responses).await;
            match self.reconnect(end).await {
                Ok(again) => responses = again,
                Err(end) => return self.to_all(|| Event::Closed(end.clone())).await,
            }
        }
    }

    /// Reads to the end of the stream; returns the status, `None` for success.
    async fn read(&self, responses: &mut Streaming<v1::PlayResponse>) -> Option<Status> {
        loop {
            match responses.message().await {
                Ok(Some(response)) => self.deliver(response).await,
                Ok(None) => return None,
                Err(status) => return Some(status),
            }
        }
    }

    /// Reconnects until the server answers or patience ends.
    async fn reconnect(&self, end: Option<Status>) -> Result<Streaming<v1::PlayResponse>, Option<Error>> {
        let end = end.map(|status| Error::from_status("play", &status));
        // A stream without RunEnd is lost even if it ends with success, for example by a proxy.
        let lost = end.as_ref().is_none_or(Error::is_passing) && !lock(&self.state).buffer.is_over;
        let Some(patience) = self.patience.filter(|_| lost) else { return Err(end) };
        let until = Instant::now() + patience;
        let mut backoff = Backoff::new();
        loop {
            match self.open_next().await {
                Ok(Some(responses)) => return Ok(responses),
                Ok(None) => return Err(end),
                Err(error) => {
                    let pause = backoff.after(&error);
                    if !error.is_passing() || Instant::now() + pause >= until {
                        return Err(Some(error));
                    }
                    sleep(pause).await;
                }
            }
        }
    }

    /// Opens the next stream and resends unanswered frames; `None` if the run has ended.
    async fn open_next(&self) -> Result<Option<Streaming<v1::PlayResponse>>, Error> {
        let known = lock(&self.state).buffer.known();
        let hello = v1::Hello { resume: true, known, ..self.reconnector.hello.clone() };
        match greet(&self.reconnector.channel, &self.reconnector.token, hello).await? {
            Greeting::RunEnd(ends, end) => {
                for end in ends {
                    self.to(end.slot, Event::End(end)).await;
                }
                self.to_all(|| Event::RunEnd(end.clone())).await;
                Ok(None)
            }
            Greeting::Welcome { requests, responses, welcome } => {
                // A concurrent `send` must not use the new stream before the buffer is read: the frame would be
                // sent twice, or behind a frame that the server expects first.
                let again = {
                    let mut state = lock(&self.state);
                    state.requests = requests.clone();
                    state.buffer.to_repeat(&welcome.resumed)
                };
                for frame in again {
                    let _ = requests.send(v1::PlayRequest { frame: Some(frame) }).await;
                }
                Ok(Some(responses))
            }
        }
    }

    async fn deliver(&self, response: v1::PlayResponse) {
        let Some(frame) = response.frame else { return };
        let (gone, is_new) = {
            let mut state = lock(&self.state);
            let gone = matches!(&frame, Arrived::Fault(fault) if state.buffer.is_gone(fault));
            (gone, state.buffer.arrived(&frame))
        };
        match frame {
            Arrived::EpisodeStart(start) => self.to(start.slot, Event::Start(Box::new(start))).await,
            Arrived::Observation(seen) if is_new => {
                self.to(seen.slot, Event::Observation(Box::new(seen))).await;
            }
            Arrived::EpisodeEnd(end) => self.to(end.slot, Event::End(end)).await,
            Arrived::Fault(fault) => self.deliver_fault(fault, gone).await,
            Arrived::RunEnd(end) => self.to_all(|| Event::RunEnd(end.clone())).await,
            Arrived::Ping(ping) => self.answer(&ping),
            Arrived::Notice(notice) => self.note(notice),
            // The server repeats the latest observation after a reconnection.
            Arrived::Welcome(_) | Arrived::Observation(_) => {}
        }
    }

    async fn deliver_fault(&self, fault: v1::Fault, gone: bool) {
        let passing = fault.reason() == v1::Reason::Draining && self.patience.is_some();
        match fault.slot {
            Some(slot) if gone => self.to(slot, Event::End(lost_episode_end(fault))).await,
            Some(slot) => self.to(slot, Event::Fault(fault)).await,
            // A draining server closes the stream afterwards, and the next stream continues the run.
            None if passing => {}
            None => self.to_all(|| Event::Fault(fault.clone())).await,
        }
    }

    async fn to(&self, slot: u32, event: Event) {
        if let Some(sender) = self.slots.get(slot as usize) {
            // Fails only for a dropped slot.
            let _ = sender.send(event).await;
        }
    }

    async fn to_all(&self, event: impl Fn() -> Event) {
        for sender in &self.slots {
            let _ = sender.send(event()).await;
        }
    }

    fn answer(&self, ping: &v1::Ping) {
        // Waiting for a full queue would block the reader, and a connection survives without a Pong.
        let frame = Sent::Pong(v1::Pong { nonce: ping.nonce });
        let _ = lock(&self.state).requests.try_send(v1::PlayRequest { frame: Some(frame) });
    }

    fn note(&self, notice: v1::Notice) {
        let notices = &mut lock(&self.state).notices;
        if notices.len() < MAX_NOTICES {
            notices.push(Notice { message: notice.message, effective_unix_ms: notice.effective_unix_ms });
        }
    }
}

fn lost_episode_end(fault: v1::Fault) -> v1::EpisodeEnd {
    // A restarted server could not restore the episode: it does not count, and the server reissues it.
    v1::EpisodeEnd {
        slot: fault.slot.unwrap_or_default(),
        episode: fault.episode,
        step: fault.step,
        reason: v1::EndReason::ServerFault.into(),
        ..v1::EpisodeEnd::default()
    }
}

/// A run's slots from the client's perspective.
#[derive(Debug, Default)]
pub(crate) struct ResendBuffer {
    slots: Vec<SlotBuffer>,
    goodbye_sent: bool,
    /// RunEnd was received.
    pub(crate) is_over: bool,
}

#[derive(Debug, Default)]
struct SlotBuffer {
    /// Open episode and last received step.
    received: Option<(String, u32)>,
    // The protocol permits one pending request per slot, so a single frame suffices.
    unanswered: Option<Sent>,
}

impl ResendBuffer {
    pub(crate) fn new(slots: u32) -> Self {
        Self { slots: (0..slots).map(|_| SlotBuffer::default()).collect(), ..Self::default() }
    }

    fn slot(&mut self, slot: u32) -> Option<&mut SlotBuffer> {
        self.slots.get_mut(usize::try_from(slot).ok()?)
    }

    pub(crate) fn sending(&mut self, frame: &Sent) {
        let slot = match frame {
            Sent::Ready(ready) => ready.slot,
            Sent::Act(act) => act.slot,
            Sent::Abandon(abandon) => abandon.slot,
            Sent::Goodbye(_) => {
                self.goodbye_sent = true;
                return;
            }
            // Specific to a stream.
            Sent::Hello(_) | Sent::Pong(_) => return,
        };
        if let Some(slot) = self.slot(slot) {
            slot.unanswered = Some(frame.clone());
        }
    }

    /// Records a received frame; returns false for a repeated observation.
    pub(crate) fn arrived(&mut self, frame: &Arrived) -> bool {
        match frame {
            Arrived::EpisodeStart(start) => {
                if let Some(slot) = self.slot(start.slot) {
                    let step = start.observation.as_ref().map_or(0, |seen| seen.step);
                    *slot = SlotBuffer { received: Some((start.episode.clone(), step)), unanswered: None };
                }
            }
            Arrived::Observation(seen) => {
                return self.slot(seen.slot).is_none_or(|slot| slot.observed(&seen.episode, seen.step));
            }
            Arrived::EpisodeEnd(end) => {
                if let Some(slot) = self.slot(end.slot).filter(|slot| slot.has_episode(&end.episode)) {
                    *slot = SlotBuffer::default();
                }
            }
            // The refused frame changed nothing on the server and must not be resent.
            Arrived::Fault(v1::Fault { slot: Some(slot), recoverable: true, .. }) => {
                if let Some(slot) = self.slot(*slot) {
                    slot.unanswered = None;
                }
            }
            Arrived::RunEnd(_) => self.is_over = true,
            _ => {}
        }
        true
    }

    /// Returns the last received steps for Hello.
    pub(crate) fn known(&self) -> Vec<v1::SlotPosition> {
        let position = |(slot, buffer): (u32, &SlotBuffer)| {
            let (episode, step) = buffer.received.clone()?;
            Some(v1::SlotPosition { slot, episode, step })
        };
        (0..).zip(&self.slots).filter_map(position).collect()
    }

    /// Returns the frames to resend, given the server's slot positions.
    pub(crate) fn to_repeat(&self, resumed: &[v1::SlotPosition]) -> Vec<Sent> {
        let again = |(slot, buffer): (u32, &SlotBuffer)| {
            let there = resumed.iter().find(|position| position.slot == slot);
            buffer.unanswered.clone().filter(|frame| match (frame, there) {
                // With a position the episode has begun, and the server resends EpisodeStart itself.
                (Sent::Ready(_), there) => there.is_none(),
                // At a later step the action was taken, and the observation is on the way.
                (Sent::Act(act), Some(there)) => act.episode == there.episode && act.step == there.step + 1,
                // Without a position the episode has ended, and EpisodeEnd is on the way.
                (_, there) => there.is_some(),
            })
        };
        let goodbye = self.goodbye_sent.then_some(Sent::Goodbye(v1::Goodbye { pause: false }));
        (0..).zip(&self.slots).filter_map(again).chain(goodbye).collect()
    }

    /// Returns true if `fault` reports a lost episode.
    pub(crate) fn is_gone(&self, fault: &v1::Fault) -> bool {
        let slot = fault.slot.and_then(|slot| self.slots.get(slot as usize));
        fault.reason() == v1::Reason::EpisodeUnknown
            && slot.is_some_and(|slot| slot.has_episode(&fault.episode))
    }
}

impl SlotBuffer {
    fn has_episode(&self, episode: &str) -> bool {
        self.received.as_ref().is_some_and(|(known, _)| known == episode)
    }

    fn observed(&mut self, episode: &str, step: u32) -> bool {
        let Some((_, last)) = self.received.as_mut().filter(|(known, _)| known == episode) else {
            return true;
        };
        if step <= *last {
            return false;
        }
        *last = step;
        self.unanswered = None;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn act(step: u32) -> Sent {
        Sent::Act(v1::Act { slot: 0, episode: "ep_a".into(), step, action: 1 })
    }

    fn seen(step: u32) -> Arrived {
        Arrived::Observation(v1::Observation { episode: "ep_a".into(), step, ..v1::Observation::default() })
    }

    fn at(step: u32) -> Vec<v1::SlotPosition> {
        vec![v1::SlotPosition { slot: 0, episode: "ep_a".into(), step }]
    }

    fn begun() -> ResendBuffer {
        let mut buffer = ResendBuffer::new(2);
        buffer.sending(&Sent::Ready(v1::Ready { slot: 0 }));
        buffer.arrived(&Arrived::EpisodeStart(v1::EpisodeStart {
            episode: "ep_a".into(),
            ..v1::EpisodeStart::default()
        }));
        buffer
    }

    #[test]
    fn only_untaken_actions_are_resent() {
        let mut buffer = begun();
        assert!(buffer.to_repeat(&at(0)).is_empty());
        buffer.sending(&act(1));
        assert_eq!(buffer.to_repeat(&at(0)), [act(1)]);
        assert!(buffer.to_repeat(&at(1)).is_empty(), "its result is on its way");
        assert!(buffer.to_repeat(&[]).is_empty(), "the episode is over, and its end on its way");
        assert!(buffer.arrived(&seen(1)));
        assert!(buffer.to_repeat(&at(1)).is_empty());
        assert_eq!(buffer.known(), at(1));
    }

    #[test]
    fn duplicates_and_new_frames_are_distinguished() {
        let mut buffer = begun();
        assert!(!buffer.arrived(&seen(0)));
        assert!(buffer.arrived(&seen(1)));
        assert!(!buffer.arrived(&seen(1)));
    }

    #[test]
    fn ready_is_resent_without_episode_start() {
        let ready = Sent::Ready(v1::Ready { slot: 1 });
        let mut buffer = begun();
        buffer.sending(&ready);
        assert_eq!(buffer.to_repeat(&at(0)), [ready]);
        let both = [at(0), vec![v1::SlotPosition { slot: 1, episode: "ep_b".into(), step: 0 }]].concat();
        assert!(buffer.to_repeat(&both).is_empty());
    }

    #[test]
    fn goodbye_is_said_again() {
        let mut buffer = begun();
        buffer.sending(&Sent::Goodbye(v1::Goodbye { pause: false }));
        assert_eq!(buffer.to_repeat(&at(0)), [Sent::Goodbye(v1::Goodbye { pause: false })]);
    }
}
