//! The loop that lets visitors in.

use crate::{Site, office::Peer, router_beside};
use avln_net::{AcceptLimits, AcceptLoop, Connection, Listener};
use avln_store::Reader;
use axum::{Router, http::Request};
use hyper::{body::Incoming, server::conn::http1};
use hyper_util::{
    rt::{TokioIo, TokioTimer},
    service::TowerToHyperService,
};
use std::{future::Future, io, pin::pin, time::Duration};
use tokio::{
    sync::watch,
    time::{sleep, timeout},
};
use tower::ServiceExt;

/// The door could not be kept open.
#[derive(Debug, thiserror::Error)]
#[error("the web server cannot accept visitors any more, {ACCEPT_ATTEMPTS} attempts failed in a row: {0}")]
pub struct WebError(#[from] io::Error);

/// Visitors inside at a time; more of them wait in the system's queue.
pub(crate) const MAX_CONNECTIONS: usize = 256;
/// Time in which a visitor must have said what it wants; also how long an idle one is kept.
const HEADER_TIMEOUT: Duration = Duration::from_secs(10);
/// After this a visitor is asked to connect anew, so that slow ones do not fill the house.
const CONNECTION_LIFE: Duration = Duration::from_secs(60);
/// Time to finish an answer that was begun.
const FAREWELL: Duration = Duration::from_secs(10);
/// Most bytes of a request's head.
const MAX_HEAD_BYTES: usize = 16 * 1024;
/// Failed accepts in a row after which the door gives up.
const ACCEPT_ATTEMPTS: u32 = 100;
const ACCEPT_PAUSE: Duration = Duration::from_millis(100);

/// Answers visitors of `listener`, which may speak TLS, until `shutdown` ends; answers that were begun are finished. Pages tell participants to let their
/// agents connect to the port of `site`, in the way that this door speaks.
///
/// # Errors
/// When the listener keeps failing.
pub async fn serve(
    listener: impl Into<Listener>,
    reader: Reader,
    site: Site,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), WebError> {
    let listener = listener.into();
    let (closing, closed) = watch::channel(());
    let router = router_beside(reader, site, listener.is_secure(), Some(closed));
    let shutdown = async move {
        shutdown.await;
        // Who follows a run would stay to the end of the patience that others get.
        drop(closing);
    };
    serve_router(listener, router, shutdown).await
}

/// Lets `router` answer visitors of `listener` in the same way: so many at a time, each for so long, and the last ones to
/// the end.
///
/// # Errors
/// When the listener keeps failing.
pub async fn serve_router(
    listener: impl Into<Listener>,
    router: Router,
    shutdown: impl Future<Output = ()> + Send + 'static,
) -> Result<(), WebError> {
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
    let accepted = tokio::select! {
        failed = accept.run(move |connection| serve_connection(connection, router.clone())) => Err(failed.into()),
        () = shutdown => Ok(()),
    };
    accept.stop_listening().close().await;
    accepted
}

/// Serves one connection until the client leaves, the connection is too old, or the server stops.
async fn serve_connection(connection: Connection, router: Router) {
    let Connection { stream, peer, mut closing, place: _place, .. } = connection;
    let mut builder = http1::Builder::new();
    builder.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_header_size(MAX_HEAD_BYTES);
    let peer = Peer::of(peer.ip());
    let from_peer = move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(peer);
        request
    };
    let router = ServiceExt::<Request<Incoming>>::map_request(router, from_peer);
    let connection = builder.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let mut connection = pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => Some(ended),
        () = closing.wait() => None,
        () = sleep(CONNECTION_LIFE) => None,
    };
    if ended.is_none() {
        connection.as_mut().graceful_shutdown();
        // Who does not take the answer in time goes without.
        let _ = timeout(FAREWELL, connection).await;
    }
}
