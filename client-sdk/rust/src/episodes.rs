//! A slot's episodes as a stream.

use crate::{Episode, Error, Play, RunSummary, TaskSpec};
use std::{
    fmt,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll, ready},
};
use tokio::sync::Mutex;
use tokio_stream::Stream;

/// Answer to the request for the next episode.
type Next = Pin<Box<dyn Future<Output = Option<Result<Episode<'static>, Error>>> + Send>>;

/// The episodes of a slot as a [`Stream`], which is that of `futures-core`: [`Play::episodes`] makes it.
///
/// It ends with the run, and after an error. An episode is asked for when the stream is polled and the one before was
/// dropped; one that was dropped before its end is given up first.
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

impl Play {
    /// The episodes that are left, as a stream.
    pub fn episodes(self) -> Episodes {
        let task = self.task().clone();
        Episodes { play: Arc::new(Mutex::new(self)), task, next: None, is_over: false }
    }
}

impl Episodes {
    /// The facts of the rules.
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
