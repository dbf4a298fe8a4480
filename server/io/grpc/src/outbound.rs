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

#[derive(Debug)]
struct Clock {
    times: Mutex<Times>,
    /// Set when nothing waits for the agent any more.
    cut: watch::Sender<bool>,
}

#[derive(Debug)]
struct Times {
    /// When each frame in the queue was put there.
    waiting: VecDeque<Instant>,
    last_sent: Instant,
}

/// A queue for `frames` frames, none of which may wait for longer than `stall`.
pub(crate) fn outbound(frames: usize, stall: Duration) -> (Outbound, Frames) {
    let (sender, receiver) = mpsc::channel(frames.max(1));
    let times = Times { waiting: VecDeque::new(), last_sent: Instant::now() };
    let clock = Arc::new(Clock { times: Mutex::new(times), cut: watch::Sender::default() });
    (Outbound { queue: sender, clock: clock.clone(), stall }, Frames { queue: receiver, clock })
}

impl Outbound {
    /// Queues a frame; waits while the queue is full, up to the stall limit.
    pub(crate) async fn send(&self, frame: Frame) -> Result<(), Gone> {
        self.put(Ok(PlayResponse { frame: Some(frame) })).await
    }

    /// Ends the stream with a status.
    pub(crate) async fn fail(&self, failure: Failure) {
        let _ = self.put(Err(failure.into())).await;
    }

    async fn put(&self, item: Item) -> Result<(), Gone> {
        let mut cut = self.clock.cut.subscribe();
        let place = tokio::select! {
            biased;
            place = timeout(self.stall, self.queue.reserve()) => place.map_err(|_| Gone)?.map_err(|_| Gone)?,
            _ = cut.wait_for(|cut| *cut) => return Err(Gone),
        };
        let now = Instant::now();
        let mut times = self.clock.times();
        times.waiting.push_back(now);
        times.last_sent = now;
        place.send(item);
        Ok(())
    }

    /// From now on frames are queued only where there is room: nobody waits for this agent.
    pub(crate) fn cut(&self) {
        self.clock.cut.send_replace(true);
    }

    /// When the last frame was queued.
    pub(crate) fn last_sent(&self) -> Instant {
        self.clock.times().last_sent
    }

    /// Waits until the agent has hung up or left a frame unread for too long.
    pub(crate) async fn gone(&self) {
        loop {
            let since = self.clock.times().waiting.front().copied();
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
    fn times(&self) -> MutexGuard<'_, Times> {
        self.times.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Stream for Frames {
    type Item = Item;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Item>> {
        let next = self.queue.poll_recv(context);
        if let Poll::Ready(Some(_)) = next {
            self.clock.times().waiting.pop_front();
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
        assert_eq!(out.send(ping()).await, Err(Gone));
    }

    #[tokio::test(start_paused = true)]
    async fn a_cut_queue_takes_what_fits_and_waits_for_nothing() {
        let (out, _frames) = outbound(1, STALL);
        out.cut();
        let before = Instant::now();
        assert_eq!(out.send(ping()).await, Ok(()));
        assert_eq!(out.send(ping()).await, Err(Gone));
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
        assert_eq!(out.send(ping()).await, Err(Gone));
    }
}
