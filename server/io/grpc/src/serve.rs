//! The listener: our own accept loop over hyper, because every limit of a connection is set here.

use crate::{
    away,
    door::Door,
    host::Host,
    left,
    limits::Limits,
    meter::{Meter, Metered},
    overdue,
    places::{Place, Places},
    service,
};
use avln_net::{Greeter, Listener};
use hyper::{body::Incoming, server::conn::http2, service::service_fn};
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use std::{
    future::Future,
    io,
    pin::pin,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};
use tokio::{
    net::TcpStream,
    sync::watch,
    task::JoinSet,
    time::{Instant, sleep, sleep_until, timeout},
};
use tonic::service::Routes;
use tower::Service;

/// Pause after a failed accept: with no file descriptors left, trying on at once would burn a core.
const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// Bytes that an agent may send unread on one call; its frames are tiny.
const STREAM_WINDOW_BYTES: u32 = 64 << 10;
/// Bytes that an agent may send unread on one connection.
const CONNECTION_WINDOW_BYTES: u32 = 1 << 20;
/// Bytes that wait for the socket on one call: a whole observation.
const SEND_BUFFER_BYTES: usize = 1 << 20;
/// Calls that an agent may open and reset at once before the connection is closed.
const PENDING_RESETS: usize = 20;
/// Calls that the server may have to reset before it closes the connection.
const LOCAL_RESETS: usize = 64;
/// Bytes that may come on a connection beyond its answers and the heads of its calls: the largest message of an agent, and half as
/// much again.
const EXCESS_BYTES: i64 = 96 << 10;
/// For how long new connections wait from where one had to be cut.
const PENALTY: Duration = Duration::from_secs(2);

/// Why the door could not be opened.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The compiled `.proto` files could not be read back.
    #[error("reading the protocol's own descriptors: {0}; rebuild the server")]
    Reflection(#[from] tonic_reflection::server::Error),
}

/// Serves agents on `listener`, which may speak TLS, until `shutdown` is ready and all that runs is put away.
///
/// Running episodes are left as they were written down: the next server goes on with them.
///
/// # Errors
/// When the door cannot be opened. Nothing that an agent does is an error here.
pub async fn serve(
    listener: impl Into<Listener>,
    host: Arc<dyn Host>,
    limits: Limits,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServeError> {
    let listener = listener.into();
    let door = Door::new(host, limits);
    let (routes, health) = service::routes(&door).await?;
    for pass in away::take_interrupted(&door).await {
        tokio::spawn(away::restore(door.clone(), pass));
    }
    let (closing, _) = watch::channel(false);
    let mut connections = JoinSet::new();
    tokio::select! {
        () = accept(&listener, &door.limits, &routes, &closing, &mut connections) => {}
        () = overdue::watch(door.clone()) => {}
        () = left::watch(door.clone()) => {}
        () = shutdown => {}
    }
    drop(listener);
    service::set_health(&health, false).await;
    if timeout(door.limits.drain, door.gate.shut()).await.is_err() {
        tracing::warn!("sessions were cut at the end of the drain time");
    }
    closing.send_replace(true);
    let all_closed = async { while connections.join_next().await.is_some() {} };
    if timeout(door.limits.drain, all_closed).await.is_err() {
        tracing::warn!("connections were cut at the end of the drain time");
    }
    Ok(())
}

/// Accepts for ever, within the limits of places.
async fn accept(
    listener: &Listener,
    limits: &Arc<Limits>,
    routes: &Routes,
    closing: &watch::Sender<bool>,
    connections: &mut JoinSet<()>,
) {
    let greeter = listener.greeter();
    let places = Places::new(limits.max_connections, limits.max_connections_per_address);
    loop {
        while connections.try_join_next().is_some() {}
        match listener.accept().await {
            Ok((stream, peer)) => match places.take(peer.ip()) {
                Some(place) => {
                    let connection =
                        Connection { limits: limits.clone(), closing: closing.subscribe(), place };
                    connections.spawn(connection.serve(stream, greeter.clone(), routes.clone()));
                }
                // Closing at once tells the client more than a connection that never answers.
                None => tracing::warn!(%peer, "connection refused: no place left"),
            },
            Err(error) => pause(&error).await,
        }
    }
}

async fn pause(error: &io::Error) {
    tracing::warn!(%error, "accept failed");
    sleep(ACCEPT_PAUSE).await;
}

struct Connection {
    limits: Arc<Limits>,
    closing: watch::Receiver<bool>,
    place: Place,
}

impl Connection {
    /// Serves one connection until either side closes it.
    async fn serve(mut self, stream: TcpStream, greeter: Greeter, routes: Routes) {
        // Without it small frames wait for acknowledgements; a socket that refuses still works.
        let _ = stream.set_nodelay(true);
        if let Some(until) = self.place.waits_until() {
            sleep_until(until).await;
        }
        let meter = Meter::new(EXCESS_BYTES);
        self.converse(stream, &meter, (greeter, routes)).await;
        if meter.exceeds(i64::from(self.limits.header_bytes)) {
            tracing::warn!("connection closed: its peer said far more than its calls can mean");
            self.place.keep_waiting(Instant::now() + PENALTY);
        }
    }

    async fn converse(
        &mut self,
        stream: TcpStream,
        meter: &Arc<Meter>,
        (greeter, routes): (Greeter, Routes),
    ) {
        let mut first_request = pin!(sleep(self.limits.first_request));
        let stream = match greeter.greet(stream, self.limits.first_request).await {
            Ok(stream) => stream,
            Err(refused) => return tracing::debug!(%refused, "connection closed"),
        };
        let seen = Arc::new(AtomicBool::new(false));
        let (mark, allowed, head_bytes) = (seen.clone(), meter.clone(), self.limits.header_bytes as usize);
        let service = service_fn(move |request: hyper::Request<Incoming>| {
            mark.store(true, Ordering::Relaxed);
            allowed.allow(head_bytes);
            routes.clone().call(request)
        });
        let stream = TokioIo::new(Metered::new(stream, meter.clone()));
        let mut connection = pin!(self.http2().serve_connection(stream, service));
        let (mut waiting, mut closing) = (true, false);
        loop {
            tokio::select! {
                ended = &mut connection => {
                    if let Err(error) = ended {
                        tracing::debug!(%error, "connection ended");
                    }
                    return;
                }
                () = &mut first_request, if waiting => {
                    waiting = false;
                    if !seen.load(Ordering::Relaxed) {
                        tracing::debug!("connection without a request closed");
                        return;
                    }
                }
                _ = self.closing.wait_for(|closing| *closing), if !closing => {
                    closing = true;
                    connection.as_mut().graceful_shutdown();
                }
            }
        }
    }

    fn http2(&self) -> http2::Builder<TokioExecutor> {
        let mut builder = http2::Builder::new(TokioExecutor::new());
        builder
            .timer(TokioTimer::new())
            .max_concurrent_streams(self.limits.http2_streams)
            .max_pending_accept_reset_streams(PENDING_RESETS)
            .max_local_error_reset_streams(LOCAL_RESETS)
            .max_header_list_size(self.limits.header_bytes)
            .max_frame_size(self.limits.http2_frame_bytes)
            .initial_stream_window_size(STREAM_WINDOW_BYTES)
            .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
            .max_send_buf_size(SEND_BUFFER_BYTES)
            .keep_alive_interval(self.limits.keepalive_interval)
            .keep_alive_timeout(self.limits.keepalive_timeout);
        builder
    }
}
