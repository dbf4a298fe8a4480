//! A test server for clients: it follows the protocol and injects permitted faults.

use crate::checks::Check;
use crate::frames;
use crate::trials::{FAULT_STEP, InjectedFault, NONCE, TrialRun};
use avln_proto::v1::{
    self, info_service_server as info, play_request::Frame as Up, play_response::Frame as Down,
    play_service_server as play, run_service_server as runs,
};
use std::{io, net::SocketAddr, sync::Arc, time::Duration};
use tokio::net::TcpListener;
use tokio::sync::{Mutex, mpsc, watch};
use tokio::time::{sleep, timeout};
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::{Request, Response, Status, Streaming, transport::Server};

const CLIENT_TIMEOUT: Duration = Duration::from_secs(60);
const OBSERVATION_DELAY: Duration = Duration::from_secs(3);
const REFUSED_STREAMS: u32 = 3;
const QUEUED_FRAMES: usize = 16;
const FLUSH_TIME: Duration = Duration::from_millis(500);

/// A listening test server.
#[derive(Debug)]
pub struct Host {
    listener: TcpListener,
    /// Listening address.
    pub address: SocketAddr,
}

impl Host {
    /// Listens at `address`, or a free port for port 0; fails if the address is unavailable.
    pub async fn bind(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address })
    }

    /// Hosts a run for the first client and returns the trial results; waits a minute for every later frame.
    pub async fn check(self) -> Vec<Check> {
        let (frame_counter, mut frames_seen) = watch::channel(0_u64);
        let run = Arc::new(Mutex::new(TrialRun::default()));
        let fake = Fake { run: run.clone(), frame_counter: Arc::new(frame_counter) };
        let server = Server::builder()
            .add_service(info::InfoServiceServer::new(fake.clone()))
            .add_service(runs::RunServiceServer::new(fake.clone()))
            .add_service(play::PlayServiceServer::new(fake))
            .serve_with_incoming(TcpListenerStream::new(self.listener));
        let serving = tokio::spawn(server);
        let _ = frames_seen.changed().await;
        let mut late = None;
        // The limit applies to every frame: a client may think longer than that about a whole run.
        while !run.lock().await.is_over && late.is_none() {
            if timeout(CLIENT_TIMEOUT, frames_seen.changed()).await.is_err() {
                late = Some(format!("no frame from the client within {} s", CLIENT_TIMEOUT.as_secs()));
            }
        }
        // RunEnd may still be in the send queue, and abort would discard it.
        sleep(FLUSH_TIME).await;
        serving.abort();
        run.lock().await.checks(late)
    }
}

#[derive(Clone)]
struct Fake {
    run: Arc<Mutex<TrialRun>>,
    frame_counter: Arc<watch::Sender<u64>>,
}

impl Fake {
    fn count_frame(&self) {
        self.frame_counter.send_modify(|frames_seen| *frames_seen += 1);
    }

    fn run_status(&self) -> v1::Run {
        v1::Run { id: frames::RUN.to_owned(), state: v1::RunState::Running.into(), ..v1::Run::default() }
    }
}

/// The end of a stream, with a status or without.
struct StreamEnd(Option<Status>);

struct Conversation {
    fake: Fake,
    requests: Streaming<v1::PlayRequest>,
    responses: mpsc::Sender<Result<v1::PlayResponse, Status>>,
}

impl Conversation {
    async fn hold(mut self) {
        if let Err(StreamEnd(Some(status))) = self.converse().await {
            let _ = self.responses.send(Err(status)).await;
        }
    }

    async fn send(&self, frame: Down) {
        let _ = self.responses.send(Ok(v1::PlayResponse { frame: Some(frame) })).await;
    }

    async fn receive(&mut self) -> Result<Up, StreamEnd> {
        let received = self.requests.message().await;
        self.fake.count_frame();
        let request = received.ok().flatten().ok_or(StreamEnd(None))?;
        request.frame.ok_or_else(|| StreamEnd(Some(Status::invalid_argument("the frame has no message"))))
    }

    async fn converse(&mut self) -> Result<(), StreamEnd> {
        let Up::Hello(hello) = self.receive().await? else {
            self.fake.run.lock().await.violation("first frame: expected Hello");
            return Err(StreamEnd(Some(Status::invalid_argument("the first frame must be Hello"))));
        };
        self.greet(&hello).await;
        loop {
            match self.receive().await? {
                Up::Ready(ready) => self.ready(ready).await?,
                Up::Act(act) => self.act(&act).await?,
                Up::Pong(pong) => self.fake.run.lock().await.pong(pong.nonce),
                Up::Abandon(_) => self.abandon().await,
                Up::Goodbye(_) => return self.end_run().await,
                Up::Hello(_) => {
                    self.fake.run.lock().await.violation("the client sent a second Hello in a stream")
                }
            }
        }
    }

    /// Sends Welcome and the missed frames.
    async fn greet(&self, hello: &v1::Hello) {
        let mut run = self.fake.run.lock().await;
        run.hello(hello);
        self.send(Down::Welcome(frames::welcome(&run))).await;
        let Some(open) = run.open.clone() else { return };
        match (open.over, open.sent_step) {
            (Some(reason), _) => {
                self.send(Down::EpisodeEnd(frames::end(&run, &open, reason))).await;
                run.close();
            }
            (None, Some(_)) => self.send(Down::Observation(frames::observation(&run, &open))).await,
            (None, None) => self.send(Down::EpisodeStart(frames::start(&run, &open))).await,
        }
        run.observation_sent();
    }

    async fn ready(&self, ready: v1::Ready) -> Result<(), StreamEnd> {
        let mut run = self.fake.run.lock().await;
        if ready.slot != 0 || run.open.is_some() {
            run.violation(format!("Ready for slot {}: the slot is busy or does not exist", ready.slot));
            let fault = frames::fault(run.open.as_ref(), v1::Reason::SlotBusy, true);
            self.send(Down::Fault(fault)).await;
            return Ok(());
        }
        if !run.has_next() {
            drop(run);
            return self.end_run().await;
        }
        run.begin();
        if run.fault() == InjectedFault::LostStart && run.inject_at(0) {
            return Err(lost(&mut run));
        }
        let Some(open) = run.open.clone() else { return Ok(()) };
        self.send(Down::EpisodeStart(frames::start(&run, &open))).await;
        run.observation_sent();
        Ok(())
    }

    async fn act(&self, act: &v1::Act) -> Result<(), StreamEnd> {
        let mut run = self.fake.run.lock().await;
        if let Err(reason) = run.act(act) {
            let fault = v1::Fault { step: act.step, ..frames::fault(run.open.as_ref(), reason, true) };
            self.send(Down::Fault(fault)).await;
            return Ok(());
        }
        let fault = run.fault();
        let is_due = run.inject_at(FAULT_STEP);
        if is_due {
            self.before_observation(&mut run, fault).await?;
        }
        let Some(open) = run.open.clone() else { return Ok(()) };
        self.send(Down::Observation(frames::observation(&run, &open))).await;
        run.observation_sent();
        if is_due {
            after_observation(&mut run, fault)?;
        }
        if let Some(reason) = open.over {
            if fault == InjectedFault::LostEnd {
                return Err(lost(&mut run));
            }
            self.send(Down::EpisodeEnd(frames::end(&run, &open, reason))).await;
            run.close();
        }
        Ok(())
    }

    async fn before_observation(&self, run: &mut TrialRun, fault: InjectedFault) -> Result<(), StreamEnd> {
        match fault {
            InjectedFault::NoticeAndPing => {
                let message = "notice of the conformance kit".to_owned();
                self.send(Down::Notice(v1::Notice { message, ..v1::Notice::default() })).await;
                self.send(Down::Ping(v1::Ping { nonce: NONCE, ..v1::Ping::default() })).await;
                run.ping_sent();
            }
            // A newer frame reaches an older client as a message without a frame.
            InjectedFault::UnknownFrame => {
                drop(self.responses.send(Ok(v1::PlayResponse { frame: None })).await)
            }
            InjectedFault::LateObservation => sleep(OBSERVATION_DELAY).await,
            InjectedFault::LostObservation => return Err(lost(run)),
            InjectedFault::SimulatorFault => {
                let Some(open) = run.open.clone() else { return Ok(()) };
                self.send(Down::Fault(frames::fault(Some(&open), v1::Reason::SimFault, false))).await;
                let end = frames::end(run, &open, v1::EndReason::ServerFault);
                self.send(Down::EpisodeEnd(end)).await;
                run.close();
            }
            _ => {}
        }
        Ok(())
    }

    async fn abandon(&self) {
        let mut run = self.fake.run.lock().await;
        run.violation("the client abandoned the episode");
        let Some(open) = run.open.clone() else { return };
        self.send(Down::EpisodeEnd(frames::end(&run, &open, v1::EndReason::Abandoned))).await;
        run.close();
    }

    async fn end_run(&self) -> Result<(), StreamEnd> {
        let mut run = self.fake.run.lock().await;
        self.send(Down::RunEnd(frames::run_end(&run))).await;
        run.is_over = true;
        self.fake.count_frame();
        Err(StreamEnd(None))
    }
}

fn after_observation(run: &mut TrialRun, fault: InjectedFault) -> Result<(), StreamEnd> {
    match fault {
        InjectedFault::BrokenStream => Err(lost(run)),
        InjectedFault::Unreachable => {
            run.refuse = REFUSED_STREAMS;
            Err(lost(run))
        }
        InjectedFault::SilentEnd => {
            run.lose_stream();
            Err(StreamEnd(None))
        }
        _ => Ok(()),
    }
}

fn lost(run: &mut TrialRun) -> StreamEnd {
    run.lose_stream();
    StreamEnd(Some(Status::unavailable("the conformance kit closed the stream")))
}

type Answer<T> = Result<Response<T>, Status>;

fn unimplemented<T>(call: &str) -> Answer<T> {
    Err(Status::unimplemented(format!("the conformance kit does not implement {call}")))
}

#[tonic::async_trait]
impl info::InfoService for Fake {
    async fn get_server_info(
        &self,
        _: Request<v1::GetServerInfoRequest>,
    ) -> Answer<v1::GetServerInfoResponse> {
        let answer = v1::GetServerInfoResponse {
            name: "avln-conformance".to_owned(),
            api_minor: avln_proto::API_MINOR,
            ..v1::GetServerInfoResponse::default()
        };
        Ok(Response::new(answer))
    }

    async fn list_phases(&self, _: Request<v1::ListPhasesRequest>) -> Answer<v1::ListPhasesResponse> {
        Ok(Response::new(v1::ListPhasesResponse { phases: Vec::new() }))
    }
}

#[tonic::async_trait]
impl runs::RunService for Fake {
    type WatchRunStream = ReceiverStream<Result<v1::WatchRunResponse, Status>>;

    async fn start_run(&self, _: Request<v1::StartRunRequest>) -> Answer<v1::StartRunResponse> {
        self.count_frame();
        Ok(Response::new(v1::StartRunResponse {
            run: Some(self.run_status()),
            run_token: "avln_run_conformance".to_owned(),
            max_slots: 1,
            ..v1::StartRunResponse::default()
        }))
    }

    async fn get_run(&self, _: Request<v1::GetRunRequest>) -> Answer<v1::GetRunResponse> {
        Ok(Response::new(v1::GetRunResponse { run: Some(self.run_status()) }))
    }

    async fn watch_run(&self, _: Request<v1::WatchRunRequest>) -> Answer<Self::WatchRunStream> {
        unimplemented("WatchRun")
    }

    async fn cancel_run(&self, _: Request<v1::CancelRunRequest>) -> Answer<v1::CancelRunResponse> {
        let mut run = self.run.lock().await;
        run.violation("the client cancelled the run");
        run.is_over = true;
        self.count_frame();
        Ok(Response::new(v1::CancelRunResponse { run: Some(self.run_status()) }))
    }

    async fn list_runs(&self, _: Request<v1::ListRunsRequest>) -> Answer<v1::ListRunsResponse> {
        Ok(Response::new(v1::ListRunsResponse::default()))
    }

    async fn get_quota(&self, _: Request<v1::GetQuotaRequest>) -> Answer<v1::GetQuotaResponse> {
        Ok(Response::new(v1::GetQuotaResponse::default()))
    }

    async fn who_am_i(&self, _: Request<v1::WhoAmIRequest>) -> Answer<v1::WhoAmIResponse> {
        Ok(Response::new(v1::WhoAmIResponse { team: "checked".to_owned(), ..v1::WhoAmIResponse::default() }))
    }
}

#[tonic::async_trait]
impl play::PlayService for Fake {
    type PlayStream = ReceiverStream<Result<v1::PlayResponse, Status>>;

    async fn play(&self, request: Request<Streaming<v1::PlayRequest>>) -> Answer<Self::PlayStream> {
        self.count_frame();
        let mut run = self.run.lock().await;
        if run.refuse > 0 {
            run.refuse -= 1;
            return Err(Status::unavailable("the conformance kit refuses this stream"));
        }
        drop(run);
        let (responses, receiver) = mpsc::channel(QUEUED_FRAMES);
        tokio::spawn(Conversation { fake: self.clone(), requests: request.into_inner(), responses }.hold());
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn reset(&self, _: Request<v1::ResetRequest>) -> Answer<v1::ResetResponse> {
        unimplemented("unary mirror")
    }

    async fn step(&self, _: Request<v1::StepRequest>) -> Answer<v1::StepResponse> {
        unimplemented("unary mirror")
    }

    async fn end(&self, _: Request<v1::EndRequest>) -> Answer<v1::EndResponse> {
        unimplemented("unary mirror")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Outcome,
        talk::{Connection, Site, hello},
    };

    #[tokio::test]
    async fn a_client_that_breaks_rules_is_found_out() {
        let host = Host::bind("127.0.0.1:0".parse().unwrap()).await.unwrap();
        let url = format!("http://{}", host.address);
        let checking = tokio::spawn(host.check());
        let server = Connection::open(&Site { server: &url, ca: None }, "any", "any").await.unwrap();
        let (mut stream, _) = server.enter(hello()).await.unwrap();
        let episode = stream.start().await.unwrap().episode;
        stream.act(&episode, 5, 1).await;
        stream.refusal(v1::Reason::StepAhead).await.unwrap();
        stream.act(&episode, 1, 1).await;
        stream.observation().await.unwrap();
        stream.act(&episode, 1, 2).await;
        stream.refusal(v1::Reason::StepConflict).await.unwrap();
        drop(stream);
        let (stream, _) = server.enter(hello()).await.unwrap();
        stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
        let checks = checking.await.unwrap();
        let Outcome::Broken(first) = &checks[0].outcome else { panic!("{checks:?}") };
        for what in
            ["step: expected 1, got 5", "resent action of step 1: expected 1, got 2", "left an intact stream"]
        {
            assert!(first.contains(what), "{first}");
        }
        let unreached = checks[1..].iter().all(
            |check| matches!(&check.outcome, Outcome::Broken(why) if why == "the client did not reach this episode"),
        );
        assert!(unreached, "{checks:?}");
    }
}
