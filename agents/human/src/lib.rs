//! A person as an agent: a browser page on this machine shows the observations and asks for actions.
//!
//! Start reading at [`run`]: `game` plays the run.
//!
//! This crate never shows the person more than an agent observes or links a server crate other than
//! `avln-simd`.

mod game;

use avln_client::{Action, Error, RunSummary, Sensors};
use avln_kit::run::OnEnd;
use axum::extract::{Path, Request};
use axum::http::{HeaderName, HeaderValue, Method, StatusCode, header};
use axum::middleware::{Next, from_fn};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Router};
use clap::Args;
use game::{PageRequest, PendingRequest};
use std::{io, net::SocketAddr, time::Duration};
use tokio::net::TcpListener;
use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

pub use avln_kit::run::RunArgs;

/// Command-line arguments.
#[derive(Args, Clone, Debug)]
pub struct HumanArgs {
    /// The run.
    #[command(flatten)]
    pub run: RunArgs,
    /// Side of the images in pixels, 64 to 1024
    #[arg(long, default_value_t = 256, value_name = "PIXELS")]
    pub size: u32,
    /// Address of the page on this machine
    #[arg(long, default_value = "127.0.0.1:8090", value_name = "ADDRESS")]
    pub page: SocketAddr,
}

/// Reasons for a failed run.
#[derive(Debug, thiserror::Error)]
pub enum HumanError {
    /// An error of the run, as for every agent.
    #[error(transparent)]
    Run(#[from] Error),
    /// The page would be reachable from other machines.
    #[error("{0} is reachable from other machines, and the page has no login; use --page 127.0.0.1:8090")]
    Open(SocketAddr),
    /// The page's address is not available.
    #[error("cannot show the page at {address}: {error}; choose another address with --page")]
    Page {
        /// Requested address.
        address: SocketAddr,
        /// System error.
        error: io::Error,
    },
}

/// Lets a person play one run, and prints the page's address; fails like the run, or without a page.
pub async fn run(args: HumanArgs) -> Result<RunSummary, HumanError> {
    let print = |address| {
        eprintln!("open http://{address} in a browser on this machine and put headphones on");
    };
    run_with(args, print, &mut |_| {}).await
}

/// Lets a person play one run like [`run`]; calls `on_page` with the address and `on_end` after each episode.
pub async fn run_with(
    args: HumanArgs,
    on_page: impl FnOnce(SocketAddr),
    on_end: OnEnd<'_>,
) -> Result<RunSummary, HumanError> {
    if !args.page.ip().is_loopback() {
        return Err(HumanError::Open(args.page));
    }
    let no_page = |error| HumanError::Page { address: args.page, error };
    let listener = TcpListener::bind(args.page).await.map_err(no_page)?;
    let address = listener.local_addr().map_err(no_page)?;
    // No method type describes a person.
    let (arena, run) = args.run.begin("human", env!("CARGO_PKG_VERSION"), None).await?;
    let play = arena.play(&run, Sensors::square(args.size)).await?;
    let (requests, received) = mpsc::channel(1);
    let (stop, stopped) = oneshot::channel();
    let page = tokio::spawn(serve(listener, address, requests, stopped));
    on_page(address);
    let played = game::play(play, received, on_end).await;
    // The last answer may still be on its way to the browser: the page closes only after sending it. A failed page has
    // nothing to finish.
    let _ = stop.send(());
    let _ = page.await;
    Ok(played?)
}

/// A header that other sites' pages cannot send without a preflight request.
const OURS: &str = "x-avln-page";
/// Time limit of an answer: the server may have to build a scene first.
const PATIENCE: Duration = Duration::from_secs(600);
/// Time limit for open answers after the run.
const FAREWELL: Duration = Duration::from_secs(2);
const HEADERS: [(HeaderName, &str); 4] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
];

#[derive(Clone, Copy)]
struct PageAddress(SocketAddr);

/// Serves the page until `stopped`, and forwards requests to the run.
pub(crate) async fn serve(
    listener: TcpListener,
    address: SocketAddr,
    requests: mpsc::Sender<PendingRequest>,
    stopped: oneshot::Receiver<()>,
) {
    let (over, ended) = oneshot::channel();
    let served = axum::serve(listener, router(address, requests)).with_graceful_shutdown(async {
        let _ = stopped.await;
        let _ = over.send(());
    });
    let served = async { served.await };
    let patience = async {
        let _ = ended.await;
        tokio::time::sleep(FAREWELL).await;
    };
    tokio::select! {
        _ = served => {}
        () = patience => {}
    }
}

fn router(address: SocketAddr, requests: mpsc::Sender<PendingRequest>) -> Router {
    let file =
        |kind: &'static str, text: &'static str| get(async move || ([(header::CONTENT_TYPE, kind)], text));
    Router::new()
        .route("/", file("text/html; charset=utf-8", include_str!("../assets/play.html")))
        .route("/play.css", file("text/css; charset=utf-8", include_str!("../assets/play.css")))
        .route("/play.js", file("text/javascript; charset=utf-8", include_str!("../assets/play.js")))
        .route("/request/{request}", post(request))
        .layer(from_fn(guarded))
        .layer(Extension(PageAddress(address)))
        .layer(Extension(requests))
}

/// Refuses requests from other hosts and pages.
async fn guarded(
    Extension(PageAddress(address)): Extension<PageAddress>,
    request: Request,
    next: Next,
) -> Response {
    let headers = request.headers();
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let is_here = host == address.to_string() || host == format!("localhost:{}", address.port());
    let is_ours = request.method() == Method::GET || headers.contains_key(OURS);
    let mut response = if is_here && is_ours {
        next.run(request).await
    } else {
        (StatusCode::FORBIDDEN, "open the page at the address that the program printed\n").into_response()
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn request(
    Path(word): Path<String>,
    Extension(requests): Extension<mpsc::Sender<PendingRequest>>,
) -> Result<Response, StatusCode> {
    let request = read(&word).ok_or(StatusCode::NOT_FOUND)?;
    let (answer, answered) = oneshot::channel();
    let asked = async {
        requests.send(PendingRequest { request, answer }).await.ok()?;
        answered.await.ok()
    };
    match timeout(PATIENCE, asked).await {
        Ok(Some(bytes)) => Ok(([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response()),
        _ => Err(StatusCode::GONE),
    }
}

fn read(word: &str) -> Option<PageRequest> {
    match word {
        "look" => Some(PageRequest::Look),
        "next" => Some(PageRequest::Next),
        "forward" => Some(PageRequest::Act(Action::MoveForward)),
        "left" => Some(PageRequest::Act(Action::TurnLeft)),
        "right" => Some(PageRequest::Act(Action::TurnRight)),
        "submit" => Some(PageRequest::Act(Action::Submit)),
        "stop" => Some(PageRequest::Act(Action::Stop)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};
    use tokio::net::TcpStream;

    async fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).await.expect("the page is there");
        stream.write_all(request.as_bytes()).await.expect("it listens");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).await.expect("it answers");
        String::from_utf8_lossy(&answer).into_owned()
    }

    #[tokio::test]
    async fn foreign_origins_are_rejected_and_shutdown_closes_port() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let (requests, mut received) = mpsc::channel(1);
        let (stop, stopped) = oneshot::channel();
        let server = tokio::spawn(serve(listener, address, requests, stopped));
        tokio::spawn(async move {
            while let Some(PendingRequest { request, answer }) = received.recv().await {
                let _ = answer.send(format!("{request:?}").into_bytes());
            }
        });
        let post = |host: &str, word: &str, more: &str| {
            format!(
                "POST /request/{word} HTTP/1.1\r\nHost: {host}\r\n{more}Connection: close\r\nContent-Length: 0\r\n\r\n"
            )
        };
        let here = address.to_string();
        let answer = ask(address, &post(&here, "left", "X-Avln-Page: 1\r\n")).await;
        assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("Act(TurnLeft)"), "{answer}");
        for (host, word, more, status) in [
            (here.as_str(), "left", "", 403),
            ("evil.example", "left", "X-Avln-Page: 1\r\n", 403),
            (here.as_str(), "fly", "X-Avln-Page: 1\r\n", 404),
        ] {
            let answer = ask(address, &post(host, word, more)).await;
            assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{word} for {host}: {answer}");
        }
        let page =
            ask(address, &format!("GET / HTTP/1.1\r\nHost: {here}\r\nConnection: close\r\n\r\n")).await;
        assert!(page.contains("script-src 'self'") && page.contains("<script src=\"/play.js\""), "{page}");
        stop.send(()).expect("a running server");
        server.await.expect("it closes");
        assert!(TcpStream::connect(address).await.is_err());
    }
}
