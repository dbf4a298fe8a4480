//! Management by teams (own tokens and runs) and organisers. The arena implements [`Management`]; permissions are decided here.

mod form;
mod sessions;

pub(crate) use form::{FormFields, MAX_FORM_BYTES, SignInForm, SignedForm};
pub(crate) use sessions::{
    Sessions, SignedIn, has_session_cookie, identify, is_management_page, session_cookie,
};

use crate::server::ClientAddress;
use std::{
    collections::BTreeMap,
    fmt,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
    time::{Duration, Instant},
};

/// The team token behind an action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TeamCredential {
    /// Team name.
    pub team: String,
    /// Public token id.
    pub token: String,
    /// Token expiry time, milliseconds since 1970-01-01 UTC; `None` if it never expires.
    pub expires_unix_ms: Option<i64>,
}

/// A team's action.
#[expect(missing_docs, reason = "the documentation of a variant explains the fields")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TeamAction {
    /// Creates a token, which expires no later than the token used to sign in.
    IssueToken {
        /// Token name; may be empty.
        name: String,
        /// True if the token only grants read access.
        looks_only: bool,
        /// Lifetime, days; `None` for the longest possible one.
        days: Option<u32>,
    },
    /// Revokes the token with a public id.
    RevokeToken { id: String },
    /// Cancels a run.
    CancelRun { run: String },
}

/// The token and the reason behind an organiser action, for the audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ActionOrigin {
    /// The organiser token's public id.
    pub token: String,
    /// Reason; may be empty unless the action requires one.
    pub reason: String,
}

/// An organiser's action.
#[expect(missing_docs, reason = "the documentation of a variant explains the fields")]
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OrganiserAction {
    /// Admits a team if it is new, and creates an account token for it.
    Admit { team: String },
    /// Approves a team for a phase that requires approval, or withdraws the approval.
    Approve { team: String, phase: String, approved: bool },
    /// Grants a team runs beyond the quota, at least 1; requires a reason.
    Grant { team: String, phase: String, runs: u32 },
    /// Stops new runs in a phase for now; requires a reason, which is public.
    Pause(String),
    /// Allows new runs in a phase that was paused or closed manually.
    Resume(String),
    /// Stops new runs in a phase.
    Close(String),
    /// Publishes a closed phase's committed secrets.
    Reveal(String),
    /// Marks a run as verified, or removes the mark.
    Verify { run: String, verified: bool },
    /// Removes a run from all leaderboards; the reason is public.
    Disqualify(String),
    /// Returns a disqualified run to the leaderboards.
    Reinstate(String),
}

/// Action outcome.
#[derive(Clone, Default, PartialEq, Eq)]
pub struct ActionOutcome {
    /// Confirmation for the visitor.
    pub message: String,
    /// A new token, shown once and never stored.
    pub secret: Option<String>,
}

impl fmt::Debug for ActionOutcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ActionOutcome").field("message", &self.message).finish_non_exhaustive()
    }
}

/// Cause of a failed action.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ActionError {
    /// The action is not possible; the message is for the visitor.
    #[error("{0}")]
    Refused(String),
    /// The server failed; the message is for the log.
    #[error("{0}")]
    Failed(String),
}

/// A running server's health.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ServerHealth {
    /// Drain reason while draining.
    pub draining: Option<String>,
    /// Announcement; empty if there is none.
    pub notice: String,
    /// Slots with an open episode: run, slot number, steps.
    pub slots: Vec<(String, u32, u32)>,
    /// Steps since the server started.
    pub steps: u64,
    /// Memory for loaded scenes, bytes.
    pub scene_bytes: usize,
    /// Simulation threads that hang.
    pub hanging: usize,
    /// Internal errors since the server started.
    pub faults: u64,
}

/// Management actions, implemented by a running arena. Each action writes a line to the audit log.
#[async_trait::async_trait]
pub trait Management: fmt::Debug + Send + Sync {
    /// Executes a team action. Fails if it is refused or the server fails.
    async fn team_action(
        &self,
        team: TeamCredential,
        action: TeamAction,
    ) -> Result<ActionOutcome, ActionError>;
    /// Executes an organiser action. Fails if it is refused or the server fails.
    async fn organiser_action(
        &self,
        origin: ActionOrigin,
        action: OrganiserAction,
    ) -> Result<ActionOutcome, ActionError>;
    /// Returns the server's current health.
    fn health(&self) -> ServerHealth;
}

#[derive(Debug)]
pub(crate) struct ManagementState {
    pub(crate) actions: Arc<dyn Management>,
    pub(crate) sessions: Sessions,
    pub(crate) sign_in_limiter: SignInLimiter,
    pub(crate) is_secure: bool,
    /// Canonical origin of the pages; `None` for the host in a request.
    pub(crate) origin: Option<String>,
}

impl ManagementState {
    pub(crate) fn new(actions: Arc<dyn Management>, is_secure: bool, origin: Option<String>) -> Self {
        let (sessions, sign_in_limiter) = (Sessions::default(), SignInLimiter::default());
        Self { actions, sessions, sign_in_limiter, is_secure, origin }
    }
}

// Consecutive failures before an address must wait; people do paste a wrong token a few times.
const MAX_FAILURES: u32 = 10;
const WAIT: Duration = Duration::from_secs(60);
// Bounds the memory: beyond it, the oldest failure is forgotten.
const MAX_CLIENTS: usize = 4096;

/// Failed sign-ins by client address: count and last time. `None`: requests without an address.
#[derive(Debug, Default)]
pub(crate) struct SignInLimiter(Mutex<BTreeMap<Option<ClientAddress>, (u32, Instant)>>);

impl SignInLimiter {
    fn failures(&self) -> MutexGuard<'_, BTreeMap<Option<ClientAddress>, (u32, Instant)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn may_try(&self, client: Option<ClientAddress>, now: Instant) -> bool {
        let failures = self.failures();
        let must_wait = |&(failed, last): &(u32, Instant)| {
            failed >= MAX_FAILURES && now.saturating_duration_since(last) < WAIT
        };
        !failures.get(&client).is_some_and(must_wait)
    }

    pub(crate) fn record_failure(&self, client: Option<ClientAddress>, now: Instant) {
        let mut failures = self.failures();
        failures.retain(|_, (_, last)| now.saturating_duration_since(*last) < WAIT);
        if failures.len() >= MAX_CLIENTS && !failures.contains_key(&client) {
            let oldest = failures.iter().min_by_key(|(_, (_, last))| *last).map(|(client, _)| *client);
            if let Some(oldest) = oldest {
                failures.remove(&oldest);
            }
        }
        let entry = failures.entry(client).or_insert((0, now));
        *entry = (entry.0.saturating_add(1), now);
    }

    pub(crate) fn record_success(&self, client: Option<ClientAddress>) {
        self.failures().remove(&client);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::IpAddr;

    fn client(text: &str) -> Option<ClientAddress> {
        Some(ClientAddress::new(text.parse().expect("an address")))
    }

    #[test]
    fn only_the_failing_client_waits() {
        let (limiter, start) = (SignInLimiter::default(), Instant::now());
        for _ in 0..MAX_FAILURES {
            assert!(limiter.may_try(client("192.0.2.1"), start));
            limiter.record_failure(client("192.0.2.1"), start);
        }
        assert!(!limiter.may_try(client("192.0.2.1"), start));
        assert!(!limiter.may_try(client("::ffff:192.0.2.1"), start), "the same address");
        assert!(limiter.may_try(client("192.0.2.2"), start) && limiter.may_try(None, start));
        assert!(limiter.may_try(client("192.0.2.1"), start + WAIT));
        limiter.record_success(client("192.0.2.1"));
        assert!(limiter.may_try(client("192.0.2.1"), start));
    }

    #[test]
    fn ipv6_network_counts_as_one_client() {
        assert_eq!(client("2001:db8::1"), client("2001:db8::ffff"));
        assert_ne!(client("2001:db8::1"), client("2001:db8:0:1::1"));
        let (limiter, start) = (SignInLimiter::default(), Instant::now());
        for index in 0..=MAX_CLIENTS as u32 {
            let address = ClientAddress::new(IpAddr::from(index.to_be_bytes()));
            limiter.record_failure(Some(address), start + Duration::from_micros(u64::from(index)));
        }
        assert_eq!(limiter.failures().len(), MAX_CLIENTS);
        assert!(!limiter.failures().contains_key(&client("0.0.0.0")), "the oldest was forgotten");
    }
}
