//! Unary calls: a session with a single slot, found by the run token.

use crate::{
    attachment::{CallTimes, StopReason, UnaryClient},
    context::{RunGuard, ServiceContext, bearer},
    host::{Host, OpenRun},
    refusal::{Failure, Refusal, Result},
    session::{Session, SlotReply, SlotRequest},
};
use avln_challenge::RunState;
use avln_proto::v1::{self, Reason, end_request, end_response, reset_response::Outcome};
use std::sync::Arc;
use tokio::{sync::watch, time::Instant};
use tonic::metadata::MetadataMap;
use tracing::Instrument;

const SLOT: u32 = 0;

type Client<H> = UnaryClient<Session<H>>;

pub(crate) struct UnaryCall<'a, H: Host> {
    context: &'a Arc<ServiceContext<H>>,
    token: String,
}

impl<'a, H: Host> UnaryCall<'a, H> {
    pub(crate) fn new(context: &'a Arc<ServiceContext<H>>, metadata: &MetadataMap) -> Result<Self, Refusal> {
        Ok(Self { context, token: bearer(metadata)? })
    }

    /// Handles Reset. A run that is over is answered with its end, also repeatedly: a caller may have missed it.
    pub(crate) async fn reset(&self, request: v1::ResetRequest) -> Result<v1::ResetResponse> {
        match self.try_reset(request).await {
            Err(refused) if refused.reason == Reason::RunOver => self.report_end(refused).await,
            answer => answer,
        }
    }

    async fn report_end(&self, refused: Failure) -> Result<v1::ResetResponse> {
        let run = self.context.any_run(&self.token).await?;
        // The organiser may have extended the deadline since.
        if run.over.is_none() {
            return Err(refused);
        }
        let outcome = Outcome::RunEnd(self.leave(&run).await?);
        Ok(v1::ResetResponse { welcome: None, outcome: Some(outcome) })
    }

    /// Handles Reset in an open run: Hello and Ready in a single call.
    async fn try_reset(&self, request: v1::ResetRequest) -> Result<v1::ResetResponse> {
        self.context.registry.check_open()?;
        let hello = request.hello.unwrap_or_default();
        check_slot(request.ready.unwrap_or_default().slot)?;
        let client = match self.context.registry.unary_client(&self.token) {
            Some(client) => {
                let (_, agreement) = self.context.check(&self.token, &hello).await?;
                client.session.check_sensors(&agreement.sensors)?;
                client
            }
            None => self.open(&hello).await?,
        };
        let request = if hello.resume { SlotRequest::Resume } else { SlotRequest::Ready };
        let outcome = match self.send(&client, request).await? {
            SlotReply::Start(start) => Outcome::EpisodeStart(*start),
            SlotReply::NothingYet => {
                let message = "the run's open episodes use its memory; call Reset again when one has ended";
                return Err(Failure::new(Reason::NoCapacity, message));
            }
            // Never abandons the run: an episode lost by the server may return to it.
            _ => Outcome::RunEnd(self.stop(&client.welcome.run, StopReason::NothingLeft).await?),
        };
        Ok(v1::ResetResponse { welcome: Some(client.welcome.clone()), outcome: Some(outcome) })
    }

    pub(crate) async fn step(&self, request: v1::StepRequest) -> Result<v1::StepResponse> {
        let act = request.act.ok_or_else(|| Failure::new(Reason::BadRequest, "Step needs an Act"))?;
        check_slot(act.slot)?;
        let client = self.find().await?;
        match self.send(&client, SlotRequest::Act(act)).await? {
            SlotReply::Step(response) => Ok(*response),
            other => Err(unexpected(&other)),
        }
    }

    pub(crate) async fn end(&self, request: v1::EndRequest) -> Result<v1::EndResponse> {
        let frame = match request.frame {
            Some(end_request::Frame::Abandon(abandon)) => {
                check_slot(abandon.slot)?;
                let client = self.find().await?;
                match self.send(&client, SlotRequest::Abandon(abandon)).await? {
                    SlotReply::Ended(end) => end_response::Frame::EpisodeEnd(*end),
                    other => return Err(unexpected(&other)),
                }
            }
            Some(end_request::Frame::Goodbye(goodbye)) if !goodbye.pause => {
                let run = self.context.any_run(&self.token).await?;
                end_response::Frame::RunEnd(self.leave(&run).await?)
            }
            Some(end_request::Frame::Goodbye(_)) => {
                let message = "unary calls do not support pause; send Goodbye without it";
                return Err(Failure::new(Reason::Unsupported, message));
            }
            None => return Err(Failure::new(Reason::BadRequest, "End needs an Abandon or a Goodbye")),
        };
        Ok(v1::EndResponse { frame: Some(frame) })
    }

    /// Opens or resumes a session for unary calls.
    async fn open(&self, hello: &v1::Hello) -> Result<Arc<Client<H>>> {
        let admission = self.context.admit(&self.token, hello, 1).await?;
        let session = admission.session;
        session.attach_unary().await;
        let calls = watch::Sender::new(CallTimes { open: 0, last: Instant::now() });
        // Without positions: the next Reset repeats this welcome, and the episode is in the answer itself.
        let welcome = v1::Welcome { resumed: vec![], ..admission.welcome };
        let client = Arc::new(UnaryClient { session, welcome, calls });
        admission.guard.attach_unary(&self.token, client.clone());
        let span = client.session.span();
        tokio::spawn(supervise(self.context.clone(), client.clone(), admission.guard).instrument(span));
        Ok(client)
    }

    async fn send(&self, client: &Client<H>, request: SlotRequest) -> Result<SlotReply> {
        let in_progress = client.begin_call();
        let reply = client.session.call(SLOT, request).await;
        drop(in_progress);
        // After a server stop, the caller must learn of the stop and not of the session's end.
        reply.map_err(|failure| self.context.registry.check_open().err().map_or(failure, Failure::from))
    }

    async fn find(&self) -> Result<Arc<Client<H>>> {
        if let Some(client) = self.context.registry.unary_client(&self.token) {
            return Ok(client);
        }
        self.context.registry.check_open()?;
        // The host is asked only for the reason: a bad token or a finished run is a better answer than a missing episode.
        let run = self.context.open_run(&self.token).await?.run;
        let message = format!(
            "run {run} has no open episode here; call Reset first, with resume in its Hello to continue"
        );
        Err(Failure::new(Reason::EpisodeUnknown, message))
    }

    /// Ends the run of a caller that leaves; a run that is over keeps its state.
    async fn leave(&self, run: &OpenRun) -> Result<v1::RunEnd> {
        let reason = match run.over {
            Some(RunState::Expired) => StopReason::Expired,
            _ => StopReason::Goodbye,
        };
        self.stop(&run.run, reason).await
    }

    /// Ends the run's session and then the run.
    async fn stop(&self, run: &str, reason: StopReason) -> Result<v1::RunEnd> {
        self.context.registry.stop(run, reason).await;
        self.context.finish_run(run, reason.abandons_run()).await
    }
}

async fn supervise<H: Host>(context: Arc<ServiceContext<H>>, client: Arc<Client<H>>, mut guard: RunGuard<H>) {
    let reason = tokio::select! {
        biased;
        reason = guard.stopped() => reason,
        reason = client.session.over() => reason,
        () = client.idle(context.limits.unary_idle) => StopReason::Idle,
    };
    let reason = guard.ends(reason);
    if let Err(failure) = context.end(client.session.clone(), guard, reason).await {
        tracing::warn!(why = failure.message, "run not finished");
    }
}

fn check_slot(slot: u32) -> Result<()> {
    if slot == SLOT {
        return Ok(());
    }
    let message = format!("slot {slot} does not exist: unary calls play slot {SLOT}; use Play for more");
    Err(Failure::new(Reason::SlotUnknown, message))
}

fn unexpected(reply: &SlotReply) -> Failure {
    Failure::server("answer a unary call", format!("{reply:?}"))
}
