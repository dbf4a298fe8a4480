//! Management actions, sign-in and sessions. Teams manage their own tokens and runs, organisers everything. The arena implements
//! [`Management`]; this module decides permissions.

mod form;
mod sessions;
mod sign_in_limit;

pub(crate) use form::{FormFields, MAX_FORM_BYTES, SignInForm, SignedForm};
pub(crate) use sessions::{
    Organiser, Sessions, SignedIn, expired_cookie, has_session_cookie, identify, is_management_page,
    session_cookie,
};
pub(crate) use sign_in_limit::SignInLimiter;

use std::{fmt, sync::Arc};

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

/// A team's action on its data.
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
    /// Revokes a token.
    RevokeToken {
        /// Public token id.
        id: String,
    },
    /// Cancels a run.
    CancelRun {
        /// Run id.
        run: String,
    },
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
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum OrganiserAction {
    /// Admits a team if it is new, and creates an account token for it.
    Admit {
        /// Public team name.
        team: String,
    },
    /// Approves a team for a phase that requires approval, or withdraws the approval.
    Approve {
        /// Team name.
        team: String,
        /// Phase id.
        phase: String,
        /// True if the team may play.
        approved: bool,
    },
    /// Grants a team runs beyond its quota; requires a reason.
    Grant {
        /// Team name.
        team: String,
        /// Phase id.
        phase: String,
        /// Run count, at least 1.
        runs: u32,
    },
    /// Stops new runs in a phase for now; requires a reason, which is public.
    Pause(String),
    /// Allows new runs in a phase that was paused or closed manually.
    Resume(String),
    /// Stops new runs in a phase.
    Close(String),
    /// Publishes a closed phase's committed secrets.
    Reveal(String),
    /// Marks a run as verified, or removes the mark.
    Verify {
        /// Run id.
        run: String,
        /// True if the run is verified.
        verified: bool,
    },
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
    /// The server failed; the message is for its log.
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
    /// Executes a team action.
    ///
    /// # Errors
    /// If the action is refused or fails.
    async fn team_action(
        &self,
        team: TeamCredential,
        action: TeamAction,
    ) -> Result<ActionOutcome, ActionError>;

    /// Executes an organiser action.
    ///
    /// # Errors
    /// If the action is refused or fails.
    async fn organiser_action(
        &self,
        origin: ActionOrigin,
        action: OrganiserAction,
    ) -> Result<ActionOutcome, ActionError>;

    /// Returns the server's current health.
    fn health(&self) -> ServerHealth;
}

/// Management actions with sessions and the sign-in limit.
#[derive(Debug)]
pub(crate) struct ManagementState {
    pub(crate) actions: Arc<dyn Management>,
    pub(crate) sessions: Sessions,
    pub(crate) sign_in_limiter: SignInLimiter,
    /// True if the server uses TLS.
    pub(crate) is_secure: bool,
}

impl ManagementState {
    pub(crate) fn new(actions: Arc<dyn Management>, is_secure: bool) -> Self {
        Self { actions, sessions: Sessions::default(), sign_in_limiter: SignInLimiter::default(), is_secure }
    }
}
