//! HTTP server: accept loop, connection limits and graceful shutdown.

use crate::{
    Site,
    proxy::{ClientAddress, TrustedProxy, client_address},
    router_until,
};
use avln_net::{AcceptLimits, AcceptLoop, Connection, Listener};
use avln_store::Reader;
use axum::{Router, http::Request};
use hyper::{body::Incoming, server::conn::http1};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use std::{future::Future, io, pin::pin, sync::Arc, time::Duration};
use tokio::{
    sync::watch,
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
    let proxies: Arc<[TrustedProxy]> = proxies.into();
    let limits = AcceptLimits {
        max_connections: MAX_CONNECTIONS,
        max_connections_per_address: MAX_CONNECTIONS,
        // Browsers open several connections at once and show a refused one as an error page.
        waits_when_full: true,
        handshake: HEADER_TIMEOUT,
        failure_pause: ACCEPT_PAUSE,
        max_failures: Some(ACCEPT_ATTEMPTS),
    };
    let mut accept = AcceptLoop::new(listener, limits);
    let serve = move |connection| serve_connection(connection, router.clone(), proxies.clone());
    let accepted = tokio::select! {
        failed = accept.run(serve) => Err(failed.into()),
        () = shutdown => Ok(()),
    };
    accept.stop_listening().close().await;
    accepted
}

/// Serves requests until the client disconnects, the connection's lifetime ends or the server shuts down.
async fn serve_connection(connection: Connection, router: Router, proxies: Arc<[TrustedProxy]>) {
    let Connection { stream, peer, mut closing, place: _place, .. } = connection;
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_header_size(MAX_HEAD_BYTES);
    let add_client_address = move |mut request: Request<Incoming>| {
        let client = client_address(peer.ip(), request.headers(), &proxies);
        request.extensions_mut().insert(ClientAddress::new(client));
        request
    };
    let router = ServiceExt::<Request<Incoming>>::map_request(router, add_client_address);
    let connection = builder.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let mut connection = pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => Some(ended),
        () = closing.wait() => None,
        () = sleep(CONNECTION_LIFETIME) => None,
    };
    if ended.is_none() {
        connection.as_mut().graceful_shutdown();
        // A client too slow for its last response loses the rest.
        let _ = timeout(SHUTDOWN_TIMEOUT, connection).await;
    }
}
