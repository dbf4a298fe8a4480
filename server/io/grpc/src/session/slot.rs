use super::{Shared, simulate};
use crate::{
    limits::Limits,
    outbound::Outbound,
    refusal::{About, Failure, ServerFault, ask},
    seat::Seat,
    wire,
};
use avln_episode::{Action, EndReason};
use avln_proto::v1::{self, Reason, play_response::Frame};
use avln_referee::StepOutcome;
use prost::Message;
use std::sync::Arc;
use tokio::{
    sync::{mpsc, oneshot, watch},
    time::{Instant, sleep_until},
};

/// What an agent wants from a slot.
#[derive(Clone, Debug)]
pub(crate) enum Order {
    Ready,
    Act(v1::Act),
    Abandon(v1::Abandon),
}

/// What came of it.
#[derive(Clone, Debug)]
pub(crate) enum Answer {
    Start(Box<v1::EpisodeStart>),
    NothingLeft,
    Step(Box<v1::StepResponse>),
    Ended(Box<v1::EpisodeEnd>),
}

/// An order, and who waits for the answer; nobody does when it goes to the stream.
pub(super) struct Command {
    pub(super) order: Order,
    pub(super) reply: Option<oneshot::Sender<Result<Answer, Failure>>>,
}

/// One slot: idle, playing, or just done. It alone touches its episode, so it needs no lock.
pub(super) struct Slot {
    id: u32,
    shared: Arc<Shared>,
    out: Option<Outbound>,
    state: State,
    /// How many episodes had gone back to the host when it had none for this slot.
    waiting: Option<u32>,
}

enum State {
    Idle,
    Playing(Box<Playing>),
    Over(Box<Over>),
}

struct Playing {
    seat: Seat,
    /// The frame that began the episode, until the first step.
    start: Option<v1::EpisodeStart>,
    last: Last,
    /// Since when the agent thinks; not set until the last observation has left.
    thinks_since: Option<Instant>,
}

/// The last observation and the action that led to it: sent again to an agent that asks again.
#[derive(Clone)]
struct Last {
    action: Option<i32>,
    observation: v1::Observation,
}

struct Over {
    last: Last,
    end: v1::EpisodeEnd,
}

impl Slot {
    pub(super) fn new(id: u32, shared: Arc<Shared>, out: Option<Outbound>) -> Self {
        Self { id, shared, out, state: State::Idle, waiting: None }
    }

    /// Serves orders until `leave` says for which reason an open episode ends.
    pub(super) async fn run(
        mut self,
        mut commands: mpsc::Receiver<Command>,
        mut leave: watch::Receiver<Option<EndReason>>,
    ) {
        loop {
            let shared = self.shared.clone();
            tokio::select! {
                biased;
                reason = left(&mut leave) => return self.put_away_and_tell(reason).await,
                () = expired(self.deadline()) => self.put_away_and_tell(EndReason::TimeBudget).await,
                command = commands.recv() => match command {
                    Some(command) => self.obey(command).await,
                    None => return self.put_away_and_tell(left(&mut leave).await).await,
                },
                () = refilled(&shared, self.waiting) => {
                    self.obey(Command { order: Order::Ready, reply: None }).await;
                }
            }
        }
    }

    fn deadline(&self) -> Option<Instant> {
        match &self.state {
            State::Playing(playing) => playing.thinks_since.map(|since| since + self.shared.limits.step_time),
            _ => None,
        }
    }

    async fn obey(&mut self, Command { order, reply }: Command) {
        let answer = match &order {
            Order::Ready => self.begin().await,
            Order::Act(act) => self.act(act).await,
            Order::Abandon(abandon) => self.abandon(abandon).await,
        };
        match reply {
            // A caller that hung up finds the answer when it asks again.
            Some(reply) => drop(reply.send(answer)),
            None => self.tell(&order, answer).await,
        }
        self.start_clock();
    }

    /// The agent's time runs from the moment when its observation has left.
    fn start_clock(&mut self) {
        if let State::Playing(playing) = &mut self.state {
            playing.thinks_since.get_or_insert_with(Instant::now);
        }
    }

    /// Asks the host for an episode. A slot of a stream that gets none asks again when one has gone back.
    async fn begin(&mut self) -> Result<Answer, Failure> {
        if let State::Playing(playing) = &self.state {
            return self.already_playing(playing);
        }
        self.waiting = None;
        let returned = self.shared.board.returned();
        self.shared.board.asking();
        let (host, run) = (self.shared.host.clone(), self.shared.run.clone());
        let sensors = self.shared.sensors.clone();
        let seat = ask("next episode", async move { host.next_episode(&run, &sensors).await }).await;
        match seat {
            Ok(Some(seat)) => self.take(seat).await,
            Ok(None) => {
                self.waiting = self.out.is_some().then_some(returned);
                self.shared.board.refused(true);
                Ok(Answer::NothingLeft)
            }
            Err(failure) => {
                self.shared.board.refused(false);
                Err(failure)
            }
        }
    }

    /// A unary Reset that is repeated before the first step finds the same episode; a stream cannot lose frames.
    fn already_playing(&self, playing: &Playing) -> Result<Answer, Failure> {
        match &playing.start {
            Some(start) if self.out.is_none() => Ok(Answer::Start(Box::new(start.clone()))),
            _ => {
                let message = format!("slot {} plays an episode; end it before the next", self.id);
                Err(Failure::new(Reason::SlotBusy, message))
            }
        }
    }

    async fn take(&mut self, seat: Seat) -> Result<Answer, Failure> {
        let ordinal = self.shared.board.started();
        let result = self.shared.crew.simulate(seat, |episode| episode.start()).await;
        let (mut seat, first) = result.inspect_err(|_| self.shared.board.ended(EndReason::ServerFault))?;
        let start = first.map(|first| self.start_frame(&seat, first, ordinal));
        match start.and_then(|start| self.fits(start)) {
            Ok(start) => {
                let observation = start.observation.clone().unwrap_or_default();
                let last = Last { action: None, observation };
                self.note(&seat, 0);
                let playing = Playing { seat, start: Some(start.clone()), last, thinks_since: None };
                self.state = State::Playing(Box::new(playing));
                Ok(Answer::Start(Box::new(start)))
            }
            Err(fault) => {
                simulate::truncate(&mut seat, EndReason::ServerFault);
                self.conclude(seat).await;
                Err(fault.into())
            }
        }
    }

    fn start_frame(&self, seat: &Seat, first: avln_episode::Observation, ordinal: u32) -> v1::EpisodeStart {
        v1::EpisodeStart {
            slot: self.id,
            episode: seat.handle.clone(),
            mission: Some(wire::mission(seat.referee.mission())),
            observation: Some(self.observation(seat, first, None)),
            ordinal,
            progress: Some(self.shared.board.progress()),
        }
    }

    /// The agent was told how large frames can be: a larger one is the server's fault.
    fn fits(&self, start: v1::EpisodeStart) -> Result<v1::EpisodeStart, ServerFault> {
        let (bytes, limit) = (start.encoded_len() as u64, self.shared.frame_bytes);
        if bytes <= limit {
            return Ok(start);
        }
        Err(ServerFault::log("begin an episode", format!("its first frame has {bytes} of {limit} bytes")))
    }

    fn observation(
        &self,
        seat: &Seat,
        sensed: avln_episode::Observation,
        end: Option<EndReason>,
    ) -> v1::Observation {
        let step_ms = self.shared.limits.step_ms();
        let sensors_and_rules = (&self.shared.sensors, seat.referee.rules());
        wire::observation(self.id, &seat.handle, sensed, sensors_and_rules, end, step_ms)
    }

    async fn act(&mut self, act: &v1::Act) -> Result<Answer, Failure> {
        let playing = match &self.state {
            State::Idle => return Err(self.holds_nothing()),
            State::Over(over) => return over.act(act, self.out.is_none()),
            State::Playing(playing) => playing,
        };
        same_episode(&playing.seat.handle, &act.episode)?;
        let Some(action) = playing.last.due(act)? else {
            let observation = Some(playing.last.observation.clone());
            return Ok(Answer::Step(Box::new(v1::StepResponse { observation, episode_end: None })));
        };
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Playing(playing) => self.step(*playing, act, action).await,
            other => {
                self.state = other;
                Err(self.holds_nothing())
            }
        }
    }

    fn holds_nothing(&self) -> Failure {
        let message = format!("slot {} holds no episode; send Ready first", self.id);
        Failure::new(Reason::SlotUnknown, message)
    }

    /// Carries out an action that is legal and due.
    async fn step(&mut self, playing: Playing, act: &v1::Act, action: Action) -> Result<Answer, Failure> {
        let (seat, last) = playing.thought();
        let result = self.shared.crew.simulate(seat, move |episode| episode.step(action)).await;
        let (seat, outcome) = result.inspect_err(|_| self.shared.board.ended(EndReason::ServerFault))?;
        let refused = |error| ServerFault::simulator("step", error);
        match outcome.and_then(|outcome| outcome.map_err(refused)) {
            Ok(outcome) => Ok(self.stepped(seat, act.action, outcome).await),
            Err(fault) => Ok(self.broken(seat, last, act, fault).await),
        }
    }

    async fn stepped(&mut self, mut seat: Seat, action: i32, outcome: StepOutcome) -> Answer {
        let StepOutcome { observation, end } = outcome;
        let begun = Instant::now();
        let observation = self.observation(&seat, observation, end);
        seat.time.encoding += begun.elapsed();
        self.note(&seat, observation.step);
        let last = Last { action: Some(action), observation: observation.clone() };
        let mut response = v1::StepResponse { observation: Some(observation), episode_end: None };
        if end.is_some() {
            response.episode_end = Some(self.end_with(seat, last).await);
        } else {
            let playing = Playing { seat, start: None, last, thinks_since: None };
            self.state = State::Playing(Box::new(playing));
        }
        Answer::Step(Box::new(response))
    }

    /// Lets the operator see how far the slot is.
    fn note(&self, seat: &Seat, step: u32) {
        if let Some(control) = self.shared.host.control() {
            control.stepped(&self.shared.run, self.id, step, seat.time);
        }
    }

    /// The simulator failed in mid-step: this episode ends, nothing else does.
    async fn broken(&mut self, mut seat: Seat, last: Last, act: &v1::Act, fault: ServerFault) -> Answer {
        if let Some(out) = &self.out {
            let about = About { slot: Some(self.id), episode: &seat.handle, step: act.step };
            let _ = out.send(Frame::Fault(Failure::from(fault).frame(about, false))).await;
        }
        simulate::truncate(&mut seat, EndReason::ServerFault);
        let episode_end = Some(self.end_with(seat, last).await);
        Answer::Step(Box::new(v1::StepResponse { observation: None, episode_end }))
    }

    async fn abandon(&mut self, abandon: &v1::Abandon) -> Result<Answer, Failure> {
        match &self.state {
            State::Idle => return Err(self.holds_nothing()),
            State::Over(over) => {
                same_episode(&over.end.episode, &abandon.episode)?;
                return Ok(Answer::Ended(Box::new(over.end.clone())));
            }
            State::Playing(playing) => {
                same_episode(&playing.seat.handle, &abandon.episode)?;
                not_ahead(abandon.step, playing.last.observation.step)?;
            }
        }
        let end = self.put_away(EndReason::Abandoned).await;
        end.map(|end| Answer::Ended(Box::new(end))).ok_or_else(|| self.holds_nothing())
    }

    /// Ends an open episode from outside and stores it.
    async fn put_away(&mut self, reason: EndReason) -> Option<v1::EpisodeEnd> {
        match std::mem::replace(&mut self.state, State::Idle) {
            State::Playing(playing) => {
                let (mut seat, last) = playing.thought();
                simulate::truncate(&mut seat, reason);
                Some(self.end_with(seat, last).await)
            }
            other => {
                self.state = other;
                None
            }
        }
    }

    async fn put_away_and_tell(&mut self, reason: EndReason) {
        if let (Some(end), Some(out)) = (self.put_away(reason).await, &self.out) {
            let _ = out.send(Frame::EpisodeEnd(end)).await;
        }
    }

    async fn end_with(&mut self, seat: Seat, last: Last) -> v1::EpisodeEnd {
        let end = self.conclude(seat).await;
        self.state = State::Over(Box::new(Over { last, end: end.clone() }));
        end
    }

    /// Gives the seat back to the host to be stored. What could not be stored does not count.
    async fn conclude(&mut self, seat: Seat) -> v1::EpisodeEnd {
        let (episode, step) = (seat.handle.clone(), seat.referee.steps());
        let reason = seat.referee.end().unwrap_or(EndReason::ServerFault);
        let (host, run) = (self.shared.host.clone(), self.shared.run.clone());
        let stored = ask("conclude", async move { host.conclude(&run, seat).await }).await;
        let (reason, outcome) = match stored {
            Ok(outcome) => (reason, outcome),
            Err(failure) => {
                let (run, why) = (&self.shared.run, failure.message());
                tracing::error!(run, episode, why, "episode not stored");
                (EndReason::ServerFault, None)
            }
        };
        self.shared.board.ended(reason);
        if let Some(control) = self.shared.host.control() {
            control.ended(&self.shared.run, self.id, reason);
        }
        v1::EpisodeEnd {
            slot: self.id,
            episode,
            step,
            reason: wire::end_reason(reason).into(),
            terminated: reason.is_terminated(),
            metrics: outcome.map(|outcome| wire::public_metrics(outcome.metrics, 0)),
            progress: Some(self.shared.board.progress()),
        }
    }

    /// Sends an answer to the stream. An agent that does not read is noticed by the stream itself.
    async fn tell(&mut self, order: &Order, answer: Result<Answer, Failure>) {
        let Some(out) = &self.out else { return };
        let frames = match answer {
            Ok(Answer::Start(start)) => vec![Frame::EpisodeStart(*start)],
            Ok(Answer::NothingLeft) => vec![],
            Ok(Answer::Ended(end)) => vec![Frame::EpisodeEnd(*end)],
            Ok(Answer::Step(step)) => {
                let observation = step.observation.map(Frame::Observation);
                observation.into_iter().chain(step.episode_end.map(Frame::EpisodeEnd)).collect()
            }
            Err(failure) => vec![Frame::Fault(failure.frame(order.about(self.id), true))],
        };
        for frame in frames {
            if out.send(frame).await.is_err() {
                return;
            }
        }
    }
}

impl Last {
    /// The action that is to be carried out now; `None` when `act` asks for this observation again.
    fn due(&self, act: &v1::Act) -> Result<Option<Action>, Failure> {
        let action = wire::action(act.action).ok_or_else(|| unknown_action(act.action))?;
        let taken = self.observation.step;
        not_ahead(act.step, taken + 1)?;
        if act.step == taken + 1 {
            return Ok(Some(action));
        }
        if act.step == taken && self.action == Some(act.action) {
            return Ok(None);
        }
        let message = format!("step {} is past, {taken} steps were taken; send step {}", act.step, taken + 1);
        Err(Failure::new(Reason::StepConflict, message))
    }
}

impl Playing {
    /// Seat and last observation, the time that the agent took included.
    fn thought(self) -> (Seat, Last) {
        let Self { mut seat, last, thinks_since, .. } = self;
        seat.time.thinking += thinks_since.map(|since| since.elapsed()).unwrap_or_default();
        (seat, last)
    }
}

impl Over {
    /// The last action again yields the last answer again. An episode that ended while the agent thought is told
    /// as an end to a unary caller, who had no other way to learn of it.
    fn act(&self, act: &v1::Act, unary: bool) -> Result<Answer, Failure> {
        same_episode(&self.end.episode, &act.episode)?;
        let taken = &self.last.observation;
        let mut response = v1::StepResponse { observation: None, episode_end: Some(self.end.clone()) };
        let again = act.step == taken.step && self.last.action == Some(act.action);
        if again && (taken.terminated || taken.truncated) {
            response.observation = Some(taken.clone());
            return Ok(Answer::Step(Box::new(response)));
        }
        let cut_short = !(taken.terminated || taken.truncated);
        if unary && cut_short && self.end.reason() != v1::EndReason::Abandoned {
            return Ok(Answer::Step(Box::new(response)));
        }
        let ended = self.end.reason().as_str_name();
        let message =
            format!("the episode ended after {} steps ({ended}); send Ready for the next", taken.step);
        Err(Failure::new(Reason::EpisodeOver, message))
    }
}

impl Order {
    /// What a fault about this order names.
    pub(crate) fn about(&self, slot: u32) -> About<'_> {
        let (episode, step) = match self {
            Self::Ready => ("", 0),
            Self::Act(act) => (act.episode.as_str(), act.step),
            Self::Abandon(abandon) => (abandon.episode.as_str(), abandon.step),
        };
        About { slot: Some(slot), episode: Limits::shorten(episode), step }
    }
}

fn same_episode(held: &str, named: &str) -> Result<(), Failure> {
    if held == named {
        return Ok(());
    }
    let message = format!("episode '{}' is not in this slot; '{held}' is", Limits::shorten(named));
    Err(Failure::new(Reason::EpisodeUnknown, message))
}

fn not_ahead(step: u32, latest: u32) -> Result<(), Failure> {
    if step <= latest {
        return Ok(());
    }
    let message = format!("step {step} lies ahead; {latest} is the latest that is possible");
    Err(Failure::new(Reason::StepAhead, message))
}

fn unknown_action(number: i32) -> Failure {
    let message = format!(
        "action {number} does not exist; use 1 MOVE_FORWARD, 2 TURN_LEFT, 3 TURN_RIGHT, 4 SUBMIT or 5 STOP"
    );
    Failure::new(Reason::ActionOutOfRange, message)
}

/// Waits for the reason to leave. A session that broke down leaves its episodes as server faults.
async fn left(leave: &mut watch::Receiver<Option<EndReason>>) -> EndReason {
    match leave.wait_for(Option::is_some).await {
        Ok(reason) => reason.unwrap_or(EndReason::ServerFault),
        Err(_) => EndReason::ServerFault,
    }
}

/// Waits until a slot that was told that nothing is left may ask again.
async fn refilled(shared: &Shared, waiting: Option<u32>) {
    match waiting {
        Some(seen) => shared.board.refilled(seen).await,
        None => std::future::pending().await,
    }
}

async fn expired(deadline: Option<Instant>) {
    match deadline {
        Some(deadline) => sleep_until(deadline).await,
        None => std::future::pending().await,
    }
}
