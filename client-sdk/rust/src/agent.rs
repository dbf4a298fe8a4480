//! Agents, and the evaluation of a run.

use crate::action::Action;
use crate::client::Client;
use crate::error::Error;
use crate::observation::{Mission, Observation};
use crate::play::Play;
use crate::service::Run;
use crate::summary::{EpisodeEnd, RunSummary};
use crate::task::{Sensors, TaskSpec};
use tokio::runtime::{Handle, RuntimeFlavor};
use tokio::sync::mpsc;
use tokio::task::{self, JoinSet};

/// A policy. An agent plays a single episode at a time.
pub trait Agent {
    /// Receives the episode handle, valid for this run only, before [`begin`](Self::begin); for agents with records.
    fn enter(&mut self, _episode: &str) {}

    /// Starts an episode; forget the previous one.
    fn begin(&mut self, task: &TaskSpec, mission: &Mission);

    /// Selects an action for an observation.
    fn act(&mut self, observation: &Observation) -> Action;
}

impl<A: Agent + ?Sized> Agent for Box<A> {
    fn enter(&mut self, episode: &str) {
        self.as_mut().enter(episode);
    }

    fn begin(&mut self, task: &TaskSpec, mission: &Mission) {
        self.as_mut().begin(task, mission);
    }

    fn act(&mut self, observation: &Observation) -> Action {
        self.as_mut().act(observation)
    }
}

/// Plays a whole run on the calling task and finishes it; fails like [`Play::next_episode`].
pub async fn evaluate(
    client: &Client,
    run: &Run,
    sensors: Sensors,
    agent: &mut (dyn Agent + Send),
) -> Result<RunSummary, Error> {
    evaluate_with(client, run, sensors, agent, &mut |_| {}).await
}

type OnEnd<'a> = &'a mut (dyn FnMut(&EpisodeEnd) + Send);

/// Plays a run like [`evaluate`] and calls `on_end` for every ended episode.
pub async fn evaluate_with(
    client: &Client,
    run: &Run,
    sensors: Sensors,
    agent: &mut (dyn Agent + Send),
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let mut play = client.play(run, sensors).await?;
    play_all(&mut play, agent, on_end).await?;
    play.finish().await
}

/// Plays a run like [`evaluate`] with an episode per agent in parallel, or fewer as the server grants.
/// `agents` must not be empty; afterwards it contains all agents except a panicked one, in any order.
pub async fn evaluate_slots<A: Agent + Send + 'static>(
    client: &Client,
    run: &Run,
    sensors: Sensors,
    agents: &mut Vec<A>,
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let wish = u32::try_from(agents.len()).unwrap_or(u32::MAX);
    let plays = client.play_slots(run, sensors, wish).await?;
    let (sender, mut ended) = mpsc::unbounded_channel();
    let mut players = JoinSet::new();
    for mut play in plays {
        let Some(mut agent) = agents.pop() else { break };
        let sender = sender.clone();
        players.spawn(async move {
            let mut on_end = |end: &EpisodeEnd| _ = sender.send(end.clone());
            let played = play_all(&mut play, &mut agent, &mut on_end).await;
            (agent, played.map(|()| play))
        });
    }
    // `recv` ends after the drop of the last sender.
    drop(sender);
    while let Some(end) = ended.recv().await {
        on_end(&end);
    }
    gather(players, agents).await?.finish().await
}

/// Waits for all slots; returns one for the Goodbye.
async fn gather<A: 'static>(
    mut players: JoinSet<(A, Result<Play, Error>)>,
    agents: &mut Vec<A>,
) -> Result<Play, Error> {
    let lost = |error: task::JoinError| Error::Lost { attempted: "play a slot", detail: error.to_string() };
    let mut all = Err(Error::protocol("no agent received a slot"));
    // After a failure the other slots still play to the end: their episodes count.
    let mut failed = None;
    while let Some(joined) = players.join_next().await {
        let played = joined.map_err(lost).and_then(|(agent, played)| {
            agents.push(agent);
            played
        });
        match played {
            Ok(play) => all = Ok(play),
            Err(error) => _ = failed.get_or_insert(error),
        }
    }
    failed.map_or(all, Err)
}

async fn play_all(play: &mut Play, agent: &mut (dyn Agent + Send), on_end: OnEnd<'_>) -> Result<(), Error> {
    let task = play.task().clone();
    while let Some(mut episode) = play.next_episode().await? {
        undisturbed(|| {
            agent.enter(episode.id());
            agent.begin(&task, episode.mission());
        });
        while !episode.is_over() {
            let action = undisturbed(|| agent.act(episode.observation()));
            episode.step(action).await?;
        }
        if let Some(end) = episode.end() {
            on_end(end);
        }
    }
    Ok(())
}

fn undisturbed<T>(think: impl FnOnce() -> T) -> T {
    // A slow agent must not block the worker thread for the reader, which answers Pings. `block_in_place` panics on
    // a single-thread runtime.
    match Handle::current().runtime_flavor() {
        RuntimeFlavor::MultiThread => task::block_in_place(think),
        _ => think(),
    }
}
