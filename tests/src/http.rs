//! A small HTTP client for the web server.

use std::{net::SocketAddr, time::Duration};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    time::{Instant, timeout_at},
};

/// An HTTP answer.
#[derive(Debug)]
pub struct Answer {
    /// Status code.
    pub status: u16,
    /// Head and body as received.
    pub bytes: Vec<u8>,
    /// The body as text.
    pub body: String,
}

/// Requests `path` anonymously and reads for `time`.
pub async fn get_events(address: SocketAddr, path: &str, time: Duration) -> Answer {
    let mut stream = ask(address, &format!("GET {path} HTTP/1.0\r\nHost: {address}\r\n\r\n")).await;
    let mut bytes = Vec::new();
    let end = Instant::now() + time;
    while let Ok(read) = timeout_at(end, stream.read_buf(&mut bytes)).await {
        if read.expect("it answers") == 0 {
            break;
        }
    }
    answer(bytes)
}

/// Requests `path` anonymously.
pub async fn get(address: SocketAddr, path: &str) -> Answer {
    look(address, &format!("GET {path} HTTP/1.0\r\nHost: {address}\r\n\r\n")).await
}

/// A signed-in visitor.
#[derive(Debug)]
pub struct Visitor {
    address: SocketAddr,
    cookie: String,
}

impl Visitor {
    /// Signs in with a token; panics if it is rejected.
    pub async fn sign_in(address: SocketAddr, token: &str) -> Self {
        let stranger = Self { address, cookie: String::new() };
        let answer = stranger.post("/sign-in", &[("token", token), ("next", "")]).await;
        assert_eq!(answer.status, 303, "{}", answer.body);
        let head = String::from_utf8_lossy(&answer.bytes).into_owned();
        let cookie = head.split("set-cookie: ").nth(1).and_then(|rest| rest.split(';').next());
        Self { address, cookie: cookie.expect("a cookie").to_owned() }
    }

    /// Requests `path`.
    pub async fn get(&self, path: &str) -> Answer {
        let Self { address, cookie } = self;
        let request = format!("GET {path} HTTP/1.0\r\nHost: {address}\r\nCookie: {cookie}\r\n\r\n");
        look(*address, &request).await
    }

    /// Sends a form.
    pub async fn post(&self, path: &str, fields: &[(&str, &str)]) -> Answer {
        let Self { address, cookie } = self;
        let fields: Vec<String> =
            fields.iter().map(|(name, value)| format!("{name}={}", encoded(value))).collect();
        let body = fields.join("&");
        let head = format!("POST {path} HTTP/1.0\r\nHost: {address}\r\nOrigin: http://{address}");
        let length = body.len();
        look(*address, &format!("{head}\r\nCookie: {cookie}\r\nContent-Length: {length}\r\n\r\n{body}")).await
    }

    /// Sends a page's form with its CSRF key.
    pub async fn act(&self, page: &str, fields: &[(&str, &str)]) -> Answer {
        let shown = self.get(page).await.body;
        let key = shown.split("name=\"key\" value=\"").nth(1).and_then(|rest| rest.split('"').next());
        let key = key.unwrap_or_else(|| panic!("no form on {page}: {shown}"));
        self.post(page, &[fields, &[("key", key)]].concat()).await
    }
}

/// Percent-encoded form value.
fn encoded(value: &str) -> String {
    value
        .bytes()
        .map(|byte| match byte {
            byte if byte.is_ascii_alphanumeric() => char::from(byte).to_string(),
            byte => format!("%{byte:02X}"),
        })
        .collect()
}

/// Sends a request and reads the whole answer.
async fn look(address: SocketAddr, request: &str) -> Answer {
    let mut stream = ask(address, request).await;
    let mut bytes = Vec::new();
    stream.read_to_end(&mut bytes).await.expect("it answers");
    answer(bytes)
}

async fn ask(address: SocketAddr, request: &str) -> TcpStream {
    let mut stream = TcpStream::connect(address).await.expect("a web connection");
    stream.write_all(request.as_bytes()).await.expect("a sent request");
    stream
}

fn answer(bytes: Vec<u8>) -> Answer {
    let text = String::from_utf8_lossy(&bytes);
    let (head, body) = text.split_once("\r\n\r\n").expect("a head and a body");
    let status = head.split(' ').nth(1).and_then(|code| code.parse().ok()).expect("a status");
    let body = body.to_owned();
    Answer { status, bytes, body }
}
