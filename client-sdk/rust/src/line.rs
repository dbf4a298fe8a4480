//! One stream: a task reads it, answers pings and hands each frame to its slot.

use crate::{Error, Notice, welcome::Agreement};
use avln_proto::v1::{self, play_request, play_response::Frame};
use std::{
    mem,
    sync::{Arc, Mutex, PoisonError},
};
use tokio::{sync::mpsc, task::JoinHandle};
use tonic::{Status, Streaming};

/// Notices that are kept until someone asks for them.
const MAX_NOTICES: usize = 64;

/// Frames that wait for a slot's reader. A slot has one observation in flight, so more is a server's fault.
const SLOT_QUEUE: usize = 8;

/// What happens to a slot.
#[derive(Debug)]
pub(crate) enum Event {
    Start(Box<v1::EpisodeStart>),
    Observation(Box<v1::Observation>),
    End(v1::EpisodeEnd),
    Fault(v1::Fault),
    RunEnd(v1::RunEnd),
    /// Nothing more will come: how the stream ended.
    Closed(Option<Status>),
}

/// The connection that the slots of a run share. Dropping the last of them closes it without a Goodbye.
#[derive(Debug)]
pub(crate) struct Line {
    pub(crate) agreement: Agreement,
    requests: mpsc::Sender<v1::PlayRequest>,
    notices: Notices,
    reader: JoinHandle<()>,
}

type Notices = Arc<Mutex<Vec<Notice>>>;

impl Drop for Line {
    fn drop(&mut self) {
        self.reader.abort();
    }
}

impl Line {
    /// Begins to read `responses`; returns one receiver a slot.
    pub(crate) fn open(
        agreement: Agreement,
        requests: mpsc::Sender<v1::PlayRequest>,
        responses: Streaming<v1::PlayResponse>,
    ) -> (Arc<Self>, Vec<mpsc::Receiver<Event>>) {
        let (slots, receivers) = (0..agreement.slots).map(|_| mpsc::channel(SLOT_QUEUE)).unzip();
        let notices = Notices::default();
        let reader = Reader { requests: requests.downgrade(), slots, notices: notices.clone() };
        let reader = tokio::spawn(reader.run(responses));
        (Arc::new(Self { agreement, requests, notices, reader }), receivers)
    }

    /// Sends a frame; a stream that is gone is told by the receiver's [`Event::Closed`].
    pub(crate) async fn send(&self, frame: play_request::Frame) {
        let _ = self.requests.send(v1::PlayRequest { frame: Some(frame) }).await;
    }

    /// Takes the notices that arrived since the last call.
    pub(crate) fn take_notices(&self) -> Vec<Notice> {
        mem::take(&mut *self.notices.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

struct Reader {
    requests: mpsc::WeakSender<v1::PlayRequest>,
    slots: Vec<mpsc::Sender<Event>>,
    notices: Notices,
}

impl Reader {
    async fn run(self, mut responses: Streaming<v1::PlayResponse>) {
        let end = loop {
            match responses.message().await {
                Ok(Some(response)) => self.deliver(response).await,
                Ok(None) => break None,
                Err(status) => break Some(status),
            }
        };
        self.to_all(|| Event::Closed(end.clone())).await;
    }

    async fn deliver(&self, response: v1::PlayResponse) {
        match response.frame {
            Some(Frame::EpisodeStart(start)) => self.to(start.slot, Event::Start(Box::new(start))).await,
            Some(Frame::Observation(seen)) => self.to(seen.slot, Event::Observation(Box::new(seen))).await,
            Some(Frame::EpisodeEnd(end)) => self.to(end.slot, Event::End(end)).await,
            Some(Frame::Fault(fault)) => match fault.slot {
                Some(slot) => self.to(slot, Event::Fault(fault)).await,
                None => self.to_all(|| Event::Fault(fault.clone())).await,
            },
            Some(Frame::RunEnd(end)) => self.to_all(|| Event::RunEnd(end.clone())).await,
            Some(Frame::Ping(ping)) => self.answer(&ping),
            Some(Frame::Notice(notice)) => self.note(notice),
            // A second Welcome changes nothing; frames of a newer minor version are skipped.
            Some(Frame::Welcome(_)) | None => {}
        }
    }

    async fn to(&self, slot: u32, event: Event) {
        if let Some(sender) = self.slots.get(slot as usize) {
            let _ = sender.send(event).await; // a slot that nobody reads any more misses nothing
        }
    }

    async fn to_all(&self, event: impl Fn() -> Event) {
        for sender in &self.slots {
            let _ = sender.send(event()).await;
        }
    }

    /// A Pong is never needed to stay connected: where the queue is full it is left out.
    fn answer(&self, ping: &v1::Ping) {
        let frame = play_request::Frame::Pong(v1::Pong { nonce: ping.nonce });
        if let Some(requests) = self.requests.upgrade() {
            let _ = requests.try_send(v1::PlayRequest { frame: Some(frame) });
        }
    }

    fn note(&self, notice: v1::Notice) {
        let mut notices = self.notices.lock().unwrap_or_else(PoisonError::into_inner);
        if notices.len() < MAX_NOTICES {
            notices.push(Notice { message: notice.message, effective_unix_ms: notice.effective_unix_ms });
        }
    }
}

/// How the end of a stream reads to the one who waited for something.
pub(crate) fn closed(attempted: &'static str, end: Option<Status>) -> Error {
    match end {
        Some(status) => Error::from_status(attempted, &status),
        None => Error::Lost { attempted, detail: "the server ended the stream without a reason".to_owned() },
    }
}
