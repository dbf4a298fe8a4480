//! TCP proxies: one cuts, delays or holds back bytes, one records and corrupts them.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::tcp::{OwnedReadHalf, OwnedWriteHalf};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};
use tokio::time::{Instant, sleep_until};

/// A listening proxy.
pub struct FaultProxy {
    /// Address for clients.
    pub address: SocketAddr,
    link: FaultLink,
}

#[derive(Clone)]
struct FaultLink {
    server: Arc<watch::Sender<SocketAddr>>,
    cuts: Arc<watch::Sender<u64>>,
    /// True to hold back all bytes in both directions.
    held: Arc<watch::Sender<bool>>,
    /// One-way delay.
    delay: Duration,
}

impl FaultProxy {
    /// Listens on a free port and passes every connection on to `server`.
    pub async fn open(server: SocketAddr) -> Self {
        Self::open_delayed(server, Duration::ZERO).await
    }

    /// Opens a proxy with a one-way `delay`.
    pub async fn open_delayed(server: SocketAddr, delay: Duration) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("its address");
        let link = FaultLink {
            server: Arc::new(watch::Sender::new(server)),
            cuts: Arc::new(watch::Sender::new(0)),
            held: Arc::new(watch::Sender::new(false)),
            delay,
        };
        tokio::spawn(accept_faulty(listener, link.clone()));
        Self { address, link }
    }

    /// URL for clients.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Cuts every connection.
    pub fn cut(&self) {
        self.link.cuts.send_modify(|cuts| *cuts += 1);
    }

    /// Holds back all bytes, or releases them. Connections stay open.
    pub fn hold(&self, hold: bool) {
        self.link.held.send_replace(hold);
    }

    /// Forwards new connections to this server.
    pub fn redirect(&self, server: SocketAddr) {
        self.link.server.send_replace(server);
    }
}

async fn accept_faulty(listener: TcpListener, link: FaultLink) {
    while let Ok((client, _)) = listener.accept().await {
        let (link, mut cuts) = (link.clone(), link.cuts.subscribe());
        tokio::spawn(async move {
            let server = *link.server.borrow();
            let Ok(server) = TcpStream::connect(server).await else { return };
            let _ = (client.set_nodelay(true), server.set_nodelay(true));
            let ((from_client, to_client), (from_server, to_server)) =
                (client.into_split(), server.into_split());
            tokio::select! {
                () = carry(from_client, to_server, &link) => {}
                () = carry(from_server, to_client, &link) => {}
                _ = cuts.changed() => {}
            }
        });
    }
}

/// Forwards bytes in one direction with delay and holds, until an end closes.
async fn carry(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, link: &FaultLink) {
    let (put, mut under_way) = mpsc::channel::<(Instant, Vec<u8>)>(1024);
    let load = async move {
        let mut buffer = vec![0; 64 << 10];
        while let Ok(length @ 1..) = from.read(&mut buffer).await {
            let arrives = Instant::now() + link.delay;
            if put.send((arrives, buffer[..length].to_vec())).await.is_err() {
                return;
            }
        }
    };
    let unload = async move {
        let mut held = link.held.subscribe();
        while let Some((arrives, bytes)) = under_way.recv().await {
            sleep_until(arrives).await;
            if held.wait_for(|held| !held).await.is_err() || to.write_all(&bytes).await.is_err() {
                return;
            }
        }
    };
    tokio::join!(load, unload);
}

/// A change to bytes on the way to the server; removed after it returned true.
pub type Corruption = Box<dyn FnMut(&mut [u8]) -> bool + Send>;

/// A listening proxy.
pub struct RecordingProxy {
    /// Address for clients.
    pub address: SocketAddr,
    recording: Recording,
    cut: watch::Sender<bool>,
}

#[derive(Clone, Default)]
struct Recording {
    received: Arc<Mutex<Vec<u8>>>,
    corruption: Arc<Mutex<Option<Corruption>>>,
}

impl Recording {
    fn add(&self, bytes: &[u8]) {
        self.received.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(bytes);
    }

    fn corrupt(&self, bytes: &mut [u8]) {
        let mut corruption = self.corruption.lock().unwrap_or_else(PoisonError::into_inner);
        if corruption.as_mut().is_some_and(|apply| apply(bytes)) {
            *corruption = None;
        }
    }
}

impl RecordingProxy {
    /// Listens on a free port and passes every connection on to `server`.
    pub async fn open(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("its address");
        let (cut, is_cut) = watch::channel(false);
        let recording = Recording::default();
        tokio::spawn(accept_recorded(listener, server, recording.clone(), is_cut));
        Self { address, recording, cut }
    }

    /// URL for clients.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// All bytes sent by the server.
    pub fn recorded(&self) -> Vec<u8> {
        self.recording.received.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Applies `corruption` to all later client bytes until it has changed something.
    pub fn corrupt(&self, corruption: Corruption) {
        *self.recording.corruption.lock().unwrap_or_else(PoisonError::into_inner) = Some(corruption);
    }

    /// Cuts every connection and rejects new ones.
    pub fn cut(&self) {
        self.cut.send_replace(true);
    }
}

async fn accept_recorded(
    listener: TcpListener,
    server: SocketAddr,
    recording: Recording,
    is_cut: watch::Receiver<bool>,
) {
    while let Ok((client, _)) = listener.accept().await {
        let Ok(server) = TcpStream::connect(server).await else { return };
        let (recording, mut is_cut) = (recording.clone(), is_cut.clone());
        tokio::spawn(async move {
            let ((from_client, to_client), (from_server, to_server)) =
                (client.into_split(), server.into_split());
            tokio::select! {
                () = forward(from_client, to_server, |bytes| recording.corrupt(bytes)) => {}
                () = forward(from_server, to_client, |bytes| recording.add(bytes)) => {}
                _ = is_cut.wait_for(|cut| *cut) => {}
            }
        });
    }
}

/// Forwards bytes in one direction until an end closes.
async fn forward(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, mut note: impl FnMut(&mut [u8])) {
    let mut buffer = vec![0; 64 << 10];
    while let Ok(length @ 1..) = from.read(&mut buffer).await {
        note(&mut buffer[..length]);
        if to.write_all(&buffer[..length]).await.is_err() {
            return;
        }
    }
}

/// Offsets after the episode id in an Act of `avln.v1`: step (field 3) and action (field 4), one byte each.
const STEP: usize = 1;
const ACTION: usize = 3;

/// Writes `value` over the byte at `offset` after the next Act's episode id.
fn overwrite(offset: usize, value: u8) -> Corruption {
    const NAME_BYTES: usize = 3 + 32;
    Box::new(move |bytes| {
        let is_act = |at: &usize| {
            let tail = bytes.get(at + NAME_BYTES..at + NAME_BYTES + 4);
            bytes[*at..].starts_with(b"ep_") && tail.is_some_and(|tail| tail[0] == 0x18 && tail[2] == 0x20)
        };
        let act = (0..bytes.len()).find(is_act);
        act.is_some_and(|at| {
            bytes[at + NAME_BYTES + offset] = value;
            true
        })
    })
}

/// Replaces the next Act's action by an unknown one. Steps must be below 128.
pub fn illegal_action() -> Corruption {
    overwrite(ACTION, 77)
}

/// Replaces the next Act's step by `step`. Steps must be below 128.
pub fn wrong_step(step: u8) -> Corruption {
    overwrite(STEP, step)
}
