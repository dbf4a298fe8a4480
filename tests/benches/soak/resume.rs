//! A restarted agent that continues a run: its first Hello has `resume`, with the generated messages instead of the client.

use crate::{
    agents::{Agent, SENSORS, SLOTS, action, report_end, report_error},
    tally::RunAccess,
};
use avln_client::Action;
use avln_proto::v1::{
    self, Act, EndReason, Hello, Observation, PlayRequest, PlayResponse, Pong, Ready, SensorKind,
    SensorSubscription, SensorWish, play_request, play_response::Frame,
    play_service_client::PlayServiceClient,
};
use std::{collections::BTreeMap, sync::Arc, time::Duration};
use tokio::{
    sync::mpsc,
    time::{sleep, timeout},
};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Code, Request, Status, Streaming, transport::Endpoint};

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
                report_end(&end.episode, end.step, end.reason() == EndReason::ServerFault);
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
