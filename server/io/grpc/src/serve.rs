//! HTTP/2 server: connections after the handshake, shutdown, and the Info and Play services.

use crate::{
    context::{Reply, ServiceContext, bearer},
    control::Control,
    host::Host,
    limits::{CallPace, Limits},
    outbound::{Frames, outbound},
    play_stream::PlayStream,
    refusal::call_host,
    run_service::RunCalls,
    unary::UnaryCall,
    wire,
};
use avln_net::{AcceptLimits, AcceptLoop, Connection, Listener, Meter, Metered};
use avln_proto::v1::{
    self,
    info_service_server::{InfoService, InfoServiceServer},
    play_service_server::{PlayService, PlayServiceServer},
    run_service_server::RunServiceServer,
};
use hyper::{body::Incoming, server::conn::http2, service::service_fn};
use hyper_util::rt::{TokioExecutor, TokioIo, TokioTimer};
use std::{
    convert::Infallible,
    future::Future,
    pin::pin,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};
use tokio::time::{Instant, sleep_until, timeout};
use tonic::{Request, Response, Streaming, server::NamedService, service::Routes};
use tonic_health::{ServingStatus, server::HealthReporter};
use tower::Service;

const ACCEPT_PAUSE: Duration = Duration::from_millis(200);
/// Unread bytes per call from a client. Client frames are tiny.
const STREAM_WINDOW_BYTES: u32 = 64 << 10;
/// Unread bytes per connection from a client.
const CONNECTION_WINDOW_BYTES: u32 = 1 << 20;
/// Bytes per call that wait for the socket: a whole observation.
const SEND_BUFFER_BYTES: usize = 1 << 20;
/// Calls that a client may open and reset at once before the connection closes.
const PENDING_RESETS: usize = 20;
/// Calls that the server may have to reset before it closes the connection.
const LOCAL_RESETS: usize = 64;
/// Received bytes per connection beyond replies and request headers: 1.5 times the largest client message.
const EXCESS_BYTES: i64 = 96 << 10;
/// Delay for new connections after a flood from the same address.
const PENALTY: Duration = Duration::from_secs(2);

/// Error: the server cannot start.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// The compiled `.proto` files are unreadable.
    #[error("cannot read the protocol's own descriptors: {0}; rebuild the server")]
    Reflection(#[from] tonic_reflection::server::Error),
}

/// Serves agents on `listener` until `shutdown` completes and all sessions have ended; open episodes remain in the run log.
/// Fails if the server cannot start. Clients cannot cause an error.
pub async fn serve<H: Host>(
    listener: impl Into<Listener>,
    host: Arc<H>,
    limits: Limits,
    shutdown: impl Future<Output = ()> + Send,
) -> Result<(), ServeError> {
    let server = LocalServer::open(host, limits).await?;
    let limits = server.context.limits.clone();
    let accept_limits = AcceptLimits {
        max_connections: limits.max_connections,
        max_connections_per_address: limits.max_connections_per_address,
        shares_by_address: true,
        // Refused at once: a client library shows a refused connection as an error, a waiting one as a hang.
        waits_when_full: false,
        handshake: limits.first_request,
        failure_pause: ACCEPT_PAUSE,
        max_failures: None,
    };
    let mut accept = AcceptLoop::new(listener, accept_limits);
    tokio::select! {
        error = accept.run({
            let limits = limits.clone();
            let routes = server.routes();
            move |connection| serve_connection(connection, limits.clone(), routes.clone())
        }) => tracing::error!(%error, "the accept loop ended"),
        () = server.work() => {}
        () = shutdown => {}
    }
    let connections = accept.stop_listening();
    // Sessions before connections: clients must receive the notice of the stop on their streams.
    server.close().await;
    if timeout(limits.drain, connections.close()).await.is_err() {
        tracing::warn!("connections were cut at the end of the drain time");
    }
    Ok(())
}

/// A server without a network: services for clients in the same process, and the work between their calls.
pub struct LocalServer<H: Host> {
    context: Arc<ServiceContext<H>>,
    routes: Routes,
    health: HealthReporter,
}

impl<H: Host> LocalServer<H> {
    /// Opens the services, and restores interrupted runs in the background.
    pub async fn open(host: Arc<H>, limits: Limits) -> Result<Self, ServeError> {
        let context = ServiceContext::new(host, limits);
        let (routes, health) = routes(&context).await?;
        // Claimed before the first client is admitted, which otherwise could start its run over.
        for guard in context.claim_interrupted().await {
            tokio::spawn(context.clone().restore(guard));
        }
        Ok(Self { context, routes, health })
    }

    /// Returns the services.
    pub fn routes(&self) -> Routes {
        self.routes.clone()
    }

    /// Ends expired and cancelled runs, and reports a drain. Never returns.
    pub async fn work(&self) {
        let Self { context, health, .. } = self;
        tokio::join!(context.end_expired_runs(), context.end_cancelled_runs(), report_drain(context, health));
    }

    /// Ends all sessions; open episodes remain in the run log.
    pub async fn close(&self) {
        set_health(&self.health, &services::<H>(), false).await;
        let end_sessions = async {
            for session in self.context.registry.shut().await {
                session.leave().await;
            }
        };
        if timeout(self.context.limits.drain, end_sessions).await.is_err() {
            tracing::warn!("sessions were cut at the end of the drain time");
        }
    }
}

/// Serves a connection until either side closes it. After a flood, delays others from the same address.
async fn serve_connection(connection: Connection, limits: Arc<Limits>, routes: Routes) {
    let Connection { stream, opened, permit, mut closing, .. } = connection;
    let meter = Meter::new(EXCESS_BYTES);
    let seen = Arc::new(AtomicBool::new(false));
    let pace = Arc::new(CallPace::new(limits.calls_per_s, opened));
    let service = service_fn({
        let seen = seen.clone();
        let meter = meter.clone();
        let header_bytes = limits.header_bytes as usize;
        move |request: hyper::Request<Incoming>| {
            seen.store(true, Ordering::Relaxed);
            meter.allow(header_bytes);
            let (pace, path) = (pace.clone(), request.uri().path().to_owned());
            let mut routes = routes.clone();
            async move {
                pace.wait(&path).await;
                let reply = routes.call(request).await?;
                pace.answered(&path, reply.headers());
                Ok::<_, Infallible>(reply)
            }
        }
    });
    let stream = TokioIo::new(Metered::new(stream, meter.clone()));
    {
        let mut http = pin!(configure(&limits).serve_connection(stream, service));
        let mut first_request = pin!(sleep_until(opened + limits.first_request));
        let mut waiting = true;
        let mut is_closing = false;
        loop {
            tokio::select! {
                ended = &mut http => {
                    if let Err(error) = ended {
                        tracing::debug!(%error, "connection ended");
                    }
                    break;
                }
                () = &mut first_request, if waiting => {
                    waiting = false;
                    if !seen.load(Ordering::Relaxed) {
                        tracing::debug!("connection without a request closed");
                        break;
                    }
                }
                () = closing.wait(), if !is_closing => {
                    is_closing = true;
                    http.as_mut().graceful_shutdown();
                }
            }
        }
    }
    if meter.exceeds(i64::from(limits.header_bytes)) {
        tracing::warn!("connection closed: its client sent excessive data");
        permit.delay_others(Instant::now() + PENALTY);
    }
}

fn configure(limits: &Limits) -> http2::Builder<TokioExecutor> {
    let mut builder = http2::Builder::new(TokioExecutor::new());
    builder
        .timer(TokioTimer::new())
        .max_concurrent_streams(limits.http2_streams)
        .max_pending_accept_reset_streams(PENDING_RESETS)
        .max_local_error_reset_streams(LOCAL_RESETS)
        .max_header_list_size(limits.header_bytes)
        .max_frame_size(limits.http2_frame_bytes)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .max_send_buf_size(SEND_BUFFER_BYTES)
        .keep_alive_interval(limits.keepalive_interval)
        .keep_alive_timeout(limits.keepalive_timeout);
    builder
}

/// Creates all services, with health and reflection, and the reporter that sets the health.
pub(crate) async fn routes<H: Host>(
    context: &Arc<ServiceContext<H>>,
) -> Result<(Routes, HealthReporter), tonic_reflection::server::Error> {
    let Limits { decode_bytes, encode_bytes, .. } = *context.limits;
    let info = InfoServiceServer::new(InfoCalls(context.clone())).max_decoding_message_size(decode_bytes);
    let run = RunServiceServer::new(RunCalls(context.clone())).max_decoding_message_size(decode_bytes);
    let play = PlayServiceServer::new(PlayCalls(context.clone()))
        .max_decoding_message_size(decode_bytes)
        .max_encoding_message_size(encode_bytes);
    let (reporter, health) = tonic_health::server::health_reporter();
    set_health(&reporter, &services::<H>(), true).await;
    let reflection = tonic_reflection::server::Builder::configure()
        .register_encoded_file_descriptor_set(avln_proto::FILE_DESCRIPTOR_SET)
        .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        .build_v1()?;
    let routes =
        Routes::new(health).add_service(reflection).add_service(info).add_service(run).add_service(play);
    Ok((routes.prepare(), reporter))
}

/// Health name of the whole server.
const SERVER: &str = "";

/// Returns the health names of the server and all services.
fn services<H: Host>() -> [&'static str; 4] {
    [
        SERVER,
        InfoServiceServer::<InfoCalls<H>>::NAME,
        RunServiceServer::<RunCalls<H>>::NAME,
        PlayServiceServer::<PlayCalls<H>>::NAME,
    ]
}

async fn set_health(reporter: &HealthReporter, names: &[&str], up: bool) {
    let status = if up { ServingStatus::Serving } else { ServingStatus::NotServing };
    for name in names {
        reporter.set_service_status(*name, status).await;
    }
}

/// Reports at the beginning of a drain that no run starts any more. Open episodes go on, and with them PlayService. Never
/// returns.
async fn report_drain<H: Host>(context: &ServiceContext<H>, reporter: &HealthReporter) {
    if let Some(control) = context.host.control() {
        control.drain_begins().await;
        set_health(reporter, &[SERVER, RunServiceServer::<RunCalls<H>>::NAME], false).await;
    }
    std::future::pending().await
}

struct InfoCalls<H: Host>(Arc<ServiceContext<H>>);

#[tonic::async_trait]
impl<H: Host> InfoService for InfoCalls<H> {
    async fn get_server_info(
        &self,
        _: Request<v1::GetServerInfoRequest>,
    ) -> Reply<v1::GetServerInfoResponse> {
        let ServiceContext { host, limits, registry, .. } = &*self.0;
        let draining =
            registry.is_shut() || host.control().is_some_and(|control| control.draining().is_some());
        let notice = host.control().map(Control::announcement).unwrap_or_default();
        Ok(Response::new(wire::server_info(host.info(), limits, draining, notice)))
    }

    async fn list_phases(&self, request: Request<v1::ListPhasesRequest>) -> Reply<v1::ListPhasesResponse> {
        let has_token = request.metadata().contains_key("authorization");
        let token = has_token.then(|| bearer(request.metadata())).transpose()?;
        let phases = call_host("list phases", &self.0.host, |host| async move {
            let account = match token {
                Some(token) => Some(host.account(&token).await?),
                None => None,
            };
            host.phases(account.as_ref()).await
        });
        let phases = phases.await?.into_iter().map(wire::phase).collect();
        Ok(Response::new(v1::ListPhasesResponse { phases }))
    }
}

struct PlayCalls<H: Host>(Arc<ServiceContext<H>>);

#[tonic::async_trait]
impl<H: Host> PlayService for PlayCalls<H> {
    type PlayStream = Frames;

    async fn play(&self, request: Request<Streaming<v1::PlayRequest>>) -> Reply<Self::PlayStream> {
        let context = self.0.clone();
        let token = bearer(request.metadata())?;
        context.registry.check_open()?;
        let open = context.any_run(&token).await?;
        // Two frames per slot: an observation and the end of its episode.
        let (out, frames) = outbound(2 * open.slot_limit() as usize, context.limits.reader_stall);
        let stream = PlayStream { context, token, inbound: request.into_inner(), out };
        // In a task, so that episodes are stored even if the connection is cut.
        tokio::spawn(stream.run());
        Ok(Response::new(frames))
    }

    async fn reset(&self, request: Request<v1::ResetRequest>) -> Reply<v1::ResetResponse> {
        let call = UnaryCall::new(&self.0, request.metadata())?;
        Ok(Response::new(call.reset(request.into_inner()).await?))
    }

    async fn step(&self, request: Request<v1::StepRequest>) -> Reply<v1::StepResponse> {
        let call = UnaryCall::new(&self.0, request.metadata())?;
        Ok(Response::new(call.step(request.into_inner()).await?))
    }

    async fn end(&self, request: Request<v1::EndRequest>) -> Reply<v1::EndResponse> {
        let call = UnaryCall::new(&self.0, request.metadata())?;
        Ok(Response::new(call.end(request.into_inner()).await?))
    }
}
