//! The page on this machine. It asks nobody who they are, so it listens to no other machine, and to no page of another site.

use crate::game::{Wish, Wished};
use avln_client::Action;
use axum::{
    Extension, Router,
    extract::{Path, Request},
    http::{HeaderName, HeaderValue, Method, StatusCode, header},
    middleware::{Next, from_fn},
    response::{IntoResponse, Response},
    routing::{get, post},
};
use std::{net::SocketAddr, time::Duration};
use tokio::{
    net::TcpListener,
    sync::{mpsc, oneshot},
    time::timeout,
};

/// A header that pages of other sites cannot send unasked.
const OURS: &str = "x-avln-page";
/// How long an answer may take: a scene may have to be made first.
const PATIENCE: Duration = Duration::from_secs(600);
/// How long an answer that was begun may take once the run is over.
const FAREWELL: Duration = Duration::from_secs(2);
/// Headers of every answer.
const HEADERS: [(HeaderName, &str); 4] = [
    (
        header::CONTENT_SECURITY_POLICY,
        "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (header::REFERRER_POLICY, "no-referrer"),
    (header::CACHE_CONTROL, "no-store"),
];

/// Where the page is.
#[derive(Clone, Copy)]
struct Address(SocketAddr);

/// Shows the page until `stopped`; what the person wants goes to `wishes`.
pub(crate) async fn serve(
    listener: TcpListener,
    address: SocketAddr,
    wishes: mpsc::Sender<Wished>,
    stopped: oneshot::Receiver<()>,
) {
    let (over, ended) = oneshot::channel();
    let served = axum::serve(listener, router(address, wishes)).with_graceful_shutdown(async {
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

fn router(address: SocketAddr, wishes: mpsc::Sender<Wished>) -> Router {
    let file =
        |kind: &'static str, text: &'static str| get(async move || ([(header::CONTENT_TYPE, kind)], text));
    Router::new()
        .route("/", file("text/html; charset=utf-8", include_str!("../assets/play.html")))
        .route("/play.css", file("text/css; charset=utf-8", include_str!("../assets/play.css")))
        .route("/play.js", file("text/javascript; charset=utf-8", include_str!("../assets/play.js")))
        .route("/wish/{wish}", post(wish))
        .layer(from_fn(guarded))
        .layer(Extension(Address(address)))
        .layer(Extension(wishes))
}

/// Turns away whoever is not our page.
async fn guarded(Extension(Address(address)): Extension<Address>, request: Request, next: Next) -> Response {
    let headers = request.headers();
    let host = headers.get(header::HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
    let is_here = host == address.to_string() || host == format!("localhost:{}", address.port());
    let is_ours = request.method() == Method::GET || headers.contains_key(OURS);
    let mut response = if is_here && is_ours {
        next.run(request).await
    } else {
        (StatusCode::FORBIDDEN, "open the page at the address that the program told\n").into_response()
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn wish(
    Path(word): Path<String>,
    Extension(wishes): Extension<mpsc::Sender<Wished>>,
) -> Result<Response, StatusCode> {
    let wish = read(&word).ok_or(StatusCode::NOT_FOUND)?;
    let (answer, answered) = oneshot::channel();
    let asked = async {
        wishes.send(Wished { wish, answer }).await.ok()?;
        answered.await.ok()
    };
    match timeout(PATIENCE, asked).await {
        Ok(Some(bytes)) => Ok(([(header::CONTENT_TYPE, "application/octet-stream")], bytes).into_response()),
        _ => Err(StatusCode::GONE),
    }
}

fn read(word: &str) -> Option<Wish> {
    match word {
        "look" => Some(Wish::Look),
        "next" => Some(Wish::Next),
        "forward" => Some(Wish::Act(Action::MoveForward)),
        "left" => Some(Wish::Act(Action::TurnLeft)),
        "right" => Some(Wish::Act(Action::TurnRight)),
        "submit" => Some(Wish::Act(Action::Submit)),
        "stop" => Some(Wish::Act(Action::Stop)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::{
        io::{AsyncReadExt, AsyncWriteExt},
        net::TcpStream,
    };

    async fn ask(address: SocketAddr, request: &str) -> String {
        let mut stream = TcpStream::connect(address).await.expect("the page is there");
        stream.write_all(request.as_bytes()).await.expect("it listens");
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).await.expect("it answers");
        String::from_utf8_lossy(&answer).into_owned()
    }

    #[tokio::test]
    async fn only_our_page_is_listened_to_and_the_end_closes_the_door() {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let address = listener.local_addr().expect("an address");
        let (wishes, mut wished) = mpsc::channel(1);
        let (stop, stopped) = oneshot::channel();
        let door = tokio::spawn(serve(listener, address, wishes, stopped));
        tokio::spawn(async move {
            while let Some(Wished { wish, answer }) = wished.recv().await {
                let _ = answer.send(format!("{wish:?}").into_bytes());
            }
        });
        let post = |host: &str, word: &str, more: &str| {
            format!(
                "POST /wish/{word} HTTP/1.1\r\nHost: {host}\r\n{more}Connection: close\r\nContent-Length: 0\r\n\r\n"
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
        stop.send(()).expect("a door");
        door.await.expect("it closes");
        assert!(TcpStream::connect(address).await.is_err());
    }
}
