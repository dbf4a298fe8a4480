//! Interface to the application behind the gRPC server.

use crate::{
    control::{Control, TimeSpent, unix_ms},
    limits::Limits,
    refusal::Refusal,
};
use avln_challenge::{Account, EpisodeOutcome, MethodInfo, PhaseInfo, Quota, RunState, RunStatus};
use avln_episode::{Action, EndReason, Mission, Observation, Order, Rules, Sensors, TimeLimits};
use avln_referee::{RefereeError, StepOutcome};
use std::{io, time::Duration};

/// The application behind the gRPC server, called concurrently. A panic ends the call. Heavy work needs a blocking thread.
#[tonic::async_trait]
pub trait Host: Send + Sync + 'static {
    /// The application's episode type.
    type Episode: Episode;
    /// Returns the server's identity.
    fn info(&self) -> ServerInfo;
    /// Returns the operator's controls, if there is an operator.
    fn control(&self) -> Option<&Control> {
        None
    }
    /// Returns the wall clock for deadlines, milliseconds since 1970-01-01 UTC; by default the system's.
    fn now_unix_ms(&self) -> i64 {
        unix_ms()
    }

    /// Returns the phases visible to the account's team, or the public ones without an account.
    async fn phases(&self, account: Option<&Account>) -> Result<Vec<PhaseInfo>, Refusal>;
    /// Returns a token's account.
    async fn account(&self, token: &str) -> Result<Account, Refusal>;
    /// Starts a run, or returns an earlier one with the same `client_request_id`.
    async fn start_run(&self, account: &Account, request: RunRequest) -> Result<RunTicket, Refusal>;
    /// Returns a run's status for the account's team.
    async fn run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal>;
    /// Returns all of the team's runs, newest first.
    async fn runs(&self, account: &Account) -> Result<Vec<RunStatus>, Refusal>;
    /// Cancels a run. Scored episodes remain.
    async fn cancel_run(&self, account: &Account, run: &str) -> Result<RunStatus, Refusal>;
    /// Returns the team's quotas in a phase, or in all visible phases.
    async fn quotas(&self, account: &Account, phase: Option<&str>) -> Result<Vec<Quota>, Refusal>;
    /// Returns a run token's run, open or over.
    async fn open_run(&self, run_token: &str) -> Result<OpenRun, Refusal>;
    /// Returns a slot's next episode; `None` if none is left.
    async fn next_episode(
        &self,
        run: &str,
        slot: u32,
        sensors: &Sensors,
    ) -> Result<Option<HostedEpisode<Self::Episode>>, Refusal>;
    /// Stores an episode; without an end reason it counts as a server fault. Returns the result if the phase shows it to agents.
    async fn conclude(
        &self,
        run: &str,
        hosted: HostedEpisode<Self::Episode>,
    ) -> Result<Option<EpisodeOutcome>, Refusal>;
    /// Returns an episode's end; `None` if no result is stored.
    async fn ended(&self, run: &str, handle: &str) -> Result<Option<StoredEnd>, Refusal>;
    /// Returns the runs interrupted by the last stop. Called once, before clients are admitted.
    async fn interrupted(&self) -> Result<Vec<String>, Refusal>;
    /// Restores a run's open episodes. If that is impossible, they restart.
    async fn restore(&self, run: &str) -> Result<Interrupted<Self::Episode>, Refusal>;
    /// Completes a run if all episodes are over, and returns the status. With `abandons`, the agent has left: a run with
    /// episodes left ends as well, as cancelled, or as expired after the deadline. Later calls have no effect.
    async fn finish_run(&self, run: &str, abandons: bool) -> Result<RunStatus, Refusal>;
    /// Takes back a hanging episode. It restarts, without charge.
    async fn lose(&self, run: &str, handle: &str, ticket: u64) -> Result<(), Refusal>;
    /// Returns expired open runs. Called periodically.
    async fn overdue(&self) -> Result<Vec<String>, Refusal>;
    /// Ends an expired run. Open episodes are concluded afterwards.
    async fn expire_run(&self, run: &str) -> Result<(), Refusal>;
}

/// Identity of the server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Installation name.
    pub name: String,
    /// Server version.
    pub version: String,
    /// Benchmark version: changes whenever a score could change.
    pub benchmark: String,
    /// API minor version, see `avln_proto::API_MINOR`.
    pub api_minor: u32,
    /// Client libraries with restricted versions. Other libraries are accepted.
    pub clients: Vec<ClientRange>,
}

/// Accepted client library versions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ClientRange {
    /// Library name.
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
    /// Phase id.
    pub phase: String,
    /// Method.
    pub method: MethodInfo,
    /// Idempotency key chosen by the client; may be empty.
    pub client_request_id: String,
    /// Goal order.
    pub order: Order,
}

/// A started run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunTicket {
    /// Run id.
    pub run: String,
    /// Bearer token that plays only this run.
    pub token: String,
    /// Episodes in the run.
    pub episodes: u32,
    /// Slot limit.
    pub max_slots: u32,
    /// Time limits.
    pub time: TimeLimits,
    /// Scarcest quota.
    pub quota: Option<Quota>,
}

/// Run that a run token plays.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenRun {
    /// Run id.
    pub run: String,
    /// Team id, for fair shares.
    pub team: String,
    /// Slot limit.
    pub max_slots: u32,
    /// Rules.
    pub rules: Rules,
    /// Allowed sensors.
    pub sensors: Sensors,
    /// Episodes in the run.
    pub episodes: u32,
    /// Stored episodes.
    pub done: u32,
    /// True if the organiser runs the agent in a sandbox.
    pub sealed: bool,
    /// Digests.
    pub digests: Digests,
    /// Time limits.
    pub time: TimeLimits,
    /// Deadline, milliseconds since 1970-01-01 UTC.
    pub deadline_unix_ms: Option<i64>,
    /// Final state; `None` while it is open.
    pub over: Option<RunState>,
}

impl OpenRun {
    pub(crate) fn slot_limit(&self) -> u32 {
        self.max_slots.clamp(1, Limits::MAX_SLOTS)
    }
}

/// A run interrupted by the last stop.
pub struct Interrupted<E> {
    /// The run.
    pub open: OpenRun,
    /// Requested sensors.
    pub sensors: Sensors,
    /// Open episodes.
    pub episodes: Vec<Restored<E>>,
    /// Used disconnect time.
    pub away: Duration,
}

/// Stored end.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredEnd {
    /// End reason; a server fault if the episode will restart.
    pub reason: EndReason,
    /// Steps taken.
    pub steps: u32,
    /// Result, if the phase shows it.
    pub outcome: Option<EpisodeOutcome>,
}

/// Hexadecimal digests that identify scoring conditions; empty if hidden by the phase.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Digests {
    /// Simulator.
    pub engine: String,
    /// Scenes and missions.
    pub dataset: String,
    /// Scoring.
    pub scorer: String,
    /// Phase rules, limits and settings.
    pub config: String,
}

/// The agent-visible part of a [`Referee`](avln_referee::Referee), on simulation threads. A panic ends only this episode.
pub trait Episode: Send + 'static {
    /// Returns the mission.
    fn mission(&self) -> &Mission;
    /// Returns the rules.
    fn rules(&self) -> &Rules;
    /// Returns the observation before the first action.
    fn start(&mut self) -> Observation;
    /// Carries out an action. Fails if the episode is over.
    fn step(&mut self, action: Action) -> Result<StepOutcome, RefereeError>;
    /// Ends the episode from outside.
    fn truncate(&mut self, reason: EndReason);
    /// Returns the end reason; `None` while the episode is open.
    fn end(&self) -> Option<EndReason>;
    /// Returns the number of steps taken.
    fn steps(&self) -> u32;
    /// Returns a hash of the simulation state.
    fn state_hash(&self) -> u64;
}

/// Log from which a restarted server restores an episode. An error of `acting` or `acted` makes the episode a server fault.
pub trait EpisodeLog: Send + 'static {
    /// Records that an action is about to be carried out.
    fn acting(&mut self, step: u32) -> io::Result<()>;
    /// Records an action, before the result is sent to the agent.
    fn acted(&mut self, acted: &Acted) -> io::Result<()>;
    /// Records a restart of the agent's clock after a disconnect of `away`, because an observation had not arrived.
    fn clock_restarted(&mut self, step: u32, away: Duration) -> io::Result<()>;
}

/// Logged action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Acted {
    /// Step number, from 1.
    pub step: u32,
    /// The action.
    pub action: Action,
    /// State hash after the action.
    pub state_hash: u64,
    /// The agent's thinking time.
    pub thought: Duration,
    /// Rest of the time bank.
    pub bank_left: Duration,
}

/// An episode on its way from the host to a slot and back.
pub struct HostedEpisode<E> {
    /// Random name within the run, visible to the agent.
    pub handle: String,
    /// The episode.
    pub episode: E,
    /// The host's episode number, never sent to agents.
    pub ticket: u64,
    /// Action log.
    pub log: Box<dyn EpisodeLog>,
    /// Time accounts, zero at first.
    pub time: TimeSpent,
}

/// An episode restored after a restart.
pub struct Restored<E> {
    /// Slot that played it.
    pub slot: u32,
    /// The episode.
    pub hosted: HostedEpisode<E>,
    /// Last observation and the action before it, which is `None` at the start.
    pub last: (Observation, Option<Action>),
    /// Rest of the time bank.
    pub bank_left: Duration,
}
