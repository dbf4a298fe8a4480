use crate::{
    control::Control,
    refusal::Refusal,
    seat::{Restored, Seat},
};
use avln_episode::{EndReason, FeedbackRule, Order, Rules, Sensors, TimeLimits};
use std::time::Duration;

/// What the door needs from the house behind it. The server implements it over its phases, data sets and store.
///
/// Methods may be called at the same time from many tasks. A panic in one of them ends that call with a server
/// fault and nothing else. Heavy work inside an `async` method belongs on a blocking thread.
#[tonic::async_trait]
pub trait Host: Send + Sync + 'static {
    /// Who this server is.
    fn info(&self) -> ServerInfo;

    /// The operator's hold on the door, where there is an operator.
    fn control(&self) -> Option<&Control> {
        None
    }

    /// The phases that the account's team may know of; without an account, those that anybody may.
    async fn phases(&self, account: Option<&Account>) -> Result<Vec<PhaseInfo>, Refusal>;

    /// Whose token this is: an account's, one for looking, or an organiser's.
    async fn account(&self, token: &str) -> Result<Account, Refusal>;

    /// Starts a run, or finds the one that the same `client_request_id` started before.
    async fn start_run(&self, account: &Account, request: RunRequest) -> Result<RunTicket, Refusal>;

    /// One run of the account's team.
    async fn run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal>;

    /// All runs of the account's team, newest first.
    async fn runs(&self, account: &Account) -> Result<Vec<RunStatus>, Refusal>;

    /// Ends a run early; what was scored stays.
    async fn cancel_run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal>;

    /// What the account's team has left in a phase, or in all that it may know of.
    async fn quotas(&self, account: &Account, phase: Option<&str>) -> Result<Vec<Quota>, Refusal>;

    /// The run that a run token plays, or played: `over` says when nothing is left to play.
    async fn open_run(&self, run_token: &str) -> Result<OpenRun, Refusal>;

    /// The next episode of the run for the slot `slot`, or `None` when none is left to hand out.
    async fn next_episode(&self, run: &str, slot: u32, sensors: &Sensors) -> Result<Option<Seat>, Refusal>;

    /// Stores what happened in the episode. `Some` only where the phase shows results to agents.
    ///
    /// A referee whose `end()` is `None` here broke down: the episode is a server fault.
    async fn conclude(&self, run: &str, seat: Seat) -> Result<Option<EpisodeOutcome>, Refusal>;

    /// How an episode ended whose result is stored; `None` when there is no such result.
    async fn ended(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal>;

    /// Runs whose episodes were being played when the server stopped. Asked once, before anybody is let in.
    async fn interrupted(&self) -> Result<Vec<String>, Refusal>;

    /// The episodes of such a run, back where they were. Those that cannot be had again are played anew.
    async fn restore(&self, run: &str) -> Result<Interrupted, Refusal>;

    /// Closes the run: every episode was played or the agent left for good. Says how it stands.
    async fn finish_run(&self, run: &str) -> Result<RunStatus, Refusal>;

    /// An episode hangs in the simulator and never comes back: it is played again, at no charge.
    async fn lose(&self, run: &str, handle: &str, ticket: u64) -> Result<(), Refusal>;

    /// The open runs whose time is over. Asked again and again while the server runs.
    async fn overdue(&self) -> Result<Vec<String>, Refusal>;

    /// Ends a run whose time is over. Episodes that are being played are concluded afterwards, as far as they came.
    async fn expire_run(&self, run: &str) -> Result<(), Refusal>;
}

/// Who this server is and what it speaks.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Name of the installation.
    pub name: String,
    /// Version of the server.
    pub version: String,
    /// Version of the benchmark: changes whenever a score could change.
    pub benchmark: String,
    /// Minor number of the API `avln.v1`, see `avln_proto::API_MINOR`.
    pub api_minor: u32,
    /// Client libraries that are accepted in some versions only; all others are accepted.
    pub clients: Vec<ClientRange>,
}

/// Versions of a client library that are accepted.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClientRange {
    /// Name of the library.
    pub name: String,
    /// Oldest version accepted, `major.minor.patch`; empty: any.
    pub min_version: String,
    /// Newest version accepted, `major.minor.patch`; empty: any.
    pub max_version: String,
    /// How to install an accepted one.
    pub install: String,
}

/// What is told of a phase.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseInfo {
    /// Id, as used in `RunRequest`.
    pub id: String,
    /// Title for people.
    pub title: String,
    /// Text for people, may be empty.
    pub description: String,
    /// Time that agents have.
    pub time: TimeLimits,
    /// Orders that can be played.
    pub orders: Vec<Order>,
    /// Name of the rule set.
    pub rules: String,
    /// Episodes of a run.
    pub episode_count: u32,
    /// What an agent learns from a Submit.
    pub feedback: FeedbackRule,
    /// Most slots of a Play stream.
    pub max_slots: u32,
    /// Sensors that an agent may ask for; width and height are the largest allowed.
    pub sensors: Sensors,
    /// Whether a run can be started now.
    pub state: PhaseState,
    /// Why it is in that state, for people; may be empty.
    pub state_reason: String,
    /// When it opens, seconds since 1970-01-01 UTC; 0: it always was.
    pub opens_unix_s: i64,
    /// When it closes, seconds since 1970-01-01 UTC; 0: never.
    pub closes_unix_s: i64,
    /// Who sees results.
    pub results: Visibility,
    /// Whether only agents that the organiser runs can play.
    pub sealed: bool,
    /// What the organiser promised before the phase; empty: nothing yet.
    pub commitment: String,
    /// The values behind the commitment, once they are published.
    pub revealed: Option<Revealed>,
}

/// Who sees results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Visibility {
    /// The organiser.
    Organiser,
    /// The organiser and the team itself.
    Team,
    /// Anyone.
    Public,
}

/// The values behind a phase's commitment.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Revealed {
    /// Digest of the episodes that runs draw from, hex.
    pub pool: String,
    /// Version of the benchmark.
    pub scorer: String,
    /// What keyed the draws, hex.
    pub secret: String,
}

/// Whether runs can be started in a phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhaseState {
    /// Not yet.
    Upcoming,
    /// Yes.
    Open,
    /// Not until the organiser goes on.
    Paused,
    /// No more.
    Closed,
}

/// Who is calling.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Account {
    /// Id of the team; empty for an organiser.
    pub team: String,
    /// What the token is good for.
    pub scope: Scope,
    /// What the token's maker calls it, may be empty.
    pub token_name: String,
    /// When the token expires, seconds since 1970-01-01 UTC; 0: never.
    pub expires_unix_s: i64,
}

/// What a token is good for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// A team's runs.
    Participant,
    /// A team's runs, for looking.
    ReadOnly,
    /// Everything.
    Organiser,
}

/// What a team has left in one window of a phase.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quota {
    /// Id of the phase.
    pub phase: String,
    /// How it fills up again.
    pub window: QuotaWindow,
    /// Runs granted in the window; `None`: any number.
    pub limit: Option<u32>,
    /// Runs counted in the window.
    pub used: u32,
    /// Runs left; `None`: any number.
    pub remaining: Option<u32>,
    /// When the window began, seconds since 1970-01-01 UTC.
    pub window_start_unix_s: i64,
    /// When `remaining` next grows, seconds since 1970-01-01 UTC; 0: never by waiting.
    pub next_increase_unix_s: i64,
    /// The runs that were counted and why, the oldest first.
    pub charges: Vec<(String, String)>,
}

/// How a quota fills up again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QuotaWindow {
    /// With each day, UTC.
    Day,
    /// With each month, UTC.
    Month,
    /// Never.
    Total,
    /// When an open run ends.
    Concurrent,
    /// Never; counts runs that were not charged.
    Uncharged,
}

/// What an agent says when it starts a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunRequest {
    /// Id of the phase.
    pub phase: String,
    /// Name of the method on the leaderboard.
    pub method: String,
    /// Version of the method, may be empty.
    pub method_version: String,
    /// Chosen by the client: the same id starts no second run. May be empty.
    pub client_request_id: String,
    /// Which order of missions is played.
    pub order: Order,
}

/// A started run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunTicket {
    /// Id of the run.
    pub run: String,
    /// Bearer token that plays this run and nothing else.
    pub token: String,
    /// Episodes of the run.
    pub episodes: u32,
    /// Most slots of its Play stream.
    pub max_slots: u32,
    /// Time that its agent has.
    pub time: TimeLimits,
    /// What the team has left now, in the window with the least.
    pub quota: Option<Quota>,
}

/// How a run stands.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStatus {
    /// Id of the run.
    pub run: String,
    /// Id of its phase.
    pub phase: String,
    /// Name of the method.
    pub method: String,
    /// Version of the method, may be empty.
    pub method_version: String,
    /// Which order of missions is played.
    pub order: Order,
    /// Where it stands.
    pub state: RunState,
    /// Episodes of the run.
    pub episodes: u32,
    /// Episodes that are over and stored.
    pub done: u32,
    /// Episodes that are being played.
    pub in_flight: u32,
    /// Start, milliseconds since 1970-01-01 UTC.
    pub created_unix_ms: i64,
    /// Last change of state, milliseconds since 1970-01-01 UTC.
    pub updated_unix_ms: i64,
    /// How many episodes ended for which reason; reasons with none are left out.
    pub ends: Vec<(EndReason, u32)>,
    /// Name and value of each metric, in the order of the phase's columns; `None` where the phase shows none.
    pub metrics: Option<Vec<(String, f64)>>,
    /// Rules that keep it out of the ranking; empty: it takes part.
    pub ineligible_because: Vec<String>,
    /// Whether the organiser ran the agent, shut off from everything but the server.
    pub sealed: bool,
    /// Whether it counts against its team's quota.
    pub charged: bool,
    /// Why it does or does not, for people.
    pub charge_reason: String,
    /// When an open run ends at the latest, milliseconds since 1970-01-01 UTC; `None`: never, or it is over.
    pub deadline_unix_ms: Option<i64>,
    /// Where people find it; may be empty.
    pub url: String,
}

/// Where a run stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RunState {
    /// Stored, nothing played.
    Created,
    /// Episodes are left.
    Running,
    /// All episodes are over.
    Completed,
    /// Ended by the server before all episodes were played.
    Failed,
    /// Ended by its team.
    Cancelled,
    /// Ran out of wall time.
    Expired,
}

/// What the holder of a run token may play.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenRun {
    /// Id of the run.
    pub run: String,
    /// Whose run it is; capacity is shared out among teams.
    pub team: String,
    /// Most slots of its Play stream.
    pub max_slots: u32,
    /// Rules in force.
    pub rules: Rules,
    /// The most that its agent may ask to sense.
    pub sensors: Sensors,
    /// Episodes of the run.
    pub episodes: u32,
    /// Episodes that are over and stored.
    pub done: u32,
    /// Whether the organiser runs the agent, shut off from everything but the server.
    pub sealed: bool,
    /// What decides scores.
    pub digests: Digests,
    /// Time that agents have.
    pub time: TimeLimits,
    /// When the run ends at the latest, milliseconds since 1970-01-01 UTC; `None`: never.
    pub deadline_unix_ms: Option<i64>,
    /// In which state the run ended; `None` while it can be played.
    pub over: Option<String>,
}

/// A run that was being played when the server stopped.
#[derive(Debug)]
pub struct Interrupted {
    /// The run.
    pub open: OpenRun,
    /// The sensors that its agent asked for.
    pub sensors: Sensors,
    /// Its episodes.
    pub episodes: Vec<Restored>,
    /// What its lost connections took so far of the time that they may be away.
    pub away: Duration,
}

/// How a stored episode ended.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredEnd {
    /// Why it ended; a server fault when it will be played again.
    pub reason: EndReason,
    /// Steps taken.
    pub steps: u32,
    /// What the agent may know of it.
    pub outcome: Option<EpisodeOutcome>,
}

/// Hexadecimal digests of what decides scores; empty where the phase hides one.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Digests {
    /// Simulator.
    pub engine: String,
    /// Scenes and missions.
    pub dataset: String,
    /// Formulas.
    pub scorer: String,
    /// Rules, limits and settings of the phase.
    pub config: String,
}

/// What an agent may know of a stored episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeOutcome {
    /// Name and value of each metric.
    pub metrics: Vec<(String, f64)>,
}
