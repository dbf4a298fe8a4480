//! An agent process: run after run in eight slots. The standard output reports runs, steps, ends and errors.
//!
//! A restarted agent continues its run: the first Hello has `resume`, with the generated messages instead of the client.

use crate::tally::RunAccess;
use avln_client::{Action, Client, EndReason, Episode, Error, Order, Play, RunOptions, Sensors};
use avln_proto::v1::play_response::Frame;
use avln_proto::v1::play_service_client::PlayServiceClient;
use avln_proto::v1::{
    self, Act, Hello, Observation, PlayRequest, PlayResponse, Pong, Ready, SensorKind, SensorSubscription,
    SensorWish, play_request,
};
use avln_tests::PHASE;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, timeout, timeout_at};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::Endpoint;
use tonic::{Code, Request, Status, Streaming};

pub(crate) const SLOTS: u32 = 8;
pub(crate) const SENSORS: Sensors =
    Sensors { rgb: true, depth: true, audio: true, width: 64, height: 64, hfov_rad: 1.57 };
const REPORT_INTERVAL: Duration = Duration::from_secs(1);
const PAUSE_AFTER_ERROR: Duration = Duration::from_secs(1);

/// Settings and state of an agent process.
#[derive(Debug)]
pub(crate) struct Agent {
    pub(crate) url: String,
    token: String,
    /// Thinking time per step.
    pub(crate) pause: Duration,
    until: Instant,
    steps: AtomicU64,
    /// The run of the predecessor.
    resumed: Option<RunAccess>,
}

impl Agent {
    /// Returns the agent of the arguments; `None` for other arguments.
    pub(crate) fn parse(words: &[String]) -> Option<Self> {
        let [word, url, token, pause_ms, seconds, run @ ..] = words else { return None };
        if word != "agent" {
            return None;
        }
        let length = Duration::from_secs(seconds.parse().ok()?);
        Some(Self {
            url: url.clone(),
            token: token.clone(),
            pause: Duration::from_millis(pause_ms.parse().ok()?),
            until: Instant::now() + length,
            steps: AtomicU64::new(0),
            resumed: run.to_vec().try_into().ok(),
        })
    }

    pub(crate) fn is_over(&self) -> bool {
        Instant::now() >= self.until
    }

    pub(crate) fn count_step(&self) {
        self.steps.fetch_add(1, Ordering::Relaxed);
    }

    fn report_steps(&self) {
        println!("steps {}", self.steps.swap(0, Ordering::Relaxed));
    }
}

/// Chooses the same action for the same step of an episode, in every process.
pub(crate) fn action(episode: &str, step: u32) -> Action {
    let last = 100 + episode.bytes().map(u32::from).sum::<u32>() % 200;
    match step.wrapping_mul(0x9e37_79b9) >> 28 {
        _ if step >= last => Action::Stop,
        0..4 => Action::TurnLeft,
        _ if step % 64 == 63 => Action::Submit,
        _ => Action::MoveForward,
    }
}

/// Reports an error on a single line.
pub(crate) fn report_error(error: &str) {
    println!("error {}", error.replace('\n', " "));
}

/// Reports the end of an episode, which counts unless the server failed.
pub(crate) fn report_end(episode: &str, steps: u32, is_fault: bool) {
    match is_fault {
        true => report_error(&format!("the server lost episode {episode} at step {steps}")),
        false => println!("end {episode} {steps}"),
    }
}

/// Plays until the time is over.
pub(crate) async fn play(mut agent: Agent) {
    let resumed = agent.resumed.take();
    let agent = Arc::new(agent);
    let reporter = agent.clone();
    tokio::spawn(async move {
        loop {
            sleep(REPORT_INTERVAL).await;
            reporter.report_steps();
        }
    });
    let Some(client) = connect(&agent).await else { return };
    if let Some(run) = resumed
        && timeout_at(agent.until, resume_run(&agent, &run)).await.is_err()
    {
        cancel(&client, &run[0]).await;
    }
    while !agent.is_over() {
        if let Err(error) = play_run(&agent, &client).await {
            report_error(&error.to_string());
            sleep(PAUSE_AFTER_ERROR).await;
        }
    }
    agent.report_steps();
}

async fn connect(agent: &Agent) -> Option<Client> {
    while !agent.is_over() {
        match Client::connect(&agent.url, &agent.token).await {
            Ok(client) => return Some(client),
            Err(error) => report_error(&error.to_string()),
        }
        sleep(PAUSE_AFTER_ERROR).await;
    }
    None
}

async fn play_run(agent: &Arc<Agent>, client: &Client) -> Result<(), Error> {
    let options = RunOptions::new(PHASE, "soak").order(Order::Unordered);
    let run = client.start_run(options).await?;
    println!("run {} {}", run.id, run.token);
    let mut players = JoinSet::new();
    for play in client.play_slots(&run, SENSORS, SLOTS).await? {
        players.spawn(play_slot(play, agent.clone()));
    }
    // All slots are awaited before the first is dropped, because the stream ends with the last.
    let Ok(plays) = timeout_at(agent.until, players.join_all()).await else {
        cancel(client, &run.id).await;
        return Ok(());
    };
    let plays: Result<Vec<_>, Error> = plays.into_iter().collect();
    if let Some(play) = plays?.pop()
        && play.finish().await?.complete
    {
        println!("complete {}", run.id);
    }
    Ok(())
}

async fn cancel(client: &Client, run: &str) {
    if let Err(error) = client.cancel_run(run).await {
        report_error(&error.to_string());
    }
}

/// Plays a slot to the end of the run; returns it.
async fn play_slot(mut play: Play, agent: Arc<Agent>) -> Result<Play, Error> {
    while let Some(mut episode) = play.next_episode().await? {
        while !episode.is_over() {
            sleep(agent.pause).await;
            let action = action(episode.id(), episode.observation().step);
            episode.step(action).await?;
            agent.count_step();
        }
        report_episode(&episode);
    }
    Ok(play)
}

fn report_episode(episode: &Episode<'_>) {
    if let Some(end) = episode.end() {
        report_end(&end.episode, end.steps, end.reason == EndReason::ServerFault);
    }
}

const KINDS: [SensorKind; 3] = [SensorKind::Rgb, SensorKind::Depth, SensorKind::Audio];
const MAX_MESSAGE_BYTES: usize = 16 << 20;
const PAUSE_AFTER_LOSS: Duration = Duration::from_millis(500);

fn request(frame: play_request::Frame) -> PlayRequest {
    PlayRequest { frame: Some(frame) }
}

fn hello() -> PlayRequest {
    let wishes = KINDS.map(|kind| SensorWish { kind: kind.into(), encodings: Vec::new() }).to_vec();
    let (width, height, hfov_rad) = (SENSORS.width, SENSORS.height, SENSORS.hfov_rad);
    let sensors = Some(SensorSubscription { wishes, width, height, hfov_rad });
    request(play_request::Frame::Hello(Hello { slots: SLOTS, sensors, resume: true, ..Hello::default() }))
}

fn ready(slot: u32) -> PlayRequest {
    request(play_request::Frame::Ready(Ready { slot }))
}

/// Continues a run to its end, over lost connections too.
pub(crate) async fn resume_run(agent: &Arc<Agent>, [id, token]: &RunAccess) {
    loop {
        match play_stream(agent, token).await {
            Ok(complete) => {
                if complete {
                    println!("complete {id}");
                }
                return;
            }
            Err(status) => {
                report_error(&format!("resumed run {id}: {status}"));
                if !matches!(status.code(), Code::Unavailable | Code::Unknown | Code::Cancelled) {
                    return;
                }
                sleep(PAUSE_AFTER_LOSS).await;
            }
        }
    }
}

/// Opens a stream without a Hello and drops it.
pub(crate) async fn open_silently(url: &str, token: &str, open: Duration) -> Result<(), Status> {
    let (_requests, outbound) = mpsc::channel(1);
    match timeout(open, stream(url, token, outbound)).await {
        Ok(answer) => answer.map(drop),
        Err(_) => Ok(()),
    }
}

async fn stream(
    url: &str,
    token: &str,
    outbound: mpsc::Receiver<PlayRequest>,
) -> Result<Streaming<PlayResponse>, Status> {
    let lost = |error: tonic::transport::Error| Status::unavailable(error.to_string());
    let channel = Endpoint::from_shared(url.to_owned()).map_err(lost)?.connect().await.map_err(lost)?;
    let mut client = PlayServiceClient::new(channel).max_decoding_message_size(MAX_MESSAGE_BYTES);
    let mut request = Request::new(ReceiverStream::new(outbound));
    let bearer = format!("Bearer {token}").parse().expect("tokens are plain text");
    request.metadata_mut().insert("authorization", bearer);
    Ok(client.play(request).await?.into_inner())
}

/// Plays until the end of the run; returns true if it is complete.
async fn play_stream(agent: &Arc<Agent>, token: &str) -> Result<bool, Status> {
    let (requests, outbound) = mpsc::channel(8 * SLOTS as usize);
    let _ = requests.try_send(hello());
    let mut responses = stream(&agent.url, token, outbound).await?;
    let mut player = Player { agent: agent.clone(), requests, seen: BTreeMap::new() };
    while let Some(response) = responses.message().await? {
        match response.frame {
            Some(Frame::RunEnd(end)) => return Ok(end.complete),
            Some(frame) => player.answer(frame),
            None => {}
        }
    }
    Err(Status::unavailable("the stream ended without RunEnd"))
}

struct Player {
    agent: Arc<Agent>,
    requests: mpsc::Sender<PlayRequest>,
    /// Episode and step of the last observation by slot.
    seen: BTreeMap<u32, (String, u32)>,
}

impl Player {
    fn answer(&mut self, frame: Frame) {
        match frame {
            Frame::Welcome(welcome) => {
                let is_idle = |slot: &u32| welcome.resumed.iter().all(|playing| playing.slot != *slot);
                (0..welcome.slots).filter(is_idle).for_each(|slot| self.send(ready(slot)));
            }
            Frame::EpisodeStart(start) => start.observation.into_iter().for_each(|seen| self.act(seen)),
            Frame::Observation(seen) => self.act(seen),
            Frame::EpisodeEnd(end) => {
                report_end(&end.episode, end.step, end.reason() == v1::EndReason::ServerFault);
                self.send(ready(end.slot));
            }
            Frame::Ping(ping) => self.send(request(play_request::Frame::Pong(Pong { nonce: ping.nonce }))),
            Frame::Fault(fault) => report_error(&format!("resumed run: {}", fault.message)),
            Frame::Notice(_) | Frame::RunEnd(_) => {}
        }
    }

    fn act(&mut self, seen: Observation) {
        let Observation { slot, episode, step, terminated, truncated, .. } = seen;
        // An action sent by the predecessor arrives again as an observation: a second answer would double all later ones.
        let is_old = self.seen.get(&slot).is_some_and(|(known, last)| *known == episode && step <= *last);
        if is_old || terminated || truncated {
            return;
        }
        self.seen.insert(slot, (episode.clone(), step));
        let action = match action(&episode, step) {
            Action::MoveForward => v1::Action::MoveForward,
            Action::TurnLeft => v1::Action::TurnLeft,
            Action::Submit => v1::Action::Submit,
            _ => v1::Action::Stop,
        };
        let act = Act { slot, episode, step: step + 1, action: action.into() };
        let (agent, requests) = (self.agent.clone(), self.requests.clone());
        tokio::spawn(async move {
            sleep(agent.pause).await;
            agent.count_step();
            let _ = requests.send(request(play_request::Frame::Act(act))).await;
        });
    }

    fn send(&self, request: PlayRequest) {
        // Room for all slots: fails only after the end of the stream.
        let _ = self.requests.try_send(request);
    }
}
