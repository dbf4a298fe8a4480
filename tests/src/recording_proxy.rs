//! A proxy that records server answers, and corrupts or cuts the client's messages.

use std::{
    net::SocketAddr,
    sync::{Arc, Mutex, PoisonError},
};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{
        TcpListener, TcpStream,
        tcp::{OwnedReadHalf, OwnedWriteHalf},
    },
    sync::watch,
};

/// A change to bytes on the way to the server; removed after it returned true.
pub type Corruption = Box<dyn FnMut(&mut [u8]) -> bool + Send>;

/// A listening proxy.
pub struct RecordingProxy {
    /// Address for clients.
    pub address: SocketAddr,
    shared: Shared,
    cut: watch::Sender<bool>,
}

#[derive(Clone, Default)]
struct Shared {
    received: Arc<Mutex<Vec<u8>>>,
    corruption: Arc<Mutex<Option<Corruption>>>,
}

impl RecordingProxy {
    /// Listens on a free port and passes every connection on to `server`.
    pub async fn open(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("its address");
        let (cut, is_cut) = watch::channel(false);
        let shared = Shared::default();
        tokio::spawn(accept(listener, server, shared.clone(), is_cut));
        Self { address, shared, cut }
    }

    /// URL for clients.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// All bytes sent by the server.
    pub fn recorded(&self) -> Vec<u8> {
        self.shared.received.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Applies `corruption` to all later client bytes until it has changed something.
    pub fn corrupt(&self, corruption: Corruption) {
        *self.shared.corruption.lock().unwrap_or_else(PoisonError::into_inner) = Some(corruption);
    }

    /// Cuts every connection and rejects new ones.
    pub fn cut(&self) {
        self.cut.send_replace(true);
    }
}

async fn accept(listener: TcpListener, server: SocketAddr, shared: Shared, is_cut: watch::Receiver<bool>) {
    while let Ok((client, _)) = listener.accept().await {
        let Ok(server) = TcpStream::connect(server).await else { return };
        let (shared, mut is_cut) = (shared.clone(), is_cut.clone());
        tokio::spawn(async move {
            let ((from_client, to_client), (from_server, to_server)) =
                (client.into_split(), server.into_split());
            tokio::select! {
                () = carry_up(from_client, to_server, &shared) => {}
                () = carry_down(from_server, to_client, &shared) => {}
                _ = is_cut.wait_for(|cut| *cut) => {}
            }
        });
    }
}

async fn carry_up(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, shared: &Shared) {
    let mut buffer = vec![0; 64 << 10];
    while let Ok(length @ 1..) = from.read(&mut buffer).await {
        corrupt_bytes(&mut buffer[..length], shared);
        if to.write_all(&buffer[..length]).await.is_err() {
            return;
        }
    }
}

fn corrupt_bytes(bytes: &mut [u8], shared: &Shared) {
    let mut corruption = shared.corruption.lock().unwrap_or_else(PoisonError::into_inner);
    if corruption.as_mut().is_some_and(|apply| apply(bytes)) {
        *corruption = None;
    }
}

async fn carry_down(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, shared: &Shared) {
    let mut buffer = vec![0; 64 << 10];
    while let Ok(length @ 1..) = from.read(&mut buffer).await {
        shared.received.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&buffer[..length]);
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
