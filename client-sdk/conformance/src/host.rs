//! A test server for clients: it follows the protocol and injects permitted faults.

use crate::checks::Check;
use crate::frames;
use crate::scenario::{Scenario, Trial};
use crate::stream::Conversation;
use crate::trials::{MAX_SLOTS, Transport, TrialRun};
use avln_proto::v1::{
    self, info_service_server as info, play_service_server as play, run_service_server as runs,
};
use std::{io, net::SocketAddr, sync::Arc, time::Duration};
use tokio::net::TcpListener;
use tokio::sync::{Mutex, mpsc, watch};
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::{Request, Response, Status, Streaming, transport::Server};

const CLIENT_TIMEOUT: Duration = Duration::from_secs(60);
pub(crate) const OBSERVATION_DELAY: Duration = Duration::from_secs(3);
/// Streams or unary calls refused by an unreachable server.
pub(crate) const REFUSED_CALLS: u32 = 3;
const QUEUED_FRAMES: usize = 16;
const FLUSH_TIME: Duration = Duration::from_millis(500);
/// Time without a call by a client that must not play any more.
const SILENCE: Duration = Duration::from_secs(5);

/// A listening test server.
#[derive(Debug)]
pub struct Host {
    listener: TcpListener,
    trials: &'static [Trial],
    /// Listening address.
    pub address: SocketAddr,
}

impl Host {
    /// Listens at `address`, or a free port for port 0; fails if the address is unavailable.
    pub async fn bind(address: SocketAddr, scenario: Scenario) -> io::Result<Self> {
        Self::with_trials(address, scenario.trials()).await
    }

    pub(crate) async fn with_trials(address: SocketAddr, trials: &'static [Trial]) -> io::Result<Self> {
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        Ok(Self { listener, trials, address })
    }

    /// Hosts a run for the first client and returns the trial results; waits a minute for every later frame.
    pub async fn check(self) -> Vec<Check> {
        let (frame_counter, mut frames_seen) = watch::channel(0_u64);
        let run = Arc::new(Mutex::new(TrialRun::new(self.trials)));
        let fake = Fake { run: run.clone(), frame_counter: Arc::new(frame_counter) };
        let server = Server::builder()
            .add_service(info::InfoServiceServer::new(fake.clone()))
            .add_service(runs::RunServiceServer::new(fake.clone()))
            .add_service(play::PlayServiceServer::new(fake))
            .serve_with_incoming(TcpListenerStream::new(self.listener));
        let serving = tokio::spawn(server);
        let _ = frames_seen.changed().await;
        let late = await_end(&run, &mut frames_seen).await;
        if late.is_none() && self.trials.iter().any(|(fault, _)| fault.finishes_client()) {
            let _ = timeout(SILENCE, await_disturbance(&run, &mut frames_seen)).await;
        }
        // RunEnd may still be in the send queue, and abort would discard it.
        sleep(FLUSH_TIME).await;
        serving.abort();
        run.lock().await.checks(late.as_deref())
    }
}

/// Waits for the end of the run; returns the reason if the client sends nothing for too long.
async fn await_end(run: &Mutex<TrialRun>, frames_seen: &mut watch::Receiver<u64>) -> Option<String> {
    // The limit applies to every frame: a client may think longer than that about a whole run.
    while !run.lock().await.is_done {
        if timeout(CLIENT_TIMEOUT, frames_seen.changed()).await.is_err() {
            return Some(format!("no frame from the client within {} s", CLIENT_TIMEOUT.as_secs()));
        }
    }
    None
}

/// Waits for a call after the end.
async fn await_disturbance(run: &Mutex<TrialRun>, frames_seen: &mut watch::Receiver<u64>) {
    while !run.lock().await.is_disturbed {
        if frames_seen.changed().await.is_err() {
            return;
        }
    }
}

/// The test server's services.
#[derive(Clone)]
pub(crate) struct Fake {
    pub(crate) run: Arc<Mutex<TrialRun>>,
    frame_counter: Arc<watch::Sender<u64>>,
}

impl Fake {
    pub(crate) fn count_frame(&self) {
        self.frame_counter.send_modify(|frames_seen| *frames_seen += 1);
    }

    /// Ends the run.
    pub(crate) fn finish(&self, run: &mut TrialRun) {
        run.finish();
        self.count_frame();
    }

    /// Refuses a call after the end, in a second transport, or to an unreachable server.
    pub(crate) fn admit(&self, run: &mut TrialRun, transport: Transport) -> Result<(), Status> {
        self.count_frame();
        if run.is_done {
            run.violation(None, "the client made another call after the end");
            run.is_disturbed = true;
            self.count_frame();
            let reason = if run.is_over() { v1::Reason::RunOver } else { v1::Reason::Superseded };
            return Err(frames::refusal(reason, None));
        }
        if *run.transport.get_or_insert(transport) != transport {
            run.violation(None, "the client used a stream and unary calls in the same run");
            return Err(frames::refusal(v1::Reason::BadRequest, None));
        }
        if run.refuse > 0 {
            run.refuse -= 1;
            return Err(Status::unavailable("the conformance kit refuses this call"));
        }
        Ok(())
    }
}

type Answer<T> = Result<Response<T>, Status>;

#[tonic::async_trait]
impl info::InfoService for Fake {
    async fn get_server_info(
        &self,
        _: Request<v1::GetServerInfoRequest>,
    ) -> Answer<v1::GetServerInfoResponse> {
        Ok(Response::new(frames::server_info()))
    }

    async fn list_phases(&self, _: Request<v1::ListPhasesRequest>) -> Answer<v1::ListPhasesResponse> {
        let phases = vec![frames::phase(&*self.run.lock().await)];
        Ok(Response::new(v1::ListPhasesResponse { phases }))
    }
}

#[tonic::async_trait]
impl runs::RunService for Fake {
    type WatchRunStream = ReceiverStream<Result<v1::WatchRunResponse, Status>>;

    async fn start_run(&self, request: Request<v1::StartRunRequest>) -> Answer<v1::StartRunResponse> {
        self.count_frame();
        let mut run = self.run.lock().await;
        run.request = request.into_inner();
        Ok(Response::new(v1::StartRunResponse {
            run: Some(frames::run_status(&run)),
            run_token: "avln_run_conformance".to_owned(),
            max_slots: MAX_SLOTS,
            time: Some(frames::time()),
            ..v1::StartRunResponse::default()
        }))
    }

    async fn get_run(&self, _: Request<v1::GetRunRequest>) -> Answer<v1::GetRunResponse> {
        let run = Some(frames::run_status(&*self.run.lock().await));
        Ok(Response::new(v1::GetRunResponse { run }))
    }

    async fn watch_run(&self, _: Request<v1::WatchRunRequest>) -> Answer<Self::WatchRunStream> {
        Err(Status::unimplemented("the conformance kit does not implement WatchRun"))
    }

    async fn cancel_run(&self, _: Request<v1::CancelRunRequest>) -> Answer<v1::CancelRunResponse> {
        let mut run = self.run.lock().await;
        run.violation(None, "the client cancelled the run");
        self.finish(&mut run);
        Ok(Response::new(v1::CancelRunResponse { run: Some(frames::run_status(&run)) }))
    }

    async fn list_runs(&self, _: Request<v1::ListRunsRequest>) -> Answer<v1::ListRunsResponse> {
        Ok(Response::new(v1::ListRunsResponse::default()))
    }

    async fn get_quota(&self, _: Request<v1::GetQuotaRequest>) -> Answer<v1::GetQuotaResponse> {
        Ok(Response::new(v1::GetQuotaResponse::default()))
    }

    async fn who_am_i(&self, _: Request<v1::WhoAmIRequest>) -> Answer<v1::WhoAmIResponse> {
        Ok(Response::new(v1::WhoAmIResponse {
            team: "checked".to_owned(),
            scope: v1::TokenScope::Participant.into(),
            ..v1::WhoAmIResponse::default()
        }))
    }
}

#[tonic::async_trait]
impl play::PlayService for Fake {
    type PlayStream = ReceiverStream<Result<v1::PlayResponse, Status>>;

    async fn play(&self, request: Request<Streaming<v1::PlayRequest>>) -> Answer<Self::PlayStream> {
        self.admit(&mut *self.run.lock().await, Transport::Stream)?;
        let (responses, receiver) = mpsc::channel(QUEUED_FRAMES);
        tokio::spawn(Conversation { fake: self.clone(), requests: request.into_inner(), responses }.hold());
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn reset(&self, request: Request<v1::ResetRequest>) -> Answer<v1::ResetResponse> {
        self.reset_slot(request.into_inner()).await.map(Response::new)
    }

    async fn step(&self, request: Request<v1::StepRequest>) -> Answer<v1::StepResponse> {
        self.step_slot(request.into_inner()).await.map(Response::new)
    }

    async fn end(&self, request: Request<v1::EndRequest>) -> Answer<v1::EndResponse> {
        self.end_slot(request.into_inner()).await.map(Response::new)
    }
}
