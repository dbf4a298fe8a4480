//! A test server for clients: it follows the protocol and injects permitted faults.

use crate::{
    Check,
    book::{Book, NONCE, TRICKED_STEP},
    frames,
    trials::Trick,
};
use avln_proto::v1::{
    self, info_service_server as info, play_request::Frame as Up, play_response::Frame as Down,
    play_service_server as play, run_service_server as runs,
};
use std::{io, net::SocketAddr, sync::Arc, time::Duration};
use tokio::{
    net::TcpListener,
    sync::{Mutex, mpsc, watch},
    time::{sleep, timeout},
};
use tokio_stream::wrappers::{ReceiverStream, TcpListenerStream};
use tonic::{Request, Response, Status, Streaming, transport::Server};

/// Longest client silence.
const PATIENCE: Duration = Duration::from_secs(60);
/// Late observation delay.
const LATE: Duration = Duration::from_secs(3);
/// Refused streams while the server is unreachable.
const REFUSED: u32 = 3;
/// Frames that wait to be sent.
const WAITING_FRAMES: usize = 16;
/// Time for the last frames to leave.
const FAREWELL: Duration = Duration::from_millis(500);

/// A listening test server.
#[derive(Debug)]
pub struct Host {
    listener: TcpListener,
    /// Listening address.
    pub address: SocketAddr,
}

impl Host {
    /// Listens at `address`; port 0 selects a free port.
    ///
    /// # Errors
    /// If the address is unavailable.
    pub async fn bind(address: SocketAddr) -> io::Result<Self> {
        let listener = TcpListener::bind(address).await?;
        let address = listener.local_addr()?;
        Ok(Self { listener, address })
    }

    /// Hosts a run for the first client, with any token and phase, and returns the results of all trials.
    /// Waits for the client without limit, then a minute per answer.
    pub async fn check(self) -> Vec<Check> {
        let (beat, mut beats) = watch::channel(0_u64);
        let book = Arc::new(Mutex::new(Book::default()));
        let fake = Fake { book: book.clone(), beat: Arc::new(beat) };
        let server = Server::builder()
            .add_service(info::InfoServiceServer::new(fake.clone()))
            .add_service(runs::RunServiceServer::new(fake.clone()))
            .add_service(play::PlayServiceServer::new(fake))
            .serve_with_incoming(TcpListenerStream::new(self.listener));
        let serving = tokio::spawn(server);
        let _ = beats.changed().await;
        let mut late = None;
        while !book.lock().await.is_over && late.is_none() {
            if timeout(PATIENCE, beats.changed()).await.is_err() {
                late = Some(format!("nothing came from the client for {} s", PATIENCE.as_secs()));
            }
        }
        sleep(FAREWELL).await;
        serving.abort();
        book.lock().await.checks(late)
    }
}

#[derive(Clone)]
struct Fake {
    book: Arc<Mutex<Book>>,
    /// Changes with every client frame.
    beat: Arc<watch::Sender<u64>>,
}

impl Fake {
    fn heard(&self) {
        self.beat.send_modify(|beats| *beats += 1);
    }

    fn run(&self) -> v1::Run {
        v1::Run { id: frames::RUN.to_owned(), state: v1::RunState::Running.into(), ..v1::Run::default() }
    }
}

/// Continue with the stream, or stop.
type Goes = Result<(), Gone>;

/// The stream is over: with a status, or without.
struct Gone(Option<Status>);

/// A stream.
struct Stage {
    fake: Fake,
    asked: Streaming<v1::PlayRequest>,
    told: mpsc::Sender<Result<v1::PlayResponse, Status>>,
}

impl Stage {
    async fn run(mut self) {
        if let Err(Gone(Some(status))) = self.converse().await {
            let _ = self.told.send(Err(status)).await;
        }
    }

    async fn tell(&self, frame: Down) {
        let _ = self.told.send(Ok(v1::PlayResponse { frame: Some(frame) })).await;
    }

    async fn hear(&mut self) -> Result<Up, Gone> {
        let heard = self.asked.message().await;
        self.fake.heard();
        let request = heard.ok().flatten().ok_or(Gone(None))?;
        request.frame.ok_or_else(|| Gone(Some(Status::invalid_argument("a frame without a message"))))
    }

    async fn converse(&mut self) -> Goes {
        let Up::Hello(hello) = self.hear().await? else {
            self.fake.book.lock().await.wrong("the first frame of a stream is not Hello");
            return Err(Gone(Some(Status::invalid_argument("the first frame must be Hello"))));
        };
        self.greet(&hello).await;
        loop {
            match self.hear().await? {
                Up::Ready(ready) => self.ready(ready).await?,
                Up::Act(act) => self.act(&act).await?,
                Up::Pong(pong) => self.fake.book.lock().await.pong(pong.nonce),
                Up::Abandon(_) => self.abandon().await,
                Up::Goodbye(_) => return self.end_run().await,
                Up::Hello(_) => self.fake.book.lock().await.wrong("a second Hello came on one stream"),
            }
        }
    }

    /// Sends Welcome and the missed frames.
    async fn greet(&self, hello: &v1::Hello) {
        let mut book = self.fake.book.lock().await;
        book.hello(hello);
        self.tell(Down::Welcome(frames::welcome(&book))).await;
        let Some(open) = book.open.clone() else { return };
        match (open.over, open.told) {
            (Some(reason), _) => {
                self.tell(Down::EpisodeEnd(frames::end(&book, &open, reason))).await;
                book.close();
            }
            (None, Some(_)) => self.tell(Down::Observation(frames::observation(&book, &open))).await,
            (None, None) => self.tell(Down::EpisodeStart(frames::start(&book, &open))).await,
        }
        told(&mut book);
    }

    async fn ready(&self, ready: v1::Ready) -> Goes {
        let mut book = self.fake.book.lock().await;
        if ready.slot != 0 || book.open.is_some() {
            book.wrong(format!("Ready for slot {}, which is no idle slot", ready.slot));
            let fault = frames::fault(book.open.as_ref(), v1::Reason::SlotBusy, true);
            self.tell(Down::Fault(fault)).await;
            return Ok(());
        }
        if !book.has_next() {
            drop(book);
            return self.end_run().await;
        }
        book.begin();
        if book.trick() == Trick::LoseStart && book.tricks(0) {
            return Err(lost(&mut book));
        }
        let Some(open) = book.open.clone() else { return Ok(()) };
        self.tell(Down::EpisodeStart(frames::start(&book, &open))).await;
        told(&mut book);
        Ok(())
    }

    async fn act(&self, act: &v1::Act) -> Goes {
        let mut book = self.fake.book.lock().await;
        if let Err(reason) = book.act(act) {
            let fault = v1::Fault { step: act.step, ..frames::fault(book.open.as_ref(), reason, true) };
            self.tell(Down::Fault(fault)).await;
            return Ok(());
        }
        let trick = book.trick();
        let is_due = book.tricks(TRICKED_STEP);
        if is_due {
            self.before_observation(&mut book, trick).await?;
        }
        let Some(open) = book.open.clone() else { return Ok(()) };
        self.tell(Down::Observation(frames::observation(&book, &open))).await;
        told(&mut book);
        if is_due {
            after_observation(&mut book, trick)?;
        }
        if let Some(reason) = open.over {
            if trick == Trick::LoseEnd {
                return Err(lost(&mut book));
            }
            self.tell(Down::EpisodeEnd(frames::end(&book, &open, reason))).await;
            book.close();
        }
        Ok(())
    }

    async fn before_observation(&self, book: &mut Book, trick: Trick) -> Goes {
        match trick {
            Trick::Interrupt => {
                let message = "the conformance kit has nothing to announce".to_owned();
                self.tell(Down::Notice(v1::Notice { message, ..v1::Notice::default() })).await;
                self.tell(Down::Ping(v1::Ping { nonce: NONCE, ..v1::Ping::default() })).await;
                book.ask();
            }
            Trick::Mumble => drop(self.told.send(Ok(v1::PlayResponse { frame: None })).await),
            Trick::Dawdle => sleep(LATE).await,
            Trick::LoseAnswer => return Err(lost(book)),
            Trick::Break => {
                let Some(open) = book.open.clone() else { return Ok(()) };
                let fault = frames::fault(Some(&open), v1::Reason::SimFault, false);
                self.tell(Down::Fault(fault)).await;
                let end = frames::end(book, &open, v1::EndReason::ServerFault);
                self.tell(Down::EpisodeEnd(end)).await;
                book.close();
            }
            _ => {}
        }
        Ok(())
    }

    async fn abandon(&self) {
        let mut book = self.fake.book.lock().await;
        book.wrong("the client gave the episode up");
        let Some(open) = book.open.clone() else { return };
        self.tell(Down::EpisodeEnd(frames::end(&book, &open, v1::EndReason::Abandoned))).await;
        book.close();
    }

    async fn end_run(&self) -> Goes {
        let mut book = self.fake.book.lock().await;
        self.tell(Down::RunEnd(frames::run_end(&book))).await;
        book.is_over = true;
        self.fake.heard();
        Err(Gone(None))
    }
}

fn after_observation(book: &mut Book, trick: Trick) -> Goes {
    match trick {
        Trick::Cut => Err(lost(book)),
        Trick::Leave => {
            book.refuse = REFUSED;
            Err(lost(book))
        }
        Trick::Hush => {
            book.lose();
            Err(Gone(None))
        }
        _ => Ok(()),
    }
}

/// The stream breaks.
fn lost(book: &mut Book) -> Gone {
    book.lose();
    Gone(Some(Status::unavailable("the conformance kit broke the stream")))
}

/// The last observation was sent.
fn told(book: &mut Book) {
    if let Some(open) = &mut book.open {
        open.told = Some(open.step());
    }
}

type Answer<T> = Result<Response<T>, Status>;

fn none<T>(what: &str) -> Answer<T> {
    Err(Status::unimplemented(format!("the server of the conformance kit has no {what}")))
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
        self.heard();
        Ok(Response::new(v1::StartRunResponse {
            run: Some(self.run()),
            run_token: "avln_run_conformance".to_owned(),
            max_slots: 1,
            ..v1::StartRunResponse::default()
        }))
    }

    async fn get_run(&self, _: Request<v1::GetRunRequest>) -> Answer<v1::GetRunResponse> {
        Ok(Response::new(v1::GetRunResponse { run: Some(self.run()) }))
    }

    async fn watch_run(&self, _: Request<v1::WatchRunRequest>) -> Answer<Self::WatchRunStream> {
        none("WatchRun")
    }

    async fn cancel_run(&self, _: Request<v1::CancelRunRequest>) -> Answer<v1::CancelRunResponse> {
        let mut book = self.book.lock().await;
        book.wrong("the client cancelled the run");
        book.is_over = true;
        self.heard();
        Ok(Response::new(v1::CancelRunResponse { run: Some(self.run()) }))
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
        self.heard();
        let mut book = self.book.lock().await;
        if book.refuse > 0 {
            book.refuse -= 1;
            return Err(Status::unavailable("the server of the conformance kit is not there yet"));
        }
        drop(book);
        let (told, receiver) = mpsc::channel(WAITING_FRAMES);
        tokio::spawn(Stage { fake: self.clone(), asked: request.into_inner(), told }.run());
        Ok(Response::new(ReceiverStream::new(receiver)))
    }

    async fn reset(&self, _: Request<v1::ResetRequest>) -> Answer<v1::ResetResponse> {
        none("unary mirror")
    }

    async fn step(&self, _: Request<v1::StepRequest>) -> Answer<v1::StepResponse> {
        none("unary mirror")
    }

    async fn end(&self, _: Request<v1::EndRequest>) -> Answer<v1::EndResponse> {
        none("unary mirror")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        Outcome,
        talk::{Site, Talk, hello},
    };

    #[tokio::test]
    async fn a_client_that_breaks_rules_is_found_out() {
        let host = Host::bind("127.0.0.1:0".parse().unwrap()).await.unwrap();
        let url = format!("http://{}", host.address);
        let checking = tokio::spawn(host.check());
        let talk = Talk::open(&Site { server: &url, ca: None }, "any", "any").await.unwrap();
        let (mut stream, _) = talk.enter(hello()).await.unwrap();
        let episode = stream.start().await.unwrap().episode;
        stream.act(&episode, 5, 1).await;
        stream.refusal(v1::Reason::StepAhead).await.unwrap();
        stream.act(&episode, 1, 1).await;
        stream.observation().await.unwrap();
        stream.act(&episode, 1, 2).await;
        stream.refusal(v1::Reason::StepConflict).await.unwrap();
        drop(stream);
        let (stream, _) = talk.enter(hello()).await.unwrap();
        stream.send(Up::Goodbye(v1::Goodbye { pause: false })).await;
        let checks = checking.await.unwrap();
        let Outcome::Broken(first) = &checks[0].outcome else { panic!("{checks:?}") };
        for what in
            ["step 5 comes after step 0", "step 1 was action 1 and is 2", "left a stream that was not"]
        {
            assert!(first.contains(what), "{first}");
        }
        let far = checks[1..].iter().all(
            |check| matches!(&check.outcome, Outcome::Broken(why) if why == "the client did not come so far"),
        );
        assert!(far, "{checks:?}");
    }
}
