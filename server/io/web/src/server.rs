//! HTTP server: accept loop, connection limits and graceful shutdown.

use crate::{
    Site,
    proxy::{ClientAddress, TrustedProxy, client_address},
    router_until,
};
use avln_net::{Listener, Stream};
use avln_store::Reader;
use axum::{Router, http::Request};
use hyper::{body::Incoming, server::conn::http1};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use std::{future::Future, io, net::SocketAddr, pin::pin, sync::Arc, time::Duration};
use tokio::{
    sync::{Semaphore, watch},
    task::JoinSet,
    time::{sleep, timeout},
};
use tower::ServiceExt;

/// The listener failed permanently.
#[derive(Debug, thiserror::Error)]
#[error("the web server cannot accept connections, {ACCEPT_ATTEMPTS} attempts failed in a row: {0}")]
pub struct WebError(#[from] io::Error);

/// Open connections; further clients wait in the system's queue.
pub(crate) const MAX_CONNECTIONS: usize = 256;
/// Time-out for TLS handshakes, request heads and idle connections.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// Connection lifetime. The client then reconnects, so slow clients cannot occupy all connections.
const CONNECTION_LIFETIME: Duration = Duration::from_secs(60);
/// Time-out for the response in progress when a connection closes.
const SHUTDOWN_TIMEOUT: Duration = Duration::from_secs(10);
/// Size limit for request heads, bytes.
const MAX_HEAD_BYTES: usize = 16 * 1024;
/// Consecutive failures of `accept` before the server gives up.
const ACCEPT_ATTEMPTS: u32 = 100;
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Serves the web application on `listener` (plain text or TLS) until `shutdown` completes, then finishes the responses in progress.
///
/// # Errors
/// If the listener fails permanently.
pub async fn serve(
    listener: impl Into<Listener>,
    reader: Reader,
    site: Site,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), WebError> {
    let listener = listener.into();
    let (closing, closed) = watch::channel(());
    let proxies = site.trusted_proxies.clone();
    let router = router_until(reader, site, listener.is_secure(), Some(closed));
    let shutdown = async move {
        shutdown.await;
        // Event streams end now; otherwise each would use up the whole shutdown time-out.
        drop(closing);
    };
    serve_connections(listener, router, proxies, shutdown).await
}

/// Serves `router` with the same connection limits as [`serve`].
///
/// # Errors
/// If the listener fails permanently.
pub async fn serve_router(
    listener: impl Into<Listener>,
    router: Router,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), WebError> {
    serve_connections(listener.into(), router, Vec::new(), shutdown).await
}

async fn serve_connections(
    listener: Listener,
    router: Router,
    proxies: Vec<TrustedProxy>,
    shutdown: impl Future<Output = ()>,
) -> Result<(), WebError> {
    let (closing, closed) = watch::channel(());
    let server = Server { listener, router, proxies: proxies.into(), closed };
    let mut connections = JoinSet::new();
    let accepted = tokio::select! {
        failed = server.accept(&mut connections) => failed,
        () = shutdown => Ok(()),
    };
    // The listener closes first: no connection may arrive during the wait below.
    drop(server);
    drop(closing);
    while connections.join_next().await.is_some() {}
    accepted
}

struct Server {
    listener: Listener,
    router: Router,
    proxies: Arc<[TrustedProxy]>,
    /// Changes when the server shuts down.
    closed: watch::Receiver<()>,
}

impl Server {
    /// Accepts connections; returns only after permanent failure.
    async fn accept(&self, connections: &mut JoinSet<()>) -> Result<(), WebError> {
        let permits = Arc::new(Semaphore::new(MAX_CONNECTIONS));
        let mut failures = 0;
        loop {
            let permit = permits.clone().acquire_owned().await;
            while connections.try_join_next().is_some() {}
            match self.listener.accept().await {
                Ok((stream, address)) => {
                    failures = 0;
                    let greeter = self.listener.greeter();
                    let connection = Connection {
                        address,
                        router: self.router.clone(),
                        proxies: self.proxies.clone(),
                        closed: self.closed.clone(),
                    };
                    connections.spawn(async move {
                        match greeter.greet(stream, HEADER_TIMEOUT).await {
                            Ok(stream) => connection.serve(stream).await,
                            Err(refused) => tracing::debug!(%refused, "connection refused"),
                        }
                        drop(permit);
                    });
                }
                Err(error) if failures < ACCEPT_ATTEMPTS => {
                    failures += 1;
                    tracing::warn!(%error, "cannot accept a connection");
                    sleep(ACCEPT_PAUSE).await;
                }
                Err(error) => return Err(error.into()),
            }
        }
    }
}

struct Connection {
    address: SocketAddr,
    router: Router,
    proxies: Arc<[TrustedProxy]>,
    closed: watch::Receiver<()>,
}

impl Connection {
    async fn serve(self, stream: Stream) {
        let Self { address, router, proxies, mut closed } = self;
        let mut builder = http1::Builder::new();
        builder.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_header_size(MAX_HEAD_BYTES);
        let add_client_address = move |mut request: Request<Incoming>| {
            let client = client_address(address.ip(), request.headers(), &proxies);
            request.extensions_mut().insert(ClientAddress::new(client));
            request
        };
        let router = ServiceExt::<Request<Incoming>>::map_request(router, add_client_address);
        let mut connection =
            pin!(builder.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router)));
        let ended = tokio::select! {
            ended = connection.as_mut() => Some(ended),
            // The sender never sends: this completes when the sender is dropped.
            _ = closed.changed() => None,
            () = sleep(CONNECTION_LIFETIME) => None,
        };
        if ended.is_none() {
            connection.as_mut().graceful_shutdown();
            // A client too slow for its last response loses the rest.
            let _ = timeout(SHUTDOWN_TIMEOUT, connection).await;
        }
    }
}
