//! gRPC calls without the SDK: unary play, health and reflection, with minimal requests. Answers are discarded: the
//! recording proxy reads them.

use prost::Message;
use tonic::{
    Request, Status,
    client::Grpc,
    codegen::{http::uri::PathAndQuery, tokio_stream},
    transport::{Channel, Endpoint},
};
use tonic_prost::ProstCodec;

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
            let goodbye = EndRequest { abandon: None, goodbye: Some(Text::default()) };
            let () = self.ask("avln.v1.PlayService/End", goodbye).await?;
        }
        Ok(())
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
        let mut request = Request::new(question);
        let token = format!("Bearer {}", self.token).parse().expect("tokens are plain text");
        request.metadata_mut().insert("authorization", token);
        let path = format!("/{method}").parse().expect("methods are plain text");
        Ok(self.grpc.unary(request, path, ProstCodec::default()).await?.into_inner())
    }

    async fn ready(&mut self) -> Result<(), Status> {
        self.grpc.ready().await.map_err(|error| Status::unavailable(error.to_string()))
    }
}
