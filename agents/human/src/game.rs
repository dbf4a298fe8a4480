//! The run, at the pace of the person.

use crate::message;
use avln_client::{Action, Episode, EpisodeEnd, Error, Play, RunSummary};
use tokio::sync::{mpsc, oneshot};

/// What the page wants to know or do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Wish {
    /// See how things are.
    Look,
    /// Take a step.
    Act(Action),
    /// Begin the next episode.
    Next,
}

/// A wish, and where its answer goes. A page that has gone gets none.
#[derive(Debug)]
pub(crate) struct Wished {
    pub(crate) wish: Wish,
    pub(crate) answer: oneshot::Sender<Vec<u8>>,
}

/// Plays a run to its end. No clock runs before the person says so: an episode begins when it is wished for.
pub(crate) async fn play(
    mut play: Play,
    mut wishes: mpsc::Receiver<Wished>,
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let mut last: Option<EpisodeEnd> = None;
    loop {
        let Some(next) = wait(&mut wishes, &message::waiting(&play, last.as_ref())).await else { break };
        let facts = message::Facts::of(&play);
        let Some(mut episode) = play.next_episode().await? else {
            let _ = next.send(message::over(last.as_ref()));
            break;
        };
        let answer = drive(&mut episode, &facts, next, &mut wishes).await?;
        last = episode.end().cloned();
        if let Some(end) = &last {
            on_end(end);
        }
        let _ = answer.map(|answer| answer.send(message::waiting(&play, last.as_ref())));
    }
    play.finish().await
}

/// Tells how things are until the next episode is wished for; `None` when nobody is there any more.
async fn wait(wishes: &mut mpsc::Receiver<Wished>, state: &[u8]) -> Option<oneshot::Sender<Vec<u8>>> {
    loop {
        let Wished { wish, answer } = wishes.recv().await?;
        if wish == Wish::Next {
            return Some(answer);
        }
        let _ = answer.send(state.to_vec());
    }
}

/// Plays an episode until it ends; gives back who waits for an answer still.
async fn drive(
    episode: &mut Episode<'_>,
    facts: &message::Facts,
    first: oneshot::Sender<Vec<u8>>,
    wishes: &mut mpsc::Receiver<Wished>,
) -> Result<Option<oneshot::Sender<Vec<u8>>>, Error> {
    let _ = first.send(facts.playing(episode, true, ""));
    loop {
        let Some(Wished { wish, answer }) = wishes.recv().await else {
            episode.abandon().await?;
            return Ok(None);
        };
        let trouble = match wish {
            Wish::Act(action) => match episode.step(action).await {
                Ok(_) => String::new(),
                Err(refused @ Error::Refused { .. }) => refused.to_string(),
                Err(error) => return Err(error),
            },
            Wish::Look | Wish::Next => String::new(),
        };
        if episode.is_over() {
            return Ok(Some(answer));
        }
        let _ = answer.send(facts.playing(episode, wish == Wish::Look, &trouble));
    }
}
