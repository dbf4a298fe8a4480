//! A proxy that records what the server answers, and that corrupts or cuts what the client sends.

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

/// Changes bytes on their way to the server; true when it has done so, and then it is forgotten.
pub type Corruption = Box<dyn FnMut(&mut [u8]) -> bool + Send>;

/// A listener in front of a server.
pub struct RecordingProxy {
    /// Where clients connect.
    pub address: SocketAddr,
    said: Shared,
    cut: watch::Sender<bool>,
}

#[derive(Clone, Default)]
struct Shared {
    heard: Arc<Mutex<Vec<u8>>>,
    spoiler: Arc<Mutex<Option<Corruption>>>,
}

impl RecordingProxy {
    /// Listens on a free port and passes every connection on to `server`.
    pub async fn open(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("its address");
        let (cut, is_cut) = watch::channel(false);
        let said = Shared::default();
        tokio::spawn(admit(listener, server, said.clone(), is_cut));
        Self { address, said, cut }
    }

    /// Where clients connect, as they write it.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Every byte that the server said so far.
    pub fn recorded(&self) -> Vec<u8> {
        self.said.heard.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Lets `spoiler` see everything that clients say from now on, until it has changed something.
    pub fn corrupt(&self, spoiler: Corruption) {
        *self.said.spoiler.lock().unwrap_or_else(PoisonError::into_inner) = Some(spoiler);
    }

    /// Cuts every connection without a farewell, and lets nobody in any more.
    pub fn cut(&self) {
        self.cut.send_replace(true);
    }
}

async fn admit(listener: TcpListener, server: SocketAddr, said: Shared, is_cut: watch::Receiver<bool>) {
    while let Ok((client, _)) = listener.accept().await {
        let Ok(server) = TcpStream::connect(server).await else { return };
        let (said, mut is_cut) = (said.clone(), is_cut.clone());
        tokio::spawn(async move {
            let ((from_client, to_client), (from_server, to_server)) =
                (client.into_split(), server.into_split());
            tokio::select! {
                () = carry_up(from_client, to_server, &said) => {}
                () = carry_down(from_server, to_client, &said) => {}
                _ = is_cut.wait_for(|cut| *cut) => {}
            }
        });
    }
}

async fn carry_up(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, said: &Shared) {
    let mut buffer = vec![0; 64 << 10];
    while let Ok(length @ 1..) = from.read(&mut buffer).await {
        spoil(&mut buffer[..length], said);
        if to.write_all(&buffer[..length]).await.is_err() {
            return;
        }
    }
}

fn spoil(bytes: &mut [u8], said: &Shared) {
    let mut spoiler = said.spoiler.lock().unwrap_or_else(PoisonError::into_inner);
    if spoiler.as_mut().is_some_and(|spoil| spoil(bytes)) {
        *spoiler = None;
    }
}

async fn carry_down(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, said: &Shared) {
    let mut buffer = vec![0; 64 << 10];
    while let Ok(length @ 1..) = from.read(&mut buffer).await {
        said.heard.lock().unwrap_or_else(PoisonError::into_inner).extend_from_slice(&buffer[..length]);
        if to.write_all(&buffer[..length]).await.is_err() {
            return;
        }
    }
}

/// What comes after the episode's name in an Act of `avln.v1`: step (field 3) and action (field 4), one byte each.
const STEP: usize = 1;
const ACTION: usize = 3;

/// Writes `value` over the byte at `offset` behind the episode's name of the next Act.
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

/// Turns the action of the next Act into one that does not exist. Steps must be below 128.
pub fn illegal_action() -> Corruption {
    overwrite(ACTION, 77)
}

/// Turns the step of the next Act into `step`, below 128. Steps must be below 128.
pub fn wrong_step(step: u8) -> Corruption {
    overwrite(STEP, step)
}
