//! A life of the simulated server: from its start to a crash or an orderly stop; unary calls to it.

use super::{
    database::Database,
    host::{Border, Faults, Issued, SimulatedHost},
    setting::Place,
};
use avln_arena::{Arena, PreparedScenes, clock::Clock, servers::Limits};
use avln_grpc::{Control, LocalServer};
use avln_proto::v1::{self, play_service_client::PlayServiceClient, run_service_client::RunServiceClient};
use avln_store::Store;
use std::{
    collections::BTreeMap,
    sync::{
        Arc, OnceLock,
        atomic::{AtomicU32, Ordering},
    },
    time::Duration,
};
use tokio::{runtime::Handle, sync::mpsc, time::timeout};
use tonic::{Request, Response, Status, service::Routes};

/// Largest message from the server, bytes.
const MESSAGE_BYTES: usize = 16 << 20;
/// Time for calls that the server answers at once. It only passes if the server has crashed.
pub(crate) const AT_ONCE: Duration = Duration::from_millis(100);

pub(crate) struct Life {
    host: Arc<SimulatedHost>,
    server: Arc<LocalServer<SimulatedHost>>,
    pub(crate) store: Store,
    pub(crate) database: Database,
    /// Age of the simulation at the start.
    pub(crate) began: Duration,
}

/// The rest of a server whose tasks are gone.
pub(crate) struct Remains {
    host: Arc<SimulatedHost>,
    store: Store,
    database: Database,
}

impl Remains {
    /// Closes the data folder.
    pub(crate) async fn close(self) {
        drop(self.host);
        self.store.close().await;
        self.database.close().await;
    }
}

/// Everything that outlives a server.
pub(crate) struct Estate {
    pub(crate) place: Place,
    pub(crate) clock: Clock,
    pub(crate) limits: Limits,
    pub(crate) issued: Issued,
    pub(crate) runs: Arc<AtomicU32>,
}

/// Scenes of all worlds, prepared by the first server.
static SCENES: OnceLock<PreparedScenes> = OnceLock::new();

impl Life {
    /// Starts a server on the data folder. Returns an error if it crashes before it has opened.
    pub(crate) async fn open(
        estate: &Estate,
        threads: &Handle,
        age: Duration,
        fuse: u32,
    ) -> Result<Self, Remains> {
        let border = Border::new(threads.clone(), estate.clock.clone(), age);
        let faults = Arc::new(Faults::default());
        let mut database = border.cross(Database::open(&estate.place.database()));
        // No server starts on a broken disk.
        border.cross(database.fail(0));
        let (arena, store) = border.cross(estate.place.open(estate.clock.clone()));
        let watchdog = arena.control().watchdog().clone();
        let (runs, step_faults, start_faults) = (estate.runs.clone(), faults.clone(), faults.clone());
        let step_watchdog = watchdog.clone();
        let scenes = SCENES.get_or_init(|| arena.scenes()).clone();
        let arena = arena
            .with_scenes(scenes)
            .with_run_ids(move || format!("run_{:06}", runs.fetch_add(1, Ordering::Relaxed)))
            .with_fault_injection(move |_| step_faults.disturb_step(&step_watchdog))
            .with_observer(move |_, referee| {
                if referee.steps() == 0 {
                    start_faults.disturb_start(&watchdog);
                }
            });
        faults.crash_after(fuse);
        let host = Arc::new(SimulatedHost { arena, border, faults, issued: estate.issued.clone() });
        match timeout(AT_ONCE, LocalServer::open(host.clone(), estate.limits.clone())).await {
            Ok(server) => {
                let server = Arc::new(server.expect("the services open"));
                let working = server.clone();
                tokio::spawn(async move { working.work().await });
                Ok(Self { host, server, store, database, began: age })
            }
            Err(_) => Err(Remains { host, store, database }),
        }
    }

    pub(crate) fn border(&self) -> &Border {
        &self.host.border
    }

    pub(crate) fn faults(&self) -> &Faults {
        &self.host.faults
    }

    pub(crate) fn arena(&self) -> &Arena {
        &self.host.arena
    }

    pub(crate) fn control(&self) -> &Control {
        self.arena().control()
    }

    pub(crate) fn age(&self) -> Duration {
        self.border().age()
    }

    /// Ends the server in an orderly way. Fails if a session delays it.
    pub(crate) async fn stop(&self) -> Result<(), String> {
        let begun = self.age();
        self.server.close().await;
        let took = self.age() - begun;
        if took < AT_ONCE { Ok(()) } else { Err(format!("the stop took {took:?}")) }
    }

    pub(crate) fn into_remains(self) -> Remains {
        let Self { host, store, database, .. } = self;
        Remains { host, store, database }
    }

    pub(crate) fn play(&self) -> PlayServiceClient<Routes> {
        PlayServiceClient::new(self.server.routes()).max_decoding_message_size(MESSAGE_BYTES)
    }

    pub(crate) fn runs(&self) -> RunServiceClient<Routes> {
        RunServiceClient::new(self.server.routes())
    }
}

/// Returns a request with a token.
pub(crate) fn authorised<T>(message: T, token: &str) -> Request<T> {
    let mut request = Request::new(message);
    let value = format!("Bearer {token}").parse().expect("tokens are plain text");
    request.metadata_mut().insert("authorization", value);
    request
}

/// Simulated time in which every call has an answer, also if it ends a session first.
const PATIENCE: Duration = Duration::from_secs(3);

/// A call's subject.
#[derive(Clone, Debug)]
pub(crate) enum Subject {
    Start {
        team: usize,
        phase: usize,
        request_id: String,
    },
    /// Index of the agent.
    Reset(usize),
    Step(usize),
    End(usize),
    Look,
}

/// An answer.
pub(crate) enum Answer {
    Start(v1::StartRunResponse),
    Reset(v1::ResetResponse),
    Step(v1::StepResponse),
    End(v1::EndResponse),
    Nothing,
}

type Answered = (u64, Result<Answer, Status>);

/// Unary calls in progress: each runs in a task, because it may wait for the end of a session.
pub(crate) struct Calls {
    next: u64,
    open: BTreeMap<u64, (Subject, Duration)>,
    answered: mpsc::UnboundedReceiver<Answered>,
    answers: mpsc::UnboundedSender<Answered>,
}

impl Default for Calls {
    fn default() -> Self {
        let (answers, answered) = mpsc::unbounded_channel();
        Self { next: 0, open: BTreeMap::new(), answered, answers }
    }
}

impl Calls {
    /// Begins a call.
    pub(crate) fn begin<T: Send + 'static>(
        &mut self,
        subject: Subject,
        age: Duration,
        call: impl Future<Output = Result<Response<T>, Status>> + Send + 'static,
        answer: impl FnOnce(T) -> Answer + Send + 'static,
    ) {
        self.next += 1;
        let (number, answers) = (self.next, self.answers.clone());
        self.open.insert(number, (subject, age));
        tokio::spawn(async move {
            let answered = call.await.map(|response| answer(response.into_inner()));
            let _ = answers.send((number, answered));
        });
    }

    /// Returns the next answer.
    pub(crate) fn next(&mut self) -> Option<(Subject, Result<Answer, Status>)> {
        let (number, answer) = self.answered.try_recv().ok()?;
        self.open.remove(&number).map(|(subject, _)| (subject, answer))
    }

    /// Fails if a call has no answer for too long.
    pub(crate) fn check_answers(&self, age: Duration) -> Result<(), String> {
        match self.open.values().find(|(_, since)| age.saturating_sub(*since) > PATIENCE) {
            Some((subject, since)) => Err(format!("{subject:?} has no answer since {since:?}")),
            None => Ok(()),
        }
    }

    pub(crate) fn count(&self) -> usize {
        self.open.len()
    }
}
