//! Playing a run: slots, episodes and steps.

use crate::action::Action;
use crate::connection::{Connection, Event};
use crate::error::{Error, closed};
use crate::observation::{Mission, Observation};
use crate::slot::{Begun, SlotState, TimeLeft};
use crate::summary::{EpisodeEnd, Notice, Progress, RunSummary};
use crate::task::TaskSpec;
use avln_proto::v1::{self, play_request::Frame};
use std::fmt;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::sync::{Mutex, OwnedMutexGuard, mpsc};
use tokio::time;
use tokio_stream::Stream;

const SUMMARY_TIMEOUT: Duration = Duration::from_secs(60);

/// A run slot, which plays episodes in sequence. After a loss it reconnects, as long as the server permits.
/// After a drop before [`finish`](Self::finish) an open episode ends as disconnected.
#[derive(Debug)]
pub struct Play {
    connection: Arc<Connection>,
    state: SlotState,
    slot: u32,
    progress: Progress,
    summary: Option<RunSummary>,
}

impl Play {
    pub(crate) fn new(connection: Arc<Connection>, slot: u32, events: mpsc::Receiver<Event>) -> Self {
        let progress = Progress::from_wire(Some(connection.agreement.progress));
        Self { state: SlotState::new(slot, events), connection, slot, progress, summary: None }
    }

    /// Returns the task rules.
    pub fn task(&self) -> &TaskSpec {
        &self.connection.agreement.task
    }

    /// Returns the run id.
    pub fn run(&self) -> &str {
        &self.connection.agreement.run
    }

    /// Returns the slot number, from 0.
    pub fn slot(&self) -> u32 {
        self.slot
    }

    /// Returns the latest run progress on this slot.
    pub fn progress(&self) -> Progress {
        self.progress
    }

    /// Takes the server's notices since the last call, at most 64.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        self.connection.take_notices()
    }

    /// Starts the next episode and its clock; `None` if no episode remains. An open episode is abandoned.
    /// Fails if the server refuses or violates the protocol, or the connection is lost.
    pub async fn next_episode(&mut self) -> Result<Option<Episode<'_>>, Error> {
        Ok(self.begin_next().await?.then(|| Episode { play: SlotAccess::Borrowed(self) }))
    }

    /// Starts the next episode; returns false at the end of the run.
    async fn begin_next(&mut self) -> Result<bool, Error> {
        if self.summary.is_some() {
            return Ok(false);
        }
        if !self.state.is_over() {
            self.state.abandon(&self.connection).await?;
        }
        self.note_progress();
        self.connection.send(Frame::Ready(v1::Ready { slot: self.slot })).await;
        match self.state.begin(&self.connection).await? {
            Begun::Episode(progress) => {
                self.progress = progress;
                Ok(true)
            }
            Begun::RunEnd(end) => {
                let summary = RunSummary::from_wire(end);
                self.progress = summary.progress;
                self.summary = Some(summary);
                Ok(false)
            }
        }
    }

    /// Returns the remaining episodes as a stream.
    pub fn episodes(self) -> Episodes {
        let task = self.task().clone();
        Episodes { play: Arc::new(Mutex::new(self)), task, next: None, is_over: false }
    }

    /// Sends Goodbye: the run ends on all slots, and open episodes end as abandoned. Fails after a minute
    /// without an answer, or if the connection is lost.
    pub async fn finish(mut self) -> Result<RunSummary, Error> {
        self.farewell().await
    }

    async fn farewell(&mut self) -> Result<RunSummary, Error> {
        self.connection.send(Frame::Goodbye(v1::Goodbye { pause: false })).await;
        if let Some(summary) = &self.summary {
            return Ok(summary.clone());
        }
        let late = |_| Error::Lost {
            attempted: "finish the run",
            detail: format!("no RunEnd within {SUMMARY_TIMEOUT:?}"),
        };
        time::timeout(SUMMARY_TIMEOUT, self.await_run_end()).await.map_err(late)?
    }

    async fn await_run_end(&mut self) -> Result<RunSummary, Error> {
        loop {
            match self.state.next().await {
                Event::RunEnd(end) => return Ok(RunSummary::from_wire(end)),
                Event::Closed(end) => return Err(closed("finish the run", end)),
                Event::Fault(fault) if fault.slot.is_none() && !fault.recoverable => {
                    return Err(Error::from_fault("finish the run", &fault));
                }
                // Goodbye abandons open episodes, whose last frames precede RunEnd.
                _ => {}
            }
        }
    }

    fn note_progress(&mut self) {
        if let Some(end) = self.state.end() {
            self.progress = end.progress;
        }
    }
}

/// An episode in progress, from [`Play::next_episode`] or the stream [`Play::episodes`].
#[derive(Debug)]
pub struct Episode<'play> {
    play: SlotAccess<'play>,
}

#[derive(Debug)]
enum SlotAccess<'play> {
    Borrowed(&'play mut Play),
    // The stream needs this lock to start the next episode, so only one is open.
    Owned(OwnedMutexGuard<Play>),
}

impl Episode<'_> {
    fn play(&self) -> &Play {
        match &self.play {
            SlotAccess::Borrowed(play) => play,
            SlotAccess::Owned(play) => play,
        }
    }

    fn play_mut(&mut self) -> &mut Play {
        match &mut self.play {
            SlotAccess::Borrowed(play) => play,
            SlotAccess::Owned(play) => play,
        }
    }

    /// Returns the random episode handle, valid in this run only.
    pub fn id(&self) -> &str {
        &self.play().state.id
    }

    /// Returns the episode number in start order, from 1.
    pub fn ordinal(&self) -> u32 {
        self.play().state.ordinal
    }

    /// Returns the mission.
    pub fn mission(&self) -> &Mission {
        &self.play().state.mission
    }

    /// Returns the latest observation.
    pub fn observation(&self) -> &Observation {
        &self.play().state.observation
    }

    /// Returns the time for the next action.
    pub fn time_left(&self) -> TimeLeft {
        self.play().state.time
    }

    /// Returns the run progress.
    pub fn progress(&self) -> Progress {
        self.play().progress()
    }

    /// Returns true if the episode has ended; see [`end`](Self::end).
    pub fn is_over(&self) -> bool {
        self.play().state.is_over()
    }

    /// Returns the episode result; `None` before the end.
    pub fn end(&self) -> Option<&EpisodeEnd> {
        self.play().state.end()
    }

    /// Returns the server failure behind [`EndReason::ServerFault`](crate::EndReason::ServerFault).
    pub fn fault(&self) -> Option<&Error> {
        self.play().state.fault.as_ref()
    }

    /// Takes a step. A limit may end the episode before the step: check [`is_over`](Self::is_over). Fails
    /// with [`Error::EpisodeOver`] after the end, and with [`Error::Refused`] if the episode continues
    /// without the step.
    pub async fn step(&mut self, action: Action) -> Result<&Observation, Error> {
        let play = self.play_mut();
        play.state.step(&play.connection, action).await?;
        play.note_progress();
        Ok(&play.state.observation)
    }

    /// Abandons the episode: it is scored up to the last step. No effect after the end.
    pub async fn abandon(&mut self) -> Result<(), Error> {
        let play = self.play_mut();
        if !play.state.is_over() {
            play.state.abandon(&play.connection).await?;
        }
        play.note_progress();
        Ok(())
    }
}

type NextEpisode = Pin<Box<dyn Future<Output = Option<Result<Episode<'static>, Error>>> + Send>>;

/// A slot's episodes as a `futures-core` [`Stream`], created by [`Play::episodes`]; see `examples/episodes.rs`.
///
/// It ends with the run or after an error. The next episode starts after the previous one was dropped; a drop before
/// the episode's end abandons it.
///
/// ```no_run
/// use avln_client::{Action, Client, Error, RunOptions, Sensors};
/// use tokio_stream::StreamExt;
///
/// # async fn play(client: Client) -> Result<(), Error> {
/// let run = client.start_run(RunOptions::new("practice", "my-method")).await?;
/// let mut episodes = client.play(&run, Sensors::default()).await?.episodes();
/// while let Some(mut episode) = episodes.try_next().await? {
///     while !episode.is_over() {
///         episode.step(Action::MoveForward).await?;
///     }
/// }
/// println!("{}", episodes.finish().await?);
/// # Ok(())
/// # }
/// ```
pub struct Episodes {
    play: Arc<Mutex<Play>>,
    task: TaskSpec,
    next: Option<NextEpisode>,
    is_over: bool,
}

impl Episodes {
    /// Returns the task rules.
    pub fn task(&self) -> &TaskSpec {
        &self.task
    }

    /// Finishes the run like [`Play::finish`], after the last episode was dropped.
    pub async fn finish(mut self) -> Result<RunSummary, Error> {
        // A pending request owns the lock or waits for it.
        drop(self.next.take());
        self.play.lock().await.farewell().await
    }
}

impl Stream for Episodes {
    type Item = Result<Episode<'static>, Error>;

    fn poll_next(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<Self::Item>> {
        let this = self.get_mut();
        if this.is_over {
            return Poll::Ready(None);
        }
        let next = this.next.get_or_insert_with(|| Box::pin(begin(this.play.clone())));
        let item = ready!(next.as_mut().poll(context));
        this.next = None;
        this.is_over = !matches!(item, Some(Ok(_)));
        Poll::Ready(item)
    }
}

impl fmt::Debug for Episodes {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Episodes").field("is_over", &self.is_over).finish_non_exhaustive()
    }
}

async fn begin(play: Arc<Mutex<Play>>) -> Option<Result<Episode<'static>, Error>> {
    let mut play = play.lock_owned().await;
    match play.begin_next().await {
        Ok(true) => Some(Ok(Episode { play: SlotAccess::Owned(play) })),
        Ok(false) => None,
        Err(error) => Some(Err(error)),
    }
}
