//! The oracle's runs of a phase, as the upper bound on its leaderboards.

use super::{
    live_episodes::{LiveEpisodes, TrueHints},
    oracle::ShortestPath,
    play::client_order,
};
use avln_arena::{Arena, Failure, FailureKind, SCENE_MEMORY_MIB, data::DataFolder, dataset::SplitFolder, servers::RunningServers, setup::admit};
use avln_client::{Agent, Play, RunOptions, RunSummary, Sensors};
use avln_episode::Order;
use avln_store::{Phase, Reference, Store};
use std::sync::Arc;

/// Team and method of the oracle.
const TEAM: &str = "Oracle";
const METHOD: &str = "shortest-path";

/// Plays a phase with the oracle in all of its orders and passes the results to `tell`. No server may use the folder.
///
/// # Errors
/// If there is no such phase, it accepts no runs, or a run fails.
pub async fn play_oracle(
    data: &DataFolder,
    phase: &str,
    tell: &mut (dyn FnMut(Order, &RunSummary) + Send),
) -> Result<(), Failure> {
    let store = data.store().await?;
    let phase = store.phases().await?.into_iter().find(|known| known.id == phase).ok_or_else(|| {
        Failure::new(FailureKind::Data, format!("there is no phase '{phase}'"))
            .hinted("list phases with: avln challenge show")
    })?;
    let token = admit(&store, TEAM, Some(Reference::Oracle)).await?;
    let live = Arc::new(LiveEpisodes::default());
    let watching = live.clone();
    let arena = Arena::open(data, store.clone(), SCENE_MEMORY_MIB).await?;
    let arena = arena.with_observer(move |handle, referee| watching.note(handle, referee));
    let servers = RunningServers::local_for(arena, &store).await?;
    let orders = phase.orders.clone();
    let split = data.missions(&phase.split)?;
    let oracle = OracleRuns { server: servers.grpc_url(), token, store: store.clone(), live, phase, split };
    for order in orders {
        tell(order, &oracle.run(order).await?);
    }
    servers.close().await?;
    store.close().await;
    Ok(())
}

/// The oracle's connection and phase.
struct OracleRuns {
    server: String,
    token: String,
    store: Store,
    live: Arc<LiveEpisodes>,
    phase: Phase,
    split: SplitFolder,
}

impl OracleRuns {
    async fn run(&self, order: Order) -> Result<RunSummary, Failure> {
        let arena =
            avln_client::Client::connect(&self.server, self.token.as_str()).await.map_err(Failure::run)?;
        let method = RunOptions::new(&self.phase.id, METHOD).method_version(env!("CARGO_PKG_VERSION"));
        let run = arena.start_run(method.order(client_order(order))).await.map_err(Failure::run)?;
        let none = Sensors { rgb: false, depth: false, audio: false, ..Sensors::square(64) };
        let mut play = arena.play(&run, none).await.map_err(Failure::run)?;
        let hints = Arc::new(TrueHints::new(self.live.clone(), self.phase.rules.clone()));
        while self.episode(&mut play, &hints, order).await? {}
        play.finish().await.map_err(Failure::run)
    }

    /// Plays the next episode. Returns `false` if there is none.
    async fn episode(&self, play: &mut Play, hints: &Arc<TrueHints>, order: Order) -> Result<bool, Failure> {
        let (task, run) = (play.task().clone(), play.run().to_owned());
        let Some(mut episode) = play.next_episode().await.map_err(Failure::run)? else { return Ok(false) };
        let handle = episode.id().to_owned();
        let open = self.store.running_episodes().await?;
        let found = open.into_iter().find(|open| open.run == run && open.handle == handle);
        let spec = found.map(|open| self.split.episode(&open.episode)).transpose()?.flatten();
        let spec = spec.ok_or_else(|| {
            Failure::new(
                FailureKind::Internal,
                format!("the episode under handle {handle} is not in the split"),
            )
        })?;
        hints.follow(&handle, spec.truth(order));
        let mut agent = ShortestPath::new(hints.clone());
        agent.begin(&task, episode.mission());
        while !episode.is_over() {
            let action = agent.act(episode.observation());
            episode.step(action).await.map_err(Failure::run)?;
        }
        self.live.forget(&handle);
        Ok(true)
    }
}
