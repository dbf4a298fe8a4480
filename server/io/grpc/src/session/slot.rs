use super::{
    Leave, Shared,
    clock::Clock,
    playing::{Last, Over, Playing, not_ahead, same_episode, start_frame},
};
use crate::{
    outbound::Outbound,
    refusal::{Failure, ServerFault, ask},
    seat::{Acted, Restored, Seat},
    watchdog::Leash,
    wire,
};
use avln_episode::{Action, EndReason};
use avln_proto::v1::{self, Reason};
use avln_referee::StepOutcome;
use prost::Message;
use std::{sync::Arc, time::Duration};
use tokio::{
    sync::{mpsc, oneshot, watch},
    time::Instant,
};

/// What an agent wants from a slot.
#[derive(Clone, Debug)]
pub(crate) enum Order {
    Ready,
    /// Of a unary caller that was away: the episode that the slot plays, or the next.
    GoOn,
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

/// Who listens to a slot.
#[derive(Clone, Debug)]
pub(crate) enum Audience {
    /// A stream, which is sent what happens.
    Stream(Outbound),
    /// Unary calls, each of which waits for its answer.
    Callers,
    /// The connection is lost: what happens is kept.
    Nobody,
}

/// What a session wants from a slot.
pub(super) enum Command {
    /// An agent's order, and who waits for the answer; nobody does when it goes to the stream.
    Obey(Order, Option<oneshot::Sender<Result<Answer, Failure>>>),
    /// Says where the slot's episode is.
    Tell(oneshot::Sender<Option<v1::SlotPosition>>),
    /// Somebody else listens from now on, who received `known` last and was away for so long.
    Switch {
        audience: Audience,
        known: Option<v1::SlotPosition>,
        away: Duration,
        /// Told whether the agent's clock started again.
        reply: oneshot::Sender<bool>,
    },
}

/// One slot: idle, playing, or just done. It alone touches its episode, so it needs no lock.
pub(super) struct Slot {
    pub(super) id: u32,
    pub(super) shared: Arc<Shared>,
    pub(super) audience: Audience,
    pub(super) state: State,
    /// How many episodes had gone back to the host when it had none for this slot.
    waiting: Option<u32>,
}

pub(super) enum State {
    Idle,
    Playing(Box<Playing>),
    Over(Box<Over>),
}

impl Slot {
    /// An idle slot, or one that takes up an episode where it was.
    pub(super) fn new(id: u32, shared: Arc<Shared>, restored: Option<Restored>) -> Self {
        let mut slot = Self { id, shared, audience: Audience::Nobody, state: State::Idle, waiting: None };
        if let Some(restored) = restored {
            slot.state = State::Playing(Box::new(slot.taken_up(restored)));
        }
        slot
    }

    fn taken_up(&self, restored: Restored) -> Playing {
        let Restored { seat, last: (sensed, action), bank_left, .. } = restored;
        self.shared.board.asking();
        let ordinal = self.shared.board.started();
        let clock = Clock::new(&self.shared.time).with_bank(bank_left);
        let observation = self.observation(&seat, sensed, seat.referee.end(), &clock);
        let last = Last { action: action.map(wire::action_number), observation };
        Playing { seat, ordinal, last, clock }
    }

    /// Serves its session until `leave` says how an open episode ends.
    pub(super) async fn run(
        mut self,
        mut commands: mpsc::Receiver<Command>,
        mut leave: watch::Receiver<Option<Leave>>,
    ) {
        self.settle().await;
        loop {
            let shared = self.shared.clone();
            tokio::select! {
                biased;
                how = left(&mut leave) => return self.end(how).await,
                () = expired(self.clock()) => self.put_away_and_tell(EndReason::TimeBudget).await,
                command = commands.recv() => match command {
                    Some(command) => self.serve(command).await,
                    None => { let how = left(&mut leave).await; return self.end(how).await },
                },
                () = refilled(&shared, self.waiting()) => self.obey(Order::Ready, None).await,
            }
        }
    }

    /// Stores an episode that had ended when the server stopped.
    async fn settle(&mut self) {
        if let State::Playing(playing) = &self.state
            && playing.last.is_last()
            && let State::Playing(playing) = std::mem::replace(&mut self.state, State::Idle)
        {
            self.end_with(playing.seat, playing.last).await;
        }
    }

    async fn end(&mut self, how: Leave) {
        match how {
            Leave::End(reason) => self.put_away_and_tell(reason).await,
            Leave::AsItIs => {}
        }
    }

    /// The clock that may run out. While nobody listens it is not known whether the agent thinks.
    fn clock(&self) -> Option<Clock> {
        match (&self.state, &self.audience) {
            (State::Playing(_), Audience::Nobody) => None,
            (State::Playing(playing), _) => Some(playing.clock.clone()),
            _ => None,
        }
    }

    /// A slot asks again by itself only for a stream.
    fn waiting(&self) -> Option<u32> {
        self.waiting.filter(|_| matches!(self.audience, Audience::Stream(_)))
    }

    async fn serve(&mut self, command: Command) {
        match command {
            Command::Obey(order, reply) => self.obey(order, reply).await,
            Command::Tell(reply) => drop(reply.send(self.position())),
            Command::Switch { audience, known, away, reply } => {
                self.audience = audience;
                let restarted = self.catch_up(known, away).await;
                let _ = reply.send(restarted);
            }
        }
    }

    fn position(&self) -> Option<v1::SlotPosition> {
        match &self.state {
            State::Playing(playing) => Some(playing.position(self.id)),
            _ => None,
        }
    }

    async fn obey(&mut self, order: Order, reply: Option<oneshot::Sender<Result<Answer, Failure>>>) {
        let answer = match &order {
            Order::Ready => self.begin().await,
            Order::GoOn => self.go_on().await,
            Order::Act(act) => self.act(act).await,
            Order::Abandon(abandon) => self.abandon(abandon).await,
        };
        match reply {
            // A caller that hung up finds the answer when it asks again.
            Some(reply) => {
                drop(reply.send(answer));
                if let State::Playing(playing) = &mut self.state {
                    playing.clock.handed_over();
                }
            }
            None => self.tell(order.about(self.id), answer).await,
        }
    }

    async fn go_on(&mut self) -> Result<Answer, Failure> {
        match &self.state {
            State::Playing(playing) => {
                Ok(Answer::Start(Box::new(start_frame(self.id, &self.shared, playing))))
            }
            _ => self.begin().await,
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
        let (host, run, id) = (self.shared.host.clone(), self.shared.run.clone(), self.id);
        let sensors = self.shared.sensors.clone();
        let seat = ask("next episode", async move { host.next_episode(&run, id, &sensors).await }).await;
        match seat {
            Ok(Some(seat)) => self.take(seat).await,
            Ok(None) => {
                self.waiting = (!matches!(self.audience, Audience::Callers)).then_some(returned);
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
        match (&playing.last.action, &self.audience) {
            (None, Audience::Callers) => {
                Ok(Answer::Start(Box::new(start_frame(self.id, &self.shared, playing))))
            }
            _ => {
                let message = format!("slot {} plays an episode; end it before the next", self.id);
                Err(Failure::new(Reason::SlotBusy, message))
            }
        }
    }

    async fn take(&mut self, seat: Seat) -> Result<Answer, Failure> {
        let ordinal = self.shared.board.started();
        let (handle, ticket) = (seat.handle.clone(), seat.ticket);
        let share = &self.shared.share;
        let begun = share.simulate(seat, share.longest_start, |seat, _| seat.referee.start()).await;
        let (seat, first) = match begun {
            Ok(begun) => begun,
            Err(fault) => {
                self.lose(&handle, ticket).await;
                return Err(fault.into());
            }
        };
        let first = match first {
            Ok(first) => first,
            Err(fault) => return self.stillborn(seat, fault).await,
        };
        let clock = Clock::new(&self.shared.time);
        let observation = self.observation(&seat, first, None, &clock);
        let playing = Playing { seat, ordinal, last: Last { action: None, observation }, clock };
        let start = start_frame(self.id, &self.shared, &playing);
        if let Err(fault) = self.fits(&start) {
            return self.stillborn(playing.seat, fault).await;
        }
        self.note(&playing.seat, 0);
        self.state = State::Playing(Box::new(playing));
        Ok(Answer::Start(Box::new(start)))
    }

    /// The agent was told how large frames can be: a larger one is the server's fault.
    fn fits(&self, start: &v1::EpisodeStart) -> Result<(), ServerFault> {
        let (bytes, limit) = (start.encoded_len() as u64, self.shared.frame_bytes);
        if bytes <= limit {
            return Ok(());
        }
        Err(ServerFault::log("begin an episode", format!("its first frame has {bytes} of {limit} bytes")))
    }

    fn observation(
        &self,
        seat: &Seat,
        sensed: avln_episode::Observation,
        end: Option<EndReason>,
        clock: &Clock,
    ) -> v1::Observation {
        let sensors_and_rules = (&self.shared.sensors, seat.referee.rules());
        let seen = wire::observation(self.id, &seat.handle, sensed, sensors_and_rules, end);
        v1::Observation { time: Some(clock.account()), ..seen }
    }

    async fn act(&mut self, act: &v1::Act) -> Result<Answer, Failure> {
        let playing = match &self.state {
            State::Idle => return Err(self.holds_nothing()),
            State::Over(over) => return over.act(act, matches!(self.audience, Audience::Callers)),
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

    /// Carries out an action that is legal and due, and writes it down before anybody learns of its result.
    async fn step(&mut self, mut playing: Playing, act: &v1::Act, action: Action) -> Result<Answer, Failure> {
        let thought = playing.stop_clock();
        let Playing { seat, ordinal, last, clock } = playing;
        let (step, bank_left) = (act.step, clock.bank());
        let (handle, ticket) = (seat.handle.clone(), seat.ticket);
        let work = move |seat: &mut Seat, leash: &Leash| {
            let unwritten = |error: std::io::Error| format!("write the action down: {error}");
            seat.log.acting(step).map_err(unwritten)?;
            let outcome = seat.referee.step(action).map_err(|error| error.to_string())?;
            let state_hash = seat.referee.state_hash();
            let acted = Acted { step, action, state_hash, thought, bank_left };
            if !leash.keep() {
                return Err("it was given up".to_owned());
            }
            seat.log.acted(&acted).map_err(unwritten)?;
            Ok(outcome)
        };
        let share = &self.shared.share;
        let (seat, outcome) = match share.simulate(seat, share.longest_step, work).await {
            Ok(result) => result,
            Err(fault) => return Ok(self.hung(&handle, ticket, last, act, fault).await),
        };
        let refused = |error: String| ServerFault::simulator("step", error);
        match outcome.and_then(|outcome| outcome.map_err(refused)) {
            Ok(outcome) => Ok(self.stepped(seat, ordinal, clock, act.action, outcome).await),
            Err(fault) => Ok(self.broken(seat, last, act, fault).await),
        }
    }

    async fn stepped(
        &mut self,
        mut seat: Seat,
        ordinal: u32,
        clock: Clock,
        action: i32,
        outcome: StepOutcome,
    ) -> Answer {
        let StepOutcome { observation, end } = outcome;
        let begun = Instant::now();
        let observation = self.observation(&seat, observation, end, &clock);
        seat.time.encoding += begun.elapsed();
        self.note(&seat, observation.step);
        let last = Last { action: Some(action), observation: observation.clone() };
        let mut response = v1::StepResponse { observation: Some(observation), episode_end: None };
        if end.is_some() {
            response.episode_end = Some(self.end_with(seat, last).await);
        } else {
            self.state = State::Playing(Box::new(Playing { seat, ordinal, last, clock }));
        }
        Answer::Step(Box::new(response))
    }

    /// Lets the operator see how far the slot is.
    fn note(&self, seat: &Seat, step: u32) {
        if let Some(control) = self.shared.host.control() {
            control.stepped(&self.shared.run, self.id, step, seat.time);
        }
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
}

/// Waits for how to leave. A session that broke down leaves its episodes as they are.
async fn left(leave: &mut watch::Receiver<Option<Leave>>) -> Leave {
    match leave.wait_for(Option::is_some).await {
        Ok(how) => how.unwrap_or(Leave::AsItIs),
        Err(_) => Leave::AsItIs,
    }
}

/// Waits until a slot that was told that nothing is left may ask again.
async fn refilled(shared: &Shared, waiting: Option<u32>) {
    match waiting {
        Some(seen) => shared.board.refilled(seen).await,
        None => std::future::pending().await,
    }
}

async fn expired(clock: Option<Clock>) {
    match clock {
        Some(clock) => clock.expired().await,
        None => std::future::pending().await,
    }
}
