use avln_proto::{
    MAX_MESSAGE_BYTES, REASON_KEY,
    v1::{
        self, play_request::Frame as Up, play_response::Frame as Down,
        play_service_client::PlayServiceClient, run_service_client::RunServiceClient,
    },
};
use std::time::Duration;
use tokio::{sync::mpsc, time::timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{
    Request, Status, Streaming,
    transport::{Certificate, Channel, ClientTlsConfig, Endpoint},
};

/// Longest time for an answer: the server may have to load scenes.
const PATIENCE: Duration = Duration::from_secs(60);
/// Frames that wait to be sent.
const WAITING_FRAMES: usize = 64;

/// Why the checks could not be made at all.
#[derive(Debug, thiserror::Error)]
pub enum Trouble {
    /// The server does not answer.
    #[error(
        "cannot reach {address}: {detail}; give the address of the server's gRPC port like http://127.0.0.1:50051"
    )]
    Unreachable {
        /// Given address.
        address: String,
        /// Network error.
        detail: String,
    },
    /// The run for the checks was refused.
    #[error("the server begins no run in phase '{phase}': {detail}")]
    NoRun {
        /// The phase.
        phase: String,
        /// Server message.
        detail: String,
    },
}

/// Server location.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// Address: `http://`, or `https://`.
    pub server: &'a str,
    /// PEM certificates of authorities for an `https://` server, instead of the system store.
    pub ca: Option<&'a str>,
}

impl Site<'_> {
    fn endpoint(&self) -> Result<Endpoint, tonic::transport::Error> {
        let endpoint = Endpoint::new(self.server.to_owned())?;
        let endpoint = endpoint.max_frame_size(256 << 10).initial_stream_window_size(2 << 20);
        match (self.server.starts_with("https://"), self.ca) {
            (false, _) => Ok(endpoint),
            (true, None) => endpoint.tls_config(ClientTlsConfig::new().with_native_roots()),
            (true, Some(pem)) => {
                endpoint.tls_config(ClientTlsConfig::new().ca_certificate(Certificate::from_pem(pem)))
            }
        }
    }
}

/// Error message with all sources.
fn chain(error: &dyn std::error::Error) -> String {
    let behind = std::iter::successors(error.source(), |error| error.source());
    behind.fold(error.to_string(), |said, error| format!("{said}: {error}"))
}

/// A connection to the server, and the run that the checks play.
pub(crate) struct Talk {
    pub(crate) channel: Channel,
    pub(crate) run: v1::Run,
    pub(crate) run_token: String,
    pub(crate) account_token: String,
}

impl Talk {
    /// Connects and begins a run.
    pub(crate) async fn open(site: &Site<'_>, token: &str, phase: &str) -> Result<Self, Trouble> {
        let unreachable = |error: tonic::transport::Error| Trouble::Unreachable {
            address: site.server.to_owned(),
            detail: chain(&error),
        };
        let channel = site.endpoint().map_err(unreachable)?.connect().await.map_err(unreachable)?;
        let no_run = |detail: String| Trouble::NoRun { phase: phase.to_owned(), detail };
        let request = v1::StartRunRequest {
            phase: phase.to_owned(),
            order: v1::Order::Unordered.into(),
            method: Some(v1::MethodInfo { name: "conformance".to_owned(), ..v1::MethodInfo::default() }),
            ..v1::StartRunRequest::default()
        };
        let started = RunServiceClient::new(channel.clone()).start_run(bearer(request, token)).await;
        let started = started.map_err(|status| no_run(status.message().to_owned()))?.into_inner();
        let run = started.run.ok_or_else(|| no_run("StartRun answers without a run".to_owned()))?;
        Ok(Self { channel, run, run_token: started.run_token, account_token: token.to_owned() })
    }

    pub(crate) fn play(&self) -> PlayServiceClient<Channel> {
        PlayServiceClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES)
    }

    /// Opens a stream with this token and these first frames.
    pub(crate) async fn dial(&self, token: &str, frames: Vec<Up>) -> Result<Stream, Status> {
        let (up, queue) = mpsc::channel(WAITING_FRAMES);
        for frame in frames {
            let _ = up.try_send(v1::PlayRequest { frame: Some(frame) });
        }
        let down = self.play().play(bearer(ReceiverStream::new(queue), token)).await?.into_inner();
        Ok(Stream { up, down })
    }

    /// Opens a stream properly.
    pub(crate) async fn enter(&self, hello: v1::Hello) -> Result<(Stream, v1::Welcome), String> {
        let mut stream =
            self.dial(&self.run_token, vec![Up::Hello(hello)]).await.map_err(|status| told(&status))?;
        match stream.next().await? {
            Down::Welcome(welcome) => Ok((stream, welcome)),
            other => Err(format!("Hello was answered by {}", name(&other))),
        }
    }
}

/// A Play stream.
pub(crate) struct Stream {
    up: mpsc::Sender<v1::PlayRequest>,
    down: Streaming<v1::PlayResponse>,
}

impl Stream {
    pub(crate) async fn send(&self, frame: Up) {
        let _ = self.up.send(v1::PlayRequest { frame: Some(frame) }).await;
    }

    pub(crate) async fn act(&self, episode: &str, step: u32, action: i32) {
        self.send(Up::Act(v1::Act { slot: 0, episode: episode.to_owned(), step, action })).await;
    }

    /// The next frame that is neither Ping nor Notice.
    pub(crate) async fn next(&mut self) -> Result<Down, String> {
        loop {
            match self.next_or_end().await? {
                Ok(Some(Down::Ping(_) | Down::Notice(_))) => {}
                Ok(Some(frame)) => return Ok(frame),
                Ok(None) => return Err("the stream ended without a word".to_owned()),
                Err(status) => return Err(told(&status)),
            }
        }
    }

    /// Next frame, or stream end.
    pub(crate) async fn next_or_end(&mut self) -> Result<Result<Option<Down>, Status>, String> {
        let next = timeout(PATIENCE, self.down.message()).await;
        let next = next.map_err(|_| format!("nothing came for {PATIENCE:?}"))?;
        Ok(next.map(|response| response.and_then(|response| response.frame)))
    }

    pub(crate) async fn start(&mut self) -> Result<v1::EpisodeStart, String> {
        self.send(Up::Ready(v1::Ready { slot: 0 })).await;
        match self.next().await? {
            Down::EpisodeStart(start) => Ok(start),
            other => Err(format!("Ready was answered by {}", name(&other))),
        }
    }

    pub(crate) async fn observation(&mut self) -> Result<v1::Observation, String> {
        match self.next().await? {
            Down::Observation(seen) => Ok(seen),
            other => Err(format!("an Observation was due, and {} came", name(&other))),
        }
    }

    pub(crate) async fn end(&mut self) -> Result<v1::EpisodeEnd, String> {
        match self.next().await? {
            Down::EpisodeEnd(end) => Ok(end),
            other => Err(format!("EpisodeEnd was due, and {} came", name(&other))),
        }
    }

    /// A recoverable fault for this reason.
    pub(crate) async fn refusal(&mut self, due: v1::Reason) -> Result<(), String> {
        match self.next().await? {
            Down::Fault(fault) if fault.reason() == due && fault.recoverable => Ok(()),
            Down::Fault(fault) => Err(format!(
                "a recoverable {} was due, and {} came, recoverable {}",
                due.as_str_name(),
                fault.reason().as_str_name(),
                fault.recoverable
            )),
            other => Err(format!("a Fault was due, and {} came", name(&other))),
        }
    }
}

/// A Hello for all sensors with small images.
pub(crate) fn hello() -> v1::Hello {
    let kinds = [v1::SensorKind::Rgb, v1::SensorKind::Depth, v1::SensorKind::Audio];
    let wish = |kind: v1::SensorKind| v1::SensorWish { kind: kind.into(), encodings: vec![] };
    v1::Hello {
        slots: 1,
        client: Some(v1::ClientInfo {
            name: "avln-conformance".to_owned(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            api_minor: avln_proto::API_MINOR,
        }),
        sensors: Some(v1::SensorSubscription {
            wishes: kinds.map(wish).to_vec(),
            width: 64,
            height: 64,
            hfov_rad: std::f32::consts::FRAC_PI_2,
        }),
        ..v1::Hello::default()
    }
}

pub(crate) fn bearer<T>(message: T, token: &str) -> Request<T> {
    let mut request = Request::new(message);
    if let Ok(value) = format!("Bearer {token}").parse() {
        request.metadata_mut().insert("authorization", value);
    }
    request
}

/// The reason in a status' trailer.
pub(crate) fn reason(status: &Status) -> String {
    let word = status.metadata().get(REASON_KEY).and_then(|word| word.to_str().ok());
    word.unwrap_or("no reason").to_owned()
}

pub(crate) fn told(status: &Status) -> String {
    format!("{:?} {}: {}", status.code(), reason(status), status.message())
}

pub(crate) fn name(frame: &Down) -> &'static str {
    match frame {
        Down::Welcome(_) => "Welcome",
        Down::EpisodeStart(_) => "EpisodeStart",
        Down::Observation(_) => "Observation",
        Down::EpisodeEnd(_) => "EpisodeEnd",
        Down::Ping(_) => "Ping",
        Down::Notice(_) => "Notice",
        Down::Fault(_) => "Fault",
        Down::RunEnd(_) => "RunEnd",
    }
}
