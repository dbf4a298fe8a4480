//! Random clients: the server stays in a legal state for well-formed and malformed input.

use crate::common::{PATIENT, Plan, RUN_TOKEN, TestServer, authorised, channel, hello};
use avln_episode::TimeLimits;
use avln_proto::v1::{
    self, PlayRequest, PlayResponse, Reason, play_request::Frame as Up, play_response::Frame as Down,
};
use bytes::BufMut;
use proptest::{
    prelude::*,
    test_runner::{Config, TestRunner},
};
use prost::Message;
use std::{
    collections::{BTreeMap, BTreeSet},
    time::Duration,
};
use tokio::{sync::mpsc, time::timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{
    Status, Streaming,
    client::Grpc,
    codec::{Codec, EncodeBuf, Encoder},
    codegen::http::uri::PathAndQuery,
};
use tonic_prost::{ProstCodec, ProstDecoder};

/// Action of a client.
#[derive(Clone, Debug)]
enum Move {
    Ready(u32),
    /// Act in a slot: offset of the step, action, and whether the episode is the slot's own.
    Act(u32, i32, i32, bool),
    Abandon(u32, bool),
    Hello(bool),
    Pong(u64),
    Nothing,
    Goodbye(bool),
    /// Frame with a changed byte: position and value.
    Spoilt(usize, u8),
    Bytes(Vec<u8>),
    /// Reads frames.
    Listen,
}

fn moves() -> impl Strategy<Value = Move> {
    prop_oneof![
        6 => (0_u32..6).prop_map(Move::Ready),
        12 => (0_u32..5, prop_oneof![8 => Just(0), 1 => -3..4], prop_oneof![8 => 1..6, 1 => -1..9], prop::bool::weighted(0.9))
            .prop_map(|(slot, off, action, own)| Move::Act(slot, off, action, own)),
        2 => (0_u32..5, any::<bool>()).prop_map(|(slot, own)| Move::Abandon(slot, own)),
        1 => any::<bool>().prop_map(Move::Hello),
        1 => (0_u64..4).prop_map(Move::Pong),
        1 => Just(Move::Nothing),
        1 => any::<bool>().prop_map(Move::Goodbye),
        1 => (0_usize..40, any::<u8>()).prop_map(|(at, to)| Move::Spoilt(at, to)),
        1 => prop::collection::vec(any::<u8>(), 0..60).prop_map(Move::Bytes),
        12 => Just(Move::Listen),
    ]
}

/// Consecutive connections of a run: whether they resume, their number of slots, and their moves.
fn lives() -> impl Strategy<Value = Vec<(bool, u32, Vec<Move>)>> {
    prop::collection::vec((any::<bool>(), 0_u32..7, prop::collection::vec(moves(), 0..40)), 1..4)
}

/// Codec that sends raw bytes.
#[derive(Clone, Copy, Debug, Default)]
struct Raw;

impl Encoder for Raw {
    type Item = Vec<u8>;
    type Error = Status;

    fn encode(&mut self, item: Self::Item, to: &mut EncodeBuf<'_>) -> Result<(), Status> {
        to.put_slice(&item);
        Ok(())
    }
}

impl Codec for Raw {
    type Encode = Vec<u8>;
    type Decode = PlayResponse;
    type Encoder = Self;
    type Decoder = ProstDecoder<PlayResponse>;

    fn encoder(&mut self) -> Self {
        *self
    }

    fn decoder(&mut self) -> Self::Decoder {
        ProstCodec::<(), PlayResponse>::default().decoder()
    }
}

/// The client's view of a run.
#[derive(Debug, Default)]
struct KnownState {
    granted: u32,
    /// Handle and step by slot.
    playing: BTreeMap<u32, (String, u32)>,
    ended: BTreeMap<String, i32>,
    begun: BTreeSet<String>,
}

impl KnownState {
    /// Applies a frame. Returns false if it is illegal in this state.
    fn take(&mut self, frame: &Down) -> bool {
        match frame {
            Down::Welcome(welcome) => {
                self.granted = welcome.slots;
                let place = |p: &v1::SlotPosition| (p.slot, (p.episode.clone(), p.step));
                self.playing = welcome.resumed.iter().map(place).collect();
                (1..=4).contains(&self.granted)
            }
            Down::EpisodeStart(start) => {
                let step = start.observation.as_ref().map_or(u32::MAX, |seen| seen.step);
                let now = (start.episode.clone(), step);
                let again = self.playing.get(&start.slot) == Some(&now);
                let new = !self.playing.contains_key(&start.slot) && self.begun.insert(start.episode.clone());
                self.begun.insert(start.episode.clone());
                self.playing.insert(start.slot, now);
                start.slot < 4 && (again || new)
            }
            Down::Observation(seen) => match self.playing.get_mut(&seen.slot) {
                Some((episode, step)) if *episode == seen.episode => {
                    let follows = (*step..=*step + 1).contains(&seen.step);
                    *step = seen.step;
                    follows
                }
                // A repetition.
                _ => self.ended.contains_key(&seen.episode) && (seen.terminated || seen.truncated),
            },
            Down::EpisodeEnd(end) => {
                let held = self.playing.get(&end.slot).is_some_and(|(episode, _)| *episode == end.episode);
                if held {
                    self.playing.remove(&end.slot);
                }
                // A client that resumes receives the end of an earlier episode.
                let before = self.ended.insert(end.episode.clone(), end.reason);
                before.map_or(held || self.begun.contains(&end.episode), |reason| reason == end.reason)
            }
            Down::Fault(fault) => !matches!(fault.reason(), Reason::Internal | Reason::SimFault),
            Down::Notice(_) | Down::Ping(_) | Down::RunEnd(_) => true,
        }
    }

    /// Returns the bytes of a move.
    fn bytes(&self, wanted: &Move) -> Vec<u8> {
        let held = |slot: &u32| self.playing.get(slot).cloned().unwrap_or_default();
        let name = |slot: &u32, own: bool| if own { held(slot).0 } else { "ep_0".to_owned() };
        let frame = match wanted {
            Move::Ready(slot) => Some(Up::Ready(v1::Ready { slot: *slot })),
            Move::Act(slot, off, action, own) => {
                let step = held(slot).1.saturating_add(1).saturating_add_signed(*off);
                Some(Up::Act(v1::Act { slot: *slot, episode: name(slot, *own), step, action: *action }))
            }
            Move::Abandon(slot, own) => {
                let step = held(slot).1;
                Some(Up::Abandon(v1::Abandon { slot: *slot, episode: name(slot, *own), step }))
            }
            Move::Hello(resume) => Some(Up::Hello(v1::Hello { resume: *resume, ..hello(1) })),
            Move::Pong(nonce) => Some(Up::Pong(v1::Pong { nonce: *nonce })),
            Move::Goodbye(pause) => Some(Up::Goodbye(v1::Goodbye { pause: *pause })),
            Move::Bytes(bytes) => return bytes.clone(),
            Move::Spoilt(at, to) => {
                let mut bytes = self.bytes(&Move::Act(0, 0, 1, true));
                let at = at % bytes.len();
                bytes[at] = *to;
                return bytes;
            }
            Move::Nothing | Move::Listen => None,
        };
        PlayRequest { frame }.encode_to_vec()
    }

    /// Applies the frames that arrive within `patience`. Returns false if the stream has ended.
    async fn listen(
        &mut self,
        down: &mut Streaming<PlayResponse>,
        patience: Duration,
    ) -> Result<bool, String> {
        while let Ok(said) = timeout(patience, down.message()).await {
            match said {
                Ok(Some(PlayResponse { frame: Some(frame) })) if !self.take(&frame) => {
                    return Err(format!("out of turn: {frame:?} after {self:?}"));
                }
                Ok(Some(PlayResponse { frame: Some(_) })) => {}
                Ok(Some(empty)) => return Err(format!("{empty:?}")),
                Ok(None) => return Ok(false),
                Err(status)
                    if status.code() == tonic::Code::Internal && status.message().contains("inc_") =>
                {
                    return Err(format!("a fault of the server: {status}"));
                }
                Err(_) => return Ok(false),
            }
        }
        Ok(true)
    }
}

const MOMENT: Duration = Duration::from_millis(4);

/// Plays a connection from Hello to the end.
async fn live(
    server: &TestServer,
    known_state: &mut KnownState,
    life: &(bool, u32, Vec<Move>),
) -> Result<(), String> {
    let (resume, slots, moves) = life;
    let known = known_state.playing.iter().map(|(&slot, (episode, step))| v1::SlotPosition {
        slot,
        episode: episode.clone(),
        step: *step,
    });
    let hello = Up::Hello(v1::Hello { resume: *resume, known: known.collect(), ..hello(*slots) });
    let (up, queue) = mpsc::channel(4);
    let first = PlayRequest { frame: Some(hello) }.encode_to_vec();
    up.send(first).await.map_err(|error| error.to_string())?;
    let mut grpc = Grpc::new(channel(server).await);
    grpc.ready().await.map_err(|error| error.to_string())?;
    let path = PathAndQuery::from_static("/avln.v1.PlayService/Play");
    let request = authorised(ReceiverStream::new(queue), RUN_TOKEN);
    let Ok(down) = grpc.streaming(request, path, Raw).await else { return Ok(()) };
    let mut down = down.into_inner();
    let mut open = known_state.listen(&mut down, MOMENT * 5).await?;
    for wanted in moves {
        if !open {
            return Ok(());
        }
        if matches!(wanted, Move::Listen) {
            open = known_state.listen(&mut down, MOMENT).await?;
        } else if timeout(MOMENT * 100, up.send(known_state.bytes(wanted))).await.is_err() {
            return Err(format!("the server does not take {wanted:?}"));
        }
    }
    known_state.listen(&mut down, MOMENT).await.map(drop)
}

async fn check(lives: Vec<(bool, u32, Vec<Move>)>) -> Result<(), String> {
    let time = TimeLimits { disconnect_s: 60, disconnect_total_s: 600, ..PATIENT };
    let server = TestServer::open(Plan { max_steps: 6, ..Plan::timed(8, time) }).await;
    let mut known_state = KnownState::default();
    for life in &lives {
        live(&server, &mut known_state, life).await?;
    }
    let concluded = server.host.concluded(0).await;
    let names: BTreeSet<_> = concluded.iter().map(|concluded| &concluded.handle).collect();
    if names.len() != concluded.len() || concluded.iter().any(|c| c.end.is_none() || c.steps > 6) {
        return Err(format!("episodes came back as {concluded:?}"));
    }
    timeout(Duration::from_secs(20), server.still_serves())
        .await
        .map_err(|_| "it serves no longer".to_owned())
}

fn check_random_lives(cases: u32) {
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    let config = Config { cases, max_shrink_iters: 200, failure_persistence: None, ..Config::default() };
    let mut runner = TestRunner::new(config);
    let checked = runner.run(&lives(), |lives| {
        let whole = runtime.spawn(async { timeout(Duration::from_secs(60), check(lives)).await });
        let outcome = runtime.block_on(whole);
        match outcome {
            Ok(Ok(Ok(()))) => Ok(()),
            Ok(Ok(Err(wrong))) => Err(TestCaseError::fail(wrong)),
            Ok(Err(_)) => Err(TestCaseError::fail("it does not end")),
            Err(panic) => Err(TestCaseError::fail(panic.to_string())),
        }
    });
    checked.unwrap();
}

#[test]
fn arbitrary_clients_leave_a_legal_state() {
    // The clients mostly wait for frames.
    std::thread::scope(|scope| (0..4).for_each(|_| drop(scope.spawn(|| check_random_lives(24)))));
}
