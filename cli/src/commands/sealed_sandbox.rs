//! The outer side of a sandbox: its folder, its sockets, and the process or container inside.

use super::sealed::SealedRunArgs;
use avln_arena::{Failure, FailureKind, data::DataFolder};
use avln_sandbox::{Container, Engine, SandboxPlan, SandboxReport};
use std::{
    io,
    net::SocketAddr,
    os::unix::fs::MetadataExt,
    path::PathBuf,
    process::{ExitStatus, Stdio},
    time::Duration,
};
use tempfile::TempDir;
use tokio::{
    io::{AsyncBufReadExt, AsyncWriteExt, BufReader, copy_bidirectional},
    net::{TcpStream, UnixListener, UnixStream},
    process::{Child, Command},
    task::JoinSet,
    time::timeout,
};

/// The kind of sandbox.
pub(super) enum SandboxKind {
    /// A process. `folder` of the plan is not yet set.
    Process(SandboxPlan),
    /// A container. Its name and folder are not yet set.
    Container(Engine, Container),
}

/// The exit of an agent.
pub(super) enum AgentExit {
    /// With exit code 0.
    Well,
    /// With a failure, described in words.
    Badly(String),
}

/// A prepared or running sandbox.
pub(super) struct Sandbox {
    folder: TempDir,
    inside: Inside,
    /// Proxy between the sandbox's socket and the server; dropped with the sandbox.
    _passage: JoinSet<()>,
}

enum Inside {
    /// The supervisor process; `running` is set once it has started.
    Process {
        control: UnixListener,
        plan: PathBuf,
        running: Option<Box<(Child, BufReader<UnixStream>)>>,
    },
    Container(Engine, Container),
}

fn failed(what: &str, error: impl std::fmt::Display) -> Failure {
    Failure::new(FailureKind::Run, format!("{what}: {error}"))
}

impl SandboxKind {
    /// Returns the kind for the arguments.
    pub(super) fn choose(data: &DataFolder, args: &SealedRunArgs) -> Result<Self, Failure> {
        let nowhere = PathBuf::new();
        let Some(image) = &args.image else {
            let workplace = std::env::current_dir().map_err(|error| failed("the current folder", error))?;
            return Ok(Self::Process(SandboxPlan {
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
            Failure::new(FailureKind::Run, "neither podman nor docker is installed, so no image can be run")
                .hinted("install one of them, or omit --image to run the agent as a process")
        })?;
        Ok(Self::Container(
            engine,
            Container {
                image: image.clone(),
                command: args.command.clone(),
                name: String::new(),
                folder: nowhere,
                owner: (0, 0),
                memory_mib: args.memory_mib,
                devices: args.device.clone(),
            },
        ))
    }
}

fn checked(path: &std::path::Path) -> Result<PathBuf, Failure> {
    path.canonicalize().map_err(|error| failed(&format!("cannot use {}", path.display()), error))
}

impl Sandbox {
    /// Creates the folder and the sockets. Connections from inside are forwarded to `server`.
    pub(super) async fn prepare(kind: &SandboxKind, server: SocketAddr) -> Result<Self, Failure> {
        let unusable = |error: io::Error| failed("cannot create a folder for the sandbox", error);
        let folder = tempfile::Builder::new().prefix("avln-sandbox-").tempdir().map_err(unusable)?;
        let place = folder.path().canonicalize().map_err(unusable)?;
        let mut passage = JoinSet::new();
        passage.spawn(pass(listen(SandboxPlan::server_socket(&place))?, server));
        let inside = match kind {
            SandboxKind::Process(plan) => {
                let control = listen(SandboxPlan::control_socket(&place))?;
                let plan = SandboxPlan { folder: place, ..plan.clone() };
                let plan = plan.write().map_err(|error| Failure::new(FailureKind::Run, error))?;
                Inside::Process { control, plan, running: None }
            }
            SandboxKind::Container(engine, container) => {
                let owner = std::fs::metadata(&place).map_err(unusable)?;
                let owner = (owner.uid(), owner.gid());
                Inside::Container(*engine, Container { folder: place, owner, ..container.clone() })
            }
        };
        Ok(Self { folder, inside, _passage: passage })
    }

    /// A word for the facts of the run.
    pub(super) fn kind(&self) -> &'static str {
        match &self.inside {
            Inside::Process { .. } => "process",
            Inside::Container(engine, _) => engine.program(),
        }
    }

    /// Starts the sandboxed process, which waits for its run, and returns the enforced restrictions. A container starts only with its
    /// run.
    pub(super) async fn enter(&mut self) -> Result<SandboxReport, Failure> {
        match &mut self.inside {
            Inside::Process { control, plan, running } => {
                let mut supervisor = spawn_supervisor(plan)?;
                let mut child_socket = tokio::select! {
                    accepted = control.accept() => BufReader::new(accepted.map_err(|error| failed("the sandbox", error))?.0),
                    _ = supervisor.wait() => return Err(Failure::new(FailureKind::Run, "the sandbox could not be started")),
                };
                let mut line = String::new();
                let read = child_socket.read_line(&mut line).await;
                read.map_err(|error| failed("the sandbox did not report", error))?;
                let report = serde_json::from_str(&line).map_err(|_| {
                    Failure::new(
                        FailureKind::Run,
                        "the sandbox could not be started; the reason is printed above",
                    )
                })?;
                *running = Some(Box::new((supervisor, child_socket)));
                Ok(report)
            }
            Inside::Container(..) => {
                Ok(SandboxReport { enforced: Container::ENFORCED.map(String::from).into(), missing: vec![] })
            }
        }
    }

    /// Stops the agent without a run.
    pub(super) async fn abandon(self) {
        if let Inside::Process { running: Some(running), .. } = self.inside {
            let (mut supervisor, child_socket) = *running;
            let _ = supervisor.kill().await;
            drop(child_socket);
        }
    }

    /// Plays the run, for at most `wall_s` seconds.
    pub(super) async fn play(self, run: &str, token: &str, wall_s: u64) -> Result<AgentExit, Failure> {
        let limit = Duration::from_secs(wall_s);
        let (mut child, container) = match self.inside {
            Inside::Process { running: Some(running), .. } => {
                let (supervisor, mut child_socket) = *running;
                let line = format!("{token}\n");
                let told = child_socket.get_mut().write_all(line.as_bytes()).await;
                told.map_err(|error| failed("the agent left before its run", error))?;
                (supervisor, None)
            }
            Inside::Process { .. } => {
                return Err(Failure::new(FailureKind::Internal, "the sandbox is empty"));
            }
            Inside::Container(engine, container) => {
                let container = Container { name: format!("avln-{run}"), ..container };
                (spawn_container(engine, &container, token)?, Some((engine, container.name)))
            }
        };
        let ended = match timeout(limit, child.wait()).await {
            Ok(status) => ended(status.map_err(|error| failed("the agent", error))?),
            Err(_) => {
                stop(&mut child, container).await;
                AgentExit::Badly(format!("the agent was stopped after {wall_s} s (--wall-s)"))
            }
        };
        drop(self.folder);
        Ok(ended)
    }
}

fn ended(status: ExitStatus) -> AgentExit {
    if status.success() { AgentExit::Well } else { AgentExit::Badly(format!("the agent failed ({status})")) }
}

async fn stop(child: &mut Child, container: Option<(Engine, String)>) {
    if let Some((engine, name)) = container {
        let _ = Command::new(engine.program()).args(["kill", &name]).stdout(Stdio::null()).status().await;
    }
    let _ = child.kill().await;
}

fn spawn_supervisor(plan: &std::path::Path) -> Result<Child, Failure> {
    let program = std::env::current_exe().map_err(|error| failed("cannot find this program", error))?;
    Command::new(program)
        .args(["challenge", "sealed", "enter"])
        .arg(plan)
        .stdin(Stdio::null())
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| failed("cannot start the sandbox", error))
}

fn spawn_container(engine: Engine, container: &Container, token: &str) -> Result<Child, Failure> {
    Command::new(engine.program())
        .args(container.arguments(engine))
        .env("AVLN_TOKEN", token)
        .stdin(Stdio::null())
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| failed(&format!("cannot start {}", engine.program()), error))
}

fn listen(path: PathBuf) -> Result<UnixListener, Failure> {
    UnixListener::bind(&path).map_err(|error| {
        failed(&format!("cannot create the socket {}", path.display()), error)
            .hinted("set TMPDIR to a folder with a short path")
    })
}

/// Forwards connections to the server.
async fn pass(listener: UnixListener, server: SocketAddr) {
    let mut connections = JoinSet::new();
    loop {
        let Ok((mut inside, _)) = listener.accept().await else { continue };
        connections.spawn(async move {
            let Ok(mut outside) = TcpStream::connect(server).await else { return };
            let _ = outside.set_nodelay(true);
            // Either side may close at any time; the error is of no interest, because the other side sees the end of the stream.
            let _ = copy_bidirectional(&mut inside, &mut outside).await;
        });
        while connections.try_join_next().is_some() {}
    }
}
