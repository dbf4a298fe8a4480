use crate::{
    Episode, Error, Notice, Progress, RunSummary, TaskSpec,
    connection::{Connection, Event},
    episode::{Begun, SlotState},
    error::closed,
};
use avln_proto::v1::{self, play_request::Frame};
use std::{
    fmt,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll, ready},
    time::Duration,
};
use tokio::{
    sync::{Mutex, mpsc},
    time,
};
use tokio_stream::Stream;

/// Longest wait for the summary in [`Play::finish`].
const FAREWELL: Duration = Duration::from_secs(60);

/// A run slot, which plays episodes in sequence.
///
/// A lost connection is reopened and episodes continue, as long as the server permits. If dropped before
/// [`finish`](Self::finish), an open episode ends as disconnected after that time.
#[derive(Debug)]
pub struct Play {
    pub(crate) connection: Arc<Connection>,
    pub(crate) state: SlotState,
    slot: u32,
    progress: Progress,
    summary: Option<RunSummary>,
}

impl Play {
    pub(crate) fn new(connection: Arc<Connection>, slot: u32, events: mpsc::Receiver<Event>) -> Self {
        let progress = Progress::from_wire(Some(connection.agreement.progress));
        Self { state: SlotState::new(slot, events), connection, slot, progress, summary: None }
    }

    /// Task rules.
    pub fn task(&self) -> &TaskSpec {
        &self.connection.agreement.task
    }

    /// Run id.
    pub fn run(&self) -> &str {
        &self.connection.agreement.run
    }

    /// Number of this slot, 0 or more.
    pub fn slot(&self) -> u32 {
        self.slot
    }

    /// Latest run progress on this slot.
    pub fn progress(&self) -> Progress {
        self.progress
    }

    /// Takes the server's notices that arrived since the last call; at most 64 are kept.
    pub fn take_notices(&mut self) -> Vec<Notice> {
        self.connection.take_notices()
    }

    /// Starts the next episode; `None` if no episode remains. An open episode is abandoned first.
    ///
    /// The clock of the first action starts now: load models before.
    ///
    /// # Errors
    /// If the server refuses or violates the protocol, or the connection is lost.
    pub async fn next_episode(&mut self) -> Result<Option<Episode<'_>>, Error> {
        Ok(self.begin_next().await?.then(|| Episode::lent(self)))
    }

    /// Begins the next episode; false when the run has none left.
    pub(crate) async fn begin_next(&mut self) -> Result<bool, Error> {
        if self.summary.is_some() {
            return Ok(false);
        }
        self.give_up_open_episode().await?;
        self.connection.send(Frame::Ready(v1::Ready { slot: self.slot })).await;
        match self.state.begin(&self.connection).await? {
            Begun::Episode(progress) => {
                self.progress = progress;
                Ok(true)
            }
            Begun::RunEnd(end) => {
                self.keep(end);
                Ok(false)
            }
        }
    }

    /// Returns the remaining episodes as a stream.
    pub fn episodes(self) -> Episodes {
        let task = self.task().clone();
        Episodes { play: Arc::new(Mutex::new(self)), task, next: None, is_over: false }
    }

    /// Sends Goodbye: the run ends on all slots, and open episodes end as abandoned.
    ///
    /// # Errors
    /// If the connection is lost, or the server does not answer within a minute.
    pub async fn finish(mut self) -> Result<RunSummary, Error> {
        self.farewell().await
    }

    pub(crate) async fn farewell(&mut self) -> Result<RunSummary, Error> {
        self.connection.send(Frame::Goodbye(v1::Goodbye { pause: false })).await;
        if let Some(summary) = &self.summary {
            return Ok(summary.clone());
        }
        let waited = time::timeout(FAREWELL, self.await_run_end()).await;
        waited.unwrap_or_else(|_| {
            Err(Error::Lost {
                attempted: "finish the run",
                detail: "no summary came within a minute".to_owned(),
            })
        })
    }

    async fn await_run_end(&mut self) -> Result<RunSummary, Error> {
        loop {
            match self.state.next().await {
                Event::RunEnd(end) => return Ok(RunSummary::from_wire(end)),
                Event::Closed(end) => return Err(closed("finish the run", end)),
                Event::Fault(fault) if fault.slot.is_none() && !fault.recoverable => {
                    return Err(Error::from_fault("finish the run", &fault));
                }
                _ => {} // the last frames of an episode that Goodbye ended
            }
        }
    }

    async fn give_up_open_episode(&mut self) -> Result<(), Error> {
        if !self.state.is_over() {
            self.state.abandon(&self.connection).await?;
        }
        self.note_progress();
        Ok(())
    }

    pub(crate) fn note_progress(&mut self) {
        if let Some(end) = self.state.end() {
            self.progress = end.progress;
        }
    }

    fn keep(&mut self, end: v1::RunEnd) {
        let summary = RunSummary::from_wire(end);
        self.progress = summary.progress;
        self.summary = Some(summary);
    }
}

/// Answer to the request for the next episode.
type Next = Pin<Box<dyn Future<Output = Option<Result<Episode<'static>, Error>>> + Send>>;

/// A slot's episodes as a `futures-core` [`Stream`], created by [`Play::episodes`].
///
/// It ends with the run or after an error. Polling requests the next episode after the previous one was dropped; an
/// episode dropped before its end is abandoned.
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
    next: Option<Next>,
    is_over: bool,
}

impl Episodes {
    /// Task rules.
    pub fn task(&self) -> &TaskSpec {
        &self.task
    }

    /// Finishes the run like [`Play::finish`], after the last episode was dropped.
    ///
    /// # Errors
    /// As for [`Play::finish`].
    pub async fn finish(mut self) -> Result<RunSummary, Error> {
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

/// Waits until the slot is idle, then starts the next episode.
async fn begin(play: Arc<Mutex<Play>>) -> Option<Result<Episode<'static>, Error>> {
    let mut play = play.lock_owned().await;
    match play.begin_next().await {
        Ok(true) => Some(Ok(Episode::kept(play))),
        Ok(false) => None,
        Err(error) => Some(Err(error)),
    }
}
