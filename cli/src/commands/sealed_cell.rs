//! The organiser's side of a cell: its folder, its sockets, and the process or container inside.

use super::sealed::Run;
use avln_arena::{Failure, FailureKind, data::DataFolder};
use avln_sandbox::{Container, Engine, Plan, Report};
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

/// What is shut in, and how.
pub(super) enum Way {
    /// A process; `folder` of the plan is still to be made.
    Process(Plan),
    /// A container; its name and folder are still to be made.
    Container(Engine, Container),
}

/// How an agent ended.
pub(super) enum Ended {
    /// With exit code 0.
    Well,
    /// In another way, in words.
    Badly(String),
}

/// Where an agent is shut in.
pub(super) struct Cell {
    folder: TempDir,
    inside: Inside,
    /// Passes bytes between the cell's socket and the server; ends with the cell.
    _passage: JoinSet<()>,
}

enum Inside {
    /// The porter, before and after it was started.
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

impl Way {
    /// What the command line asks for.
    pub(super) fn choose(data: &DataFolder, options: &Run) -> Result<Self, Failure> {
        let nowhere = PathBuf::new();
        let Some(image) = &options.image else {
            let workplace = std::env::current_dir().map_err(|error| failed("the present folder", error))?;
            return Ok(Self::Process(Plan {
                folder: nowhere,
                command: options.command.clone(),
                workplace,
                hidden: data.root().to_owned(),
                readable: options.read.iter().map(|path| checked(path)).collect::<Result<_, _>>()?,
                devices: options.device.iter().map(|path| checked(path)).collect::<Result<_, _>>()?,
                memory_mib: options.memory_mib,
                variables: options.env.clone(),
            }));
        };
        let engine = Engine::find(&std::env::var_os("PATH").unwrap_or_default()).ok_or_else(|| {
            Failure::new(FailureKind::Run, "neither podman nor docker is installed, so no image can be run")
                .hinted("install one of them, or run the agent as a process: leave --image away")
        })?;
        Ok(Self::Container(
            engine,
            Container {
                image: image.clone(),
                command: options.command.clone(),
                name: String::new(),
                folder: nowhere,
                owner: (0, 0),
                memory_mib: options.memory_mib,
                devices: options.device.clone(),
            },
        ))
    }
}

fn checked(path: &std::path::Path) -> Result<PathBuf, Failure> {
    path.canonicalize().map_err(|error| failed(&format!("cannot use {}", path.display()), error))
}

impl Cell {
    /// Makes the cell's folder and opens its sockets; who connects from inside gets to the server at `server`.
    pub(super) async fn prepare(way: &Way, server: SocketAddr) -> Result<Self, Failure> {
        let unusable = |error: io::Error| failed("cannot make a folder for the cell", error);
        let folder = tempfile::Builder::new().prefix("avln-sandbox-").tempdir().map_err(unusable)?;
        let place = folder.path().canonicalize().map_err(unusable)?;
        let mut passage = JoinSet::new();
        passage.spawn(pass(listen(Plan::server_socket(&place))?, server));
        let inside = match way {
            Way::Process(plan) => {
                let control = listen(Plan::control_socket(&place))?;
                let plan = Plan { folder: place, ..plan.clone() };
                let plan = plan.write().map_err(|error| Failure::new(FailureKind::Run, error))?;
                Inside::Process { control, plan, running: None }
            }
            Way::Container(engine, container) => {
                let owner = std::fs::metadata(&place).map_err(unusable)?;
                let owner = (owner.uid(), owner.gid());
                Inside::Container(*engine, Container { folder: place, owner, ..container.clone() })
            }
        };
        Ok(Self { folder, inside, _passage: passage })
    }

    /// In a word, for the run's facts.
    pub(super) fn kind(&self) -> &'static str {
        match &self.inside {
            Inside::Process { .. } => "process",
            Inside::Container(engine, _) => engine.program(),
        }
    }

    /// Shuts the process in and says what holds; it waits for its run. A container is not started before its run.
    pub(super) async fn enter(&mut self) -> Result<Report, Failure> {
        match &mut self.inside {
            Inside::Process { control, plan, running } => {
                let mut porter = spawn_porter(plan)?;
                let mut inmate = tokio::select! {
                    accepted = control.accept() => BufReader::new(accepted.map_err(|error| failed("the cell", error))?.0),
                    _ = porter.wait() => return Err(Failure::new(FailureKind::Run, "the agent could not be shut in")),
                };
                let mut line = String::new();
                let read = inmate.read_line(&mut line).await;
                read.map_err(|error| failed("the cell did not report", error))?;
                let report = serde_json::from_str(&line).map_err(|_| {
                    Failure::new(FailureKind::Run, "the agent could not be shut in; the reason stands above")
                })?;
                *running = Some(Box::new((porter, inmate)));
                Ok(report)
            }
            Inside::Container(..) => {
                Ok(Report { enforced: Container::ENFORCED.map(String::from).into(), missing: vec![] })
            }
        }
    }

    /// Lets the agent go without a run.
    pub(super) async fn abandon(self) {
        if let Inside::Process { running: Some(running), .. } = self.inside {
            let (mut porter, inmate) = *running;
            let _ = porter.kill().await;
            drop(inmate);
        }
    }

    /// Has the agent play the run, for `wall_s` seconds at most.
    pub(super) async fn play(self, run: &str, token: &str, wall_s: u64) -> Result<Ended, Failure> {
        let limit = Duration::from_secs(wall_s);
        let (mut child, container) = match self.inside {
            Inside::Process { running: Some(running), .. } => {
                let (porter, mut inmate) = *running;
                let line = format!("{token}\n");
                let told = inmate.get_mut().write_all(line.as_bytes()).await;
                told.map_err(|error| failed("the agent left before its run", error))?;
                (porter, None)
            }
            Inside::Process { .. } => {
                return Err(Failure::new(FailureKind::Internal, "nobody is in the cell"));
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
                Ended::Badly(format!("the agent was stopped after {wall_s} s (--wall-s)"))
            }
        };
        drop(self.folder);
        Ok(ended)
    }
}

fn ended(status: ExitStatus) -> Ended {
    if status.success() { Ended::Well } else { Ended::Badly(format!("the agent failed ({status})")) }
}

async fn stop(child: &mut Child, container: Option<(Engine, String)>) {
    if let Some((engine, name)) = container {
        let _ = Command::new(engine.program()).args(Engine::kill(&name)).stdout(Stdio::null()).status().await;
    }
    let _ = child.kill().await;
}

fn spawn_porter(plan: &std::path::Path) -> Result<Child, Failure> {
    let program = std::env::current_exe().map_err(|error| failed("cannot find this program", error))?;
    Command::new(program)
        .args(["challenge", "sealed", "enter"])
        .arg(plan)
        .stdin(Stdio::null())
        .kill_on_drop(true)
        .spawn()
        .map_err(|error| failed("cannot start the cell", error))
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
        failed(&format!("cannot make the socket {}", path.display()), error)
            .hinted("name a folder with a short path in TMPDIR")
    })
}

/// Passes bytes between whoever connects and the server.
async fn pass(listener: UnixListener, server: SocketAddr) {
    let mut connections = JoinSet::new();
    loop {
        let Ok((mut inside, _)) = listener.accept().await else { continue };
        connections.spawn(async move {
            let Ok(mut outside) = TcpStream::connect(server).await else { return };
            let _ = outside.set_nodelay(true);
            // Either side may go at any time; the other sees the end.
            let _ = copy_bidirectional(&mut inside, &mut outside).await;
        });
        while connections.try_join_next().is_some() {}
    }
}
