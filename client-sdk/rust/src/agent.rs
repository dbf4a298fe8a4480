use crate::{
    Action, Arena, EpisodeEnd, Error, Mission, Observation, Play, Run, RunSummary, Sensors, TaskSpec,
};
use tokio::{
    runtime::{Handle, RuntimeFlavor},
    sync::mpsc,
    task::{self, JoinSet},
};

/// Something that plays. One agent plays one episode at a time.
pub trait Agent {
    /// An episode is about to [`begin`](Self::begin): its handle, good for this run only, for agents that write things down.
    fn enter(&mut self, _episode: &str) {}

    /// An episode begins: forget the last one.
    fn begin(&mut self, task: &TaskSpec, mission: &Mission);

    /// What to do, seeing this.
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

/// Plays a run to its end with one agent and says Goodbye.
///
/// The agent thinks on the calling task; on a multi-thread runtime other tasks go on meanwhile.
///
/// # Errors
/// When the server refuses something, breaks the protocol or the connection is lost.
pub async fn evaluate(
    arena: &Arena,
    run: &Run,
    sensors: Sensors,
    agent: &mut (dyn Agent + Send),
) -> Result<RunSummary, Error> {
    evaluate_with(arena, run, sensors, agent, &mut |_| {}).await
}

/// As [`evaluate`], telling `on_end` about every episode that ended.
///
/// # Errors
/// As for [`evaluate`].
pub async fn evaluate_with(
    arena: &Arena,
    run: &Run,
    sensors: Sensors,
    agent: &mut (dyn Agent + Send),
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let mut play = arena.play(run, sensors).await?;
    play_all(&mut play, agent, on_end).await?;
    play.finish().await
}

/// Plays a run with as many episodes at the same time as there are agents, or fewer where the server grants fewer slots,
/// telling `on_end` about every episode that ended. `agents` must not be empty; but for one that panicked, all are there
/// afterwards, in any order.
///
/// Each slot is a task of its own: agents think at the same time on a multi-thread runtime, and in turn on one thread.
///
/// # Errors
/// As for [`evaluate`].
pub async fn evaluate_slots<A: Agent + Send + 'static>(
    arena: &Arena,
    run: &Run,
    sensors: Sensors,
    agents: &mut Vec<A>,
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let wish = u32::try_from(agents.len()).unwrap_or(u32::MAX);
    let plays = arena.play_slots(run, sensors, wish).await?;
    let (tell, mut ended) = mpsc::unbounded_channel();
    let mut players = JoinSet::new();
    for mut play in plays {
        let Some(mut agent) = agents.pop() else { break };
        let tell = tell.clone();
        players.spawn(async move {
            let mut on_end = |end: &EpisodeEnd| _ = tell.send(end.clone());
            let played = play_all(&mut play, &mut agent, &mut on_end).await;
            (agent, played.map(|()| play))
        });
    }
    drop(tell);
    while let Some(end) = ended.recv().await {
        on_end(&end);
    }
    gather(players, agents).await?.finish().await
}

/// Waits for all slots; gives back one of their plays.
async fn gather<A: 'static>(
    mut players: JoinSet<(A, Result<Play, Error>)>,
    agents: &mut Vec<A>,
) -> Result<Play, Error> {
    let lost = |error: task::JoinError| Error::Lost { attempted: "play a slot", detail: error.to_string() };
    let mut all = Err(Error::protocol("no agent was given a slot"));
    let mut failed = None;
    while let Some(joined) = players.join_next().await {
        match joined.map_err(lost) {
            Ok((agent, played)) => {
                agents.push(agent);
                match played {
                    Ok(play) => all = Ok(play),
                    Err(error) => _ = failed.get_or_insert(error),
                }
            }
            Err(error) => _ = failed.get_or_insert(error),
        }
    }
    failed.map_or(all, Err)
}

async fn play_all(
    play: &mut Play,
    agent: &mut (dyn Agent + Send),
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<(), Error> {
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

/// Lets other tasks go on while an agent thinks, where the runtime can.
fn undisturbed<T>(think: impl FnOnce() -> T) -> T {
    match Handle::current().runtime_flavor() {
        RuntimeFlavor::MultiThread => task::block_in_place(think),
        _ => think(),
    }
}
