//! A TCP proxy that can cut connections, delay bytes, or hold them back silently.

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

/// A listening proxy.
pub struct FaultProxy {
    /// Address for clients.
    pub address: SocketAddr,
    link: Link,
}

#[derive(Clone)]
struct Link {
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
        let link = Link {
            server: Arc::new(watch::Sender::new(server)),
            cuts: Arc::new(watch::Sender::new(0)),
            held: Arc::new(watch::Sender::new(false)),
            delay,
        };
        tokio::spawn(accept(listener, link.clone()));
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

async fn accept(listener: TcpListener, link: Link) {
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

/// Forwards bytes in one direction until an end closes.
async fn carry(mut from: OwnedReadHalf, mut to: OwnedWriteHalf, link: &Link) {
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
