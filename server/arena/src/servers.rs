//! gRPC server for agents, web server for visitors, and admin server for the operator.

use crate::{
    Arena, Failure, SCENE_MEMORY_MIB,
    admin::{self, AdminState},
    data::DataFolder,
    management::{ArenaManagement, ControlStatus},
};
use avln_grpc::Control;
pub use avln_grpc::Limits;
use avln_net::{Identity, Listener, Protocol};
use avln_store::{Reader, Store};
use avln_web::{Documents, SignedLogs, Site, TrustedProxy};
use std::{
    net::{Ipv4Addr, SocketAddr, SocketAddrV4},
    path::PathBuf,
    sync::Arc,
};
use tokio::{net::TcpListener, sync::watch, task::JoinSet};

/// Addresses for agents and visitors.
#[derive(Clone, Copy, Debug)]
pub struct Addresses {
    /// Address for agents.
    pub grpc: SocketAddr,
    /// Address for visitors.
    pub web: SocketAddr,
}

impl Addresses {
    /// Free local ports.
    pub const LOCAL: Self = {
        let free = SocketAddr::V4(SocketAddrV4::new(Ipv4Addr::LOCALHOST, 0));
        Self { grpc: free, web: free }
    };
}

/// TLS files; plain text without them.
#[derive(Clone, Debug, Default)]
pub struct Security {
    /// PEM file with certificate and intermediates.
    pub tls_cert: Option<PathBuf>,
    /// PEM file with the private key.
    pub tls_key: Option<PathBuf>,
}

impl Security {
    /// Reads the certificate, if any, and warns on standard error about one that agents would reject.
    pub fn identity(&self) -> Result<Option<Identity>, Failure> {
        let (Some(certificate), Some(key)) = (&self.tls_cert, &self.tls_key) else { return Ok(None) };
        let identity = Identity::read(certificate, key).map_err(|error| {
            Failure::address(error)
                .hinted("docs/deploying.md, section Certificates, shows how to make a certificate for tests")
        })?;
        if let Some(warning) = identity.warning() {
            eprintln!("warning: {warning}");
        }
        Ok(Some(identity))
    }
}

/// Canonical addresses on pages; without them, pages contain the host of each request.
#[derive(Clone, Debug, Default)]
pub struct PublicUrls {
    /// Web server, such as `https://arena.example`.
    pub web: Option<String>,
    /// gRPC server; `None` for the host of `web` with the gRPC port.
    pub grpc: Option<String>,
}

/// Bound listeners.
pub struct Servers {
    grpc: TcpListener,
    web: TcpListener,
    admin: Option<TcpListener>,
    identity: Option<Identity>,
    limits: Limits,
    trusted_proxies: Vec<TrustedProxy>,
    documents: Documents,
    urls: PublicUrls,
}

/// Running servers.
pub struct RunningServers {
    /// gRPC address.
    pub grpc: SocketAddr,
    /// Web address.
    pub web: SocketAddr,
    /// Admin address, if any.
    pub admin: Option<SocketAddr>,
    is_secure: bool,
    control: Control,
    stop: watch::Sender<bool>,
    tasks: JoinSet<Result<(), Failure>>,
}

impl Servers {
    /// Binds both addresses without TLS.
    pub async fn bind(addresses: &Addresses) -> Result<Self, Failure> {
        Self::bind_as(addresses, None).await
    }

    /// Binds both addresses, with TLS for an identity.
    pub async fn bind_as(addresses: &Addresses, identity: Option<Identity>) -> Result<Self, Failure> {
        if identity.is_none() {
            reject_public_plain_text(addresses)?;
        }
        let grpc = listen(addresses.grpc, "agents (gRPC)", "--grpc").await?;
        let web = listen(addresses.web, "the leaderboard (web)", "--web").await?;
        Ok(Self {
            grpc,
            web,
            admin: None,
            identity,
            limits: Limits::default(),
            trusted_proxies: vec![],
            documents: Documents::default(),
            urls: PublicUrls::default(),
        })
    }

    /// Adds the admin server; its address must not be reachable from other machines.
    pub async fn with_admin(self, address: SocketAddr) -> Result<Self, Failure> {
        if !address.ip().is_loopback() {
            let message =
                format!("the admin server must not be reachable from other machines, as {address} is");
            return Err(Failure::address(message)
                .hinted("use --admin 127.0.0.1:50052, and ssh -L 50052:127.0.0.1:50052 from elsewhere"));
        }
        let admin = listen(address, "the operator", "--admin").await?;
        Ok(Self { admin: Some(admin), ..self })
    }

    /// Changes gRPC limits.
    pub fn with_limits(self, change: impl FnOnce(Limits) -> Limits) -> Self {
        Self { limits: change(self.limits), ..self }
    }

    /// Trusts these proxies' `X-Forwarded-For`, for the sign-in limit.
    pub fn with_trusted_proxies(self, trusted_proxies: Vec<TrustedProxy>) -> Self {
        Self { trusted_proxies, ..self }
    }

    /// Shows these documents on the web pages.
    pub fn with_documents(self, documents: Documents) -> Self {
        Self { documents, ..self }
    }

    /// Shows these addresses on the web pages.
    pub fn with_public_urls(self, urls: PublicUrls) -> Self {
        Self { urls, ..self }
    }

    /// Returns the web server's local URL, for links; `None` if it listens on all addresses.
    pub fn web_url(&self) -> Option<String> {
        let address = self.web.local_addr().ok().filter(|address| !address.ip().is_unspecified())?;
        let scheme = if self.identity.is_some() { "https" } else { "http" };
        Some(format!("{scheme}://{address}"))
    }

    /// Starts serving.
    pub fn open(self, arena: Arc<Arena>, reader: Reader) -> Result<RunningServers, Failure> {
        let local = |listener: &TcpListener| listener.local_addr().map_err(Failure::address);
        let (grpc, web) = (local(&self.grpc)?, local(&self.web)?);
        let (stop, stopped) = watch::channel(false);
        let mut tasks = JoinSet::new();
        let identity = self.identity.as_ref();
        let agents = Listener::new(self.grpc, identity, Protocol::Http2);
        let visitors = Listener::new(self.web, identity, Protocol::Http1);
        let admin = self.admin.as_ref().map(local).transpose()?;
        if let Some(listener) = self.admin {
            let state = AdminState { arena: arena.clone(), reader: reader.clone() };
            let operator = avln_web::serve_router(listener, admin::router(state), until(stopped.clone()));
            tasks.spawn(async { operator.await.map_err(Failure::internal) });
        }
        let control = arena.control().clone();
        let site = Site {
            grpc_port: grpc.port(),
            web_url: self.urls.web,
            grpc_url: self.urls.grpc,
            frozen_unix_ms: None,
            logs: Some(SignedLogs { folder: arena.logs.folder.clone(), key: arena.key.public() }),
            replay_renderer: Some(arena.replay_renderer.clone()),
            live_status: Some(Arc::new(ControlStatus(arena.control.clone()))),
            management: Some(Arc::new(ArenaManagement(arena.clone()))),
            documents: self.documents,
            trusted_proxies: self.trusted_proxies,
        };
        let grpc_server = avln_grpc::serve(agents, arena, self.limits, until(stopped.clone()));
        tasks.spawn(async { grpc_server.await.map_err(Failure::internal) });
        let web_server = avln_web::serve(visitors, reader, site, until(stopped));
        tasks.spawn(async { web_server.await.map_err(Failure::internal) });
        Ok(RunningServers { grpc, web, admin, is_secure: self.identity.is_some(), control, stop, tasks })
    }
}

impl RunningServers {
    /// Hosts a data folder at free local ports.
    pub async fn local(data: &DataFolder, store: &Store) -> Result<Self, Failure> {
        let arena = Arena::open(data, store.clone(), SCENE_MEMORY_MIB).await?;
        Self::local_for(arena, store).await
    }

    /// Serves an arena at free local ports.
    pub async fn local_for(arena: Arena, store: &Store) -> Result<Self, Failure> {
        Servers::bind(&Addresses::LOCAL).await?.open(Arc::new(arena), store.reader())
    }

    /// Returns the gRPC URL.
    pub fn grpc_url(&self) -> String {
        format!("{}://{}", self.scheme(), self.grpc)
    }

    /// Returns the URL scheme: `https` with TLS, otherwise `http`.
    pub fn scheme(&self) -> &'static str {
        if self.is_secure { "https" } else { "http" }
    }

    /// Waits for Ctrl-C, a termination signal, a finished drain or a failure, then closes.
    pub async fn wait(mut self) -> Result<(), Failure> {
        let control = self.control.clone();
        tokio::select! {
            () = signalled() => self.close().await,
            () = control.drained() => self.close().await,
            Some(ended) = self.tasks.join_next() => ended.map_err(Failure::internal)?,
        }
    }

    /// Stops accepting connections, waits for running work, then closes.
    pub async fn close(mut self) -> Result<(), Failure> {
        let _ = self.stop.send(true);
        while let Some(ended) = self.tasks.join_next().await {
            ended.map_err(Failure::internal)??;
        }
        Ok(())
    }
}

/// Rejects plain text for other machines: tokens would be readable on the network.
fn reject_public_plain_text(addresses: &Addresses) -> Result<(), Failure> {
    let open = [addresses.grpc, addresses.web].into_iter().find(|address| !address.ip().is_loopback());
    match open {
        Some(address) if std::env::var_os("AVLN_ALLOW_PLAIN_TEXT").is_none() => {
            Err(Failure::address(format!("{address} is reachable from other machines in plain text"))
                .hinted("add --tls-cert and --tls-key, or set AVLN_ALLOW_PLAIN_TEXT=1 on a trusted network"))
        }
        _ => Ok(()),
    }
}

async fn listen(address: SocketAddr, what: &str, flag: &str) -> Result<TcpListener, Failure> {
    TcpListener::bind(address).await.map_err(|error| {
        Failure::address(format!("cannot listen on {address} for {what}: {error}")).hinted(format!(
            "stop the program on port {}, or choose another with {flag} {}:{}",
            address.port(),
            address.ip(),
            address.port().wrapping_add(1).max(1024)
        ))
    })
}

async fn until(mut stopped: watch::Receiver<bool>) {
    // An error means that the sender is gone, which is a stop too.
    let _ = stopped.wait_for(|stopped| *stopped).await;
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn link_address_is_local_unless_unspecified() {
        let servers = Servers::bind(&Addresses::LOCAL).await.expect("free ports");
        let port = servers.web.local_addr().expect("an address").port();
        assert_eq!(servers.web_url(), Some(format!("http://127.0.0.1:{port}")));
        let everywhere = TcpListener::bind("0.0.0.0:0").await.expect("a free port");
        assert_eq!(Servers { web: everywhere, ..servers }.web_url(), None);
    }
}
