//! A wire that can be cut again and again: what is connected is lost, and whoever comes next is let through. It can be long, and
//! it can be dead without anybody being told.

use std::{net::SocketAddr, sync::Arc, time::Duration};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{
        TcpListener, TcpStream,
        tcp::{OwnedReadHalf, OwnedWriteHalf},
    },
    sync::{mpsc, watch},
    time::{Instant, sleep_until},
};

/// A listener in front of a server.
pub struct FaultProxy {
    /// Where clients connect.
    pub address: SocketAddr,
    wire: Wire,
}

#[derive(Clone)]
struct Wire {
    server: Arc<watch::Sender<SocketAddr>>,
    snips: Arc<watch::Sender<u64>>,
    /// Whether nothing gets through, in either direction.
    dead: Arc<watch::Sender<bool>>,
    /// Time of the way in one direction.
    delay: Duration,
}

impl FaultProxy {
    /// Listens on a free port and passes every connection on to `server`.
    pub async fn open(server: SocketAddr) -> Self {
        Self::open_delayed(server, Duration::ZERO).await
    }

    /// The same, `delay` away: everything takes that time in each direction.
    pub async fn open_delayed(server: SocketAddr, delay: Duration) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("its address");
        let wire = Wire {
            server: Arc::new(watch::Sender::new(server)),
            snips: Arc::new(watch::Sender::new(0)),
            dead: Arc::new(watch::Sender::new(false)),
            delay,
        };
        tokio::spawn(admit(listener, wire.clone()));
        Self { address, wire }
    }

    /// Where clients connect, as they write it.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Cuts every connection without a farewell.
    pub fn cut(&self) {
        self.wire.snips.send_modify(|snips| *snips += 1);
    }

    /// Holds back what both sides say, or lets it through again. The connections stay open.
    pub fn hold(&self, hold: bool) {
        self.wire.dead.send_replace(hold);
    }

    /// Whoever connects from now on reaches this server.
    pub fn redirect(&self, server: SocketAddr) {
        self.wire.server.send_replace(server);
    }
}

async fn admit(listener: TcpListener, wire: Wire) {
    while let Ok((client, _)) = listener.accept().await {
        let (wire, mut snips) = (wire.clone(), wire.snips.subscribe());
        tokio::spawn(async move {
            let server = *wire.server.borrow();
            let Ok(server) = TcpStream::connect(server).await else { return };
            let _ = (client.set_nodelay(true), server.set_nodelay(true));
            let ((from_client, to_client), (from_server, to_server)) =
                (client.into_split(), server.into_split());
            tokio::select! {
                () = carry(from_client, to_server, &wire) => {}
                () = carry(from_server, to_client, &wire) => {}
                _ = snips.changed() => {}
            }
        });
    }
}

/// Carries bytes in one direction until one end closes.
async fn carry(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, wire: &Wire) {
    let (put, mut under_way) = mpsc::channel::<(Instant, Vec<u8>)>(1024);
    let load = async move {
        let mut buffer = vec![0; 64 << 10];
        while let Ok(length @ 1..) = from.read(&mut buffer).await {
            let arrives = Instant::now() + wire.delay;
            if put.send((arrives, buffer[..length].to_vec())).await.is_err() {
                return;
            }
        }
    };
    let unload = async move {
        let mut dead = wire.dead.subscribe();
        while let Some((arrives, bytes)) = under_way.recv().await {
            sleep_until(arrives).await;
            if dead.wait_for(|dead| !dead).await.is_err() || to.write_all(&bytes).await.is_err() {
                return;
            }
        }
    };
    tokio::join!(load, unload);
}
