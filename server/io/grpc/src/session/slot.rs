//! Slot: a task that owns an episode at a time.

use super::{
    Hosted, SessionContext, SessionEnding, SlotEnding, WaitingFor,
    playing::{
        Audience, ChessClock, FinishedEpisode, LastStep, OpenEpisode, SlotReply, SlotRequest, not_ahead,
        same_episode,
    },
};
use crate::{
    host::{Acted, Episode, Host, Restored},
    refusal::{Failure, Result, call_host},
    spans::{EpisodeSpan, StepSpan},
    watchdog::CancelToken,
    wire,
};
use avln_episode::{Action, EndReason, Observation};
use avln_proto::v1::{self, Reason};
use avln_referee::StepOutcome;
use prost::Message;
use std::{sync::Arc, time::Duration};
use tokio::sync::{mpsc, oneshot};
use tracing::{Instrument, Span};

pub(super) enum SlotCommand {
    /// Handle a request, and reply to the caller, or to the stream if there is none.
    Handle(SlotRequest, Option<oneshot::Sender<Result<SlotReply>>>),
    Position(oneshot::Sender<Option<v1::SlotPosition>>),
    Switch {
        audience: Audience,
        /// Last frame that the new client received.
        known: Option<v1::SlotPosition>,
        away: Duration,
        /// Receives whether the agent's clock restarted.
        reply: oneshot::Sender<bool>,
    },
}

/// A slot. The task is the episode's only user, so the episode needs no lock.
pub(super) struct Slot<H: Host> {
    pub(super) id: u32,
    pub(super) session: Arc<SessionContext<H>>,
    pub(super) audience: Audience,
    pub(super) state: SlotContent<H::Episode>,
    /// Event before the next request to the host, which had no episode for this slot.
    waiting: Option<WaitingFor>,
    /// Span of the requested or open episode.
    pub(super) episode: Option<EpisodeSpan>,
}

pub(super) enum SlotContent<E> {
    Idle,
    Playing(Box<OpenEpisode<E>>),
    Finished(Box<FinishedEpisode>),
}

impl<H: Host> Slot<H> {
    pub(super) fn new(
        id: u32,
        session: Arc<SessionContext<H>>,
        restored: Option<Restored<H::Episode>>,
    ) -> Self {
        let (audience, state) = (Audience::Nobody, SlotContent::Idle);
        let mut slot = Self { id, session, audience, state, waiting: None, episode: None };
        if let Some(restored) = restored {
            slot.state = SlotContent::Playing(Box::new(slot.restored(restored)));
        }
        slot
    }

    fn restored(&mut self, restored: Restored<H::Episode>) -> OpenEpisode<H::Episode> {
        let Restored { hosted, last: (sensed, action), bank_left, .. } = restored;
        self.session.progress.requested();
        let ordinal = self.session.progress.started();
        let mut span = EpisodeSpan::begin(&self.session.span.span(), self.id);
        span.issued(&hosted.handle, ordinal);
        span.stepped(hosted.episode.steps());
        self.episode = Some(span);
        let clock = ChessClock::new(&self.session.time).with_bank(bank_left);
        // Here and not on a simulation thread: slots are restored once per start of the server.
        let observation = encoded(&self.session, self.id, &hosted, sensed, hosted.episode.end());
        let observation = with_account(observation, &clock);
        let last = LastStep { action: action.map(wire::action_number), observation };
        OpenEpisode { hosted, ordinal, last, clock }
    }

    pub(super) async fn run(mut self, mut commands: mpsc::Receiver<SlotCommand>, ending: Arc<SessionEnding>) {
        self.store_finished().await;
        loop {
            let (session, span) = (self.session.clone(), self.span());
            let refilled = self.waiting().map(|event| session.progress.wait(event));
            tokio::select! {
                // In this order: the end of the session first, and the clock before requests, so that a flood of requests buys
                // no time.
                biased;
                ending = ending.wait_for(|ending| *ending) => return self.end(ending).instrument(span).await,
                () = if_any(self.clock().map(ChessClock::expired)) => {
                    self.cut(EndReason::TimeBudget).instrument(span).await;
                }
                command = commands.recv() => match command {
                    Some(command) => self.serve(command).instrument(span).await,
                    // The session was dropped without an end: the run log is the safe place for open episodes.
                    None => return self.end(SlotEnding::Keep).instrument(span).await,
                },
                () = if_any(refilled) => self.handle(SlotRequest::Ready, None).await,
            }
        }
    }

    /// Returns the span of the open episode, otherwise that of the session.
    fn span(&self) -> Span {
        self.episode.as_ref().map_or_else(|| self.session.span.span(), EpisodeSpan::span)
    }

    /// Stores a restored episode that had ended before the server stopped.
    async fn store_finished(&mut self) {
        if let SlotContent::Playing(playing) = &self.state
            && playing.last.is_last()
            && let SlotContent::Playing(playing) = std::mem::replace(&mut self.state, SlotContent::Idle)
        {
            self.end_with(playing.hosted, playing.last).await;
        }
    }

    async fn end(&mut self, ending: SlotEnding) {
        if let SlotEnding::Close(reason) = ending {
            self.cut(reason).await;
        }
    }

    /// Returns the clock that may expire.
    fn clock(&self) -> Option<ChessClock> {
        match (&self.state, &self.audience) {
            // Without a client, the server cannot know whether the observation arrived and the agent thinks.
            (SlotContent::Playing(_), Audience::Nobody) => None,
            (SlotContent::Playing(playing), _) => Some(playing.clock.clone()),
            _ => None,
        }
    }

    fn waiting(&self) -> Option<WaitingFor> {
        // Only a stream can receive an episode unasked; unary callers repeat Reset.
        self.waiting.filter(|_| matches!(self.audience, Audience::Stream(_)))
    }

    async fn serve(&mut self, command: SlotCommand) {
        match command {
            SlotCommand::Handle(request, reply) => self.handle(request, reply).await,
            SlotCommand::Position(reply) => drop(reply.send(self.position())),
            SlotCommand::Switch { audience, known, away, reply } => {
                self.audience = audience;
                let restarted = self.catch_up(known, away).await;
                let _ = reply.send(restarted);
            }
        }
    }

    fn position(&self) -> Option<v1::SlotPosition> {
        let SlotContent::Playing(playing) = &self.state else { return None };
        let (episode, step) = (playing.hosted.handle.clone(), playing.last.observation.step);
        Some(v1::SlotPosition { slot: self.id, episode, step })
    }

    async fn handle(&mut self, request: SlotRequest, caller: Option<oneshot::Sender<Result<SlotReply>>>) {
        let reply = match &request {
            SlotRequest::Ready => self.begin().await,
            SlotRequest::Resume => self.resume().await,
            SlotRequest::Act(act) => self.act(act).await,
            SlotRequest::Abandon(abandon) => self.abandon(abandon).await,
        };
        match caller {
            Some(caller) => {
                // A caller that hung up receives the same reply to a repeated request.
                drop(caller.send(reply));
                if let SlotContent::Playing(playing) = &mut self.state {
                    playing.clock.handed_over();
                }
            }
            None => self.deliver(request.subject(self.id), reply).await,
        }
    }

    async fn resume(&mut self) -> Result<SlotReply> {
        match &self.state {
            SlotContent::Playing(playing) => {
                Ok(SlotReply::Start(Box::new(playing.start_frame(self.id, &self.session))))
            }
            _ => self.begin().await,
        }
    }

    /// Requests and starts an episode in a span of its own.
    async fn begin(&mut self) -> Result<SlotReply> {
        if let SlotContent::Playing(playing) = &self.state {
            return self.already_playing(playing);
        }
        let episode = EpisodeSpan::begin(&self.session.span.span(), self.id);
        let span = episode.span();
        self.episode = Some(episode);
        let reply = self.request_episode().instrument(span).await;
        if !matches!(self.state, SlotContent::Playing(_)) {
            self.episode = None;
        }
        reply
    }

    /// Requests an episode from the host and starts it.
    async fn request_episode(&mut self) -> Result<SlotReply> {
        let was_parked = matches!(self.waiting.take(), Some(WaitingFor::End { .. }));
        // Before the request: an episode that another slot ends or returns meanwhile must wake this slot.
        let (returned, ended) = self.session.progress.returned_and_ended();
        let is_called = matches!(self.audience, Audience::Callers);
        self.session.progress.requested();
        if was_parked {
            self.session.progress.unparked();
        }
        let run = self.session.run.clone();
        let id = self.id;
        let sensors = self.session.sensors.clone();
        let next = |host: Arc<H>| async move { host.next_episode(&run, id, &sensors).await };
        match call_host("next episode", &self.session.host, next).await {
            Ok(Some(hosted)) => self.start(hosted).await,
            Ok(None) => {
                self.waiting = (!is_called).then_some(WaitingFor::Return { seen: returned });
                self.session.progress.refused(true);
                Ok(SlotReply::NothingLeft)
            }
            // The run's open episodes use its memory.
            Err(failure) if failure.reason == Reason::NoCapacity && !is_called => {
                self.waiting = Some(WaitingFor::End { seen: ended });
                self.session.progress.parked();
                Ok(SlotReply::NothingYet)
            }
            Err(failure) => {
                self.session.progress.refused(false);
                Err(failure)
            }
        }
    }

    fn already_playing(&self, playing: &OpenEpisode<H::Episode>) -> Result<SlotReply> {
        match (&playing.last.action, &self.audience) {
            // A unary Reset may be repeated until the first step, because the reply can be lost. A stream loses no frames.
            (None, Audience::Callers) => {
                Ok(SlotReply::Start(Box::new(playing.start_frame(self.id, &self.session))))
            }
            _ => {
                let message = format!("slot {} plays an episode; end it before the next", self.id);
                Err(Failure::new(Reason::SlotBusy, message))
            }
        }
    }

    async fn start(&mut self, hosted: Hosted<H>) -> Result<SlotReply> {
        let ordinal = self.session.progress.started();
        let handle = hosted.handle.clone();
        let ticket = hosted.ticket;
        if let Some(span) = &self.episode {
            span.issued(&handle, ordinal);
        }
        let simulator = &self.session.simulator;
        let (session, id) = (self.session.clone(), self.id);
        let work = |hosted: &mut Hosted<H>, _: &CancelToken| hosted.episode.start();
        let encode =
            move |hosted: &Hosted<H>, sensed: Observation| encoded(&session, id, hosted, sensed, None);
        let (hosted, first) = match simulator.run(hosted, simulator.longest_start, work, encode).await {
            Ok(started) => started,
            Err(fault) => {
                self.mark_lost(&handle, ticket).await;
                return Err(fault);
            }
        };
        let first = match first {
            Ok(first) => first,
            Err(fault) => return self.failed_to_start(hosted, fault).await,
        };
        let clock = ChessClock::new(&self.session.time);
        let observation = with_account(first, &clock);
        let playing = OpenEpisode { hosted, ordinal, last: LastStep { action: None, observation }, clock };
        let start = playing.start_frame(self.id, &self.session);
        if let Err(fault) = self.check_size(&start) {
            return self.failed_to_start(playing.hosted, fault).await;
        }
        self.report_step(&playing.hosted, 0);
        self.state = SlotContent::Playing(Box::new(playing));
        Ok(SlotReply::Start(Box::new(start)))
    }

    fn check_size(&self, start: &v1::EpisodeStart) -> Result<()> {
        let bytes = start.encoded_len() as u64;
        let limit = self.session.frame_bytes;
        if bytes <= limit {
            return Ok(());
        }
        // Welcome announced the limit to the client, which may refuse larger frames: this is a fault of the server.
        Err(Failure::server("begin an episode", format!("its first frame has {bytes} of {limit} bytes")))
    }

    async fn act(&mut self, act: &v1::Act) -> Result<SlotReply> {
        let playing = match &self.state {
            SlotContent::Idle => return Err(self.no_episode()),
            SlotContent::Finished(over) => return over.act(act, matches!(self.audience, Audience::Callers)),
            SlotContent::Playing(playing) => playing,
        };
        same_episode(&playing.hosted.handle, &act.episode)?;
        let Some(action) = playing.last.due(act)? else {
            return Ok(SlotReply::step(Some(playing.last.observation.clone()), None));
        };
        match std::mem::replace(&mut self.state, SlotContent::Idle) {
            SlotContent::Playing(mut playing) => {
                let thought = playing.stop_clock();
                let span = StepSpan::begin(act.step, action, playing.hosted.time, thought);
                let entered = span.span();
                self.step(*playing, act, (action, thought), span).instrument(entered).await
            }
            other => {
                self.state = other;
                Err(self.no_episode())
            }
        }
    }

    fn no_episode(&self) -> Failure {
        let message = format!("slot {} has no episode; send Ready first", self.id);
        Failure::new(Reason::SlotUnknown, message)
    }

    async fn step(
        &mut self,
        playing: OpenEpisode<H::Episode>,
        act: &v1::Act,
        (action, thought): (Action, Duration),
        span: StepSpan,
    ) -> Result<SlotReply> {
        let OpenEpisode { hosted, ordinal, last, clock } = playing;
        let step = act.step;
        let bank_left = clock.bank();
        let handle = hosted.handle.clone();
        let ticket = hosted.ticket;
        let work = move |hosted: &mut Hosted<H>, token: &CancelToken| {
            let unwritten = |error: std::io::Error| format!("write the action down: {error}");
            hosted.log.acting(step).map_err(unwritten)?;
            let outcome = hosted.episode.step(action).map_err(|error| error.to_string())?;
            let state_hash = hosted.episode.state_hash();
            let acted = Acted { step, action, state_hash, thought, bank_left };
            // The log must not contain an abandoned step: the episode restarts.
            if !token.commit() {
                return Err("it was given up".to_owned());
            }
            // Before the client receives the result: after a crash the log must lead to every observation that it has seen.
            hosted.log.acted(&acted).map_err(unwritten)?;
            Ok(outcome)
        };
        let (session, id) = (self.session.clone(), self.id);
        let encode = move |hosted: &Hosted<H>, worked: Result<StepOutcome, String>| {
            worked
                .map(|outcome| (encoded(&session, id, hosted, outcome.observation, outcome.end), outcome.end))
        };
        let simulator = &self.session.simulator;
        let (hosted, outcome) = match simulator.run(hosted, simulator.longest_step, work, encode).await {
            Ok(result) => result,
            Err(fault) => {
                span.fail("lost");
                self.report_fault(&handle, step, fault).await;
                return Ok(self.timed_out(&handle, ticket, last).await);
            }
        };
        let refused = |error: String| Failure::simulator("step", error);
        match outcome.and_then(|outcome| outcome.map_err(refused)) {
            Ok((observation, end)) => {
                let last = (act.action, observation, end);
                Ok(self.stepped(hosted, ordinal, clock, last, span).await)
            }
            Err(fault) => {
                span.fail(EndReason::ServerFault.as_str());
                self.report_fault(&handle, step, fault).await;
                Ok(self.broken(hosted, last).await)
            }
        }
    }

    async fn stepped(
        &mut self,
        hosted: Hosted<H>,
        ordinal: u32,
        clock: ChessClock,
        (action, observation, end): (i32, v1::Observation, Option<EndReason>),
        span: StepSpan,
    ) -> SlotReply {
        let observation = with_account(observation, &clock);
        span.end(end.map_or("continues", EndReason::as_str), hosted.time);
        if let Some(span) = &mut self.episode {
            span.stepped(observation.step);
        }
        self.report_step(&hosted, observation.step);
        let last = LastStep { action: Some(action), observation: observation.clone() };
        let mut episode_end = None;
        if end.is_some() {
            episode_end = Some(self.end_with(hosted, last).await);
        } else {
            self.state = SlotContent::Playing(Box::new(OpenEpisode { hosted, ordinal, last, clock }));
        }
        SlotReply::step(Some(observation), episode_end)
    }

    fn report_step(&self, hosted: &Hosted<H>, step: u32) {
        if let Some(control) = self.session.host.control() {
            control.stepped(&self.session.run, self.id, step, hosted.time);
        }
    }

    async fn abandon(&mut self, abandon: &v1::Abandon) -> Result<SlotReply> {
        match &self.state {
            SlotContent::Idle => return Err(self.no_episode()),
            SlotContent::Finished(over) => {
                same_episode(&over.end.episode, &abandon.episode)?;
                return Ok(SlotReply::Ended(Box::new(over.end.clone())));
            }
            SlotContent::Playing(playing) => {
                same_episode(&playing.hosted.handle, &abandon.episode)?;
                not_ahead(abandon.step, playing.last.observation.step)?;
            }
        }
        let end = self.store_open_episode(EndReason::Abandoned).await;
        end.map(|end| SlotReply::Ended(Box::new(end))).ok_or_else(|| self.no_episode())
    }
}

/// Encodes an observation, without the time account.
fn encoded<H: Host>(
    session: &SessionContext<H>,
    slot: u32,
    hosted: &Hosted<H>,
    sensed: Observation,
    end: Option<EndReason>,
) -> v1::Observation {
    let format = wire::ObservationFormat { sensors: &session.sensors, rules: hosted.episode.rules() };
    wire::observation(slot, &hosted.handle, sensed, format, end)
}

fn with_account(observation: v1::Observation, clock: &ChessClock) -> v1::Observation {
    v1::Observation { time: Some(clock.account()), ..observation }
}

/// Waits for a future; for ever without one.
async fn if_any<T>(future: Option<impl Future<Output = T>>) -> T {
    match future {
        Some(future) => future.await,
        None => std::future::pending().await,
    }
}
