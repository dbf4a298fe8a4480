//! Toy host and test client.

use avln_episode::{
    Action, EndReason, Feedback, GoalCue, Mission, Observation, Order, Point3, Pose, RgbImage, Rules,
    Sensors, TimeLimits,
};
use avln_grpc::{Episode, Limits, serve};
use avln_proto::v1::run_service_client::RunServiceClient;
use avln_referee::{RefereeError, StepOutcome};
use std::{
    net::SocketAddr,
    sync::{Arc, mpsc},
    thread,
    time::Duration,
};
use tokio::{net::TcpListener, sync::oneshot, task::JoinHandle, time::timeout};
use tonic::transport::Channel;

mod clients;
mod host;

pub(crate) use clients::{Agent, Attack, Siege, authorised, channel, hello, play_client, reason};
pub(crate) use host::{ACCOUNT, Book, LOOKING, ORGANISER, RUN, RUN_TOKEN, ToyHost};

/// A minute per action, and no time for lost connections.
pub(crate) const PATIENT: TimeLimits =
    TimeLimits { step_ms: 60_000, bank_ms: 0, run_s: 0, disconnect_s: 0, disconnect_total_s: 0 };

/// Episodes and limits of the toy host.
pub(crate) struct Plan {
    /// One entry per episode.
    pub(crate) episodes: Vec<Quirk>,
    pub(crate) max_steps: u32,
    /// Episodes that fit into the memory.
    pub(crate) most_open: usize,
    pub(crate) max_slots: u32,
    pub(crate) shows_metrics: bool,
    pub(crate) time: TimeLimits,
}

impl Plan {
    pub(crate) fn plain(episodes: usize) -> Self {
        Self::odd((0..episodes).map(|_| Quirk::None).collect())
    }

    pub(crate) fn odd(episodes: Vec<Quirk>) -> Self {
        Self {
            episodes,
            max_steps: 10,
            most_open: usize::MAX,
            max_slots: 4,
            shows_metrics: true,
            time: PATIENT,
        }
    }

    /// Plain episodes with time limits.
    pub(crate) fn timed(episodes: usize, time: TimeLimits) -> Self {
        Self { time, ..Self::plain(episodes) }
    }
}

/// A gRPC server on a free port.
pub(crate) struct TestServer {
    pub(crate) host: Arc<ToyHost>,
    pub(crate) address: SocketAddr,
    stop: oneshot::Sender<()>,
    served: JoinHandle<()>,
}

impl TestServer {
    pub(crate) async fn open(plan: Plan) -> Self {
        Self::with_limits(plan, Limits::default()).await
    }

    pub(crate) async fn with_limits(plan: Plan, limits: Limits) -> Self {
        Self::with_book(plan, limits, Book::default()).await
    }

    /// Opens a server that continues the episodes of another with the same book.
    pub(crate) async fn with_book(plan: Plan, limits: Limits, book: Book) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let host = Arc::new(ToyHost::new(plan, book));
        let (stop, stopped) = oneshot::channel::<()>();
        let behind = host.clone();
        let served = tokio::spawn(async move {
            let until = async { drop(stopped.await) };
            serve(listener, behind, limits, until).await.unwrap();
        });
        Self { host, address, stop, served }
    }

    /// Returns a client for the run service.
    pub(crate) async fn runs(&self) -> RunServiceClient<Channel> {
        RunServiceClient::new(channel(self).await)
    }

    /// Stops the server.
    pub(crate) fn close(self) -> JoinHandle<()> {
        self.stop.send(()).unwrap();
        self.served
    }

    /// Returns whether a new connection is served.
    pub(crate) async fn answers(&self) -> bool {
        let endpoint = tonic::transport::Endpoint::from_shared(format!("http://{}", self.address)).unwrap();
        let Ok(channel) = endpoint.connect().await else { return false };
        let mut client = avln_proto::v1::info_service_client::InfoServiceClient::new(channel);
        client.get_server_info(avln_proto::v1::GetServerInfoRequest {}).await.is_ok()
    }

    /// Plays an episode, as proof that the server works.
    pub(crate) async fn still_serves(&self) {
        self.host.refill();
        let mut agent = Agent::enter(self, 1).await;
        let start = agent.ready(0).await;
        agent.act(0, &start.episode, 1, 5).await;
        assert!(agent.observation().await.terminated);
        agent.episode_end().await;
    }
}

/// Waits up to 20 s.
pub(crate) async fn soon<T>(future: impl Future<Output = T>) -> T {
    timeout(Duration::from_secs(20), future).await.expect("nothing happened within 20 s")
}

/// Oddity of an episode.
pub(crate) enum Quirk {
    None,
    /// The simulator panics when the agent submits.
    Fragile,
    /// The simulator panics at the start.
    Stillborn,
    /// A step lasts until the test sends a message.
    Slow(mpsc::Receiver<()>),
    /// The first observation lasts until the test sends a message.
    SlowStart(mpsc::Receiver<()>),
    /// The encoding of an observation sends the name of its thread.
    Encoded(mpsc::Sender<String>),
}

/// A world of one number: the count of forward steps.
pub(crate) struct ToyRunner {
    mission: Mission,
    rules: Rules,
    sensors: Sensors,
    quirk: Quirk,
    walked: u32,
    steps: u32,
    end: Option<EndReason>,
}

impl ToyRunner {
    pub(crate) fn new(max_steps: u32, sensors: Sensors, quirk: Quirk) -> Self {
        let picture = RgbImage { width: 2, height: 2, pixels: (0..12).collect() };
        let goals = vec![
            GoalCue::Category("chair".into()),
            GoalCue::Description("the lamp by the bed".into()),
            GoalCue::Image(picture),
        ];
        let rules = Rules { max_steps, ..Rules::paper() };
        let mission = Mission { order: Order::Unordered, goals };
        Self { mission, rules, sensors, quirk, walked: 0, steps: 0, end: None }
    }

    fn sense(&self) -> Observation {
        let pixels = (self.sensors.width * self.sensors.height) as usize;
        let value = self.steps as f32;
        Observation {
            step: self.steps,
            rgb: self.sensors.rgb.then(|| vec![self.steps as u8; pixels * 3]),
            depth: self.sensors.depth.then(|| vec![value; pixels]),
            audio: self.sensors.audio.then(|| vec![value / 100.0; 2 * self.rules.audio_samples as usize]),
            pose: Pose { position: Point3::new(0.0, 0.0, self.walked as f32 * -0.25), heading_rad: 0.0 },
            remaining_steps: self.rules.max_steps - self.steps,
            remaining_submits: 2,
            feedback: Feedback::None,
        }
    }
}

impl Episode for ToyRunner {
    fn mission(&self) -> &Mission {
        &self.mission
    }
    fn rules(&self) -> &Rules {
        if let Quirk::Encoded(threads) = &self.quirk {
            let _ = threads.send(thread::current().name().unwrap_or_default().to_owned());
        }
        &self.rules
    }
    fn start(&mut self) -> Observation {
        assert!(!matches!(self.quirk, Quirk::Stillborn), "the secret of this episode");
        if let Quirk::SlowStart(release) = &self.quirk {
            let _ = release.recv();
        }
        self.sense()
    }
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError> {
        if let Quirk::Slow(release) = &self.quirk {
            release.recv().expect("the test releases the step");
        }
        if matches!(self.quirk, Quirk::Fragile) && action == Action::Submit {
            panic!("the secret of this episode");
        }
        self.steps += 1;
        self.walked += u32::from(action == Action::MoveForward);
        if action == Action::Stop {
            self.end = Some(EndReason::Stopped);
        } else if self.steps >= self.rules.max_steps {
            self.end = Some(EndReason::StepLimit);
        }
        Ok(StepOutcome { observation: self.sense(), end: self.end })
    }
    fn truncate(&mut self, reason: EndReason) {
        self.end.get_or_insert(reason);
    }
    fn end(&self) -> Option<EndReason> {
        self.end
    }
    fn steps(&self) -> u32 {
        self.steps
    }
    fn state_hash(&self) -> u64 {
        u64::from(self.steps) << 32 | u64::from(self.walked)
    }
}
