//! Sandbox from outside: folder, sockets, and the process or container inside.

use avln_arena::Failure;
use avln_sandbox::{
    Container, ControlGroup, Engine, SandboxPlan, SandboxReport, available_mib, lower_thread,
};
use std::{
    io,
    net::SocketAddr,
    os::unix::fs::MetadataExt,
    path::PathBuf,
    process::{ExitStatus, Stdio},
    thread,
    time::Duration,
};
use tempfile::TempDir;
use tokio::{
    io::{AsyncBufReadExt, AsyncWriteExt, BufReader, copy_bidirectional},
    net::{TcpStream, UnixListener, UnixStream},
    process::{Child, Command},
    runtime::Handle,
    sync::oneshot,
    task::{JoinSet, LocalSet},
    time::{sleep, timeout},
};

/// Time for a failed sandbox to write the reason, at its low priority.
const LAST_WORDS: Duration = Duration::from_secs(60);
/// Interval between looks at the available memory. In this time an agent fills some hundred megabytes.
const LOOK: Duration = Duration::from_millis(50);
/// Open connections of an agent: the server counts them as its own address, like those of a proxy in front of it.
const MAX_CONNECTIONS: usize = 16;

pub(super) enum SandboxKind {
    /// A process. `folder` is not yet set.
    Process(SandboxPlan),
    /// A container. `name` and `folder` are not yet set.
    Container(Engine, Container),
}

pub(super) enum AgentExit {
    /// With exit code 0.
    Well,
    /// With a failure, described in words.
    Badly(String),
}

pub(super) struct Sandbox {
    folder: TempDir,
    inside: Inside,
    /// Memory that remains available to others, MiB; 0 for none.
    reserve_mib: u64,
    /// Ends the proxy between the sandbox's socket and the server when the sandbox is dropped.
    _passage: oneshot::Sender<()>,
    /// The agent's control group, if this user may create one; dropped with the sandbox.
    group: Option<ControlGroup>,
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

pub(super) fn failed(what: &str, error: impl std::fmt::Display) -> Failure {
    Failure::run(format!("{what}: {error}"))
}

impl Sandbox {
    /// Creates the folder and the sockets. Connections from inside are forwarded to `server`. Fails if less memory than
    /// `reserve_mib` is available.
    pub(super) async fn prepare(
        kind: &SandboxKind,
        server: SocketAddr,
        reserve_mib: u64,
    ) -> Result<Self, Failure> {
        if !has_reserve(reserve_mib) {
            return Err(Failure::run(low_memory(reserve_mib)).hinted("end other programs, or choose less"));
        }
        let unusable = |error: io::Error| failed("cannot create a folder for the sandbox", error);
        let folder = tempfile::Builder::new().prefix("avln-sandbox-").tempdir().map_err(unusable)?;
        let place = folder.path().canonicalize().map_err(unusable)?;
        let passage = start_passage(SandboxPlan::server_socket(&place), server)?;
        let mut group = None;
        let inside = match kind {
            SandboxKind::Process(plan) => {
                let control = listen(SandboxPlan::control_socket(&place))?;
                let most_mib = available_mib().map(|mib| mib.saturating_sub(reserve_mib));
                group = ControlGroup::create(&place, most_mib);
                let plan = SandboxPlan { folder: place, ..plan.clone() };
                let plan = plan.write().map_err(Failure::run)?;
                Inside::Process { control, plan, running: None }
            }
            SandboxKind::Container(engine, container) => {
                let owner = std::fs::metadata(&place).map_err(unusable)?;
                let owner = (owner.uid(), owner.gid());
                let has_share = engine.has_shares(owner.0);
                Inside::Container(*engine, Container { folder: place, owner, has_share, ..container.clone() })
            }
        };
        Ok(Self { folder, inside, reserve_mib, _passage: passage, group })
    }

    /// Returns a word for the run's record.
    pub(super) fn kind(&self) -> &'static str {
        match &self.inside {
            Inside::Process { .. } => "process",
            Inside::Container(engine, _) => engine.program(),
        }
    }

    /// Starts the sandboxed process and returns the restrictions. A container starts only with its run.
    pub(super) async fn enter(&mut self) -> Result<SandboxReport, Failure> {
        let mut report = self.start().await?;
        if self.reserve_mib > 0 {
            let looked = available_mib().map(|_| ()).ok_or("the system does not report its available memory");
            report.note(&format!("end below {} MiB of available memory", self.reserve_mib), looked);
        }
        Ok(report)
    }

    async fn start(&mut self) -> Result<SandboxReport, Failure> {
        match &mut self.inside {
            Inside::Process { control, plan, running } => {
                let mut supervisor = spawn_supervisor(plan)?;
                let mut child_socket = tokio::select! {
                    accepted = control.accept() => BufReader::new(accepted.map_err(|error| failed("the sandbox", error))?.0),
                    _ = supervisor.wait() => return Err(Failure::run("the sandbox could not be started")),
                };
                let mut line = String::new();
                let read = child_socket.read_line(&mut line).await;
                read.map_err(|error| failed("the sandbox did not report", error))?;
                let Ok(report) = serde_json::from_str(&line) else {
                    // The process inside writes the reason before it ends; a dropped supervisor would kill it.
                    let _ = timeout(LAST_WORDS, supervisor.wait()).await;
                    let message = "the sandbox could not be started; the reason is printed above";
                    return Err(Failure::run(message));
                };
                *running = Some(Box::new((supervisor, child_socket)));
                Ok(report)
            }
            Inside::Container(_, container) => Ok(container.report()),
        }
    }

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
                let sent = child_socket.get_mut().write_all(line.as_bytes()).await;
                sent.map_err(|error| failed("the agent left before its run", error))?;
                (supervisor, None)
            }
            Inside::Process { .. } => return Err(Failure::internal("the sandbox is empty")),
            Inside::Container(engine, container) => {
                let container = Container { name: format!("avln-{run}"), ..container };
                (spawn_container(engine, &container, token)?, Some((engine, container.name)))
            }
        };
        let stopped = || format!("the agent was stopped: {}", low_memory(self.reserve_mib));
        let outcome = tokio::select! {
            status = child.wait() => Ok(status),
            () = sleep(limit) => Err(format!("the agent was stopped after {wall_s} s (--wall-s)")),
            () = memory_shortage(self.reserve_mib) => Err(stopped()),
        };
        let is_full = self.group.as_ref().is_some_and(ControlGroup::is_out_of_memory);
        let ended = match outcome {
            Ok(_) if is_full => AgentExit::Badly(stopped()),
            Ok(status) => ended(status.map_err(|error| failed("the agent", error))?),
            Err(why) => {
                stop(&mut child, container).await;
                AgentExit::Badly(why)
            }
        };
        drop(self.folder);
        Ok(ended)
    }
}

/// Waits until less than `reserve_mib` of memory is available.
async fn memory_shortage(reserve_mib: u64) {
    while has_reserve(reserve_mib) {
        sleep(LOOK).await;
    }
}

/// Returns whether more than `reserve_mib` of memory is available; true if there is no reserve, or the system reports nothing.
fn has_reserve(reserve_mib: u64) -> bool {
    reserve_mib == 0 || available_mib().is_none_or(|available| available > reserve_mib)
}

fn low_memory(reserve_mib: u64) -> String {
    format!("this machine has less than {reserve_mib} MiB of available memory (--reserve-mib)")
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

/// Starts the proxy; it ends when the sender is dropped. Its thread has the agent's low priority, because the agent's traffic must not
/// delay others either.
fn start_passage(path: PathBuf, server: SocketAddr) -> Result<oneshot::Sender<()>, Failure> {
    let (passage, ended) = oneshot::channel();
    let (listener, runtime) = (listen(path)?, Handle::current());
    let work = move || {
        lower_thread();
        runtime.block_on(LocalSet::new().run_until(async {
            tokio::select! {
                () = pass(listener, server) => {}
                _ = ended => {}
            }
        }));
    };
    let started = thread::Builder::new().name("sealed-proxy".to_owned()).spawn(work);
    started.map_err(|error| failed("cannot start the proxy of the sandbox", error))?;
    Ok(passage)
}

async fn pass(listener: UnixListener, server: SocketAddr) {
    let mut connections = JoinSet::new();
    loop {
        // Further connections wait in the socket's queue.
        while connections.len() >= MAX_CONNECTIONS {
            connections.join_next().await;
        }
        let Ok((mut inside, _)) = listener.accept().await else { continue };
        // On this thread, for its priority.
        connections.spawn_local(async move {
            let Ok(mut outside) = TcpStream::connect(server).await else { return };
            // Steps are small messages, which must not wait for more data.
            let _ = outside.set_nodelay(true);
            // Either side may close at any time. The error is irrelevant, because the other side sees the
            // stream's end.
            let _ = copy_bidirectional(&mut inside, &mut outside).await;
        });
        while connections.try_join_next().is_some() {}
    }
}
