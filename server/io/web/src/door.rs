//! The loop that lets visitors in.

use crate::{Site, office::Peer, router_beside};
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
    let listener = listener.into();
    let (closing, closed) = watch::channel(());
    let mut visitors = JoinSet::new();
    let accepted = tokio::select! {
        failed = accept(&listener, &router, &mut visitors, &closed) => failed,
        () = shutdown => Ok(()),
    };
    drop(listener);
    // Whom this wakes says good-bye after the answer that was begun.
    drop(closing);
    while visitors.join_next().await.is_some() {}
    accepted
}

/// Lets visitors in for ever; returns only when that keeps failing.
async fn accept(
    listener: &Listener,
    router: &Router,
    visitors: &mut JoinSet<()>,
    closed: &watch::Receiver<()>,
) -> Result<(), WebError> {
    let places = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    let mut failures = 0;
    loop {
        let place = places.clone().acquire_owned().await;
        while visitors.try_join_next().is_some() {}
        match listener.accept().await {
            Ok((stream, address)) => {
                failures = 0;
                let (greeter, router, closed) = (listener.greeter(), router.clone(), closed.clone());
                visitors.spawn(async move {
                    match greeter.greet(stream, HEADER_TIMEOUT).await {
                        Ok(stream) => attend(stream, address, router, closed).await,
                        Err(refused) => tracing::debug!(%refused, "a visitor was turned away"),
                    }
                    drop(place);
                });
            }
            Err(error) if failures < ACCEPT_ATTEMPTS => {
                failures += 1;
                tracing::warn!(%error, "a visitor could not be let in");
                sleep(ACCEPT_PAUSE).await;
            }
            Err(error) => return Err(error.into()),
        }
    }
}

/// Answers one visitor until it leaves, has been here for long enough, or the door closes.
async fn attend(stream: Stream, address: SocketAddr, router: Router, mut closed: watch::Receiver<()>) {
    let mut manners = http1::Builder::new();
    manners.timer(TokioTimer::new()).header_read_timeout(HEADER_TIMEOUT).max_header_size(MAX_HEAD_BYTES);
    let peer = Peer::of(address.ip());
    let from_peer = move |mut request: Request<Incoming>| {
        request.extensions_mut().insert(peer);
        request
    };
    let router = ServiceExt::<Request<Incoming>>::map_request(router, from_peer);
    let connection = manners.serve_connection(TokioIo::new(stream), TowerToHyperService::new(router));
    let mut connection = pin!(connection);
    let ended = tokio::select! {
        ended = connection.as_mut() => Some(ended),
        // The sender never sends: this ends when it is dropped.
        _ = closed.changed() => None,
        () = sleep(CONNECTION_LIFE) => None,
    };
    if ended.is_none() {
        connection.as_mut().graceful_shutdown();
        // Who does not take the answer in time goes without.
        let _ = timeout(FAREWELL, connection).await;
    }
}
