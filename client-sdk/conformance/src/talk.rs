//! A protocol client for checks: a connection with a run, and streams.

use avln_proto::v1;
use avln_proto::v1::play_request::Frame as Up;
use avln_proto::v1::play_response::Frame as Down;
use avln_proto::v1::play_service_client::PlayServiceClient;
use avln_proto::v1::run_service_client::RunServiceClient;
use avln_proto::{MAX_MESSAGE_BYTES, REASON_KEY};
use std::time::Duration;
use tokio::{sync::mpsc, time::timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Certificate, Channel, ClientTlsConfig, Endpoint};
use tonic::{Request, Status, Streaming};

// The server may have to load scenes before it answers.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(60);
const QUEUED_FRAMES: usize = 64;

/// Errors before the first check.
#[derive(Debug, thiserror::Error)]
pub enum Trouble {
    /// No answer from the server.
    #[error("cannot reach {address}: {detail}; use the gRPC port's address like http://127.0.0.1:50051")]
    Unreachable {
        /// Given address.
        address: String,
        /// Network error.
        detail: String,
    },
    /// The server refused the run for the checks.
    #[error(
        "cannot start a run in phase '{phase}': {detail}; use an open phase with --phase and an account token"
    )]
    NoRun {
        /// Phase.
        phase: String,
        /// Server message.
        detail: String,
    },
}

/// Server location.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// Address: `http://` or `https://`.
    pub server: &'a str,
    /// PEM certificates of authorities for an `https://` server, instead of the system store.
    pub ca: Option<&'a str>,
}

impl Site<'_> {
    fn endpoint(&self) -> Result<Endpoint, tonic::transport::Error> {
        let endpoint = Endpoint::new(self.server.to_owned())?;
        let endpoint = endpoint.max_frame_size(256 << 10).initial_stream_window_size(2 << 20);
        if !self.server.starts_with("https://") {
            return Ok(endpoint);
        }
        let tls = ClientTlsConfig::new();
        endpoint.tls_config(match self.ca {
            None => tls.with_native_roots(),
            Some(pem) => tls.ca_certificate(Certificate::from_pem(pem)),
        })
    }
}

fn chain(error: &dyn std::error::Error) -> String {
    let behind = std::iter::successors(error.source(), |error| error.source());
    behind.fold(error.to_string(), |text, error| format!("{text}: {error}"))
}

/// A connection to the server with a run.
pub(crate) struct Connection {
    pub(crate) channel: Channel,
    pub(crate) run: v1::Run,
    pub(crate) run_token: String,
    pub(crate) account_token: String,
}

impl Connection {
    pub(crate) async fn open(site: &Site<'_>, token: &str, phase: &str) -> Result<Self, Trouble> {
        let unreachable = |error: tonic::transport::Error| Trouble::Unreachable {
            address: site.server.to_owned(),
            detail: chain(&error),
        };
        let channel = site.endpoint().map_err(unreachable)?.connect().await.map_err(unreachable)?;
        let no_run = |detail: String| Trouble::NoRun { phase: phase.to_owned(), detail };
        let method = v1::MethodInfo {
            name: "conformance".to_owned(),
            method_type: v1::MethodType::TrainingFree.into(),
            ..v1::MethodInfo::default()
        };
        let request = v1::StartRunRequest {
            phase: phase.to_owned(),
            order: v1::Order::Unordered.into(),
            method: Some(method),
            ..v1::StartRunRequest::default()
        };
        let started = RunServiceClient::new(channel.clone()).start_run(bearer(request, token)).await;
        let started = started.map_err(|status| no_run(status.message().to_owned()))?.into_inner();
        let run = started.run.ok_or_else(|| no_run("the answer to StartRun contains no run".to_owned()))?;
        Ok(Self { channel, run, run_token: started.run_token, account_token: token.to_owned() })
    }

    pub(crate) fn runs(&self) -> RunServiceClient<Channel> {
        RunServiceClient::new(self.channel.clone())
    }

    pub(crate) fn play(&self) -> PlayServiceClient<Channel> {
        PlayServiceClient::new(self.channel.clone()).max_decoding_message_size(MAX_MESSAGE_BYTES)
    }

    pub(crate) async fn dial(&self, token: &str, first: Up) -> Result<Stream, Status> {
        let (up, queue) = mpsc::channel(QUEUED_FRAMES);
        // The queue is new and therefore has room.
        let _ = up.try_send(v1::PlayRequest { frame: Some(first) });
        let down = self.play().play(bearer(ReceiverStream::new(queue), token)).await?.into_inner();
        Ok(Stream { up, down })
    }

    /// Opens a stream up to Welcome.
    pub(crate) async fn enter(&self, hello: v1::Hello) -> Result<(Stream, v1::Welcome), String> {
        let opened = self.dial(&self.run_token, Up::Hello(hello)).await;
        let mut stream = opened.map_err(|status| describe(&status))?;
        match stream.next().await? {
            Down::Welcome(welcome) => Ok((stream, welcome)),
            other => Err(format!("Hello: expected Welcome, got {}", frame_name(&other))),
        }
    }
}

pub(crate) struct Stream {
    up: mpsc::Sender<v1::PlayRequest>,
    down: Streaming<v1::PlayResponse>,
}

impl Stream {
    pub(crate) async fn send(&self, frame: Up) {
        let _ = self.up.send(v1::PlayRequest { frame: Some(frame) }).await;
    }

    /// Acts in slot 0.
    pub(crate) async fn act(&self, episode: &str, step: u32, action: i32) {
        self.act_in(0, episode, step, action).await;
    }

    pub(crate) async fn act_in(&self, slot: u32, episode: &str, step: u32, action: i32) {
        self.send(Up::Act(v1::Act { slot, episode: episode.to_owned(), step, action })).await;
    }

    pub(crate) async fn next(&mut self) -> Result<Down, String> {
        loop {
            // The server may send Ping and Notice at any time.
            match self.next_or_end().await? {
                Ok(Some(Down::Ping(_) | Down::Notice(_))) => {}
                Ok(Some(frame)) => return Ok(frame),
                Ok(None) => return Err("the stream ended without a frame".to_owned()),
                Err(status) => return Err(describe(&status)),
            }
        }
    }

    /// Returns the next frame, or `None` at the end of the stream.
    pub(crate) async fn next_or_end(&mut self) -> Result<Result<Option<Down>, Status>, String> {
        let next = timeout(ANSWER_TIMEOUT, self.down.message()).await;
        let next = next.map_err(|_| format!("no answer within {ANSWER_TIMEOUT:?}"))?;
        Ok(next.map(|response| response.and_then(|response| response.frame)))
    }

    /// Starts an episode in slot 0.
    pub(crate) async fn start(&mut self) -> Result<v1::EpisodeStart, String> {
        self.start_in(0).await
    }

    pub(crate) async fn start_in(&mut self, slot: u32) -> Result<v1::EpisodeStart, String> {
        self.send(Up::Ready(v1::Ready { slot })).await;
        match self.next().await? {
            Down::EpisodeStart(start) => Ok(start),
            other => Err(format!("Ready: expected EpisodeStart, got {}", frame_name(&other))),
        }
    }

    pub(crate) async fn observation(&mut self) -> Result<v1::Observation, String> {
        match self.next().await? {
            Down::Observation(seen) => Ok(seen),
            other => Err(format!("expected Observation, got {}", frame_name(&other))),
        }
    }

    pub(crate) async fn abandon(&mut self, episode: String, step: u32) -> Result<v1::EpisodeEnd, String> {
        self.send(Up::Abandon(v1::Abandon { slot: 0, episode, step })).await;
        self.end().await
    }

    pub(crate) async fn end(&mut self) -> Result<v1::EpisodeEnd, String> {
        match self.next().await? {
            Down::EpisodeEnd(end) => Ok(end),
            other => Err(format!("expected EpisodeEnd, got {}", frame_name(&other))),
        }
    }

    /// Expects a recoverable fault.
    pub(crate) async fn refusal(&mut self, expected: v1::Reason) -> Result<(), String> {
        match self.next().await? {
            Down::Fault(fault) if fault.reason() == expected && fault.recoverable => Ok(()),
            Down::Fault(fault) => Err(format!(
                "expected a recoverable {}, got {} with recoverable = {}",
                expected.as_str_name(),
                fault.reason().as_str_name(),
                fault.recoverable
            )),
            other => Err(format!("expected Fault, got {}", frame_name(&other))),
        }
    }
}

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

pub(crate) fn reason(status: &Status) -> String {
    let word = status.metadata().get(REASON_KEY).and_then(|word| word.to_str().ok());
    word.unwrap_or("no reason").to_owned()
}

pub(crate) fn describe(status: &Status) -> String {
    format!("{:?} {}: {}", status.code(), reason(status), status.message())
}

pub(crate) fn frame_name(frame: &Down) -> &'static str {
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
