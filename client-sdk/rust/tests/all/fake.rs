//! A scripted server.

#![allow(unreachable_pub, missing_docs, reason = "a test module")]

use avln_proto::{
    REASON_KEY,
    v1::{
        self, info_service_server as info, play_request::Frame as Asked, play_response::Frame as Told,
        play_service_server as play, run_service_server as runs,
    },
};
use std::{future::Future, pin::Pin, sync::Arc};
use tokio::{net::TcpListener, sync::mpsc};
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::{Code, Request, Response, Status, Streaming, transport::Server};

/// The account's token.
pub const TOKEN: &str = "good";
/// The run's token.
pub const RUN_TOKEN: &str = "run-good";
/// Fake camera's pixels per side; the smallest that a client may ask for.
pub const SIDE: u32 = 64;
/// Samples per fake ear.
pub const SAMPLES: u32 = 8;

type Scene = Pin<Box<dyn Future<Output = ()> + Send>>;
type Script = Arc<dyn Fn(Stage) -> Scene + Send + Sync>;

/// Starts a server with `script` as its Play stream; returns the address.
pub async fn serve<F, S>(script: F) -> String
where
    F: Fn(Stage) -> S + Send + Sync + 'static,
    S: Future<Output = ()> + Send + 'static,
{
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let fake = Fake(Arc::new(move |stage| Box::pin(script(stage))));
    let server = Server::builder()
        .add_service(info::InfoServiceServer::new(fake.clone()))
        .add_service(runs::RunServiceServer::new(fake.clone()))
        .add_service(play::PlayServiceServer::new(fake));
    tokio::spawn(server.serve_with_incoming(TcpListenerStream::new(listener)));
    address
}

/// A stream's server side.
pub struct Stage {
    asked: Streaming<v1::PlayRequest>,
    told: mpsc::Sender<Result<v1::PlayResponse, Status>>,
}

impl Stage {
    /// Next client frame; `None` at the stream's end.
    pub async fn hear(&mut self) -> Option<Asked> {
        self.asked.message().await.ok().flatten().and_then(|request| request.frame)
    }

    pub async fn tell(&self, frame: Told) {
        let _ = self.told.send(Ok(v1::PlayResponse { frame: Some(frame) })).await;
    }

    /// Sends a frame unknown to all clients with this version.
    pub async fn mumble(&self) {
        let _ = self.told.send(Ok(v1::PlayResponse { frame: None })).await;
    }

    /// Ends the stream with a status.
    pub async fn die(&self, status: Status) {
        let _ = self.told.send(Err(status)).await;
    }

    /// Reads Hello and grants the requested slots.
    pub async fn greet(&mut self) -> v1::Hello {
        let Some(Asked::Hello(hello)) = self.hear().await else { panic!("no Hello") };
        self.tell(Told::Welcome(welcome(hello.slots))).await;
        hello
    }

    pub async fn hear_ready(&mut self) -> v1::Ready {
        match self.hear().await {
            Some(Asked::Ready(ready)) => ready,
            other => panic!("no Ready but {other:?}"),
        }
    }

    pub async fn hear_act(&mut self) -> v1::Act {
        match self.hear().await {
            Some(Asked::Act(act)) => act,
            other => panic!("no Act but {other:?}"),
        }
    }

    /// Begins an episode in a slot.
    pub async fn begin(&self, slot: u32, episode: &str, ordinal: u32) {
        let start = v1::EpisodeStart {
            slot,
            episode: episode.into(),
            mission: Some(mission()),
            observation: Some(observation(slot, episode, 0)),
            ordinal,
            progress: Some(progress(ordinal - 1)),
        };
        self.tell(Told::EpisodeStart(start)).await;
    }

    /// Ends an episode after `step` steps; the metrics are shown.
    pub async fn end(&self, slot: u32, episode: &str, step: u32, reason: v1::EndReason, done: u32) {
        let end = v1::EpisodeEnd {
            slot,
            episode: episode.into(),
            step,
            reason: reason as i32,
            terminated: reason == v1::EndReason::Stopped,
            metrics: Some(v1::PublicMetrics { metrics: vec![metric("isr", 0.5)] }),
            progress: Some(progress(done)),
        };
        self.tell(Told::EpisodeEnd(end)).await;
    }

    /// Answers Acts with observations until Stop, which ends the episode; returns the actions.
    pub async fn play_until_stop(&mut self, slot: u32, episode: &str, done: u32) -> Vec<v1::Action> {
        let mut actions = Vec::new();
        loop {
            let act = self.hear_act().await;
            assert_eq!((act.slot, act.episode.as_str()), (slot, episode));
            assert_eq!(act.step as usize, actions.len() + 1);
            actions.push(act.action());
            let stop = act.action() == v1::Action::Stop;
            let mut seen = observation(slot, episode, act.step);
            (seen.terminated, seen.reason) = (stop, if stop { v1::EndReason::Stopped as i32 } else { 0 });
            self.tell(Told::Observation(seen)).await;
            if stop {
                self.end(slot, episode, act.step, v1::EndReason::Stopped, done).await;
                return actions;
            }
        }
    }

    pub async fn end_run(&self, done: u32) {
        let end = v1::RunEnd {
            run: "run_1".into(),
            progress: Some(progress(done)),
            ends: vec![v1::EndCount { reason: v1::EndReason::Stopped as i32, episodes: done }],
            metrics: Some(v1::PublicMetrics { metrics: vec![metric("isr", 0.5)] }),
            complete: done == 2,
            url: String::new(),
        };
        self.tell(Told::RunEnd(end)).await;
    }
}

pub fn fault(slot: Option<u32>, reason: v1::Reason, recoverable: bool) -> v1::Fault {
    v1::Fault {
        slot,
        code: reason.code() as u32,
        reason: reason as i32,
        message: format!("told {}", reason.word()),
        recoverable,
        ..v1::Fault::default()
    }
}

pub fn welcome(slots: u32) -> v1::Welcome {
    v1::Welcome {
        run: "run_1".into(),
        slots,
        task: Some(task()),
        tensors: vec![
            spec(1, v1::SensorKind::Rgb, v1::Dtype::U8, vec![SIDE, SIDE, 3]),
            spec(2, v1::SensorKind::Depth, v1::Dtype::F32, vec![SIDE, SIDE]),
            spec(3, v1::SensorKind::Audio, v1::Dtype::F32, vec![2, SAMPLES]),
        ],
        max_message_bytes: 1 << 20,
        progress: Some(progress(0)),
        ..v1::Welcome::default()
    }
}

fn task() -> v1::TaskSpec {
    v1::TaskSpec {
        rules: "fake-v1".into(),
        forward_m: 0.25,
        turn_deg: 30,
        step_s: 0.25,
        max_steps: 100,
        width: SIDE,
        height: SIDE,
        hfov_rad: 1.5,
        depth_max_m: 10.0,
        depth_divisor: 10.0,
        sample_rate_hz: 16_000,
        audio_samples: SAMPLES,
        samples_per_step: SAMPLES,
        success_radius_m: 2.0,
        pose_frame: v1::PoseFrame::Start as i32,
        ..v1::TaskSpec::default()
    }
}

fn spec(id: u32, kind: v1::SensorKind, dtype: v1::Dtype, shape: Vec<u32>) -> v1::TensorSpec {
    v1::TensorSpec {
        id,
        name: kind.as_str_name().into(),
        kind: kind as i32,
        dtype: dtype as i32,
        shape,
        encoding: v1::Encoding::Raw as i32,
        minimum: 0.0,
        maximum: 1.0,
    }
}

fn mission() -> v1::Mission {
    let goal = |cue| v1::Goal { cue: Some(cue) };
    let goals = vec![
        goal(v1::goal::Cue::Category("chair".into())),
        goal(v1::goal::Cue::Description("the lamp beside the bed".into())),
    ];
    v1::Mission { order: v1::Order::Unordered as i32, goals }
}

/// Colour counts the step, depth is 0.5 before division, the left ear contains the step and the right ear its
/// negative.
pub fn observation(slot: u32, episode: &str, step: u32) -> v1::Observation {
    let pixels = (SIDE * SIDE) as usize;
    let floats = |values: Vec<f32>| values.into_iter().flat_map(f32::to_le_bytes).collect::<Vec<u8>>();
    let ear = |sign: f32| vec![sign * step as f32; SAMPLES as usize];
    let tensors = vec![
        tensor(1, v1::Dtype::U8, vec![SIDE, SIDE, 3], vec![step as u8; pixels * 3]),
        tensor(2, v1::Dtype::F32, vec![SIDE, SIDE], floats(vec![0.5; pixels])),
        tensor(3, v1::Dtype::F32, vec![2, SAMPLES], floats([ear(1.0), ear(-1.0)].concat())),
    ];
    v1::Observation {
        slot,
        episode: episode.into(),
        step,
        tensors,
        pose: Some(v1::Pose { x_m: 0.0, y_m: 0.0, z_m: -0.25 * step as f32, heading_rad: 0.0 }),
        remaining_steps: 100 - step,
        remaining_submits: 1,
        time: Some(v1::TimeAccount { step_ms: 5000, bank_ms: 60_000 }),
        ..v1::Observation::default()
    }
}

fn tensor(id: u32, dtype: v1::Dtype, shape: Vec<u32>, data: Vec<u8>) -> v1::Tensor {
    v1::Tensor { id, dtype: dtype as i32, shape, encoding: v1::Encoding::Raw as i32, data: data.into() }
}

fn metric(name: &str, value: f64) -> v1::Metric {
    v1::Metric { name: name.into(), value, low: None, high: None, n: 1 }
}

fn progress(done: u32) -> v1::RunProgress {
    v1::RunProgress { total: 2, done, in_flight: 0, eta_s: None }
}

/// A status with a reason, as the server sends it.
pub fn refusal(code: Code, reason: v1::Reason) -> Status {
    let mut status = Status::new(code, format!("told {}", reason.word()));
    status.metadata_mut().insert(REASON_KEY, reason.word().parse().unwrap());
    status
}

fn check_token<T>(request: &Request<T>, token: &str) -> Result<(), Status> {
    let sent = request.metadata().get("authorization").and_then(|value| value.to_str().ok());
    match sent {
        Some(sent) if sent == format!("Bearer {token}") => Ok(()),
        _ => Err(refusal(Code::Unauthenticated, v1::Reason::TokenMalformed)),
    }
}

#[derive(Clone)]
struct Fake(Script);

type Answer<T> = Result<Response<T>, Status>;

#[tonic::async_trait]
impl info::InfoService for Fake {
    async fn get_server_info(
        &self,
        _: Request<v1::GetServerInfoRequest>,
    ) -> Answer<v1::GetServerInfoResponse> {
        let name = "fake".into();
        Ok(Response::new(v1::GetServerInfoResponse { name, ..v1::GetServerInfoResponse::default() }))
    }

    async fn list_phases(&self, _: Request<v1::ListPhasesRequest>) -> Answer<v1::ListPhasesResponse> {
        let phase = v1::Phase {
            id: "practice".into(),
            orders: vec![v1::Order::Ordered as i32, v1::Order::Unordered as i32],
            episodes: 2,
            state: v1::PhaseState::Open as i32,
            ..v1::Phase::default()
        };
        Ok(Response::new(v1::ListPhasesResponse { phases: vec![phase] }))
    }
}

fn run(id: &str) -> v1::Run {
    let state = v1::RunState::Running as i32;
    v1::Run { id: id.into(), state, progress: Some(progress(0)), ..v1::Run::default() }
}

#[tonic::async_trait]
impl runs::RunService for Fake {
    type WatchRunStream = ReceiverStream<Result<v1::WatchRunResponse, Status>>;

    async fn start_run(&self, request: Request<v1::StartRunRequest>) -> Answer<v1::StartRunResponse> {
        check_token(&request, TOKEN)?;
        match request.get_ref().phase.as_str() {
            "practice" => {}
            _ => return Err(refusal(Code::NotFound, v1::Reason::PhaseUnknown)),
        }
        let run_token = RUN_TOKEN.into();
        let answer =
            v1::StartRunResponse { run: Some(run("run_1")), run_token, max_slots: 2, ..Default::default() };
        Ok(Response::new(answer))
    }

    async fn get_run(&self, request: Request<v1::GetRunRequest>) -> Answer<v1::GetRunResponse> {
        check_token(&request, TOKEN)?;
        Ok(Response::new(v1::GetRunResponse { run: Some(run(&request.get_ref().run)) }))
    }

    async fn watch_run(&self, request: Request<v1::WatchRunRequest>) -> Answer<Self::WatchRunStream> {
        check_token(&request, TOKEN)?;
        let (sender, receiver) = mpsc::channel(2);
        for state in [v1::RunState::Running, v1::RunState::Completed] {
            let run = v1::Run { state: state as i32, ..run("run_1") };
            let _ = sender.send(Ok(v1::WatchRunResponse { run: Some(run) })).await;
        }
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn cancel_run(&self, request: Request<v1::CancelRunRequest>) -> Answer<v1::CancelRunResponse> {
        check_token(&request, TOKEN)?;
        let run = v1::Run { state: v1::RunState::Cancelled as i32, ..run(&request.get_ref().run) };
        Ok(Response::new(v1::CancelRunResponse { run: Some(run) }))
    }

    /// Two pages with a run each.
    async fn list_runs(&self, request: Request<v1::ListRunsRequest>) -> Answer<v1::ListRunsResponse> {
        check_token(&request, TOKEN)?;
        let first = request.get_ref().page_token.is_empty();
        let (id, next) = if first { ("run_2", "more") } else { ("run_1", "") };
        Ok(Response::new(v1::ListRunsResponse { runs: vec![run(id)], next_page_token: next.into() }))
    }

    async fn get_quota(&self, request: Request<v1::GetQuotaRequest>) -> Answer<v1::GetQuotaResponse> {
        check_token(&request, TOKEN)?;
        let window = v1::QuotaWindow::Day as i32;
        let quota = v1::Quota { phase: "practice".into(), window, used: 3, ..v1::Quota::default() };
        Ok(Response::new(v1::GetQuotaResponse { quotas: vec![quota] }))
    }

    async fn who_am_i(&self, request: Request<v1::WhoAmIRequest>) -> Answer<v1::WhoAmIResponse> {
        check_token(&request, TOKEN)?;
        Ok(Response::new(v1::WhoAmIResponse { team: "red".into(), ..v1::WhoAmIResponse::default() }))
    }
}

#[tonic::async_trait]
impl play::PlayService for Fake {
    type PlayStream = ReceiverStream<Result<v1::PlayResponse, Status>>;

    async fn play(&self, request: Request<Streaming<v1::PlayRequest>>) -> Answer<Self::PlayStream> {
        check_token(&request, RUN_TOKEN)?;
        let (told, receiver) = mpsc::channel(16);
        tokio::spawn((self.0)(Stage { asked: request.into_inner(), told }));
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn reset(&self, _: Request<v1::ResetRequest>) -> Answer<v1::ResetResponse> {
        Err(refusal(Code::Unimplemented, v1::Reason::Unsupported))
    }

    async fn step(&self, _: Request<v1::StepRequest>) -> Answer<v1::StepResponse> {
        Err(refusal(Code::Unimplemented, v1::Reason::Unsupported))
    }

    async fn end(&self, _: Request<v1::EndRequest>) -> Answer<v1::EndResponse> {
        Err(refusal(Code::Unimplemented, v1::Reason::Unsupported))
    }
}
