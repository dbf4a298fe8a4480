//! Latency of pages over a full database: 1000 runs of 550 episodes, 200 requests per second.
//!
//! `cargo bench -p avln-web --bench leaderboards -- 20` measures each page for 20 seconds; the default is 10. The latency of a request
//! starts at its scheduled time, so a stalled server also counts for the requests behind it (no coordinated omission).

#[path = "leaderboards/fill.rs"]
mod fill;

use avln_store::Store;
use avln_web::Site;
use std::{
    io,
    net::SocketAddr,
    sync::Arc,
    time::{Duration, Instant},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
    runtime::Runtime,
    sync::Mutex,
    task::JoinSet,
    time::sleep_until,
};

/// Requests per second.
const RATE: u32 = 200;
/// Open connections.
const VISITORS: usize = 16;
/// Requests of a connection before the client reconnects, below the server's limit.
const REQUESTS_PER_CONNECTION: usize = 200;

fn main() {
    let seconds = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(10);
    Runtime::new().expect("a runtime").block_on(measure(seconds));
}

async fn measure(seconds: u32) {
    let folder = tempfile::tempdir().expect("a folder");
    let begun = Instant::now();
    let filled = fill::fill(folder.path()).await;
    println!(
        "{} runs of {} episodes, {} MB, made in {:.0} s",
        fill::RUNS,
        fill::EPISODES,
        filled.bytes / 1_000_000,
        begun.elapsed().as_secs_f64()
    );
    let store = Store::open(&folder.path().join(fill::DATABASE)).await.expect("the database");
    let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
    let web = listener.local_addr().expect("its address");
    tokio::spawn(avln_web::serve(listener, store.reader(), Site::default(), std::future::pending()));
    println!("| page | first, ms | bytes | p50 ms | p99 ms | worst ms |\n|---|---:|---:|---:|---:|---:|");
    let leaderboard = format!("/leaderboard/{}", fill::PHASE);
    let pages = [
        ("home", "/".to_owned()),
        ("both leaderboards", leaderboard.clone()),
        ("leaderboard", format!("{leaderboard}?order=ordered")),
        ("leaderboard by SPL", format!("{leaderboard}?order=ordered&sort=spl")),
        ("leaderboard, JSON", format!("/api/v1/phases/{}/leaderboard?order=ordered", fill::PHASE)),
        ("run", format!("/runs/{}", filled.run)),
        ("runs", "/runs".to_owned()),
    ];
    for (name, path) in pages {
        report(name, web, &path, seconds).await;
    }
}

async fn report(name: &str, web: SocketAddr, path: &str, seconds: u32) {
    let mut first = Visitor::new(web);
    let begun = Instant::now();
    let bytes = first.get(path).await;
    let first_ms = begun.elapsed().as_secs_f64() * 1e3;
    let mut waited_ms = send_requests(web, path, RATE * seconds).await;
    waited_ms.sort_by(f64::total_cmp);
    let at = |share: f64| waited_ms[((waited_ms.len() - 1) as f64 * share) as usize];
    println!("| {name} | {first_ms:.0} | {bytes} | {:.1} | {:.1} | {:.1} |", at(0.5), at(0.99), at(1.0));
}

/// Sends `count` requests at the rate, and returns the latency of each from its scheduled time, milliseconds.
async fn send_requests(web: SocketAddr, path: &str, count: u32) -> Vec<f64> {
    let idle: Arc<Mutex<Vec<Visitor>>> = Arc::default();
    idle.lock().await.extend((0..VISITORS).map(|_| Visitor::new(web)));
    let (begun, mut asked) = (Instant::now(), JoinSet::new());
    for number in 0..count {
        let due = begun + Duration::from_secs(1) * number / RATE;
        sleep_until(due.into()).await;
        let (idle, path) = (idle.clone(), path.to_owned());
        asked.spawn(async move {
            let free = idle.lock().await.pop();
            let mut visitor = free.unwrap_or_else(|| Visitor::new(web));
            visitor.get(&path).await;
            let waited_ms = due.elapsed().as_secs_f64() * 1e3;
            idle.lock().await.push(visitor);
            waited_ms
        });
    }
    asked.join_all().await
}

/// A client with a connection.
struct Visitor {
    web: SocketAddr,
    stream: Option<TcpStream>,
    answers: usize,
}

impl Visitor {
    fn new(web: SocketAddr) -> Self {
        Self { web, stream: None, answers: 0 }
    }

    /// Requests a page as a browser does, and returns the size of the response. Reconnects if the server has closed the connection.
    async fn get(&mut self, path: &str) -> usize {
        if self.answers == REQUESTS_PER_CONNECTION {
            *self = Self::new(self.web);
        }
        let is_old = self.stream.is_some();
        match self.try_get(path).await {
            Ok(bytes) => bytes,
            Err(_) if is_old => {
                *self = Self::new(self.web);
                self.try_get(path).await.expect("an answer")
            }
            Err(error) => panic!("{path}: {error}"),
        }
    }

    async fn try_get(&mut self, path: &str) -> io::Result<usize> {
        let web = self.web;
        let stream = match &mut self.stream {
            Some(stream) => stream,
            none => none.insert(TcpStream::connect(web).await?),
        };
        self.answers += 1;
        let request = format!("GET {path} HTTP/1.1\r\nHost: {web}\r\nAccept-Encoding: gzip\r\n\r\n");
        stream.write_all(request.as_bytes()).await?;
        read_answer(stream).await
    }
}

/// Reads a response up to its declared length or its final chunk.
async fn read_answer(stream: &mut TcpStream) -> io::Result<usize> {
    let (mut bytes, mut part) = (Vec::new(), [0; 16 << 10]);
    loop {
        let read = stream.read(&mut part).await?;
        if read == 0 {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        bytes.extend_from_slice(&part[..read]);
        let Some(head) = bytes.windows(4).position(|end| end == b"\r\n\r\n") else { continue };
        let words = String::from_utf8_lossy(&bytes[..head]).to_lowercase();
        assert!(words.starts_with("http/1.1 200"), "{words}");
        let length =
            words.split("content-length: ").nth(1).and_then(|rest| rest.lines().next()?.parse().ok());
        let is_whole = match length {
            Some(length) => bytes.len() - head - 4 >= length,
            None => bytes.ends_with(b"0\r\n\r\n"),
        };
        if is_whole {
            return Ok(bytes.len());
        }
    }
}
