//! Clients of a test server: runs with fixed actions, and gRPC calls without the SDK.

use crate::PHASE;
use avln_client::{Action, Client, Observation, Order, RunOptions, Sensors};
use prost::Message;
use tonic::client::Grpc;
use tonic::codegen::http::uri::PathAndQuery;
use tonic::codegen::tokio_stream;
use tonic::transport::{Channel, Endpoint};
use tonic::{Request, Status};
use tonic_prost::ProstCodec;

/// Pose only.
pub const NO_SENSORS: Sensors =
    Sensors { rgb: false, depth: false, audio: false, width: 64, height: 64, hfov_rad: 1.57 };
/// Most actions per episode.
pub const STEPS: u32 = 41;

/// Pose and sound.
pub const AUDIO_ONLY: Sensors = Sensors { audio: true, ..NO_SENSORS };

/// Plays a run's episodes in sequence; returns the id.
pub async fn play_script(url: &str, token: &str, method: &str) -> String {
    play_script_with(url, token, method, NO_SENSORS, |_, _| ()).await
}

/// Plays with `sensors` and passes each observation to `sense`, with the episode index from 0.
pub async fn play_script_with(
    url: &str,
    token: &str,
    method: &str,
    sensors: Sensors,
    mut sense: impl FnMut(u32, &Observation),
) -> String {
    let client = Client::connect(url, token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, method).order(Order::Unordered)).await.expect("a run");
    let mut play = client.play(&run, sensors).await.expect("a stream");
    while let Some(mut episode) = play.next_episode().await.expect("a stream") {
        let ordinal = episode.ordinal() - 1;
        sense(ordinal, episode.observation());
        while !episode.is_over() {
            let action = match episode.observation().step + 1 {
                STEPS => Action::Stop,
                20 => Action::Submit,
                step if step % 7 == 3 => Action::TurnLeft,
                _ => Action::MoveForward,
            };
            episode.step(action).await.expect("a legal step");
            sense(ordinal, episode.observation());
        }
    }
    assert!(play.finish().await.expect("a summary").complete);
    run.id
}

/// Wire action number.
pub const MOVE_FORWARD: i32 = 1;
/// Wire action number.
pub const SUBMIT: i32 = 4;

/// Tags from `avln.v1`, `grpc.health.v1` and `grpc.reflection.v1`.
#[derive(Clone, PartialEq, Message)]
struct Text {
    #[prost(string, tag = "1")]
    text: String,
}

#[derive(Clone, PartialEq, Message)]
struct ResetRequest {
    #[prost(message, optional, tag = "1")]
    hello: Option<Text>,
}

#[derive(Clone, PartialEq, Message)]
struct ResetResponse {
    #[prost(message, optional, tag = "2")]
    episode_start: Option<EpisodeStart>,
    #[prost(message, optional, tag = "3")]
    run_end: Option<RunEnd>,
}

#[derive(Clone, PartialEq, Message)]
struct RunEnd {
    #[prost(bool, tag = "5")]
    complete: bool,
}

#[derive(Clone, PartialEq, Message)]
struct EpisodeStart {
    #[prost(string, tag = "2")]
    episode: String,
}

#[derive(Clone, PartialEq, Message)]
struct Abandon {
    #[prost(string, tag = "2")]
    episode: String,
    #[prost(uint32, tag = "3")]
    step: u32,
}

#[derive(Clone, PartialEq, Message)]
struct Act {
    #[prost(string, tag = "2")]
    episode: String,
    #[prost(uint32, tag = "3")]
    step: u32,
    #[prost(int32, tag = "4")]
    action: i32,
}

#[derive(Clone, PartialEq, Message)]
struct StepRequest {
    #[prost(message, optional, tag = "1")]
    act: Option<Act>,
}

#[derive(Clone, PartialEq, Message)]
struct EndRequest {
    #[prost(message, optional, tag = "1")]
    abandon: Option<Abandon>,
    #[prost(message, optional, tag = "2")]
    goodbye: Option<Text>,
}

#[derive(Clone, PartialEq, Message)]
struct EndResponse {
    #[prost(message, optional, tag = "2")]
    run_end: Option<RunEnd>,
}

#[derive(Clone, PartialEq, Message)]
struct PlayRequest {
    #[prost(message, optional, tag = "1")]
    hello: Option<ResumingHello>,
}

#[derive(Clone, PartialEq, Message)]
struct ResumingHello {
    #[prost(bool, tag = "5")]
    resume: bool,
    #[prost(message, repeated, tag = "6")]
    known: Vec<SlotPosition>,
}

#[derive(Clone, PartialEq, Message)]
struct SlotPosition {
    #[prost(string, tag = "2")]
    episode: String,
}

#[derive(Clone, PartialEq, Message)]
struct PlayResponse {
    #[prost(message, optional, tag = "4")]
    episode_end: Option<EpisodeEnd>,
}

#[derive(Clone, PartialEq, Message)]
struct EpisodeEnd {
    #[prost(uint32, tag = "3")]
    step: u32,
    #[prost(message, optional, tag = "7")]
    progress: Option<RunProgress>,
}

#[derive(Clone, PartialEq, Message)]
struct RunProgress {
    #[prost(uint32, tag = "2")]
    done: u32,
}

#[derive(Clone, PartialEq, Message)]
struct HealthCheckResponse {
    #[prost(int32, tag = "1")]
    status: i32,
}

#[derive(Clone, PartialEq, Message)]
struct ReflectionRequest {
    #[prost(string, optional, tag = "4")]
    file_containing_symbol: Option<String>,
    #[prost(string, optional, tag = "7")]
    list_services: Option<String>,
}

/// A connection, with the token that it shows.
#[derive(Debug)]
pub struct RawClient {
    grpc: Grpc<Channel>,
    token: String,
}

impl RawClient {
    /// Connects to the agents' door at `url`.
    pub async fn connect(url: &str, token: &str) -> Self {
        let endpoint = Endpoint::from_shared(url.to_owned()).expect("an address");
        let channel = endpoint.connect().await.expect("a connection");
        Self { grpc: Grpc::new(channel), token: token.to_owned() }
    }

    /// Plays `actions` in the next episode with Reset and Step and the run's sensors, then abandons the episode with
    /// End, and with `farewell` the run.
    ///
    /// # Errors
    /// If the server rejects a call.
    pub async fn play(&mut self, actions: &[i32], farewell: bool) -> Result<(), Status> {
        let reset = ResetRequest { hello: Some(Text::default()) };
        let begun: ResetResponse = self.ask("avln.v1.PlayService/Reset", reset).await?;
        let episode = begun.episode_start.unwrap_or_default().episode;
        for (step, &action) in (1..).zip(actions) {
            let act = Act { episode: episode.clone(), step, action };
            let () = self.ask("avln.v1.PlayService/Step", StepRequest { act: Some(act) }).await?;
        }
        let abandon = Some(Abandon { episode, step: actions.len() as u32 });
        let () = self.ask("avln.v1.PlayService/End", EndRequest { abandon, goodbye: None }).await?;
        if farewell {
            self.leave().await?;
        }
        Ok(())
    }

    /// Leaves the run with End; returns whether every episode was played.
    ///
    /// # Errors
    /// If the server rejects the call.
    pub async fn leave(&mut self) -> Result<bool, Status> {
        let goodbye = EndRequest { abandon: None, goodbye: Some(Text::default()) };
        let answer: EndResponse = self.ask("avln.v1.PlayService/End", goodbye).await?;
        Ok(answer.run_end.is_some_and(|end| end.complete))
    }

    /// Calls Reset; returns whether every episode was played, or `None` if an episode begins.
    ///
    /// # Errors
    /// If the server rejects the call.
    pub async fn reset(&mut self) -> Result<Option<bool>, Status> {
        let reset = ResetRequest { hello: Some(Text::default()) };
        let answer: ResetResponse = self.ask("avln.v1.PlayService/Reset", reset).await?;
        Ok(answer.run_end.map(|end| end.complete))
    }

    /// Resumes a run that is over on a stream; returns the reported steps of `episode` and the run's finished episodes.
    ///
    /// # Errors
    /// If the server rejects the call or reports no end.
    pub async fn late_result(&mut self, episode: &str) -> Result<(u32, u32), Status> {
        let known = vec![SlotPosition { episode: episode.to_owned() }];
        let hello = PlayRequest { hello: Some(ResumingHello { resume: true, known }) };
        self.ready().await?;
        let path = PathAndQuery::from_static("/avln.v1.PlayService/Play");
        let codec = ProstCodec::<PlayRequest, PlayResponse>::default();
        let request = self.authorised(tokio_stream::iter([hello]));
        let mut answers = self.grpc.streaming(request, path, codec).await?.into_inner();
        while let Some(answer) = answers.message().await? {
            if let Some(end) = answer.episode_end {
                return Ok((end.step, end.progress.unwrap_or_default().done));
            }
        }
        Err(Status::internal("the stream ended without EpisodeEnd"))
    }

    /// Asks for the team's quota in a phase.
    ///
    /// # Errors
    /// If the server rejects the call.
    pub async fn quota(&mut self, phase: &str) -> Result<(), Status> {
        self.ask("avln.v1.RunService/GetQuota", Text { text: phase.to_owned() }).await
    }

    /// Returns whether health reports `service` as serving; an empty name is the whole server.
    ///
    /// # Errors
    /// If the server rejects the call.
    pub async fn health(&mut self, service: &str) -> Result<bool, Status> {
        const SERVING: i32 = 1;
        let question = Text { text: service.to_owned() };
        let answer: HealthCheckResponse = self.ask("grpc.health.v1.Health/Check", question).await?;
        Ok(answer.status == SERVING)
    }

    /// Calls health, and reflection for all services and `symbols`.
    ///
    /// # Errors
    /// If the server rejects a call.
    pub async fn inspect(&mut self, symbols: &[&str]) -> Result<(), Status> {
        let () = self.ask("grpc.health.v1.Health/Check", Text::default()).await?;
        let list = ReflectionRequest { list_services: Some(String::new()), file_containing_symbol: None };
        let files = symbols.iter().map(|symbol| ReflectionRequest {
            file_containing_symbol: Some((*symbol).to_owned()),
            list_services: None,
        });
        let questions: Vec<_> = std::iter::once(list).chain(files).collect();
        let count = questions.len();
        self.ready().await?;
        let path = PathAndQuery::from_static("/grpc.reflection.v1.ServerReflection/ServerReflectionInfo");
        let codec = ProstCodec::<ReflectionRequest, ()>::default();
        let answers = self.grpc.streaming(Request::new(tokio_stream::iter(questions)), path, codec).await?;
        let mut answers = answers.into_inner();
        for _ in 0..count {
            answers.message().await?.ok_or_else(|| Status::internal("reflection fell silent"))?;
        }
        Ok(())
    }

    async fn ask<Q, A>(&mut self, method: &str, question: Q) -> Result<A, Status>
    where
        Q: Message + 'static,
        A: Message + Default + 'static,
    {
        self.ready().await?;
        let request = self.authorised(question);
        let path = format!("/{method}").parse().expect("methods are plain text");
        Ok(self.grpc.unary(request, path, ProstCodec::default()).await?.into_inner())
    }

    fn authorised<Q>(&self, question: Q) -> Request<Q> {
        let mut request = Request::new(question);
        let token = format!("Bearer {}", self.token).parse().expect("tokens are plain text");
        request.metadata_mut().insert("authorization", token);
        request
    }

    async fn ready(&mut self) -> Result<(), Status> {
        self.grpc.ready().await.map_err(|error| Status::unavailable(error.to_string()))
    }
}
