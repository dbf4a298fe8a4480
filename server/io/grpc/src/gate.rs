use crate::{limits::Limits, refusal::Refusal, session::Session, unary::Desk};
use avln_proto::v1::Reason;
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};
use tokio::{
    sync::watch,
    time::{Instant, timeout_at},
};

/// Why a session must end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stop {
    /// Another connection plays the run now, from new episodes on.
    Superseded,
    /// Another connection goes on with the session.
    Resumed,
    /// The server is about to stop.
    Draining,
    /// The team cancelled the run, or its agent said goodbye by a unary call.
    Left,
    /// The run's time is over.
    Expired,
}

/// Who is playing which run: one session a run, and a bound on all of them.
#[derive(Debug)]
pub(crate) struct Gate {
    rooms: Mutex<Rooms>,
    /// How many sessions there are, and whether the gate is shut.
    state: watch::Sender<State>,
    limits: Arc<Limits>,
}

#[derive(Clone, Copy, Debug, Default)]
struct State {
    sessions: usize,
    shut: bool,
}

#[derive(Debug, Default)]
struct Rooms {
    by_run: BTreeMap<String, Room>,
    /// Runs whose unary sessions are open, by run token. Keyed hashing tells nothing about tokens by its timing.
    by_token: HashMap<String, String>,
    /// Sessions on their way from one connection to the next.
    handed_over: BTreeMap<String, Arc<Session>>,
    passes: u64,
}

#[derive(Debug)]
struct Room {
    pass: u64,
    team: String,
    /// Slots that its session was granted.
    slots: u32,
    stop: watch::Sender<Option<Stop>>,
    /// Closed when the session is over.
    over: watch::Receiver<()>,
    desk: Option<Arc<Desk>>,
}

/// The right to play a run, until it is dropped.
#[derive(Debug)]
pub(crate) struct Pass {
    pub(crate) run: String,
    /// Says when the session must end.
    pub(crate) stop: watch::Receiver<Option<Stop>>,
    number: u64,
    gate: Arc<Gate>,
    _over: watch::Sender<()>,
}

impl Gate {
    pub(crate) fn new(limits: Arc<Limits>) -> Arc<Self> {
        Arc::new(Self { rooms: Mutex::default(), state: watch::Sender::default(), limits })
    }

    fn rooms(&self) -> MutexGuard<'_, Rooms> {
        self.rooms.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether the server is about to stop.
    pub(crate) fn is_shut(&self) -> bool {
        self.state.borrow().shut
    }

    /// Waits until the server is about to stop.
    pub(crate) async fn shutting(&self) {
        // The sender lives in self, so waiting cannot fail.
        let _ = self.state.subscribe().wait_for(|state| state.shut).await;
    }

    /// Refuses work that begins while the server is about to stop.
    pub(crate) fn check_open(&self) -> Result<(), Refusal> {
        if !self.is_shut() {
            return Ok(());
        }
        let message = "the server is about to stop; connect again when it is back";
        Err(Refusal::new(Reason::Draining, message).retry_after(30))
    }

    /// Takes a run over from whoever plays it: with its session, or once that has put its episodes away.
    pub(crate) async fn enter(
        self: &Arc<Self>,
        run: &str,
        how: Stop,
    ) -> Result<(Pass, Option<Arc<Session>>), Refusal> {
        let patience = Instant::now() + self.limits.handover;
        while let Some(mut over) = self.evict(run, how) {
            if timeout_at(patience, over.changed()).await.is_err() {
                let message = format!("the session that plays run {run} does not end; try again");
                return Err(Refusal::new(Reason::NoCapacity, message).retry_after(10));
            }
        }
        let pass = self.admit(run)?;
        let session = self.rooms().handed_over.remove(run);
        Ok((pass, session))
    }

    /// Ends the session of a run, if there is one, and waits until its episodes are put away.
    pub(crate) async fn stop(&self, run: &str, why: Stop) {
        let patience = Instant::now() + self.limits.handover;
        while let Some(mut over) = self.evict(run, why) {
            if timeout_at(patience, over.changed()).await.is_err() {
                return;
            }
        }
    }

    fn evict(&self, run: &str, why: Stop) -> Option<watch::Receiver<()>> {
        let rooms = self.rooms();
        let room = rooms.by_run.get(run)?;
        room.ask_to_end(why);
        Some(room.over.clone())
    }

    fn admit(self: &Arc<Self>, run: &str) -> Result<Pass, Refusal> {
        let mut rooms = self.rooms();
        self.check_open()?;
        if rooms.by_run.contains_key(run) {
            let message = format!("another connection takes run {run} over at the same time");
            return Err(Refusal::new(Reason::Superseded, message));
        }
        if rooms.by_run.len() >= self.limits.max_sessions {
            let message = format!("all {} sessions of the server are in use", self.limits.max_sessions);
            return Err(Refusal::new(Reason::NoCapacity, message).retry_after(60));
        }
        rooms.passes += 1;
        let number = rooms.passes;
        let (stop, stopped) = watch::channel(None);
        let (over, ended) = watch::channel(());
        let room = Room { pass: number, team: String::new(), slots: 0, stop, over: ended, desk: None };
        rooms.by_run.insert(run.to_owned(), room);
        self.state.send_modify(|state| state.sessions = rooms.by_run.len());
        Ok(Pass { run: run.to_owned(), stop: stopped, number, gate: self.clone(), _over: over })
    }

    /// The desk of the unary session that the token opened, if that goes on.
    pub(crate) fn desk(&self, token: &str) -> Option<Arc<Desk>> {
        let rooms = self.rooms();
        let room = rooms.by_run.get(rooms.by_token.get(token)?)?;
        room.desk.clone().filter(|_| room.stop.borrow().is_none())
    }

    /// Lets nobody in any more, ends all sessions, and waits until they are over.
    pub(crate) async fn shut(&self) {
        {
            let rooms = self.rooms();
            self.state.send_modify(|state| state.shut = true);
            for room in rooms.by_run.values() {
                room.ask_to_end(Stop::Draining);
            }
        }
        // The sender lives in self, so waiting cannot fail.
        let _ = self.state.subscribe().wait_for(|state| state.sessions == 0).await;
    }
}

impl Room {
    /// The first reason stands.
    fn ask_to_end(&self, why: Stop) {
        self.stop.send_if_modified(|stop| {
            let first = stop.is_none();
            stop.get_or_insert(why);
            first
        });
    }
}

impl Rooms {
    /// Slots that a team may have in one more session. Teams that play have equal shares of all.
    fn share(&self, team: &str, of: u32) -> u32 {
        let playing = self.by_run.values().filter(|room| room.slots > 0).map(|room| room.team.as_str());
        let teams = playing.chain([team]).collect::<BTreeSet<_>>().len() as u32;
        let own = self.by_run.values().filter(|room| room.team == team).map(|room| room.slots).sum();
        (of / teams).saturating_sub(own)
    }
}

impl Pass {
    /// Takes slots for the session: `wished` or the team's share of what the server has, one at least, and `held` at least,
    /// which hold episodes.
    pub(crate) fn take_slots(&self, team: &str, wished: u32, held: u32) -> u32 {
        let mut rooms = self.gate.rooms();
        let share = rooms.share(team, self.gate.limits.max_slots);
        let granted = wished.min(share).max(held).max(1);
        if let Some(room) = rooms.by_run.get_mut(&self.run) {
            (room.team, room.slots) = (team.to_owned(), granted);
        }
        granted
    }

    /// Leaves, and leaves the session to whoever enters next.
    pub(crate) fn hand_over(self, session: Arc<Session>) {
        self.gate.rooms().handed_over.insert(self.run.clone(), session);
    }

    /// Opens a desk where unary calls with this token find the session.
    pub(crate) fn open_desk(&self, token: &str, desk: Arc<Desk>) {
        let mut rooms = self.gate.rooms();
        rooms.by_token.insert(token.to_owned(), self.run.clone());
        if let Some(room) = rooms.by_run.get_mut(&self.run) {
            room.desk = Some(desk);
        }
    }

    /// Waits until the session must end.
    pub(crate) async fn stopped(&mut self) -> Stop {
        match self.stop.wait_for(Option::is_some).await {
            Ok(stop) => stop.unwrap_or(Stop::Draining),
            Err(_) => Stop::Draining,
        }
    }
}

impl Drop for Pass {
    fn drop(&mut self) {
        let mut rooms = self.gate.rooms();
        if rooms.by_run.get(&self.run).is_some_and(|room| room.pass == self.number) {
            rooms.by_run.remove(&self.run);
            rooms.by_token.retain(|_, run| *run != self.run);
        }
        self.gate.state.send_modify(|state| state.sessions = rooms.by_run.len());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn gate(max_sessions: usize) -> Arc<Gate> {
        Gate::new(Arc::new(Limits { max_sessions, ..Limits::default() }))
    }

    #[tokio::test]
    async fn the_second_waits_for_the_first_to_leave() {
        let gate = gate(4);
        let (mut first, _) = gate.enter("run_a", Stop::Superseded).await.unwrap();
        let second = tokio::spawn({
            let gate = gate.clone();
            async move { gate.enter("run_a", Stop::Superseded).await }
        });
        assert_eq!(first.stopped().await, Stop::Superseded);
        assert!(!second.is_finished());
        drop(first);
        let (second, _) = second.await.unwrap().unwrap();
        assert!(second.stop.borrow().is_none());
    }

    #[tokio::test(start_paused = true)]
    async fn one_that_never_leaves_costs_a_bounded_wait() {
        let gate = gate(4);
        let _first = gate.enter("run_a", Stop::Superseded).await.unwrap();
        let before = Instant::now();
        assert_eq!(gate.enter("run_a", Stop::Superseded).await.unwrap_err().reason, Reason::NoCapacity);
        assert_eq!(before.elapsed(), Duration::from_secs(30));
    }

    #[tokio::test]
    async fn teams_share_the_slots() {
        let gate = Gate::new(Arc::new(Limits { max_slots: 32, ..Limits::default() }));
        let enter = async |run| gate.enter(run, Stop::Superseded).await.unwrap().0;
        let (greedy, more) = (enter("run_a").await, enter("run_b").await);
        assert_eq!(greedy.take_slots("red", 20, 0), 20);
        assert_eq!(more.take_slots("red", 20, 0), 12, "one team has the same slots in any number of runs");
        let other = enter("run_c").await;
        assert_eq!(other.take_slots("blue", 64, 0), 16, "half of them");
        let late = enter("run_d").await;
        assert_eq!(late.take_slots("red", 4, 0), 1, "a session has one at least");
        assert_eq!(late.take_slots("red", 4, 3), 3, "and those that hold episodes");
        drop((greedy, more, late));
        let again = enter("run_a").await;
        assert_eq!(again.take_slots("red", 64, 0), 16);
    }

    #[tokio::test]
    async fn a_full_gate_and_a_shut_gate_say_so() {
        let gate = gate(1);
        let (mut first, _) = gate.enter("run_a", Stop::Superseded).await.unwrap();
        assert_eq!(gate.enter("run_b", Stop::Superseded).await.unwrap_err().reason, Reason::NoCapacity);
        let shutting = tokio::spawn({
            let gate = gate.clone();
            async move { gate.shut().await }
        });
        assert_eq!(first.stopped().await, Stop::Draining);
        drop(first);
        shutting.await.unwrap();
        assert_eq!(gate.enter("run_b", Stop::Superseded).await.unwrap_err().reason, Reason::Draining);
    }
}
