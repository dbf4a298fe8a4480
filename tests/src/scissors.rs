//! A wire that can be cut again and again: what is connected is lost, and whoever comes next is let through.

use std::{net::SocketAddr, sync::Arc};
use tokio::{
    io::copy_bidirectional,
    net::{TcpListener, TcpStream},
    sync::watch,
};

/// A listener in front of a server.
pub struct Scissors {
    /// Where clients connect.
    pub address: SocketAddr,
    server: watch::Sender<SocketAddr>,
    snips: Arc<watch::Sender<u64>>,
}

impl Scissors {
    /// Listens on a free port and passes every connection on to `server`.
    pub async fn open(server: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a free port");
        let address = listener.local_addr().expect("its address");
        let snips = Arc::new(watch::Sender::new(0));
        let server = watch::Sender::new(server);
        tokio::spawn(admit(listener, server.subscribe(), snips.clone()));
        Self { address, server, snips }
    }

    /// Where clients connect, as they write it.
    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Cuts every connection without a farewell.
    pub fn snip(&self) {
        self.snips.send_modify(|snips| *snips += 1);
    }

    /// Whoever connects from now on reaches this server.
    pub fn lead_to(&self, server: SocketAddr) {
        self.server.send_replace(server);
    }
}

async fn admit(listener: TcpListener, server: watch::Receiver<SocketAddr>, snips: Arc<watch::Sender<u64>>) {
    while let Ok((mut client, _)) = listener.accept().await {
        let (server, mut snips) = (*server.borrow(), snips.subscribe());
        tokio::spawn(async move {
            let Ok(mut server) = TcpStream::connect(server).await else { return };
            let _ = (client.set_nodelay(true), server.set_nodelay(true));
            tokio::select! {
                _ = copy_bidirectional(&mut client, &mut server) => {}
                _ = snips.changed() => {}
            }
        });
    }
}
