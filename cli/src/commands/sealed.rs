//! Sealed runs: the organiser runs an agent that can reach only the server.

use super::sealed_sandbox::{AgentExit, Sandbox, SandboxKind, failed};
use crate::output::say;
use avln_arena::{
    Arena, Failure,
    actions::{SealedRunRequest, start_sealed_run},
    data::DataFolder,
    now_unix_ms,
    servers::RunningServers,
};
use avln_episode::Order;
use avln_sandbox::{Container, Engine, SandboxPlan, SandboxReport};
use avln_store::{MethodType, RunState, Store};
use clap::{
    Args, Subcommand,
    builder::{PossibleValuesParser, TypedValueParser},
};
use std::{
    fs::File,
    net::SocketAddr,
    path::{Path, PathBuf},
    process,
};

#[derive(Debug, Subcommand)]
pub(crate) enum SealedCommand {
    /// Play a team's run with an agent in a sandboxed process or container that reaches only the server's
    /// socket
    Run(Box<SealedRunArgs>),
    /// Internal: start the sandbox
    #[command(hide = true)]
    Enter(EnterArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct SealedRunArgs {
    /// Phase id
    #[arg(long, value_name = "ID")]
    phase: String,
    /// Team name
    #[arg(long)]
    team: String,
    /// Method name on leaderboards
    #[arg(long, value_name = "NAME")]
    method: String,
    /// Method version
    #[arg(long, default_value = "", value_name = "VERSION")]
    method_version: String,
    /// Method type on leaderboards
    #[arg(long, value_name = "TYPE", value_parser = method_type_parser())]
    method_type: Option<MethodType>,
    /// Goal order: ordered or unordered
    #[arg(long, default_value = "unordered")]
    order: Order,
    /// gRPC address of a plain-text server for this data folder; by default the command hosts the folder
    /// itself, and no other server may run
    #[arg(long, value_name = "ADDRESS")]
    server: Option<SocketAddr>,
    /// Container image for Podman or Docker, instead of a process; COMMAND is then optional
    #[arg(long, value_name = "IMAGE")]
    image: Option<String>,
    /// Time limit in seconds
    #[arg(long, default_value_t = 86_400, value_parser = clap::value_parser!(u64).range(1..=2_592_000), value_name = "S")]
    wall_s: u64,
    /// Memory limit for the container or each process in MiB; unlimited by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(16..), value_name = "MIB")]
    memory_mib: Option<u32>,
    /// Stop the agent when less than this is available of the machine's memory, in MiB; an eighth by default, 0
    /// for never
    #[arg(long, value_name = "MIB")]
    reserve_mib: Option<u64>,
    /// Additional readable path, besides system programs and the current folder
    #[arg(long, value_name = "PATH", conflicts_with = "image")]
    read: Vec<PathBuf>,
    /// Device for the agent, such as /dev/nvidia0
    #[arg(long, value_name = "PATH")]
    device: Vec<PathBuf>,
    /// Environment variable to pass to the process
    #[arg(long, value_name = "NAME", conflicts_with = "image")]
    env: Vec<String>,
    /// Fail if the system cannot enforce all restrictions
    #[arg(long)]
    require_all: bool,
    /// Agent command; the environment contains AVLN_SERVER (address) and AVLN_TOKEN (run token)
    #[arg(last = true, required_unless_present = "image", value_name = "COMMAND")]
    command: Vec<String>,
}

#[derive(Clone, Debug, Args)]
pub(crate) struct EnterArgs {
    /// File with the sandbox plan
    plan: PathBuf,
    /// Second step, in the new namespaces
    #[arg(long)]
    inmate: bool,
    /// Reason for a second step outside namespaces
    #[arg(long, requires = "inmate")]
    outside: Option<String>,
}

impl EnterArgs {
    /// Runs the step. The first step exits the process with the agent's exit code.
    pub(crate) fn take(self) -> Result<(), Failure> {
        let failed = |error: avln_sandbox::SandboxError| Failure::run(error);
        if self.inmate {
            return avln_sandbox::enter(&self.plan, self.outside.as_deref()).map(|_| ()).map_err(failed);
        }
        let again = ["challenge", "sealed", "enter", "--inmate"].map(String::from);
        let arguments = [again.as_slice(), &[self.plan.display().to_string()]].concat();
        let code =
            avln_sandbox::supervise(&self.plan, Path::new("/proc/self/exe"), &arguments).map_err(failed)?;
        process::exit(code.into())
    }
}

pub(crate) async fn run(data: &Path, command: SealedCommand) -> Result<(), Failure> {
    match command {
        SealedCommand::Run(args) => play(data, *args).await,
        SealedCommand::Enter(step) => step.take(),
    }
}

async fn play(data: &Path, args: SealedRunArgs) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let choice = ServerChoice::of(&data, args.server)?;
    let store = data.store().await?;
    let kind = choose_sandbox(&data, &args)?;
    let host = SealedHost::open(choice, &data, &store, &args.phase).await?;
    let reserve_mib = args.reserve_mib.unwrap_or_else(avln_sandbox::default_reserve_mib);
    let played = match Sandbox::prepare(&kind, host.address(), reserve_mib).await {
        Ok(sandbox) => play_in(sandbox, &data, &store, &args).await,
        Err(failure) => Err(failure),
    };
    host.close().await?;
    store.close().await;
    played
}

async fn play_in(
    mut sandbox: Sandbox,
    data: &DataFolder,
    store: &Store,
    args: &SealedRunArgs,
) -> Result<(), Failure> {
    // Before the run: if the sandbox fails, no quota is used.
    let report = sandbox.enter().await?;
    tell(&report);
    if args.require_all && !report.missing.is_empty() {
        sandbox.abandon().await;
        return Err(Failure::run("this system cannot enforce everything; no run was started")
            .hinted("use a newer Linux, or omit --require-all"));
    }
    let SealedRunArgs { phase, team, method, method_version, method_type, order, .. } = args;
    let wanted = SealedRunRequest {
        phase,
        team,
        method,
        version: method_version,
        method_type: *method_type,
        order: *order,
    };
    let missing: Vec<_> = report.missing.iter().map(|gap| format!("{}: {}", gap.what, gap.why)).collect();
    let enforced = format!("{}: {}", sandbox.kind(), report.enforced.join("; "));
    let started = start_sealed_run(data, store, &wanted, enforced, missing.join("; ")).await;
    let ticket = match started {
        Ok(ticket) => ticket,
        Err(failure) => {
            sandbox.abandon().await;
            return Err(failure);
        }
    };
    say!("run      {}", ticket.run);
    let ended = sandbox.play(&ticket.run, &ticket.token, args.wall_s).await;
    conclude(store, &ticket.run, ended).await
}

fn method_type_parser() -> impl TypedValueParser<Value = MethodType> {
    PossibleValuesParser::new(MethodType::ALL.iter().map(|known| known.as_str()))
        .try_map(|word| word.parse::<MethodType>())
}

fn tell(report: &SandboxReport) {
    say!("sealed   {}", report.enforced.join("; "));
    for gap in &report.missing {
        eprintln!("warning: not enforced: {}: {}", gap.what, gap.why);
    }
}

/// Cancels an unfinished run and reports the result.
async fn conclude(store: &Store, run: &str, ended: Result<AgentExit, Failure>) -> Result<(), Failure> {
    let mut found = store.run(run).await?;
    // The token existed only in the sandbox, so the run cannot continue.
    if found.state.is_open() {
        found = store.cancel_run(run, now_unix_ms()).await?;
    }
    let how = ended?;
    say!("played   {} of {} episodes", found.done, found.episodes);
    match (found.state, how) {
        (RunState::Completed, AgentExit::Well) => Ok(()),
        (_, AgentExit::Well) => {
            let message = format!("the agent left after {} of {} episodes", found.done, found.episodes);
            Err(Failure::run(message).hinted("the run is cancelled; its scored episodes remain"))
        }
        (state, AgentExit::Badly(why)) => Err(Failure::run(format!("{why}; the run is {}", state.as_str()))),
    }
}

/// Server for a sealed run: a folder to host, locked before the database is opened, or a running server.
enum ServerChoice {
    Own(File),
    Other(SocketAddr),
}

impl ServerChoice {
    fn of(data: &DataFolder, server: Option<SocketAddr>) -> Result<Self, Failure> {
        server.map_or_else(|| data.lock().map(Self::Own), |address| Ok(Self::Other(address)))
    }
}

enum SealedHost {
    Own(Box<RunningServers>),
    Other(SocketAddr),
}

impl SealedHost {
    async fn open(
        choice: ServerChoice,
        data: &DataFolder,
        store: &Store,
        phase: &str,
    ) -> Result<Self, Failure> {
        match choice {
            ServerChoice::Own(lock) => {
                let arena = Arena::open_phase(lock, data, store.clone(), phase).await?;
                Ok(Self::Own(Box::new(RunningServers::local_for(arena, store).await?)))
            }
            ServerChoice::Other(address) => {
                let url = format!("http://{address}");
                avln_client::Client::connect(url, "").await.map_err(Failure::run)?;
                Ok(Self::Other(address))
            }
        }
    }

    fn address(&self) -> SocketAddr {
        match self {
            Self::Own(servers) => servers.grpc,
            Self::Other(address) => *address,
        }
    }

    async fn close(self) -> Result<(), Failure> {
        match self {
            Self::Own(servers) => servers.close().await,
            Self::Other(_) => Ok(()),
        }
    }
}

fn choose_sandbox(data: &DataFolder, args: &SealedRunArgs) -> Result<SandboxKind, Failure> {
    let nowhere = PathBuf::new();
    let Some(image) = &args.image else {
        let workplace = std::env::current_dir().map_err(|error| failed("the current folder", error))?;
        return Ok(SandboxKind::Process(SandboxPlan {
            folder: nowhere,
            command: args.command.clone(),
            workplace,
            hidden: data.root().to_owned(),
            readable: args.read.iter().map(|path| checked(path)).collect::<Result<_, _>>()?,
            devices: args.device.iter().map(|path| checked(path)).collect::<Result<_, _>>()?,
            memory_mib: args.memory_mib,
            variables: args.env.clone(),
        }));
    };
    let engine = Engine::find(&std::env::var_os("PATH").unwrap_or_default()).ok_or_else(|| {
        Failure::run("neither podman nor docker is installed, so no image can be run")
            .hinted("install one of them, or omit --image to run the agent as a process")
    })?;
    Ok(SandboxKind::Container(
        engine,
        Container {
            image: image.clone(),
            command: args.command.clone(),
            name: String::new(),
            folder: nowhere,
            owner: (0, 0),
            memory_mib: args.memory_mib,
            devices: args.device.clone(),
            has_share: false,
        },
    ))
}

fn checked(path: &std::path::Path) -> Result<PathBuf, Failure> {
    path.canonicalize().map_err(|error| failed(&format!("cannot use {}", path.display()), error))
}
