//! Sealed runs: the organiser runs an agent that reaches nothing but the server.

use super::sealed_cell::{Cell, Ended, Way};
use crate::output::say;
use avln_arena::{
    Arena, Failure, FailureKind, SCENE_MEMORY_MIB,
    data::DataFolder,
    now_unix_ms,
    sealed::{Wanted, start},
    servers::{Addresses, RunningServers, Servers},
};
use avln_episode::Order;
use avln_sandbox::Report;
use avln_store::{RunState, Store};
use clap::{Args, Subcommand};
use std::{
    net::SocketAddr,
    path::{Path, PathBuf},
    process,
    sync::Arc,
};

/// Commands about sealed runs.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Run an agent as a process or in a container, without network but the server's socket, and play one run of a team
    Run(Box<Run>),
    /// What the program calls itself with, to shut an agent in
    #[command(hide = true)]
    Enter(Enter),
}

/// Who plays what, and what it may use.
#[derive(Clone, Debug, Args)]
pub struct Run {
    /// Phase to play in
    #[arg(long, value_name = "ID")]
    pub phase: String,
    /// The team whose run it is
    #[arg(long)]
    pub team: String,
    /// Name of the method on the board
    #[arg(long, value_name = "NAME")]
    pub method: String,
    /// Version of the method
    #[arg(long, default_value = "", value_name = "VERSION")]
    pub method_version: String,
    /// Order of the missions: ordered or unordered
    #[arg(long, default_value = "unordered", value_parser = order)]
    pub order: Order,
    /// Agents' door of a server that hosts this data folder in plain text; by default the command hosts it by itself, and no
    /// other server may
    #[arg(long, value_name = "ADDRESS")]
    pub server: Option<SocketAddr>,
    /// Run a container of this image by Podman or Docker, instead of a process; COMMAND may then be left out
    #[arg(long, value_name = "IMAGE")]
    pub image: Option<String>,
    /// Seconds after which the agent is stopped
    #[arg(long, default_value_t = 86_400, value_parser = clap::value_parser!(u64).range(1..=2_592_000), value_name = "S")]
    pub wall_s: u64,
    /// MiB that the container may use, or that each process may map; any by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(16..), value_name = "MIB")]
    pub memory_mib: Option<u32>,
    /// Let the process read this too, beside the system's programs, the present folder and all below it
    #[arg(long, value_name = "PATH", conflicts_with = "image")]
    pub read: Vec<PathBuf>,
    /// Let the agent use this device, such as /dev/nvidia0
    #[arg(long, value_name = "PATH")]
    pub device: Vec<PathBuf>,
    /// Give the process this variable of the environment
    #[arg(long, value_name = "NAME", conflicts_with = "image")]
    pub env: Vec<String>,
    /// Refuse to run where the system cannot enforce everything
    #[arg(long)]
    pub require_all: bool,
    /// The agent's program and its arguments. It finds the server's address in AVLN_SERVER and its run's token in AVLN_TOKEN
    #[arg(last = true, required_unless_present = "image", value_name = "COMMAND")]
    pub command: Vec<String>,
}

/// A step into the cell.
#[derive(Clone, Debug, Args)]
pub struct Enter {
    /// Plan of the cell
    plan: PathBuf,
    /// The second step, inside
    #[arg(long)]
    inmate: bool,
    /// Why the second step is not inside
    #[arg(long, requires = "inmate")]
    outside: Option<String>,
}

fn order(word: &str) -> Result<Order, String> {
    [Order::Ordered, Order::Unordered]
        .into_iter()
        .find(|order| order.as_str() == word)
        .ok_or_else(|| "use ordered or unordered".to_owned())
}

impl Enter {
    /// Takes the step; comes back only from the first one, to leave with the agent's exit code, and when it failed.
    ///
    /// # Errors
    /// When the agent cannot be shut in or started.
    pub fn take(self) -> Result<(), Failure> {
        let failed = |error: avln_sandbox::CellError| Failure::new(FailureKind::Run, error);
        if self.inmate {
            return avln_sandbox::shut(&self.plan, self.outside.as_deref()).map(|_| ()).map_err(failed);
        }
        let again = ["challenge", "sealed", "enter", "--inmate"].map(String::from);
        let arguments = [again.as_slice(), &[self.plan.display().to_string()]].concat();
        let code =
            avln_sandbox::enter(&self.plan, Path::new("/proc/self/exe"), &arguments).map_err(failed)?;
        process::exit(code.into())
    }
}

/// Carries out a command about sealed runs.
///
/// # Errors
/// When the agent cannot be shut in, its run cannot be started, or it did not play it to the end.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Run(options) => play(data, *options).await,
        Command::Enter(step) => step.take(),
    }
}

async fn play(data: &Path, options: Run) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    let way = Way::choose(&data, &options)?;
    let host = Host::open(&data, &store, options.server).await?;
    let played = match Cell::prepare(&way, host.address()).await {
        Ok(cell) => play_in(cell, &data, &store, &options).await,
        Err(failure) => Err(failure),
    };
    host.close().await?;
    store.close().await;
    played
}

async fn play_in(mut cell: Cell, data: &DataFolder, store: &Store, options: &Run) -> Result<(), Failure> {
    let report = cell.enter().await?;
    tell(&report);
    if options.require_all && !report.missing.is_empty() {
        cell.abandon().await;
        return Err(Failure::new(
            FailureKind::Run,
            "this system cannot enforce everything; no run was started",
        )
        .hinted("use a newer Linux, or leave --require-all away"));
    }
    let Run { phase, team, method, method_version, order, .. } = options;
    let wanted = Wanted { phase, team, method, version: method_version, order: *order };
    let missing: Vec<_> = report.missing.iter().map(|gap| format!("{}: {}", gap.what, gap.why)).collect();
    let enforced = format!("{}: {}", cell.kind(), report.enforced.join("; "));
    let started = start(data, store, &wanted, enforced, missing.join("; ")).await;
    let ticket = match started {
        Ok(ticket) => ticket,
        Err(failure) => {
            cell.abandon().await;
            return Err(failure);
        }
    };
    say!("run      {}", ticket.run);
    let ended = cell.play(&ticket.run, &ticket.token, options.wall_s).await;
    conclude(store, &ticket.run, ended).await
}

fn tell(report: &Report) {
    say!("sealed   {}", report.enforced.join("; "));
    for gap in &report.missing {
        eprintln!("warning: not enforced: {}: {}", gap.what, gap.why);
    }
}

/// Ends a run that its agent left, and says how it went.
async fn conclude(store: &Store, run: &str, ended: Result<Ended, Failure>) -> Result<(), Failure> {
    let mut found = store.run(run).await?;
    if found.state.is_open() {
        found = store.cancel_run(run, now_unix_ms()).await?;
    }
    let how = ended?;
    say!("played   {} of {} episodes", found.done, found.episodes);
    match (found.state, how) {
        (RunState::Completed, Ended::Well) => Ok(()),
        (_, Ended::Well) => {
            let message = format!("the agent left after {} of {} episodes", found.done, found.episodes);
            Err(Failure::new(FailureKind::Run, message).hinted("the run is cancelled; what was scored stays"))
        }
        (state, Ended::Badly(why)) => {
            Err(Failure::new(FailureKind::Run, format!("{why}; the run is {}", state.as_str())))
        }
    }
}

/// Who hosts the data folder while the agent plays.
enum Host {
    Own(Box<RunningServers>),
    Other(SocketAddr),
}

impl Host {
    async fn open(data: &DataFolder, store: &Store, server: Option<SocketAddr>) -> Result<Self, Failure> {
        if let Some(address) = server {
            avln_client::Arena::connect(format!("http://{address}"), "").await.map_err(Failure::run)?;
            return Ok(Self::Other(address));
        }
        if store.open_runs().await?.iter().any(|run| run.state == RunState::Running) {
            let message = "runs of this data folder are being played, so a server may be hosting it";
            return Err(Failure::new(FailureKind::Data, message).hinted(
                "name its agents' door with --server 127.0.0.1:50051, or start it with: avln serve",
            ));
        }
        let doors = Servers::bind(&Addresses::LOCAL).await?;
        let arena = Arena::open(data, store.clone(), SCENE_MEMORY_MIB).await?;
        Ok(Self::Own(Box::new(doors.open(Arc::new(arena), store.reader())?)))
    }

    fn address(&self) -> SocketAddr {
        match self {
            Self::Own(doors) => doors.grpc,
            Self::Other(address) => *address,
        }
    }

    async fn close(self) -> Result<(), Failure> {
        match self {
            Self::Own(doors) => doors.close().await,
            Self::Other(_) => Ok(()),
        }
    }
}
