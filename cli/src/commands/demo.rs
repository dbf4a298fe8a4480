//! Demo: houses, missions, two agents and a leaderboard in one command.

use super::serve::AddressArgs;
use crate::{
    documents,
    output::{say, styled_bar},
};
use avln_arena::{
    Arena, Failure, SCENE_MEMORY_MIB,
    data::DataFolder,
    now_unix_ms,
    servers::{RunningServers, Servers},
    setup::{NewPhase, NewSplit, admit, make_split, open_phase},
};
use avln_dataset::{SceneSource, Seed};
use avln_episode::{Order, Rules};
use avln_scoring::{Key, Metric};
use avln_store::{
    LeaderboardQuery, LeaderboardRow, Reference, RowFilter, RunChoice, RunLine, RunState, Store, Viewer,
};
use indicatif::ProgressBar;
use std::{
    path::{Path, PathBuf},
    process::Stdio,
    sync::Arc,
    time::Duration,
};
use tokio::process::{Child, Command};

#[derive(Clone, Debug, clap::Args)]
pub(crate) struct DemoArgs {
    #[command(flatten)]
    addresses: AddressArgs,
    /// Scene file or folder instead of procedural houses, in any layout that `avln scene import` reads
    #[arg(long, value_name = "PATH")]
    scene: Option<PathBuf>,
    /// Procedural houses
    #[arg(long, default_value_t = 3)]
    houses: u32,
    /// Missions per scene
    #[arg(long, default_value_t = 4)]
    missions: usize,
    /// Seed for houses and missions
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Exit after the table instead of keeping the servers running
    #[arg(long)]
    once: bool,
}

const TEAM: &str = "LH-AVLN Arena";
/// The agents, by their names in `avln agent`.
const AGENTS: [&str; 2] = ["random", "pag-nav"];
const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];
const RUNS_AT_ONCE: usize = 2;

/// Builds houses and missions, runs two agents over gRPC, prints the table and continues to serve.
pub(crate) async fn run(data: &Path, args: DemoArgs) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    // Before the database and minutes of building: a running server and a used address end the demo at once.
    let lock = data.lock()?;
    let servers = Servers::bind(&args.addresses.addresses()).await?.with_documents(documents());
    let store = data.store().await?;
    let phase = prepare(&data, &store, &args).await?;
    let link_url = servers.web_url().unwrap_or_default();
    let arena =
        Arena::open_locked(lock, &data, store.clone(), SCENE_MEMORY_MIB).await?.with_web_url(link_url);
    let token = admit(&store, TEAM, Some(Reference::Baseline)).await?;
    let open = servers.open(Arc::new(arena), store.reader())?;
    play(&store, &open, &phase, &token).await?;
    print_table(&store, &phase).await?;
    print_outlook(&data, &open, &phase, &args);
    let ended = if args.once { open.close().await } else { open.wait().await };
    store.close().await;
    ended
}

/// Returns the id of the demo's phase; an existing phase is reused.
async fn prepare(data: &DataFolder, store: &Store, args: &DemoArgs) -> Result<String, Failure> {
    let name = match &args.scene {
        None => format!("practice-{}x{}-seed{}", args.houses, args.missions, args.seed),
        Some(path) => {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let fits = |letter: &char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
            let stem: String = stem.chars().filter(fits).take(24).collect();
            format!("scene-{stem}-{}-seed{}", args.missions, args.seed)
        }
    };
    if store.phases().await?.iter().any(|phase| phase.id == name) {
        say!("Found phase {name} of an earlier demo in {}", data.root().display());
        return Ok(name);
    }
    say!("Building scenes and missions");
    let make = NewSplit {
        name: name.clone(),
        houses: args.houses,
        scenes: args.scene.iter().cloned().collect(),
        missions: if args.scene.is_some() { args.missions * 2 } else { args.missions },
        seed: Seed::Number(args.seed),
        rules: Rules::PAPER.to_owned(),
    };
    let split = make_split(data, store, make, |line| say!("{line}")).await?;
    let real = split.scenes.iter().any(|scene| matches!(scene.source, SceneSource::File { .. }));
    let open = NewPhase {
        title: Some(if real { "Practice in a real house".to_owned() } else { "Practice".to_owned() }),
        ..NewPhase::public(&name, &name)
    };
    open_phase(data, store, &open).await?;
    Ok(name)
}

/// Plays both orders with all agents, except for runs that an earlier demo completed.
async fn play(store: &Store, open: &RunningServers, phase: &str, token: &str) -> Result<(), Failure> {
    let before = runs(store, phase).await?;
    let method_of = |agent: &str| if agent == "random" { "random" } else { "PAG-Nav" };
    let done = |agent: &str, order: Order| {
        let same = |run: &&RunLine| run.method == method_of(agent) && run.order == order;
        before.iter().filter(same).any(|run| run.state == RunState::Completed)
    };
    let all = AGENTS.iter().flat_map(|&agent| ORDERS.map(|order| (agent, order)));
    let mut waiting: Vec<_> = all.filter(|&(agent, order)| !done(agent, order)).rev().collect();
    if waiting.is_empty() {
        say!("All agents have played this phase; here is the table of their runs");
        return Ok(());
    }
    say!("Running {} agents over gRPC: {} runs", AGENTS.len(), waiting.len());
    let mut watch = DemoProgress::new(store, phase, before, waiting.len()).await?;
    let mut playing: Vec<Child> = Vec::new();
    while !waiting.is_empty() || !playing.is_empty() {
        while playing.len() < RUNS_AT_ONCE
            && let Some((agent, order)) = waiting.pop()
        {
            playing.push(spawn(agent, order, open, phase, token)?);
        }
        watch.look(store, phase).await?;
        tokio::time::sleep(Duration::from_millis(250)).await;
        reap(&mut playing).await?;
    }
    watch.look(store, phase).await?;
    watch.bar.finish();
    Ok(())
}

fn spawn(
    agent: &str,
    order: Order,
    open: &RunningServers,
    phase: &str,
    token: &str,
) -> Result<Child, Failure> {
    let failed = |error| Failure::internal(format!("cannot start agent {agent}: {error}"));
    let program = std::env::current_exe().map_err(failed)?;
    let server = format!("http://{}", open.grpc);
    Command::new(program)
        .args(["agent", agent, "--server", &server, "--phase", phase, "--order", order.as_str()])
        // Not as an argument: those are visible to other users.
        .env("AVLN_TOKEN", token)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .kill_on_drop(true)
        .spawn()
        .map_err(failed)
}

/// Removes exited agents. Fails with the message from a failed agent.
async fn reap(playing: &mut Vec<Child>) -> Result<(), Failure> {
    let mut index = 0;
    while index < playing.len() {
        let ended = playing[index].try_wait().map_err(Failure::internal)?;
        if ended.is_none() {
            index += 1;
            continue;
        }
        let output = playing.swap_remove(index).wait_with_output().await;
        let output = output.map_err(Failure::internal)?;
        if !output.status.success() {
            let words = String::from_utf8_lossy(&output.stderr).trim().to_owned();
            return Err(Failure::run(format!("an agent failed ({}): {words}", output.status)));
        }
    }
    Ok(())
}

async fn runs(store: &Store, phase: &str) -> Result<Vec<RunLine>, Failure> {
    Ok(store.reader().runs(&Viewer::Organiser, Some(phase), 1000).await?)
}

/// A progress bar with the ISR of the finished episodes.
struct DemoProgress {
    bar: ProgressBar,
    before: Vec<RunLine>,
}

impl DemoProgress {
    async fn new(store: &Store, phase: &str, before: Vec<RunLine>, runs: usize) -> Result<Self, Failure> {
        let episodes = store.phase(phase).await?.episodes.len();
        let bar = styled_bar("{bar:30} {pos}/{len} episodes, {eta} left  {msg}", runs * episodes);
        Ok(Self { bar, before })
    }

    async fn look(&mut self, store: &Store, phase: &str) -> Result<(), Failure> {
        let known = |run: &RunLine| self.before.iter().any(|before| before.run == run.run);
        let new: Vec<_> = runs(store, phase).await?.into_iter().filter(|run| !known(run)).collect();
        self.bar.set_position(new.iter().map(|run| u64::from(run.done)).sum());
        let isr_of = |run: &RunLine| Some(format!("{} {} {:.2}", run.method, run.order, run.isr?));
        let mut shares: Vec<_> = new.iter().filter_map(isr_of).collect();
        shares.sort();
        let shares = if shares.is_empty() { "-".to_owned() } else { shares.join(", ") };
        self.bar.set_message(format!("ISR {shares}"));
        Ok(())
    }
}

async fn print_table(store: &Store, phase: &str) -> Result<(), Failure> {
    for order in ORDERS {
        let query = LeaderboardQuery {
            phase,
            order,
            key: Key::default(),
            pick: RunChoice::Latest,
            as_of_unix_ms: None,
            now_unix_ms: now_unix_ms(),
            filter: RowFilter::default(),
        };
        let Some(view) = store.reader().leaderboard(&Viewer::Organiser, &query).await? else { continue };
        say!("\n{order} ({} episodes a run; mean and 95 % interval over scenes)", view.phase.episodes);
        let labels = Metric::headlines().map(|metric| metric.label.to_owned()).collect();
        print_cells("rank", "method", labels);
        view.rows.iter().for_each(print_row);
    }
    Ok(())
}

fn print_row(row: &LeaderboardRow) {
    let estimates = Metric::headlines().filter_map(|metric| metric.estimate_of(&row.summary));
    let cells = estimates.map(|e| format!("{:.2} [{:.2}, {:.2}]", e.value, e.low, e.high)).collect();
    let rank = row.standing.map_or_else(|| "-".to_owned(), |standing| standing.rank.to_string());
    print_cells(&rank, &row.method, cells);
}

fn print_cells(rank: &str, method: &str, numbers: Vec<String>) {
    let numbers: Vec<String> = numbers.iter().map(|cell| format!("{cell:>17}")).collect();
    say!("{rank:>4}  {method:<12} {}", numbers.join(" "));
}

fn print_outlook(data: &DataFolder, open: &RunningServers, phase: &str, args: &DemoArgs) {
    say!("\nData folder   {}", data.root().display());
    if args.once {
        return;
    }
    say!("Leaderboard   http://{}", open.web);
    say!("Agents        http://{}", open.grpc);
    say!("Stop with     Ctrl-C; the next start continues with the same data");
    say!("Try next      avln challenge team add \"My team\"");
    say!("              avln agent random --server http://{} --phase {phase} --token TOKEN", open.grpc);
    say!("              avln demo --scene PATH/TO/HOUSE.glb");
}
