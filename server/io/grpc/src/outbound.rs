//! Outbound frames: a bounded queue, pings, and round-trip measurement.

use crate::{control::unix_ms, host::OpenRun, refusal::Failure, shared::Shared};
use avln_proto::v1::{self, PlayResponse, play_response::Frame};
use parking_lot::Mutex;
use std::{
    collections::VecDeque,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
    time::Duration,
};
use tokio::{
    sync::{mpsc, watch},
    time::{Instant, sleep_until, timeout},
};
use tokio_stream::Stream;
use tonic::Status;

/// Longest time between the deadline warning and the deadline.
const WARNING: Duration = Duration::from_secs(300);

type Item = Result<PlayResponse, Status>;

/// The sending end of a bounded frame queue, which measures the oldest frame's waiting time.
#[derive(Clone, Debug)]
pub(crate) struct Outbound {
    queue: mpsc::Sender<Item>,
    state: Arc<QueueState>,
    stall: Duration,
}

/// The receiving end of the queue, read by the transport.
#[derive(Debug)]
pub(crate) struct Frames {
    queue: mpsc::Receiver<Item>,
    state: Arc<QueueState>,
}

/// Error: the client does not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Gone;

#[derive(Debug, Default)]
struct QueueState {
    waiting: Mutex<VecDeque<QueuedFrame>>,
    /// Shortest measured round trip.
    round_trip: Mutex<Option<Duration>>,
    is_cut: Shared<bool>,
}

#[derive(Debug)]
struct QueuedFrame {
    since: Instant,
    left: watch::Sender<Option<Instant>>,
}

/// Time at which a frame leaves the queue for the transport.
#[derive(Clone, Debug)]
pub(crate) struct Departure {
    left: watch::Receiver<Option<Instant>>,
    state: Arc<QueueState>,
}

impl Departure {
    /// Returns the time at which the frame left, if it has.
    pub(crate) fn at(&self) -> Option<Instant> {
        *self.left.borrow()
    }

    /// Returns the round-trip time that agents are not charged for.
    pub(crate) fn round_trip(&self) -> Duration {
        self.state.round_trip.lock().unwrap_or_default()
    }

    /// Waits until the frame has left. After a broken stream it never returns.
    pub(crate) async fn left(mut self) -> Instant {
        match self.left.wait_for(Option::is_some).await.map(|at| *at) {
            Ok(Some(at)) => at,
            _ => std::future::pending().await,
        }
    }
}

/// Creates a queue for `frames` frames, none of which may wait longer than `stall`.
pub(crate) fn outbound(frames: usize, stall: Duration) -> (Outbound, Frames) {
    let (sender, receiver) = mpsc::channel(frames.max(1));
    let state = Arc::<QueueState>::default();
    (Outbound { queue: sender, state: state.clone(), stall }, Frames { queue: receiver, state })
}

impl Outbound {
    /// Queues a frame; waits while the queue is full, up to the stall limit.
    pub(crate) async fn send(&self, frame: Frame) -> Result<Departure, Gone> {
        self.put(Ok(PlayResponse { frame: Some(frame) })).await
    }

    pub(crate) async fn fail(&self, failure: Failure) {
        let _ = self.put(Err(failure.into())).await;
    }

    async fn put(&self, item: Item) -> Result<Departure, Gone> {
        let permit = tokio::select! {
            // First, so that a cut queue still takes the frames that fit.
            biased;
            permit = timeout(self.stall, self.queue.reserve()) => permit.map_err(|_| Gone)?.map_err(|_| Gone)?,
            () = self.state.is_cut.wait_until(|is_cut| *is_cut) => return Err(Gone),
        };
        let now = Instant::now();
        let (left, departure) = watch::channel(None);
        let mut waiting = self.state.waiting.lock();
        waiting.push_back(QueuedFrame { since: now, left });
        // Under the lock, so that frames leave in the order of `waiting`.
        permit.send(item);
        drop(waiting);
        Ok(Departure { left: departure, state: self.state.clone() })
    }

    /// Queues frames only while there is room from now on, without waiting for the client.
    pub(crate) fn cut(&self) {
        self.state.is_cut.set(true);
    }

    pub(crate) fn measured(&self, took: Duration) {
        let mut round_trip = self.state.round_trip.lock();
        // The shortest: longer ones contain pauses of either side.
        *round_trip = Some(round_trip.map_or(took, |shortest| shortest.min(took)));
    }

    /// Waits until the client has hung up or left a frame unread for too long.
    pub(crate) async fn gone(&self) {
        loop {
            let since = self.state.waiting.lock().front().map(|waiting| waiting.since);
            let check = since.unwrap_or_else(Instant::now) + self.stall;
            if since.is_some() && check <= Instant::now() {
                return;
            }
            tokio::select! {
                biased;
                () = self.queue.closed() => return,
                () = sleep_until(check) => {}
            }
        }
    }
}

impl Stream for Frames {
    type Item = Item;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Item>> {
        let next = self.queue.poll_recv(context);
        if let Poll::Ready(Some(_)) = next
            && let Some(waiting) = self.state.waiting.lock().pop_front()
        {
            waiting.left.send_replace(Some(Instant::now()));
        }
        next
    }
}

#[derive(Debug, Default)]
pub(crate) struct PingTimer {
    nonce: u64,
    sent: Option<Departure>,
}

impl PingTimer {
    pub(crate) async fn tick(&mut self, out: &Outbound, deadline: &RunDeadline) {
        self.nonce += 1;
        let ping = v1::Ping {
            nonce: self.nonce,
            server_time_unix_ms: unix_ms(),
            run_remaining_s: deadline.remaining_s(),
        };
        self.sent = out.send(Frame::Ping(ping)).await.ok();
    }

    /// Handles a Pong. The round trip counts up to `limit`.
    pub(crate) fn answered(&mut self, nonce: u64, out: &Outbound, limit: Duration) {
        if nonce != self.nonce {
            return;
        }
        if let Some(left) = self.sent.take().and_then(|sent| sent.at()) {
            // Limited, because a client could answer late to be charged less thinking time.
            out.measured(left.elapsed().min(limit));
        }
    }
}

/// Wall-clock deadline.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RunDeadline {
    /// Deadline and warning time, by the monotonic clock.
    end: Option<(Instant, Instant)>,
    unix_ms: i64,
}

impl RunDeadline {
    pub(crate) fn of(open: &OpenRun, now_unix_ms: i64) -> Self {
        let deadline_unix_ms = open.deadline_unix_ms.unwrap_or_default();
        let left_ms = u64::try_from(deadline_unix_ms.saturating_sub(now_unix_ms)).unwrap_or(0);
        let end =
            open.deadline_unix_ms.and_then(|_| Instant::now().checked_add(Duration::from_millis(left_ms)));
        let tenth = Duration::from_secs(u64::from(open.time.run_s) / 10);
        let warning = if tenth.is_zero() { WARNING } else { tenth.min(WARNING) };
        let end = end.map(|end| (end, end.checked_sub(warning).unwrap_or(end)));
        Self { end, unix_ms: deadline_unix_ms }
    }

    fn remaining_s(&self) -> Option<u32> {
        let (end, _) = self.end?;
        u32::try_from(end.saturating_duration_since(Instant::now()).as_secs()).ok()
    }

    pub(crate) async fn runs_low(&self) {
        match self.end {
            Some((_, warning)) => sleep_until(warning).await,
            None => std::future::pending().await,
        }
    }

    pub(crate) fn notice(&self) -> v1::Notice {
        let seconds = self.remaining_s().unwrap_or_default();
        v1::Notice {
            kind: v1::NoticeKind::BudgetLow.into(),
            message: format!("the run's wall time ends in {seconds} s, and open episodes with it"),
            effective_unix_ms: self.unix_ms,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_proto::v1::Ping;
    use tokio::time::advance;
    use tokio_stream::StreamExt;

    const STALL: Duration = Duration::from_secs(30);

    fn ping() -> Frame {
        Frame::Ping(Ping::default())
    }

    #[tokio::test(start_paused = true)]
    async fn an_unread_frame_means_gone() {
        let (out, _frames) = outbound(4, STALL);
        out.send(ping()).await.unwrap();
        let before = Instant::now();
        out.gone().await;
        assert_eq!(before.elapsed().as_secs(), 30);
    }

    #[tokio::test(start_paused = true)]
    async fn a_full_queue_fails_after_the_stall_limit() {
        let (out, _frames) = outbound(1, STALL);
        out.send(ping()).await.unwrap();
        assert!(out.send(ping()).await.is_err());
    }

    #[tokio::test(start_paused = true)]
    async fn a_cut_queue_never_waits() {
        let (out, _frames) = outbound(1, STALL);
        out.cut();
        let before = Instant::now();
        assert!(out.send(ping()).await.is_ok());
        assert!(out.send(ping()).await.is_err());
        assert_eq!(before.elapsed(), Duration::ZERO);
    }

    #[tokio::test(start_paused = true)]
    async fn reading_client_stays_until_it_disconnects() {
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
    async fn frame_leaves_when_transport_is_ready() {
        let (out, mut frames) = outbound(4, STALL);
        let departure = out.send(ping()).await.unwrap();
        advance(Duration::from_secs(5)).await;
        assert_eq!(departure.at(), None);
        assert!(frames.next().await.is_some());
        assert_eq!(departure.clone().left().await, Instant::now());
        assert_eq!(departure.at(), Some(Instant::now()));
        let lost = out.send(ping()).await.unwrap();
        drop((out, frames));
        assert!(timeout(STALL, lost.left()).await.is_err(), "it never leaves");
    }

    #[tokio::test(start_paused = true)]
    async fn pongs_measure_the_round_trip() {
        let (out, mut frames) = outbound(8, STALL);
        let deadline = RunDeadline { end: None, unix_ms: 0 };
        let mut pings = PingTimer::default();
        let limit = Duration::from_secs(1);
        let round_trip = async |out: &Outbound| out.send(ping()).await.unwrap().round_trip();
        pings.tick(&out, &deadline).await;
        frames.next().await.unwrap().unwrap();
        advance(Duration::from_millis(100)).await;
        pings.answered(77, &out, limit);
        assert_eq!(round_trip(&out).await, Duration::ZERO, "a wrong nonce");
        pings.answered(1, &out, limit);
        assert_eq!(round_trip(&out).await, Duration::from_millis(100));
        pings.answered(1, &out, limit);
        pings.tick(&out, &deadline).await;
        while !frames
            .next()
            .await
            .is_some_and(|frame| matches!(frame.unwrap().frame, Some(Frame::Ping(ping)) if ping.nonce == 2))
        {
        }
        advance(Duration::from_secs(60)).await;
        pings.answered(2, &out, limit);
        assert_eq!(round_trip(&out).await, Duration::from_millis(100), "the shortest counts");
        let (other, mut frames) = outbound(8, STALL);
        let mut pings = PingTimer::default();
        pings.tick(&other, &deadline).await;
        frames.next().await.unwrap().unwrap();
        advance(Duration::from_secs(60)).await;
        pings.answered(1, &other, limit);
        assert_eq!(round_trip(&other).await, limit, "a late Pong counts up to the limit");
    }
}
