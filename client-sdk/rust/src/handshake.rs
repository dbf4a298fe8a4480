//! The start of a run stream: Hello, and the server's answer.

use crate::{
    Error,
    calls::{TIMEOUT, bearer, signed, unwrap},
    error::closed,
};
use avln_proto::{
    MAX_MESSAGE_BYTES,
    v1::{self, play_request, play_response::Frame, play_service_client::PlayServiceClient},
};
use tokio::{sync::mpsc, time::timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::{Request, Streaming, transport::Channel};

const PLAY: &str = "open the run's stream";

/// Answer to a Hello.
pub(crate) enum Greeting {
    Welcome {
        requests: mpsc::Sender<v1::PlayRequest>,
        responses: Streaming<v1::PlayResponse>,
        welcome: Box<v1::Welcome>,
    },
    /// The resumed run has ended, including episodes still open at the client.
    RunEnd(Vec<v1::EpisodeEnd>, v1::RunEnd),
}

enum First {
    Welcome(Box<v1::Welcome>),
    RunEnd(Vec<v1::EpisodeEnd>, v1::RunEnd),
}

fn silent() -> Error {
    let detail = format!("no Welcome within {TIMEOUT:?}");
    Error::Lost { attempted: PLAY, detail }
}

/// Opens a stream with this Hello.
pub(crate) async fn greet(channel: &Channel, token: &str, hello: v1::Hello) -> Result<Greeting, Error> {
    let (requests, outbound) = mpsc::channel(2 * hello.slots.min(64) as usize + 4);
    let _ = requests.try_send(v1::PlayRequest { frame: Some(play_request::Frame::Hello(hello)) });
    let request = signed(Request::new(ReceiverStream::new(outbound)), &bearer(token)?);
    let mut client = PlayServiceClient::new(channel.clone())
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let mut responses = unwrap(PLAY, client.play(request).await)?;
    let waited = timeout(TIMEOUT, await_welcome(&mut responses)).await;
    match waited.unwrap_or_else(|_| Err(silent()))? {
        First::Welcome(welcome) => Ok(Greeting::Welcome { requests, responses, welcome }),
        First::RunEnd(ends, end) => Ok(Greeting::RunEnd(ends, end)),
    }
}

async fn await_welcome(responses: &mut Streaming<v1::PlayResponse>) -> Result<First, Error> {
    let mut ends = Vec::new();
    loop {
        let next = responses.message().await.map_err(|status| Error::from_status(PLAY, &status))?;
        let Some(response) = next else { return Err(closed(PLAY, None)) };
        match response.frame {
            Some(Frame::Welcome(welcome)) => return Ok(First::Welcome(Box::new(welcome))),
            Some(Frame::EpisodeEnd(end)) => ends.push(end),
            Some(Frame::RunEnd(end)) => return Ok(First::RunEnd(ends, end)),
            Some(Frame::Fault(fault)) => return Err(Error::from_fault(PLAY, &fault)),
            Some(Frame::Ping(_) | Frame::Notice(_)) | None => {}
            Some(_) => return Err(Error::protocol("the first frame was not Welcome")),
        }
    }
}
