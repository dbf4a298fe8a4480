//! Opens the two doors and keeps them open until somebody says stop.

use crate::{Failure, FailureKind, arena::Arena};
use avln_grpc::Limits;
use avln_store::Reader;
use clap::Args;
use std::{net::SocketAddr, sync::Arc};
use tokio::{net::TcpListener, sync::watch, task::JoinSet};

/// Where the doors are.
#[derive(Clone, Debug, Args)]
pub struct Addresses {
    /// Where agents connect
    #[arg(long, env = "AVLN_GRPC", default_value = "127.0.0.1:50051", value_name = "ADDRESS")]
    pub grpc: SocketAddr,
    /// Where the leaderboard is shown
    #[arg(long, env = "AVLN_WEB", default_value = "127.0.0.1:8080", value_name = "ADDRESS")]
    pub web: SocketAddr,
}

/// The listeners, bound and not yet served.
pub struct Doors {
    grpc: TcpListener,
    web: TcpListener,
}

/// Both doors, open.
pub struct OpenDoors {
    /// Where agents connect.
    pub grpc: SocketAddr,
    /// Where people look.
    pub web: SocketAddr,
    stop: watch::Sender<bool>,
    tasks: JoinSet<Result<(), Failure>>,
}

impl Doors {
    /// Takes both addresses.
    ///
    /// # Errors
    /// When one is taken or cannot be had.
    pub async fn bind(addresses: &Addresses) -> Result<Self, Failure> {
        refuse_open_plain_text(addresses)?;
        let grpc = listen(addresses.grpc, "agents (gRPC)", "--grpc").await?;
        let web = listen(addresses.web, "the leaderboard (web)", "--web").await?;
        Ok(Self { grpc, web })
    }

    /// Serves the arena through both doors.
    ///
    /// # Errors
    /// When an address cannot be read back from the system.
    pub fn open(self, arena: Arc<Arena>, reader: Reader) -> Result<OpenDoors, Failure> {
        let local = |listener: &TcpListener| {
            listener.local_addr().map_err(|error| Failure::new(FailureKind::Address, error))
        };
        let (grpc, web) = (local(&self.grpc)?, local(&self.web)?);
        let (stop, stopped) = watch::channel(false);
        let mut tasks = JoinSet::new();
        let agents = avln_grpc::serve(self.grpc, arena, Limits::default(), until(stopped.clone()));
        tasks.spawn(async { agents.await.map_err(|error| Failure::new(FailureKind::Internal, error)) });
        let people = avln_web::serve(self.web, reader, grpc.port(), until(stopped));
        tasks.spawn(async { people.await.map_err(|error| Failure::new(FailureKind::Internal, error)) });
        Ok(OpenDoors { grpc, web, stop, tasks })
    }
}

impl OpenDoors {
    /// Waits for Ctrl-C or a termination signal, then closes. A door that fails ends the wait.
    ///
    /// # Errors
    /// When a door failed.
    pub async fn wait(mut self) -> Result<(), Failure> {
        tokio::select! {
            () = signalled() => self.close().await,
            Some(ended) = self.tasks.join_next() => ended.map_err(|error| Failure::new(FailureKind::Internal, error))?,
        }
    }

    /// Lets nobody in any more, lets running work end, and closes.
    ///
    /// # Errors
    /// When a door failed.
    pub async fn close(mut self) -> Result<(), Failure> {
        let _ = self.stop.send(true);
        while let Some(ended) = self.tasks.join_next().await {
            ended.map_err(|error| Failure::new(FailureKind::Internal, error))??;
        }
        Ok(())
    }
}

/// Tokens cross these doors in plain text, so only this machine may reach them.
fn refuse_open_plain_text(addresses: &Addresses) -> Result<(), Failure> {
    let open = [addresses.grpc, addresses.web].into_iter().find(|address| !address.ip().is_loopback());
    match open {
        Some(address) if std::env::var_os("AVLN_ALLOW_PLAIN_TEXT").is_none() => {
            Err(Failure::new(FailureKind::Address, format!("{address} can be reached from other machines in plain text"))
                .hinted("put a TLS proxy in front of a loopback address, or set AVLN_ALLOW_PLAIN_TEXT=1 on a network you trust"))
        }
        _ => Ok(()),
    }
}

async fn listen(address: SocketAddr, what: &str, flag: &str) -> Result<TcpListener, Failure> {
    TcpListener::bind(address).await.map_err(|error| {
        Failure::new(FailureKind::Address, format!("cannot listen on {address} for {what}: {error}")).hinted(
            format!(
                "stop what uses port {}, or choose another with {flag} {}:{}",
                address.port(),
                address.ip(),
                address.port().wrapping_add(1).max(1024)
            ),
        )
    })
}

async fn until(mut stopped: watch::Receiver<bool>) {
    // An error means that the sender is gone, which is a stop too.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}

/// Waits for Ctrl-C, or for the signal with which services are stopped.
async fn signalled() {
    #[cfg(unix)]
    {
        use tokio::signal::unix::{SignalKind, signal};
        if let Ok(mut terminate) = signal(SignalKind::terminate()) {
            tokio::select! {
                _ = tokio::signal::ctrl_c() => {}
                _ = terminate.recv() => {}
            }
            return;
        }
    }
    let _ = tokio::signal::ctrl_c().await;
}
