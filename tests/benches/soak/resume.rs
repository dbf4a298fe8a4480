//! A restarted agent that continues a run: its first Hello has `resume`, with minimal messages instead of the client.

use crate::{
    agents::{Agent, SENSORS, SLOTS, action, report_end, report_error},
    tally::RunAccess,
};
use avln_client::Action;
use prost::Message;
use std::{collections::BTreeMap, sync::Arc, time::Duration};
use tokio::{
    sync::mpsc,
    time::{sleep, timeout},
};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{
    Code, Request, Status, Streaming, client::Grpc, codegen::http::uri::PathAndQuery, transport::Endpoint,
};
use tonic_prost::ProstCodec;

const SERVER_FAULT: i32 = 7;
const KINDS: [i32; 3] = [1, 2, 3];
const MAX_MESSAGE_BYTES: usize = 16 << 20;
const PAUSE_AFTER_LOSS: Duration = Duration::from_millis(500);

/// Frames up, tags from `avln.v1`.
#[derive(Clone, PartialEq, Message)]
struct PlayRequest {
    #[prost(message, optional, tag = "1")]
    hello: Option<Hello>,
    #[prost(message, optional, tag = "2")]
    ready: Option<Ready>,
    #[prost(message, optional, tag = "3")]
    act: Option<Act>,
    #[prost(message, optional, tag = "5")]
    pong: Option<Nonce>,
}

#[derive(Clone, PartialEq, Message)]
struct Hello {
    #[prost(uint32, tag = "3")]
    slots: u32,
    #[prost(message, optional, tag = "4")]
    sensors: Option<Subscription>,
    #[prost(bool, tag = "5")]
    resume: bool,
}

#[derive(Clone, PartialEq, Message)]
struct Subscription {
    #[prost(message, repeated, tag = "1")]
    wishes: Vec<Wish>,
    #[prost(uint32, tag = "2")]
    width: u32,
    #[prost(uint32, tag = "3")]
    height: u32,
    #[prost(float, tag = "4")]
    hfov_rad: f32,
}

#[derive(Clone, PartialEq, Message)]
struct Wish {
    #[prost(int32, tag = "1")]
    kind: i32,
}

#[derive(Clone, PartialEq, Message)]
struct Ready {
    #[prost(uint32, tag = "1")]
    slot: u32,
}

#[derive(Clone, PartialEq, Message)]
struct Act {
    #[prost(uint32, tag = "1")]
    slot: u32,
    #[prost(string, tag = "2")]
    episode: String,
    #[prost(uint32, tag = "3")]
    step: u32,
    #[prost(int32, tag = "4")]
    action: i32,
}

#[derive(Clone, PartialEq, Message)]
struct Nonce {
    #[prost(uint64, tag = "1")]
    nonce: u64,
}

/// Frames down.
#[derive(Clone, PartialEq, Message)]
struct PlayResponse {
    #[prost(message, optional, tag = "1")]
    welcome: Option<Welcome>,
    #[prost(message, optional, tag = "2")]
    start: Option<EpisodeStart>,
    #[prost(message, optional, tag = "3")]
    observation: Option<Observation>,
    #[prost(message, optional, tag = "4")]
    end: Option<EpisodeEnd>,
    #[prost(message, optional, tag = "5")]
    ping: Option<Nonce>,
    #[prost(message, optional, tag = "7")]
    fault: Option<Fault>,
    #[prost(message, optional, tag = "8")]
    run_end: Option<RunEnd>,
}

#[derive(Clone, PartialEq, Message)]
struct Welcome {
    #[prost(uint32, tag = "3")]
    slots: u32,
    #[prost(message, repeated, tag = "9")]
    resumed: Vec<Ready>,
}

#[derive(Clone, PartialEq, Message)]
struct EpisodeStart {
    #[prost(message, optional, tag = "4")]
    observation: Option<Observation>,
}

#[derive(Clone, PartialEq, Message)]
struct Observation {
    #[prost(uint32, tag = "1")]
    slot: u32,
    #[prost(string, tag = "2")]
    episode: String,
    #[prost(uint32, tag = "3")]
    step: u32,
    #[prost(bool, tag = "9")]
    terminated: bool,
    #[prost(bool, tag = "10")]
    truncated: bool,
}

#[derive(Clone, PartialEq, Message)]
struct EpisodeEnd {
    #[prost(uint32, tag = "1")]
    slot: u32,
    #[prost(string, tag = "2")]
    episode: String,
    #[prost(uint32, tag = "3")]
    step: u32,
    #[prost(int32, tag = "4")]
    reason: i32,
}

#[derive(Clone, PartialEq, Message)]
struct Fault {
    #[prost(string, tag = "6")]
    message: String,
}

#[derive(Clone, PartialEq, Message)]
struct RunEnd {
    #[prost(bool, tag = "5")]
    complete: bool,
}

impl PlayRequest {
    fn hello() -> Self {
        let wishes = KINDS.map(|kind| Wish { kind }).to_vec();
        let (width, height, hfov_rad) = (SENSORS.width, SENSORS.height, SENSORS.hfov_rad);
        let sensors = Some(Subscription { wishes, width, height, hfov_rad });
        let hello = Some(Hello { slots: SLOTS, sensors, resume: true });
        Self { hello, ..Self::default() }
    }

    fn ready(slot: u32) -> Self {
        Self { ready: Some(Ready { slot }), ..Self::default() }
    }
}

/// Continues a run to its end, over lost connections too.
pub(crate) async fn play_on(agent: &Arc<Agent>, [id, token]: &RunAccess) {
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
    let mut grpc = Grpc::new(channel).max_decoding_message_size(MAX_MESSAGE_BYTES);
    grpc.ready().await.map_err(lost)?;
    let mut request = Request::new(ReceiverStream::new(outbound));
    let bearer = format!("Bearer {token}").parse().expect("tokens are plain text");
    request.metadata_mut().insert("authorization", bearer);
    let path = PathAndQuery::from_static("/avln.v1.PlayService/Play");
    let codec = ProstCodec::<PlayRequest, PlayResponse>::default();
    Ok(grpc.streaming(request, path, codec).await?.into_inner())
}

/// Plays until the end of the run; returns true if it is complete.
async fn play_stream(agent: &Arc<Agent>, token: &str) -> Result<bool, Status> {
    let (requests, outbound) = mpsc::channel(8 * SLOTS as usize);
    let _ = requests.try_send(PlayRequest::hello());
    let mut responses = stream(&agent.url, token, outbound).await?;
    let mut player = Player { agent: agent.clone(), requests, seen: BTreeMap::new() };
    while let Some(response) = responses.message().await? {
        if let Some(end) = response.run_end {
            return Ok(end.complete);
        }
        player.answer(response);
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
    fn answer(&mut self, response: PlayResponse) {
        if let Some(Welcome { slots, resumed }) = response.welcome {
            let is_idle = |slot: &u32| resumed.iter().all(|playing| playing.slot != *slot);
            (0..slots).filter(is_idle).for_each(|slot| self.send(PlayRequest::ready(slot)));
        }
        if let Some(seen) = response.start.and_then(|start| start.observation).or(response.observation) {
            self.act(seen);
        }
        if let Some(end) = response.end {
            report_end(&end.episode, end.step, end.reason == SERVER_FAULT);
            self.send(PlayRequest::ready(end.slot));
        }
        if let Some(pong) = response.ping {
            self.send(PlayRequest { pong: Some(pong), ..PlayRequest::default() });
        }
        if let Some(fault) = response.fault {
            report_error(&format!("resumed run: {}", fault.message));
        }
    }

    fn act(&mut self, Observation { slot, episode, step, terminated, truncated }: Observation) {
        // An action sent by the predecessor arrives again as an observation: a second answer would double all later ones.
        let is_old = self.seen.get(&slot).is_some_and(|(known, last)| *known == episode && step <= *last);
        if is_old || terminated || truncated {
            return;
        }
        self.seen.insert(slot, (episode.clone(), step));
        let action = match action(&episode, step) {
            Action::MoveForward => 1,
            Action::TurnLeft => 2,
            Action::Submit => 4,
            _ => 5,
        };
        let act = Some(Act { slot, episode, step: step + 1, action });
        let (agent, requests) = (self.agent.clone(), self.requests.clone());
        tokio::spawn(async move {
            sleep(agent.pause).await;
            agent.count_step();
            let _ = requests.send(PlayRequest { act, ..PlayRequest::default() }).await;
        });
    }

    fn send(&self, request: PlayRequest) {
        // Room for all slots: fails only after the end of the stream.
        let _ = self.requests.try_send(request);
    }
}
