//! A test server for clients: it follows the protocol and injects permitted faults.

use crate::checks::Check;
use crate::frames;
use crate::scenario::{InjectedFault, Scenario, Trial};
use crate::stream::{Conversation, Fake, OBSERVATION_DELAY, REFUSED_CALLS};
use crate::trials::{FAULT_STEP, MAX_SLOTS, Transport, TrialRun, UnaryCall};
use avln_proto::v1::reset_response::Outcome;
use avln_proto::v1::{
    self, end_request, end_response, info_service_server as info, play_service_server as play,
    run_service_server as runs,
};
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::net::TcpListener;
use tokio::sync::{Mutex, mpsc, watch};
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::transport::Server;
use tonic::{Request, Response, Status, Streaming};

const CLIENT_TIMEOUT: Duration = Duration::from_secs(60);
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

impl Fake {
    /// Handles Reset: Hello and Ready in a single call.
    pub(crate) async fn reset_slot(&self, request: v1::ResetRequest) -> Result<v1::ResetResponse, Status> {
        let hello = request.hello.unwrap_or_default();
        let slot = request.ready.unwrap_or_default().slot;
        let mut run = self.run.lock().await;
        // A client that lost RunEnd repeats Reset.
        if run.is_unary() && run.is_over() {
            return Ok(no_episode(&run));
        }
        self.admit(&mut run, Transport::Unary)?;
        compare_repeated(&mut run, &UnaryCall::Reset { slot });
        run.agree(&hello);
        let welcome = frames::welcome(&run);
        if !is_repeated(&run, slot, hello.resume) {
            run.ready(slot).map_err(|reason| frames::refusal(reason, None))?;
            if !run.has_next(slot) {
                self.finish(&mut run);
                return Ok(no_episode(&run));
            }
            run.begin(slot);
        }
        if run.fault(slot) == InjectedFault::LostStart && run.inject_at(slot, 0) {
            return Err(lost_answer(&mut run, UnaryCall::Reset { slot }));
        }
        run.observation_sent(slot);
        let start = run.open.get(&slot).map(|open| Outcome::EpisodeStart(frames::start(&run, open)));
        Ok(v1::ResetResponse { welcome: Some(welcome), outcome: start })
    }

    /// Handles Step: an action and its observation.
    pub(crate) async fn step_slot(&self, request: v1::StepRequest) -> Result<v1::StepResponse, Status> {
        let act = request.act.unwrap_or_default();
        let mut run = self.run.lock().await;
        self.admit(&mut run, Transport::Unary)?;
        compare_repeated(&mut run, &UnaryCall::Step(act.clone()));
        if run.report_loss(act.slot, &act.episode) {
            return Err(frames::refusal(v1::Reason::EpisodeUnknown, None));
        }
        run.act(&act).map_err(|reason| frames::refusal(reason, None))?;
        let fault = run.fault(act.slot);
        let is_due = fault.needs_steps() && run.inject_at(act.slot, FAULT_STEP);
        if is_due && let Some(response) = self.before_answer(&mut run, &act, fault).await? {
            return Ok(response);
        }
        let response = answer(&mut run, &act)?;
        match fault {
            InjectedFault::Unreachable if is_due => run.refuse = REFUSED_CALLS,
            InjectedFault::Reissued if is_due => run.drop_episode(act.slot),
            _ => {}
        }
        Ok(response)
    }

    /// Injects a fault; returns the answer if it replaces the observation.
    async fn before_answer(
        &self,
        run: &mut TrialRun,
        act: &v1::Act,
        fault: InjectedFault,
    ) -> Result<Option<v1::StepResponse>, Status> {
        match fault {
            InjectedFault::LateObservation => sleep(OBSERVATION_DELAY).await,
            InjectedFault::LostObservation => return Err(lost_answer(run, UnaryCall::Step(act.clone()))),
            InjectedFault::Superseded => {
                run.supersede(act.slot);
                self.count_frame();
                return Err(frames::refusal(v1::Reason::Superseded, None));
            }
            InjectedFault::SimulatorFault => {
                let ended = run.close(act.slot);
                let end = ended.map(|open| frames::end(run, &open, v1::EndReason::ServerFault));
                return Ok(Some(v1::StepResponse { observation: None, episode_end: end }));
            }
            _ => {}
        }
        Ok(None)
    }

    /// Handles End: Abandon or Goodbye.
    pub(crate) async fn end_slot(&self, request: v1::EndRequest) -> Result<v1::EndResponse, Status> {
        let mut run = self.run.lock().await;
        let is_goodbye = matches!(request.frame, Some(end_request::Frame::Goodbye(_)));
        if !(is_goodbye && run.is_unary() && run.is_over()) {
            self.admit(&mut run, Transport::Unary)?;
        }
        compare_repeated(&mut run, &UnaryCall::End);
        let frame = match request.frame {
            Some(end_request::Frame::Abandon(abandon)) => {
                run.violation(Some(abandon.slot), "the client abandoned the episode");
                let ended = run.close(abandon.slot);
                let open = ended.ok_or_else(|| frames::refusal(v1::Reason::EpisodeUnknown, None))?;
                let end = frames::end(&run, &open, v1::EndReason::Abandoned);
                end_response::Frame::EpisodeEnd(end)
            }
            Some(end_request::Frame::Goodbye(_)) => {
                self.finish(&mut run);
                end_response::Frame::RunEnd(frames::run_end(&run))
            }
            None => return Err(frames::refusal(v1::Reason::BadRequest, None)),
        };
        Ok(v1::EndResponse { frame: Some(frame) })
    }
}

fn no_episode(run: &TrialRun) -> v1::ResetResponse {
    let outcome = Some(Outcome::RunEnd(frames::run_end(run)));
    v1::ResetResponse { welcome: Some(frames::welcome(run)), outcome }
}

/// Returns true for a Reset that returns the open episode: with `resume`, or again before the first step.
fn is_repeated(run: &TrialRun, slot: u32, resumes: bool) -> bool {
    run.open.get(&slot).is_some_and(|open| resumes || open.step() == 0)
}

fn compare_repeated(run: &mut TrialRun, call: &UnaryCall) {
    let Some(lost) = run.lost_call.take().filter(|lost| lost != call) else { return };
    let slot = match &lost {
        UnaryCall::Reset { slot } => Some(*slot),
        UnaryCall::Step(act) => Some(act.slot),
        UnaryCall::End => None,
    };
    run.violation(slot, format!("after a lost answer: expected the same {lost:?}, got {call:?}"));
}

fn lost_answer(run: &mut TrialRun, call: UnaryCall) -> Status {
    run.lost_call = Some(call);
    Status::unavailable("the conformance kit lost the answer")
}

/// Returns the observation after an action, and the end of the episode.
fn answer(run: &mut TrialRun, act: &v1::Act) -> Result<v1::StepResponse, Status> {
    let open = run.open.get(&act.slot).cloned();
    let open = open.ok_or_else(|| frames::refusal(v1::Reason::EpisodeUnknown, None))?;
    let is_lost = run.fault(act.slot) == InjectedFault::LostEnd && open.over.is_some();
    if is_lost && run.inject_at(act.slot, open.step()) {
        return Err(lost_answer(run, UnaryCall::Step(act.clone())));
    }
    let observation = Some(frames::observation(run, &open));
    run.observation_sent(act.slot);
    let ended = open.over.and_then(|reason| Some((run.close(act.slot)?, reason)));
    let episode_end = ended.map(|(open, reason)| frames::end(run, &open, reason));
    Ok(v1::StepResponse { observation, episode_end })
}
