use crate::refusal::Failure;
use avln_proto::v1::{PlayResponse, play_response::Frame};
use std::{
    collections::VecDeque,
    pin::Pin,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    task::{Context, Poll},
    time::Duration,
};
use tokio::{
    sync::{mpsc, watch},
    time::{Instant, sleep_until, timeout},
};
use tokio_stream::Stream;
use tonic::Status;

type Item = Result<PlayResponse, Status>;

/// The frames on their way to one agent: a bounded queue that knows for how long its head has waited.
#[derive(Clone, Debug)]
pub(crate) struct Outbound {
    queue: mpsc::Sender<Item>,
    clock: Arc<Clock>,
    stall: Duration,
}

/// The end of the queue that the transport reads.
#[derive(Debug)]
pub(crate) struct Frames {
    queue: mpsc::Receiver<Item>,
    clock: Arc<Clock>,
}

/// The agent does not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gone;

#[derive(Debug, Default)]
struct Clock {
    waiting: Mutex<VecDeque<Waiting>>,
    /// What a small frame and its answer took at least on the wire; `None` before it was measured.
    wire: Mutex<Option<Duration>>,
    /// Set when nothing waits for the agent any more.
    cut: watch::Sender<bool>,
}

/// A frame in the queue.
#[derive(Debug)]
struct Waiting {
    since: Instant,
    left: watch::Sender<Option<Instant>>,
}

/// When a frame leaves the queue for the transport.
#[derive(Clone, Debug)]
pub(crate) struct Departure {
    left: watch::Receiver<Option<Instant>>,
    clock: Arc<Clock>,
}

impl Departure {
    /// When the frame left, if it has.
    pub(crate) fn at(&self) -> Option<Instant> {
        *self.left.borrow()
    }

    /// The time on the wire, there and back, that nobody is charged for.
    pub(crate) fn wire(&self) -> Duration {
        self.clock.wire().unwrap_or_default()
    }

    /// Waits until the frame has left. One whose stream is gone never leaves.
    pub(crate) async fn left(mut self) -> Instant {
        match self.left.wait_for(Option::is_some).await.map(|at| *at) {
            Ok(Some(at)) => at,
            _ => std::future::pending().await,
        }
    }
}

/// A queue for `frames` frames, none of which may wait for longer than `stall`.
pub(crate) fn outbound(frames: usize, stall: Duration) -> (Outbound, Frames) {
    let (sender, receiver) = mpsc::channel(frames.max(1));
    let clock = Arc::<Clock>::default();
    (Outbound { queue: sender, clock: clock.clone(), stall }, Frames { queue: receiver, clock })
}

impl Outbound {
    /// Queues a frame; waits while the queue is full, up to the stall limit.
    pub(crate) async fn send(&self, frame: Frame) -> Result<Departure, Gone> {
        self.put(Ok(PlayResponse { frame: Some(frame) })).await
    }

    /// Ends the stream with a status.
    pub(crate) async fn fail(&self, failure: Failure) {
        let _ = self.put(Err(failure.into())).await;
    }

    async fn put(&self, item: Item) -> Result<Departure, Gone> {
        let mut cut = self.clock.cut.subscribe();
        let place = tokio::select! {
            biased;
            place = timeout(self.stall, self.queue.reserve()) => place.map_err(|_| Gone)?.map_err(|_| Gone)?,
            _ = cut.wait_for(|cut| *cut) => return Err(Gone),
        };
        let now = Instant::now();
        let (left, departure) = watch::channel(None);
        let mut waiting = self.clock.waiting();
        waiting.push_back(Waiting { since: now, left });
        // Under the lock, so that frames leave in the order in which they wait.
        place.send(item);
        drop(waiting);
        Ok(Departure { left: departure, clock: self.clock.clone() })
    }

    /// From now on frames are queued only where there is room: nobody waits for this agent.
    pub(crate) fn cut(&self) {
        self.clock.cut.send_replace(true);
    }

    /// A small frame was answered after `took`. The shortest such time is what the wire takes.
    pub(crate) fn measured(&self, took: Duration) {
        let mut wire = self.clock.wire();
        *wire = Some(wire.map_or(took, |shortest| shortest.min(took)));
    }

    /// Waits until the agent has hung up or left a frame unread for too long.
    pub(crate) async fn gone(&self) {
        loop {
            let since = self.clock.waiting().front().map(|waiting| waiting.since);
            let check = since.unwrap_or_else(Instant::now) + self.stall;
            if since.is_some() && check <= Instant::now() {
                return;
            }
            tokio::select! {
                () = self.queue.closed() => return,
                () = sleep_until(check) => {}
            }
        }
    }
}

impl Clock {
    fn wire(&self) -> MutexGuard<'_, Option<Duration>> {
        self.wire.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn waiting(&self) -> MutexGuard<'_, VecDeque<Waiting>> {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stream for Frames {
    type Item = Item;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Item>> {
        let next = self.queue.poll_recv(context);
        if let Poll::Ready(Some(_)) = next
            && let Some(waiting) = self.clock.waiting().pop_front()
        {
            waiting.left.send_replace(Some(Instant::now()));
        }
        next
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_proto::v1::Ping;
    use tokio_stream::StreamExt;

    const STALL: Duration = Duration::from_secs(30);

    fn ping() -> Frame {
        Frame::Ping(Ping::default())
    }

    #[tokio::test(start_paused = true)]
    async fn a_frame_that_nobody_reads_means_gone() {
        let (out, _frames) = outbound(4, STALL);
        out.send(ping()).await.unwrap();
        let before = Instant::now();
        out.gone().await;
        assert_eq!(before.elapsed().as_secs(), 30);
    }

    #[tokio::test(start_paused = true)]
    async fn a_full_queue_gives_up_after_the_stall_limit() {
        let (out, _frames) = outbound(1, STALL);
        out.send(ping()).await.unwrap();
        assert!(out.send(ping()).await.is_err());
    }

    #[tokio::test(start_paused = true)]
    async fn a_cut_queue_takes_what_fits_and_waits_for_nothing() {
        let (out, _frames) = outbound(1, STALL);
        out.cut();
        let before = Instant::now();
        assert!(out.send(ping()).await.is_ok());
        assert!(out.send(ping()).await.is_err());
        assert_eq!(before.elapsed(), Duration::ZERO);
    }

    #[tokio::test(start_paused = true)]
    async fn a_reader_that_reads_stays_and_one_that_hangs_up_is_gone_at_once() {
        let (out, mut frames) = outbound(4, STALL);
        out.send(ping()).await.unwrap();
        assert!(frames.next().await.is_some());
        assert!(timeout(Duration::from_secs(600), out.gone()).await.is_err());
        drop(frames);
        let before = Instant::now();
        out.gone().await;
        assert_eq!(before.elapsed(), Duration::ZERO);
        assert!(out.send(ping()).await.is_err());
    }

    #[tokio::test(start_paused = true)]
    async fn a_frame_leaves_when_the_transport_takes_it() {
        let (out, mut frames) = outbound(4, STALL);
        let departure = out.send(ping()).await.unwrap();
        tokio::time::advance(Duration::from_secs(5)).await;
        assert_eq!(departure.at(), None);
        assert!(frames.next().await.is_some());
        assert_eq!(departure.clone().left().await, Instant::now());
        assert_eq!(departure.at(), Some(Instant::now()));
        let lost = out.send(ping()).await.unwrap();
        drop((out, frames));
        assert!(timeout(STALL, lost.left()).await.is_err(), "it never leaves");
    }
}
