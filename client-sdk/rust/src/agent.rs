use crate::{
    Action, Arena, EpisodeEnd, Error, Mission, Observation, Play, Run, RunSummary, Sensors, TaskSpec,
};
use tokio::{
    runtime::{Handle, RuntimeFlavor},
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

/// Plays a run with as many episodes at the same time as there are agents, or fewer where the server grants fewer
/// slots. `agents` must not be empty.
///
/// # Errors
/// As for [`evaluate`]; the first slot that fails ends the run's stream.
pub async fn evaluate_slots(
    arena: &Arena,
    run: &Run,
    sensors: Sensors,
    agents: Vec<Box<dyn Agent + Send>>,
) -> Result<RunSummary, Error> {
    let wish = u32::try_from(agents.len()).unwrap_or(u32::MAX);
    let mut players = JoinSet::new();
    for (mut play, mut agent) in arena.play_slots(run, sensors, wish).await?.into_iter().zip(agents) {
        players.spawn(async move {
            play_all(&mut play, agent.as_mut(), &mut |_| {}).await?;
            Ok::<Play, Error>(play)
        });
    }
    let mut last = None;
    while let Some(joined) = players.join_next().await {
        let lost =
            |error: task::JoinError| Error::Lost { attempted: "play a slot", detail: error.to_string() };
        last = Some(joined.map_err(lost)??);
    }
    last.ok_or_else(|| Error::protocol("no agent was given a slot"))?.finish().await
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
