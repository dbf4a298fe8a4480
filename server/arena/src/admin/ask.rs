use crate::{Failure, FailureKind};
use axum::http::{Method, Request, StatusCode, Uri, header};
use http_body_util::{BodyExt, Full, Limited};
use hyper::{body::Bytes, client::conn::http1};
use hyper_util::rt::TokioIo;
use std::time::Duration;
use tokio::{net::TcpStream, time::timeout};

/// Longest wait for an answer.
const PATIENCE: Duration = Duration::from_secs(10);
/// Largest answer, bytes.
const MAX_ANSWER_BYTES: usize = 4 << 20;

/// Answer of the admin server.
pub struct Answer {
    /// HTTP status.
    pub status: StatusCode,
    /// The words.
    pub body: Bytes,
}

/// Requests `path` from the admin server at `server`, like `http://127.0.0.1:50052`, with an optional `body`.
///
/// # Errors
/// If the server does not answer.
pub async fn ask(server: &str, path: &str, token: &str, body: Option<Vec<u8>>) -> Result<Answer, Failure> {
    let failed = |problem: String| {
        Failure::new(FailureKind::Run, format!("{server}{path}: {problem}"))
            .hinted("--server is the address that `avln serve` was given with --admin, http://127.0.0.1:50052 unless told otherwise; from another machine go through: ssh -L 50052:127.0.0.1:50052 HOST")
    };
    let address: Uri = server.parse().map_err(|error| failed(format!("it is no address: {error}")))?;
    let (Some("http"), Some(authority)) = (address.scheme_str(), address.authority()) else {
        return Err(failed("it is no address like http://127.0.0.1:50052".to_owned()));
    };
    let method = if body.is_some() { Method::POST } else { Method::GET };
    let request = Request::builder()
        .method(method)
        .uri(path)
        .header(header::HOST, authority.as_str())
        .header(header::AUTHORIZATION, format!("Bearer {token}"))
        .header(header::CONTENT_TYPE, "application/json")
        .body(Full::new(Bytes::from(body.unwrap_or_default())))
        .map_err(|error| failed(error.to_string()))?;
    let place = (authority.host().trim_matches(['[', ']']).to_owned(), authority.port_u16().unwrap_or(80));
    match timeout(PATIENCE, send(place, request)).await {
        Ok(answer) => answer.map_err(|error| failed(error.to_string())),
        Err(_) => Err(failed("no answer in ten seconds".to_owned())),
    }
}

type Trouble = Box<dyn std::error::Error + Send + Sync>;

async fn send(place: (String, u16), request: Request<Full<Bytes>>) -> Result<Answer, Trouble> {
    let stream = TcpStream::connect(place).await?;
    let (mut sender, connection) = http1::handshake(TokioIo::new(stream)).await?;
    let driver = tokio::spawn(connection);
    let response = sender.send_request(request).await?;
    let status = response.status();
    let body = Limited::new(response.into_body(), MAX_ANSWER_BYTES).collect().await?.to_bytes();
    driver.abort();
    Ok(Answer { status, body })
}
