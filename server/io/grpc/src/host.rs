//! The interface between the gRPC server and the application behind it.

use crate::{
    control::Control,
    episode::{Episode, HostedEpisode, Restored},
    limits::Limits,
    refusal::Refusal,
};
use avln_challenge::{Account, EpisodeOutcome, MethodInfo, PhaseInfo, Quota, RunState, RunStatus};
use avln_episode::{EndReason, Order, Rules, Sensors, TimeLimits};
use std::time::Duration;

/// The application behind the gRPC server. `Arena` implements it.
///
/// Methods are called concurrently. A panic ends only its call, with a server fault. Heavy work belongs on a blocking thread.
#[tonic::async_trait]
pub trait Host: Send + Sync + 'static {
    /// Running episode of this application.
    type Episode: Episode;

    /// Returns the identity of the server.
    fn info(&self) -> ServerInfo;

    /// Returns the operator's controls, if there is an operator.
    fn control(&self) -> Option<&Control> {
        None
    }

    /// Returns the phases visible to the account's team, or the public ones without an account.
    async fn phases(&self, account: Option<&Account>) -> Result<Vec<PhaseInfo>, Refusal>;

    /// Returns the account of a token: a team's, a read-only one, or an organiser's.
    async fn account(&self, token: &str) -> Result<Account, Refusal>;

    /// Starts a run, or returns the run of an earlier request with the same `client_request_id`.
    async fn start_run(&self, account: &Account, request: RunRequest) -> Result<RunTicket, Refusal>;

    /// Returns a run of the account's team.
    async fn run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal>;

    /// Returns all runs of the account's team, newest first.
    async fn runs(&self, account: &Account) -> Result<Vec<RunStatus>, Refusal>;

    /// Cancels a run. Scored episodes remain.
    async fn cancel_run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal>;

    /// Returns the quotas of the account's team in one phase, or in all visible ones.
    async fn quotas(&self, account: &Account, phase: Option<&str>) -> Result<Vec<Quota>, Refusal>;

    /// Returns the run of a run token, open or over.
    async fn open_run(&self, run_token: &str) -> Result<OpenRun, Refusal>;

    /// Returns the next episode of the run for a slot; `None` if none is left.
    async fn next_episode(&self, run: &str, slot: u32, sensors: &Sensors) -> Result<Option<HostedEpisode<Self::Episode>>, Refusal>;

    /// Stores an episode. Returns its result if the phase shows results to agents.
    ///
    /// An episode without an end reason broke down and counts as a server fault.
    async fn conclude(&self, run: &str, hosted: HostedEpisode<Self::Episode>) -> Result<Option<EpisodeOutcome>, Refusal>;

    /// Returns the end of an episode; `None` if its result is not stored.
    async fn ended(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal>;

    /// Returns the runs with open episodes at the last stop of the server. Called once, before clients are admitted.
    async fn interrupted(&self) -> Result<Vec<String>, Refusal>;

    /// Restores the open episodes of a run. Episodes that cannot be restored are played again from the start.
    async fn restore(&self, run: &str) -> Result<Interrupted<Self::Episode>, Refusal>;

    /// Closes a run whose agent has finished or left, and returns its status. Later calls change nothing.
    async fn finish_run(&self, run: &str) -> Result<RunStatus, Refusal>;

    /// Takes back an episode whose simulator hangs. It is played again, without charge.
    async fn lose(&self, run: &str, handle: &str, ticket: u64) -> Result<(), Refusal>;

    /// Returns the open runs whose deadline has passed. Called periodically.
    async fn overdue(&self) -> Result<Vec<String>, Refusal>;

    /// Ends a run whose deadline has passed. Its open episodes are concluded afterwards.
    async fn expire_run(&self, run: &str) -> Result<(), Refusal>;
}

/// Identity of the server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Name of the installation.
    pub name: String,
    /// Version of the server.
    pub version: String,
    /// Version of the benchmark: changes whenever a score could change.
    pub benchmark: String,
    /// Minor version of the API `avln.v1`, see `avln_proto::API_MINOR`.
    pub api_minor: u32,
    /// Client libraries with restricted versions. Other libraries are accepted.
    pub clients: Vec<ClientRange>,
}

/// Accepted versions of a client library.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClientRange {
    /// Name of the library.
    pub name: String,
    /// Oldest accepted version, `major.minor.patch`; empty for any.
    pub min_version: String,
    /// Newest accepted version, `major.minor.patch`; empty for any.
    pub max_version: String,
    /// Command that installs an accepted version.
    pub install: String,
}

/// Request to start a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunRequest {
    /// Id of the phase.
    pub phase: String,
    /// Method that plays the run.
    pub method: MethodInfo,
    /// Idempotency key chosen by the client; may be empty.
    pub client_request_id: String,
    /// Order of goals.
    pub order: Order,
}

/// A started run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunTicket {
    /// Id of the run.
    pub run: String,
    /// Bearer token that plays only this run.
    pub token: String,
    /// Episodes of the run.
    pub episodes: u32,
    /// Maximum number of slots.
    pub max_slots: u32,
    /// Time limits of its agent.
    pub time: TimeLimits,
    /// Quota with the fewest remaining runs.
    pub quota: Option<Quota>,
}

/// Run of a run token.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenRun {
    /// Id of the run.
    pub run: String,
    /// Team id. Teams share the capacity of the server.
    pub team: String,
    /// Maximum number of slots.
    pub max_slots: u32,
    /// Rules.
    pub rules: Rules,
    /// Allowed sensors.
    pub sensors: Sensors,
    /// Episodes of the run.
    pub episodes: u32,
    /// Stored episodes.
    pub done: u32,
    /// Whether the organiser runs the agent in a sandbox.
    pub sealed: bool,
    /// Digests of everything that decides scores.
    pub digests: Digests,
    /// Time limits of its agent.
    pub time: TimeLimits,
    /// Deadline, milliseconds since 1970-01-01 UTC.
    pub deadline_unix_ms: Option<i64>,
    /// Final state; `None` while it is open.
    pub over: Option<RunState>,
}

impl OpenRun {
    /// Returns the maximum number of slots of a session.
    pub(crate) fn slot_limit(&self) -> u32 {
        self.max_slots.clamp(1, Limits::MAX_SLOTS)
    }
}

/// A run with open episodes at the last stop of the server.
#[derive(Debug)]
pub struct Interrupted<E> {
    /// The run.
    pub open: OpenRun,
    /// Requested sensors.
    pub sensors: Sensors,
    /// Its open episodes.
    pub episodes: Vec<Restored<E>>,
    /// Time that earlier disconnects used of its allowance.
    pub away: Duration,
}

/// End of a stored episode.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredEnd {
    /// End reason; a server fault if the episode will be played again.
    pub reason: EndReason,
    /// Steps taken.
    pub steps: u32,
    /// Result, if the phase shows it.
    pub outcome: Option<EpisodeOutcome>,
}

/// Hexadecimal digests of everything that decides scores; empty if the phase hides one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Digests {
    /// Simulator.
    pub engine: String,
    /// Scenes and missions.
    pub dataset: String,
    /// Scoring.
    pub scorer: String,
    /// Rules, limits and settings of the phase.
    pub config: String,
}
