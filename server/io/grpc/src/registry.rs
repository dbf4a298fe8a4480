//! Session registry: at most one session per run, a bound on all sessions, and their attachments.

use crate::{
    attachment::{Attachment, AttachmentEvent, Ending, StopReason},
    limits::Limits,
    refusal::Refusal,
};
use avln_proto::v1::{self, Reason};
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
    summary: watch::Sender<RegistrySummary>,
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
    session: Arc<S>,
}

struct SessionEntry<S> {
    guard: u64,
    team: String,
    slots: u32,
    attachment: watch::Sender<Attachment>,
    /// Closed when the guard is dropped.
    over: watch::Receiver<()>,
    unary: Option<Arc<UnaryClient<S>>>,
}

pub(crate) struct UnaryClient<S> {
    pub(crate) session: Arc<S>,
    pub(crate) welcome: v1::Welcome,
    pub(crate) last_call: watch::Sender<Instant>,
}

/// Exclusive right to play a run, until it is dropped.
pub(crate) struct SessionGuard<S> {
    pub(crate) run: String,
    attachment: watch::Receiver<Attachment>,
    number: u64,
    registry: Arc<SessionRegistry<S>>,
    _over: watch::Sender<()>,
}

impl<S> SessionRegistry<S> {
    pub(crate) fn new(limits: Arc<Limits>) -> Arc<Self> {
        let entries = SessionEntries {
            by_run: BTreeMap::new(),
            run_of_token: HashMap::new(),
            handed_over: BTreeMap::new(),
            guards: 0,
        };
        Arc::new(Self { entries: Mutex::new(entries), summary: watch::Sender::default(), limits })
    }

    pub(crate) fn is_shut(&self) -> bool {
        self.summary.borrow().is_shut
    }

    pub(crate) async fn shutting(&self) {
        // The sender lives in self, so waiting cannot fail.
        let _ = self.summary.subscribe().wait_for(|summary| summary.is_shut).await;
    }

    /// Refuses new work while the server stops.
    pub(crate) fn check_open(&self) -> Result<(), Refusal> {
        if !self.is_shut() {
            return Ok(());
        }
        let message = "the server is about to stop; connect again when it is back";
        Err(Refusal::new(Reason::Draining, message).retry_after(30))
    }

    /// Stops a run's present session and returns the right to play, with the previous session if that was handed over.
    pub(crate) async fn enter(
        self: &Arc<Self>,
        run: &str,
        reason: StopReason,
    ) -> Result<(SessionGuard<S>, Option<Arc<S>>), Refusal> {
        if !self.stop(run, reason).await {
            let message = format!("the session that plays run {run} does not end; try again");
            return Err(Refusal::new(Reason::NoCapacity, message).retry_after(10));
        }
        // Superseded during Resumed: several connections may wait for the same session, some to resume, some to start over. The
        // lock decides who enters first. A connection that starts over closes a session that was handed over to another; the
        // loser then stops the winner, or is refused if both arrived in the same moment.
        self.claim(run)
    }

    /// Stops a run's session and waits until open episodes are stored. Returns false if that takes too long.
    pub(crate) async fn stop(&self, run: &str, reason: StopReason) -> bool {
        let deadline = Instant::now() + self.limits.handover;
        // A loop, because another connection may enter between the end of the session and this check.
        while let Some(mut over) = self.request_stop(run, reason) {
            if timeout_at(deadline, over.changed()).await.is_err() {
                return false;
            }
        }
        true
    }

    fn request_stop(&self, run: &str, reason: StopReason) -> Option<watch::Receiver<()>> {
        let entries = self.entries.lock();
        let entry = entries.by_run.get(run)?;
        entry.apply(AttachmentEvent::Stopped(reason));
        Some(entry.over.clone())
    }

    fn claim(self: &Arc<Self>, run: &str) -> Result<(SessionGuard<S>, Option<Arc<S>>), Refusal> {
        let mut entries = self.entries.lock();
        // Under the same lock as `shut`: either this call is refused, or `shut` finds the entry and stops it.
        self.check_open()?;
        if entries.by_run.contains_key(run) {
            let message = format!("another connection takes run {run} over at the same time");
            return Err(Refusal::new(Reason::Superseded, message));
        }
        if entries.by_run.len() >= self.limits.max_sessions {
            let message = format!("all {} sessions of the server are in use", self.limits.max_sessions);
            return Err(Refusal::new(Reason::NoCapacity, message).retry_after(60));
        }
        entries.guards += 1;
        let number = entries.guards;
        let (sender, attachment) = watch::channel(Attachment::Admitted);
        let (over, ended) = watch::channel(());
        let entry = SessionEntry {
            guard: number,
            team: String::new(),
            slots: 0,
            attachment: sender,
            over: ended,
            unary: None,
        };
        entries.by_run.insert(run.to_owned(), entry);
        self.summary.send_modify(|summary| summary.sessions = entries.by_run.len());
        let session = entries.handed_over.remove(run).map(|waiting| waiting.session);
        let guard =
            SessionGuard { run: run.to_owned(), attachment, number, registry: self.clone(), _over: over };
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
            self.summary.send_modify(|summary| summary.is_shut = true);
            for entry in entries.by_run.values() {
                entry.apply(AttachmentEvent::Stopped(StopReason::Draining));
            }
        }
        // The sender lives in self, so waiting cannot fail.
        let _ = self.summary.subscribe().wait_for(|summary| summary.sessions == 0).await;
        // The connections that would have resumed these sessions are refused from now on.
        let unclaimed = std::mem::take(&mut self.entries.lock().handed_over);
        unclaimed.into_values().map(|waiting| waiting.session).collect()
    }
}

impl<S> SessionEntry<S> {
    fn apply(&self, event: AttachmentEvent) {
        self.attachment.send_if_modified(|attachment| {
            let next = attachment.next(event);
            std::mem::replace(attachment, next) != next
        });
    }
}

impl<S> SessionEntries<S> {
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
    pub(crate) fn take_slots(&self, team: &str, wished: u32, held: u32) -> u32 {
        let mut entries = self.registry.entries.lock();
        let share = entries.share(team, self.registry.limits.max_slots);
        let granted = wished.min(share).max(held).max(1);
        if let Some(entry) = entries.by_run.get_mut(&self.run) {
            entry.team = team.to_owned();
            entry.slots = granted;
        }
        granted
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
        // Before the guard is dropped, which wakes that connection.
        self.registry.entries.lock().handed_over.insert(self.run.clone(), HandedOver { guard, session });
        guard
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
        self.registry.summary.send_modify(|summary| summary.sessions = entries.by_run.len());
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
        let (mut first, _) = registry.enter("run_a", StopReason::Superseded).await.unwrap();
        let second = tokio::spawn({
            let registry = registry.clone();
            async move { registry.enter("run_a", StopReason::Superseded).await }
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
        let _first = registry.enter("run_a", StopReason::Superseded).await.unwrap();
        let before = Instant::now();
        let refused = registry.enter("run_a", StopReason::Superseded).await.err().unwrap();
        assert_eq!(refused.reason, Reason::NoCapacity);
        assert_eq!(before.elapsed(), Duration::from_secs(30));
    }

    #[tokio::test]
    async fn teams_share_slots() {
        let registry = SessionRegistry::<()>::new(Arc::new(Limits { max_slots: 32, ..Limits::default() }));
        let enter = async |run| registry.enter(run, StopReason::Superseded).await.unwrap().0;
        let (greedy, more) = (enter("run_a").await, enter("run_b").await);
        assert_eq!(greedy.take_slots("red", 20, 0), 20);
        assert_eq!(more.take_slots("red", 20, 0), 12, "a team's share does not depend on its run count");
        let other = enter("run_c").await;
        assert_eq!(other.take_slots("blue", 64, 0), 16, "half of all");
        let late = enter("run_d").await;
        assert_eq!(late.take_slots("red", 4, 0), 1, "at least one per session");
        assert_eq!(late.take_slots("red", 4, 3), 3, "at least the slots with open episodes");
        drop((greedy, more, late));
        let again = enter("run_a").await;
        assert_eq!(again.take_slots("red", 64, 0), 16);
    }

    #[tokio::test]
    async fn late_cleanup_spares_sessions_handed_over_again() {
        let registry = registry(4);
        let session = Arc::new(());
        let (first, _) = registry.enter("run_a", StopReason::Resumed).await.unwrap();
        let earlier = first.hand_over(session.clone());
        let (second, resumed) = registry.enter("run_a", StopReason::Resumed).await.unwrap();
        assert!(resumed.is_some_and(|resumed| Arc::ptr_eq(&resumed, &session)));
        let later = second.hand_over(session);
        assert!(registry.take_unclaimed("run_a", earlier).is_none(), "the earlier hand-over was claimed");
        assert!(registry.take_unclaimed("run_a", later).is_some());
    }

    #[tokio::test]
    async fn full_and_closed_registries_refuse() {
        let registry = registry(1);
        let (mut first, _) = registry.enter("run_a", StopReason::Superseded).await.unwrap();
        let refused = registry.enter("run_b", StopReason::Superseded).await.err().unwrap();
        assert_eq!(refused.reason, Reason::NoCapacity);
        let shutting = tokio::spawn({
            let registry = registry.clone();
            async move { registry.shut().await }
        });
        assert_eq!(first.stopped().await, StopReason::Draining);
        drop(first);
        shutting.await.unwrap();
        let refused = registry.enter("run_b", StopReason::Superseded).await.err().unwrap();
        assert_eq!(refused.reason, Reason::Draining);
    }
}
