//! Unary calls with retries after a lost answer, and the handshake of a run stream.

use crate::error::{Error, closed};
use crate::service::RunOptions;
use avln_proto::{
    MAX_MESSAGE_BYTES,
    v1::{self, play_request, play_response::Frame, play_service_client::PlayServiceClient},
};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, timeout};
use tokio_stream::wrappers::ReceiverStream;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::transport::Channel;
use tonic::{Request, Response, Status, Streaming};

pub(crate) const TIMEOUT: Duration = Duration::from_secs(30);
const RETRY_TIME: Duration = Duration::from_secs(10);

/// Makes an idempotent call, repeated while the connection is lost.
pub(crate) async fn persist<A, F>(
    attempted: &'static str,
    patience: Option<Duration>,
    call: impl Fn() -> F,
) -> Result<A, Error>
where
    F: Future<Output = Result<Response<A>, Status>>,
{
    let until = Instant::now() + patience.unwrap_or(RETRY_TIME).min(RETRY_TIME);
    let mut backoff = Backoff::new();
    loop {
        let answer = unwrap(attempted, call().await);
        // A refusal is an answer: repeating the request would not change it.
        let Err(error @ Error::Lost { .. }) = &answer else { return answer };
        let pause = backoff.after(error);
        if Instant::now() + pause >= until {
            return answer;
        }
        sleep(pause).await;
    }
}

pub(crate) fn unwrap<T>(attempted: &'static str, answer: Result<Response<T>, Status>) -> Result<T, Error> {
    answer.map(Response::into_inner).map_err(|status| Error::from_status(attempted, &status))
}

pub(crate) fn plain<T>(message: T) -> Request<T> {
    let mut request = Request::new(message);
    request.set_timeout(TIMEOUT);
    request
}

pub(crate) type Bearer = MetadataValue<Ascii>;

pub(crate) fn bearer(token: &str) -> Result<Bearer, Error> {
    format!("Bearer {token}").parse().map_err(|_| Error::Token {
        attempted: "send the token",
        reason: v1::Reason::TokenMalformed,
        message: "it contains characters that are not allowed in tokens".to_owned(),
    })
}

pub(crate) fn signed<T>(mut request: Request<T>, bearer: &Bearer) -> Request<T> {
    request.metadata_mut().insert("authorization", bearer.clone());
    request
}

impl RunOptions {
    /// Adds a request id if missing, so that a repeated request starts a single run.
    pub(crate) fn named(self) -> Self {
        if self.request_id.is_empty() { self.request_id(random_name()) } else { self }
    }
}

/// Returns 32 random hexadecimal digits.
fn random_name() -> String {
    // Without a random source the id is empty, and the server starts a run per request. A constant id would return
    // an older run instead.
    let words = getrandom::u64().and_then(|first| Ok((first, getrandom::u64()?)));
    words.map_or_else(|_| String::new(), |(first, second)| format!("{first:016x}{second:016x}"))
}

const FIRST_PAUSE: Duration = Duration::from_millis(50);
/// Longest pause without a delay requested by the server.
const LONGEST_PAUSE: Duration = Duration::from_secs(2);
// A wrong delay from a server must not stop a client for hours.
const LONGEST_DELAY: Duration = Duration::from_secs(300);

pub(crate) struct Backoff {
    pause: Duration,
}

impl Backoff {
    pub(crate) fn new() -> Self {
        Self { pause: FIRST_PAUSE }
    }

    /// Returns the pause after `error`, at least the server's requested delay, and doubles the next pause.
    pub(crate) fn after(&mut self, error: &Error) -> Duration {
        let delay = Duration::from_secs(error.retry_after_s().unwrap_or(0).into()).min(LONGEST_DELAY);
        // A restart ends all streams at once. Without jitter the clients would return in lockstep and overload the
        // server, also after an equal delay.
        let pause = delay + self.pause.mul_f64(0.5 + 0.5 * random_share());
        self.pause = (2 * self.pause).min(LONGEST_PAUSE);
        pause
    }
}

/// Returns a random number in [0, 1).
fn random_share() -> f64 {
    let bits = getrandom::u64().unwrap_or(1 << 63);
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

const PLAY: &str = "open the run's stream";

pub(crate) enum Greeting {
    Welcome {
        requests: mpsc::Sender<v1::PlayRequest>,
        responses: Streaming<v1::PlayResponse>,
        welcome: Box<v1::Welcome>,
    },
    /// The resumed run has ended, including episodes still open at the client.
    RunEnd(Vec<v1::EpisodeEnd>, v1::RunEnd),
}

pub(crate) async fn greet(channel: &Channel, token: &str, hello: v1::Hello) -> Result<Greeting, Error> {
    // Per slot one unanswered frame and one to resend, plus Hello, Goodbye and Pongs.
    let (requests, outbound) = mpsc::channel(2 * hello.slots.min(64) as usize + 4);
    let _ = requests.try_send(v1::PlayRequest { frame: Some(play_request::Frame::Hello(hello)) });
    let request = signed(Request::new(ReceiverStream::new(outbound)), &bearer(token)?);
    let mut client = PlayServiceClient::new(channel.clone())
        .max_decoding_message_size(MAX_MESSAGE_BYTES)
        .max_encoding_message_size(MAX_MESSAGE_BYTES);
    let responses = unwrap(PLAY, client.play(request).await)?;
    let silent = |_| Error::Lost { attempted: PLAY, detail: format!("no Welcome within {TIMEOUT:?}") };
    timeout(TIMEOUT, await_welcome(requests, responses)).await.map_err(silent)?
}

async fn await_welcome(
    requests: mpsc::Sender<v1::PlayRequest>,
    mut responses: Streaming<v1::PlayResponse>,
) -> Result<Greeting, Error> {
    let mut ends = Vec::new();
    loop {
        let next = responses.message().await.map_err(|status| Error::from_status(PLAY, &status))?;
        let Some(response) = next else { return Err(closed(PLAY, None)) };
        match response.frame {
            Some(Frame::Welcome(welcome)) => {
                return Ok(Greeting::Welcome { requests, responses, welcome: Box::new(welcome) });
            }
            // Episodes that ended during the disconnection precede RunEnd.
            Some(Frame::EpisodeEnd(end)) => ends.push(end),
            Some(Frame::RunEnd(end)) => return Ok(Greeting::RunEnd(ends, end)),
            Some(Frame::Fault(fault)) => return Err(Error::from_fault(PLAY, &fault)),
            Some(Frame::Ping(_) | Frame::Notice(_)) | None => {}
            Some(_) => return Err(Error::protocol("the first frame was not Welcome")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_proto::v1::Reason;
    use std::cell::Cell;
    use tonic::Code;

    #[test]
    fn token_with_line_break_is_rejected() {
        assert!(matches!(bearer("a\nb"), Err(Error::Token { .. })));
    }

    #[tokio::test]
    async fn lost_answer_is_retried_but_not_refusal() {
        let asked = Cell::new(0);
        let lost_twice = || {
            asked.set(asked.get() + 1);
            let answer =
                if asked.get() < 3 { Err(Status::unavailable("gone")) } else { Ok(Response::new(7)) };
            async move { answer }
        };
        assert!(matches!(persist("ask", None, lost_twice).await, Ok(7)));
        let refused = || {
            asked.set(asked.get() + 1);
            async { Err::<Response<()>, _>(Status::not_found("no such run")) }
        };
        assert!(matches!(persist("ask", None, refused).await, Err(Error::Refused { .. })));
        assert_eq!(asked.get(), 4);
    }

    #[tokio::test]
    async fn patience_ends() {
        let asked = Cell::new(0);
        let gone = || {
            asked.set(asked.get() + 1);
            async { Err::<Response<()>, _>(Status::unavailable("gone")) }
        };
        let (began, patience) = (Instant::now(), Duration::from_millis(400));
        assert!(matches!(persist("ask", Some(patience), gone).await, Err(Error::Lost { .. })));
        assert!(began.elapsed() < RETRY_TIME && asked.get() > 1, "{} attempts", asked.get());
        asked.set(0);
        assert!(persist("ask", Some(Duration::ZERO), gone).await.is_err());
        assert_eq!(asked.get(), 1);
    }

    #[test]
    fn requests_get_names_of_their_own() {
        assert_ne!(random_name(), random_name());
        assert_eq!(random_name().len(), 32);
        let named = RunOptions::new("practice", "m").request_id("mine").named();
        assert_eq!(named, RunOptions::new("practice", "m").request_id("mine"));
    }

    fn lost() -> Error {
        Error::Lost { attempted: "ask", detail: "gone".to_owned() }
    }

    #[test]
    fn pauses_double_up_to_the_limit() {
        let mut backoff = Backoff::new();
        for expected in [50, 100, 200, 400, 800, 1600, 2000, 2000] {
            let pause = backoff.after(&lost()).as_millis();
            assert!((expected / 2..=expected).contains(&pause), "{pause} ms, expected up to {expected} ms");
        }
    }

    #[test]
    fn pauses_of_two_clients_differ() {
        let pauses: Vec<_> = (0..8).map(|_| Backoff::new().after(&lost())).collect();
        assert!(pauses.windows(2).any(|pair| pair[0] != pair[1]), "{pauses:?}");
    }

    #[test]
    fn requested_delay_is_a_lower_bound() {
        let draining = Error::refused("play", Code::Unavailable, Reason::Draining, "stopping", Some(5));
        assert!(Backoff::new().after(&draining) >= Duration::from_secs(5));
    }
}
