//! Session registry: at most one session per run, a bound on all sessions, shared between teams, and their attachments.

use crate::{
    attachment::{Attachment, AttachmentEvent, Ending, StopReason, UnaryClient},
    limits::Limits,
    refusal::Refusal,
    shared::Shared,
};
use avln_net::fair_share;
use avln_proto::v1::Reason;
use parking_lot::Mutex;
use std::{
    collections::{BTreeMap, BTreeSet, HashMap},
    sync::Arc,
};
use tokio::{
    sync::watch,
    time::{Instant, timeout_at},
};

pub(crate) struct SessionRegistry<S> {
    entries: Mutex<SessionEntries<S>>,
    summary: Shared<RegistrySummary>,
    limits: Arc<Limits>,
}

#[derive(Clone, Copy, Debug, Default)]
struct RegistrySummary {
    sessions: usize,
    is_shut: bool,
}

struct SessionEntries<S> {
    by_run: BTreeMap<String, SessionEntry<S>>,
    // A hash map with random keys: lookup times reveal no other tokens.
    run_of_token: HashMap<String, String>,
    /// Sessions between two connections, by run.
    handed_over: BTreeMap<String, HandedOver<S>>,
    guards: u64,
}

/// Session that waits for the connection that resumes it.
struct HandedOver<S> {
    /// Guard that handed it over.
    guard: u64,
    team: String,
    session: Arc<S>,
}

struct SessionEntry<S> {
    guard: u64,
    /// Empty until an interrupted run is restored.
    team: String,
    slots: u32,
    attachment: watch::Sender<Attachment>,
    /// True when another party wants the session to end, also while it ends already.
    stop_wanted: Arc<Shared<bool>>,
    /// True when the guard is dropped.
    over: Arc<Shared<bool>>,
    unary: Option<Arc<UnaryClient<S>>>,
}

/// Exclusive right to play a run, until it is dropped.
pub(crate) struct SessionGuard<S> {
    pub(crate) run: String,
    attachment: watch::Receiver<Attachment>,
    stop_wanted: Arc<Shared<bool>>,
    number: u64,
    registry: Arc<SessionRegistry<S>>,
    over: Arc<Shared<bool>>,
}

impl<S> SessionRegistry<S> {
    pub(crate) fn new(limits: Arc<Limits>) -> Arc<Self> {
        let entries = SessionEntries {
            by_run: BTreeMap::new(),
            run_of_token: HashMap::new(),
            handed_over: BTreeMap::new(),
            guards: 0,
        };
        Arc::new(Self { entries: Mutex::new(entries), summary: Shared::default(), limits })
    }

    pub(crate) fn is_shut(&self) -> bool {
        self.summary.read(|summary| summary.is_shut)
    }

    pub(crate) async fn shutting(&self) {
        self.summary.wait_until(|summary| summary.is_shut).await;
    }

    /// Refuses new work while the server stops.
    pub(crate) fn check_open(&self) -> Result<(), Refusal> {
        if !self.is_shut() {
            return Ok(());
        }
        let message = "the server is about to stop; connect again when it is back";
        Err(Refusal::new(Reason::Draining, message).retry_after(30))
    }

    /// Stops a run's present session and returns the right to play, with the previous session if that was handed over. Without a
    /// team, only the bound on all sessions applies.
    pub(crate) async fn enter(
        self: &Arc<Self>,
        run: &str,
        team: &str,
        reason: StopReason,
    ) -> Result<(SessionGuard<S>, Option<Arc<S>>), Refusal> {
        if !self.stop(run, reason).await {
            let message = format!("the session that plays run {run} does not end; try again");
            return Err(Refusal::new(Reason::NoCapacity, message).retry_after(10));
        }
        // Superseded during Resumed: several connections may wait for the same session, some to resume, some to start over. The
        // lock decides who enters first. A connection that starts over closes a session that was handed over to another; the
        // loser then stops the winner, or is refused if both arrived in the same moment.
        self.claim(run, team)
    }

    /// Stops a run's session and waits until open episodes are stored. Returns false if that takes too long.
    pub(crate) async fn stop(&self, run: &str, reason: StopReason) -> bool {
        let deadline = Instant::now() + self.limits.handover;
        // A loop, because another connection may enter between the end of the session and this check.
        while let Some(over) = self.request_stop(run, reason) {
            if timeout_at(deadline, over.wait_until(|is_over| *is_over)).await.is_err() {
                return false;
            }
        }
        true
    }

    fn request_stop(&self, run: &str, reason: StopReason) -> Option<Arc<Shared<bool>>> {
        let entries = self.entries.lock();
        let entry = entries.by_run.get(run)?;
        entry.stop(reason);
        Some(entry.over.clone())
    }

    fn claim(self: &Arc<Self>, run: &str, team: &str) -> Result<(SessionGuard<S>, Option<Arc<S>>), Refusal> {
        let mut entries = self.entries.lock();
        // Under the same lock as `shut`: either this call is refused, or `shut` finds the entry and stops it.
        self.check_open()?;
        if entries.by_run.contains_key(run) {
            let message = format!("another connection takes run {run} over at the same time");
            return Err(Refusal::new(Reason::Superseded, message));
        }
        entries.check_place(run, team, self.limits.max_sessions)?;
        entries.guards += 1;
        let number = entries.guards;
        let (sender, attachment) = watch::channel(Attachment::Admitted);
        let (stop_wanted, over) = (Arc::<Shared<bool>>::default(), Arc::<Shared<bool>>::default());
        let entry = SessionEntry {
            guard: number,
            team: team.to_owned(),
            slots: 0,
            attachment: sender,
            stop_wanted: stop_wanted.clone(),
            over: over.clone(),
            unary: None,
        };
        entries.by_run.insert(run.to_owned(), entry);
        self.summary.modify(|summary| summary.sessions = entries.by_run.len());
        let session = entries.handed_over.remove(run).map(|waiting| waiting.session);
        let guard = SessionGuard {
            run: run.to_owned(),
            attachment,
            number,
            registry: self.clone(),
            stop_wanted,
            over,
        };
        Ok((guard, session))
    }

    /// Returns a run token's unary client, unless the session ends.
    pub(crate) fn unary_client(&self, token: &str) -> Option<Arc<UnaryClient<S>>> {
        let entries = self.entries.lock();
        let entry = entries.by_run.get(entries.run_of_token.get(token)?)?;
        entry.unary.clone().filter(|_| *entry.attachment.borrow() == Attachment::Unary)
    }

    /// Removes the session that guard number `guard` handed over, if no connection took it.
    pub(crate) fn take_unclaimed(&self, run: &str, guard: u64) -> Option<Arc<S>> {
        // The session does not identify the hand-over: one session passes through several, and a late call for an earlier
        // hand-over must not remove it.
        let mut entries = self.entries.lock();
        let is_unclaimed = entries.handed_over.get(run).is_some_and(|waiting| waiting.guard == guard);
        if is_unclaimed { entries.handed_over.remove(run).map(|waiting| waiting.session) } else { None }
    }

    /// Admits no further session, stops all, and waits until they are over. Returns sessions between two connections.
    pub(crate) async fn shut(&self) -> Vec<Arc<S>> {
        {
            let entries = self.entries.lock();
            self.summary.modify(|summary| summary.is_shut = true);
            for entry in entries.by_run.values() {
                entry.stop(StopReason::Draining);
            }
        }
        self.summary.wait_until(|summary| summary.sessions == 0).await;
        // The connections that would have resumed these sessions are refused from now on.
        let unclaimed = std::mem::take(&mut self.entries.lock().handed_over);
        unclaimed.into_values().map(|waiting| waiting.session).collect()
    }
}

impl<S> SessionEntry<S> {
    fn stop(&self, reason: StopReason) {
        self.apply(AttachmentEvent::Stopped(reason));
        self.stop_wanted.set(true);
    }

    fn apply(&self, event: AttachmentEvent) {
        self.attachment.send_if_modified(|attachment| {
            let next = attachment.next(event);
            std::mem::replace(attachment, next) != next
        });
    }
}

impl<S> SessionEntries<S> {
    /// Refuses a session if all are in use, or the team has its share.
    fn check_place(&self, run: &str, team: &str, all: usize) -> Result<(), Refusal> {
        // A session between two connections keeps its place. Otherwise, a team could fill the places of its sessions while they are
        // handed over.
        let waiting = self.handed_over.iter().filter(|(id, _)| *id != run && !self.by_run.contains_key(*id));
        let teams = self.by_run.values().map(|entry| &entry.team).chain(waiting.map(|(_, held)| &held.team));
        let (own, others): (Vec<_>, Vec<_>) = teams.partition(|held| *held == team);
        let (own, others) = (own.len(), others.len());
        let is_resumed = self.handed_over.contains_key(run);
        let refused = |message| Err(Refusal::new(Reason::NoCapacity, message).retry_after(60));
        if own + others >= all {
            return refused(format!("all {all} sessions of the server are in use"));
        }
        let share = fair_share(all, others);
        if !team.is_empty() && !is_resumed && own >= share {
            return refused(format!(
                "the team has {own} sessions, and its share is {share} of the server's {all}; end a run of the team first"
            ));
        }
        Ok(())
    }

    /// Returns a team's free slots for another session. Active teams have equal shares of `all`.
    fn share(&self, team: &str, all: u32) -> u32 {
        let playing = self.by_run.values().filter(|entry| entry.slots > 0).map(|entry| entry.team.as_str());
        let teams = playing.chain([team]).collect::<BTreeSet<_>>().len() as u32;
        let own = self.by_run.values().filter(|entry| entry.team == team).map(|entry| entry.slots).sum();
        (all / teams).saturating_sub(own)
    }
}

impl<S> SessionGuard<S> {
    /// Grants slots: `wished`, up to the team's share, but at least 1 and at least the `held` slots with open episodes.
    pub(crate) fn take_slots(&self, wished: u32, held: u32) -> u32 {
        let mut entries = self.registry.entries.lock();
        let team = entries.by_run.get(&self.run).map(|entry| entry.team.clone()).unwrap_or_default();
        let share = entries.share(&team, self.registry.limits.max_slots);
        let granted = wished.min(share).max(held).max(1);
        if let Some(entry) = entries.by_run.get_mut(&self.run) {
            entry.slots = granted;
        }
        granted
    }

    /// Sets the team of a session that was claimed without one.
    pub(crate) fn set_team(&self, team: &str) {
        if let Some(entry) = self.registry.entries.lock().by_run.get_mut(&self.run) {
            entry.team = team.to_owned();
        }
    }

    pub(crate) fn apply(&self, event: AttachmentEvent) {
        if let Some(entry) = self.registry.entries.lock().by_run.get(&self.run) {
            entry.apply(event);
        }
    }

    /// Records the attachment's end and returns the effective reason: an earlier stop by another party wins.
    pub(crate) fn ends(&self, reason: StopReason) -> StopReason {
        if reason.ending() != Ending::Detach {
            self.apply(AttachmentEvent::Stopped(reason));
        }
        self.attachment.borrow().stop_reason().unwrap_or(reason)
    }

    /// Makes the session available to unary calls with this token.
    pub(crate) fn attach_unary(&self, token: &str, client: Arc<UnaryClient<S>>) {
        let mut entries = self.registry.entries.lock();
        entries.run_of_token.insert(token.to_owned(), self.run.clone());
        if let Some(entry) = entries.by_run.get_mut(&self.run) {
            entry.unary = Some(client);
            entry.apply(AttachmentEvent::UnaryAttached);
        }
    }

    /// Leaves the session to the next connection that enters the run, and returns the number of this guard.
    pub(crate) fn hand_over(self, session: Arc<S>) -> u64 {
        let guard = self.number;
        let mut entries = self.registry.entries.lock();
        let team = entries.by_run.get(&self.run).map(|entry| entry.team.clone()).unwrap_or_default();
        // Before the guard is dropped, which wakes that connection.
        entries.handed_over.insert(self.run.clone(), HandedOver { guard, team, session });
        drop(entries);
        guard
    }

    /// Returns a future that waits until another party wants the session to end.
    pub(crate) fn stop_wanted(&self) -> impl Future<Output = ()> + use<S> {
        let wanted = self.stop_wanted.clone();
        async move { wanted.wait_until(|is_wanted| *is_wanted).await }
    }

    pub(crate) async fn stopped(&mut self) -> StopReason {
        let closing = self.attachment.wait_for(|attachment| attachment.stop_reason().is_some()).await;
        // The sender lives in the registry as long as this guard. Draining would lose no episode.
        closing.ok().and_then(|attachment| attachment.stop_reason()).unwrap_or(StopReason::Draining)
    }
}

impl<S> Drop for SessionGuard<S> {
    fn drop(&mut self) {
        let mut entries = self.registry.entries.lock();
        if entries.by_run.get(&self.run).is_some_and(|entry| entry.guard == self.number) {
            entries.by_run.remove(&self.run);
            entries.run_of_token.retain(|_, run| *run != self.run);
        }
        self.registry.summary.modify(|summary| summary.sessions = entries.by_run.len());
        drop(entries);
        self.over.set(true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn registry(max_sessions: usize) -> Arc<SessionRegistry<()>> {
        SessionRegistry::new(Arc::new(Limits { max_sessions, ..Limits::default() }))
    }

    #[tokio::test]
    async fn a_second_connection_waits_for_the_first() {
        let registry = registry(4);
        let (mut first, _) = registry.enter("run_a", "red", StopReason::Superseded).await.unwrap();
        let second = tokio::spawn({
            let registry = registry.clone();
            async move { registry.enter("run_a", "red", StopReason::Superseded).await }
        });
        assert_eq!(first.stopped().await, StopReason::Superseded);
        assert!(!second.is_finished());
        assert_eq!(first.ends(StopReason::Goodbye), StopReason::Superseded, "the first reason wins");
        drop(first);
        let (second, _) = second.await.unwrap().unwrap();
        assert_eq!(*second.attachment.borrow(), Attachment::Admitted);
    }

    #[tokio::test(start_paused = true)]
    async fn waiting_for_a_stuck_session_is_bounded() {
        let registry = registry(4);
        let _first = registry.enter("run_a", "red", StopReason::Superseded).await.unwrap();
        let before = Instant::now();
        let refused = registry.enter("run_a", "red", StopReason::Superseded).await.err().unwrap();
        assert_eq!(refused.reason, Reason::NoCapacity);
        assert_eq!(before.elapsed(), Duration::from_secs(30));
    }

    #[tokio::test]
    async fn teams_share_slots() {
        let registry = SessionRegistry::<()>::new(Arc::new(Limits { max_slots: 32, ..Limits::default() }));
        let enter = async |run, team| registry.enter(run, team, StopReason::Superseded).await.unwrap().0;
        let (greedy, more) = (enter("run_a", "red").await, enter("run_b", "red").await);
        assert_eq!(greedy.take_slots(20, 0), 20);
        assert_eq!(more.take_slots(20, 0), 12, "a team's share does not depend on its run count");
        let other = enter("run_c", "blue").await;
        assert_eq!(other.take_slots(64, 0), 16, "half of all");
        let late = enter("run_d", "red").await;
        assert_eq!(late.take_slots(4, 0), 1, "at least one per session");
        assert_eq!(late.take_slots(4, 3), 3, "at least the slots with open episodes");
        drop((greedy, more, late));
        let again = enter("run_a", "red").await;
        assert_eq!(again.take_slots(64, 0), 16);
    }

    /// Enters runs of a team until a refusal. Returns the guards and the refusal.
    async fn fill(registry: &Arc<SessionRegistry<()>>, team: &str) -> (Vec<SessionGuard<()>>, Refusal) {
        let mut guards = Vec::new();
        loop {
            let run = format!("run_{team}_{}", guards.len());
            match registry.enter(&run, team, StopReason::Superseded).await {
                Ok((guard, _)) => guards.push(guard),
                Err(refused) => return (guards, refused),
            }
        }
    }

    #[tokio::test]
    async fn teams_leave_half_of_the_sessions() {
        let registry = registry(8);
        let (red, refused) = fill(&registry, "red").await;
        assert_eq!((red.len(), refused.reason, refused.retry_after_s), (4, Reason::NoCapacity, Some(60)));
        assert!(refused.message.contains("share is 4 of the server's 8"), "{refused}");
        let (blue, _) = fill(&registry, "blue").await;
        let (green, _) = fill(&registry, "green").await;
        let (late, refused) = fill(&registry, "late").await;
        assert_eq!((blue.len(), green.len(), late.len()), (2, 1, 1), "a new team gets the last place");
        assert!(refused.message.contains("all 8 sessions"), "{refused}");
        drop((blue, green, late));
        assert_eq!(fill(&registry, "blue").await.0.len(), 2, "ended sessions no longer count");
    }

    #[tokio::test]
    async fn sessions_handed_over_keep_their_places() {
        let registry = registry(4);
        let (mut red, _) = fill(&registry, "red").await;
        let run = red[0].run.clone();
        red.remove(0).hand_over(Arc::new(()));
        let refused = registry.enter("run_more", "red", StopReason::Superseded).await.err().unwrap();
        assert_eq!(refused.reason, Reason::NoCapacity, "the handed over session counts");
        let (_blue, _) = fill(&registry, "blue").await;
        let (_green, _) = fill(&registry, "green").await;
        let (_, resumed) = registry.enter(&run, "red", StopReason::Resumed).await.unwrap();
        assert!(resumed.is_some(), "a smaller share ends no session");
    }

    #[tokio::test]
    async fn interrupted_runs_get_their_team_later() {
        let registry = registry(4);
        let enter = async |run, team| registry.enter(run, team, StopReason::Resumed).await;
        let mut guards = Vec::new();
        for run in ["run_a", "run_b", "run_c"] {
            guards.push(enter(run, "").await.unwrap().0);
        }
        guards[0].set_team("red");
        assert!(enter("run_d", "red").await.is_err(), "the team has its share");
        let _new = enter("run_e", "blue").await.unwrap();
        assert!(enter("run_f", "").await.is_err(), "the server is full");
    }

    #[tokio::test]
    async fn late_cleanup_spares_sessions_handed_over_again() {
        let registry = registry(4);
        let session = Arc::new(());
        let (first, _) = registry.enter("run_a", "red", StopReason::Resumed).await.unwrap();
        let earlier = first.hand_over(session.clone());
        let (second, resumed) = registry.enter("run_a", "red", StopReason::Resumed).await.unwrap();
        assert!(resumed.is_some_and(|resumed| Arc::ptr_eq(&resumed, &session)));
        let later = second.hand_over(session);
        assert!(registry.take_unclaimed("run_a", earlier).is_none(), "the earlier hand-over was claimed");
        assert!(registry.take_unclaimed("run_a", later).is_some());
    }

    #[tokio::test]
    async fn full_and_closed_registries_refuse() {
        let registry = registry(1);
        let (mut first, _) = registry.enter("run_a", "red", StopReason::Superseded).await.unwrap();
        let refused = registry.enter("run_b", "blue", StopReason::Superseded).await.err().unwrap();
        assert_eq!(refused.reason, Reason::NoCapacity);
        let shutting = tokio::spawn({
            let registry = registry.clone();
            async move { registry.shut().await }
        });
        assert_eq!(first.stopped().await, StopReason::Draining);
        drop(first);
        shutting.await.unwrap();
        let refused = registry.enter("run_b", "blue", StopReason::Superseded).await.err().unwrap();
        assert_eq!(refused.reason, Reason::Draining);
    }
}
