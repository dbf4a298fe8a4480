use crate::{
    control::Control,
    episode::{Episode, HostedEpisode, Restored},
    limits::Limits,
    refusal::Refusal,
};
use avln_episode::{EndReason, FeedbackRule, Order, Rules, Sensors, TimeLimits};
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

/// Public description of a phase.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseInfo {
    /// Id.
    pub id: String,
    /// Title for people.
    pub title: String,
    /// Text for people; may be empty.
    pub description: String,
    /// Time limits of agents.
    pub time: TimeLimits,
    /// Playable orders.
    pub orders: Vec<Order>,
    /// Name of the rule set.
    pub rules: String,
    /// Episodes per run.
    pub episode_count: u32,
    /// Feedback to a Submit.
    pub feedback: FeedbackRule,
    /// Maximum number of slots.
    pub max_slots: u32,
    /// Allowed sensors, with the largest width and height.
    pub sensors: Sensors,
    /// Whether runs can be started.
    pub state: PhaseState,
    /// Reason of the state, for people; may be empty.
    pub state_reason: String,
    /// Opening time, seconds since 1970-01-01 UTC; 0 if it has always been open.
    pub opens_unix_s: i64,
    /// Closing time, seconds since 1970-01-01 UTC; 0 if it never closes.
    pub closes_unix_s: i64,
    /// Visibility of results.
    pub results: Visibility,
    /// Whether only agents run by the organiser can play.
    pub sealed: bool,
    /// Commitment published before the phase; empty if none.
    pub commitment: String,
    /// Values behind the commitment, once published.
    pub revealed: Option<Revealed>,
}

/// Visibility of results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// To the organiser.
    Organiser,
    /// To the organiser and the team itself.
    Team,
    /// To the public.
    Public,
}

/// Values behind a phase's commitment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Revealed {
    /// Digest of the episode pool, hex.
    pub pool: String,
    /// Version of the benchmark.
    pub scorer: String,
    /// Key of the draws, hex.
    pub secret: String,
}

/// State of a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhaseState {
    /// Not open yet.
    Upcoming,
    /// Runs can be started.
    Open,
    /// No runs until the organiser resumes it.
    Paused,
    /// Over.
    Closed,
}

/// Account of a caller.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Account {
    /// Team id; empty for an organiser.
    pub team: String,
    /// Permissions of the token.
    pub scope: Scope,
    /// Name of the token; may be empty.
    pub token_name: String,
    /// Expiry time, seconds since 1970-01-01 UTC; 0 if it never expires.
    pub expires_unix_s: i64,
}

/// Permissions of a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Read and write a team's runs.
    Participant,
    /// Read a team's runs.
    ReadOnly,
    /// All permissions.
    Organiser,
}

/// Quota of a team in one window of a phase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quota {
    /// Id of the phase.
    pub phase: String,
    /// Window of time.
    pub window: QuotaWindow,
    /// Granted runs; `None` if unlimited.
    pub limit: Option<u32>,
    /// Counted runs.
    pub used: u32,
    /// Remaining runs; `None` if unlimited.
    pub remaining: Option<u32>,
    /// Start of the window, seconds since 1970-01-01 UTC.
    pub window_start_unix_s: i64,
    /// Time of the next increase of `remaining`, seconds since 1970-01-01 UTC; 0 if it does not depend on time.
    pub next_increase_unix_s: i64,
    /// Counted runs and the reasons, oldest first.
    pub charges: Vec<(String, String)>,
}

/// Window of a quota.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QuotaWindow {
    /// Renewed daily, UTC.
    Day,
    /// Renewed monthly, UTC.
    Month,
    /// Never renewed.
    Total,
    /// Renewed when an open run ends.
    Concurrent,
    /// Not a limit; counts uncharged runs.
    Uncharged,
}

/// Request to start a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunRequest {
    /// Id of the phase.
    pub phase: String,
    /// Name of the method on the leaderboard.
    pub method: String,
    /// Version of the method; may be empty.
    pub method_version: String,
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

/// Status of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStatus {
    /// Id of the run.
    pub run: String,
    /// Id of its phase.
    pub phase: String,
    /// Name of the method.
    pub method: String,
    /// Version of the method; may be empty.
    pub method_version: String,
    /// Order of goals.
    pub order: Order,
    /// State.
    pub state: RunState,
    /// Episodes of the run.
    pub episodes: u32,
    /// Stored episodes.
    pub done: u32,
    /// Open episodes.
    pub in_flight: u32,
    /// Start time, milliseconds since 1970-01-01 UTC.
    pub created_unix_ms: i64,
    /// Time of the last change of state, milliseconds since 1970-01-01 UTC.
    pub updated_unix_ms: i64,
    /// End reasons with the number of episodes, without zeros.
    pub ends: Vec<(EndReason, u32)>,
    /// Names and values of the metrics, in the order of the phase's columns; `None` if the phase hides them.
    pub metrics: Option<Vec<(String, f64)>>,
    /// Rules that exclude it from the ranking; empty if it takes part.
    pub ineligible_because: Vec<String>,
    /// Whether the organiser ran the agent in a sandbox.
    pub sealed: bool,
    /// Whether it counts against the quota of its team.
    pub charged: bool,
    /// Reason for that, for people.
    pub charge_reason: String,
    /// Deadline of an open run, milliseconds since 1970-01-01 UTC.
    pub deadline_unix_ms: Option<i64>,
    /// Path of its web page; may be empty.
    pub url: String,
}

/// State of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunState {
    /// No episode was played.
    Created,
    /// Episodes remain.
    Running,
    /// All episodes are over.
    Completed,
    /// Ended early by the server.
    Failed,
    /// Ended early by its team.
    Cancelled,
    /// Ended early by its deadline.
    Expired,
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
    pub over: Option<String>,
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

/// Public result of a stored episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeOutcome {
    /// Names and values of the metrics.
    pub metrics: Vec<(String, f64)>,
}
