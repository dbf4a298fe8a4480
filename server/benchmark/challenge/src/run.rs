//! Runs, episodes, methods, rulings and charges.

use crate::words;
use avln_episode::{EndReason, Order};
use serde::{Deserialize, Serialize};

/// A run's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// No episode was assigned yet.
    Created,
    /// Episodes remain.
    Running,
    /// All episodes are over.
    Completed,
    /// Ended by the team or the organiser.
    Cancelled,
    /// Ended by a server failure.
    Failed,
    /// Ended by the wall-time limit.
    Expired,
}
words!(RunState, "run state", {
    Created => "created", Running => "running", Completed => "completed", Cancelled => "cancelled",
    Failed => "failed", Expired => "expired",
});

impl RunState {
    /// Returns whether episodes can still be assigned.
    pub fn is_open(self) -> bool {
        matches!(self, Self::Created | Self::Running)
    }
}

/// An episode's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeState {
    /// Not assigned yet.
    Pending,
    /// Assigned and not over.
    Running,
    /// Ended by the task's rules.
    Terminated,
    /// Ended by a limit or the agent's absence.
    Truncated,
    /// Abandoned after repeated server failures; does not count.
    Infra,
}
words!(EpisodeState, "episode state", {
    Pending => "pending", Running => "running", Terminated => "terminated", Truncated => "truncated", Infra => "infra",
});

/// A method's type, declared by the team.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MethodType {
    /// Without learnt parts.
    TrainingFree,
    /// Learnt perception; the decisions are not learnt.
    LearntPerception,
    /// Models trained on data from outside the benchmark: detectors, encoders, language models.
    FoundationModels,
    /// A policy learnt from demonstrations.
    Imitation,
    /// A policy learnt by reinforcement learning.
    Rl,
}
words!(MethodType, "method type", {
    TrainingFree => "training-free", LearntPerception => "learnt-perception",
    FoundationModels => "foundation-models", Imitation => "imitation", Rl => "rl",
});

/// A method, as described by the team.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct MethodInfo {
    /// Name on the leaderboard.
    pub name: String,
    /// Version; may be empty.
    pub version: String,
    /// Type; `None` if the team declared none.
    #[serde(rename = "type")]
    pub method_type: Option<MethodType>,
    /// Text for people; may be empty, as the fields below.
    pub description: String,
    /// Code address.
    pub code_url: String,
    /// Paper address.
    pub paper_url: String,
    /// Weights licence.
    pub weights_licence: String,
    /// Training data other than the benchmark's.
    pub external_data: String,
}

impl MethodInfo {
    /// Longest name, characters.
    pub const MAX_NAME_CHARS: usize = 80;
    /// Longest version, characters.
    pub const MAX_VERSION_CHARS: usize = 40;

    /// A method without a description.
    pub fn new(name: impl Into<String>, version: impl Into<String>) -> Self {
        Self { name: name.into(), version: version.into(), ..Self::default() }
    }
}

/// The organiser's ruling on a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ruling {
    /// True if the organiser verified the run.
    pub verified: bool,
    /// Public disqualification reason; `None` if the run is not disqualified.
    pub disqualified: Option<String>,
}

/// An episode's wall-clock time by activity, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct TimeAccount {
    /// Simulating motion, vision and sound.
    pub simulation_s: f64,
    /// Encoding observations.
    pub encoding_s: f64,
    /// Waiting for a simulation thread.
    pub queue_s: f64,
    /// Waiting for the agent, including the network in both directions.
    pub thinking_s: f64,
}

impl TimeAccount {
    /// Adds both accounts.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            simulation_s: self.simulation_s + other.simulation_s,
            encoding_s: self.encoding_s + other.encoding_s,
            queue_s: self.queue_s + other.queue_s,
            thinking_s: self.thinking_s + other.thinking_s,
        }
    }

    /// Returns the account in whole seconds, for viewers without replays: the exact time of a simulation depends on the results of
    /// Submits.
    pub fn rounded(&self) -> Self {
        Self {
            simulation_s: self.simulation_s.round(),
            encoding_s: self.encoding_s.round(),
            queue_s: self.queue_s.round(),
            thinking_s: self.thinking_s.round(),
        }
    }
}

/// A run's effect on the team quota.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, utoipa::ToSchema)]
pub struct Charge {
    /// Run id.
    pub run: String,
    /// True if the run counts.
    pub charged: bool,
    /// Reason, for people.
    pub reason: &'static str,
}

impl Charge {
    /// Maximum listed runs in a quota: a bound on answers for teams without a limit.
    pub const MAX_LISTED: usize = 200;
}

/// A run's stored facts that decide the charge. An agent's statements have no influence.
#[derive(Clone, Debug)]
pub struct RunUse {
    /// Run id.
    pub run: String,
    /// Run state.
    pub state: RunState,
    /// Start time, milliseconds since 1970-01-01 UTC.
    pub created_unix_ms: i64,
    /// Episodes with a score.
    pub scored: u32,
    /// Episodes abandoned after server failures.
    pub given_up: u32,
    /// Attempts lost by server failures.
    pub server_faults: u32,
    /// True if an episode is assigned and has no result yet.
    pub in_progress: bool,
}

impl RunUse {
    /// Returns the charge.
    pub fn charge(&self) -> Charge {
        let (charged, reason) = match self.state {
            // An open run counts: otherwise a team could open more runs than remain.
            RunState::Created | RunState::Running => (true, "it is open; it counts until it ends"),
            RunState::Failed => (false, "the server failed"),
            _ if self.given_up > 0 => (false, "the server lost an episode of it for good"),
            RunState::Completed => (true, "all of its episodes were played"),
            // The agent has seen the mission: otherwise, runs without a step would show all missions free of charge.
            _ if self.scored > 0 || self.in_progress => (true, "it ended after its first episode began"),
            _ if self.server_faults > 0 => (false, "the server lost every episode that began"),
            _ => (false, "it ended before its first episode"),
        };
        Charge { run: self.run.clone(), charged, reason }
    }
}

/// A run's status, for its team. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStatus {
    /// Run id.
    pub run: String,
    /// Phase id.
    pub phase: String,
    /// The method.
    pub method: MethodInfo,
    /// Mission order.
    pub order: Order,
    /// Run state.
    pub state: RunState,
    /// Episode count.
    pub episodes: u32,
    /// Episodes with a stored result.
    pub done: u32,
    /// Episodes in progress.
    pub in_flight: u32,
    /// Start time.
    pub created_unix_ms: i64,
    /// Last state change.
    pub updated_unix_ms: i64,
    /// Deadline; `None` for no deadline, or if the run is over.
    pub deadline_unix_ms: Option<i64>,
    /// Episodes by end reason; reasons without episodes are omitted.
    pub ends: Vec<(EndReason, u32)>,
    /// Public metrics: name and mean; `None` if the phase hides them from the team.
    pub metrics: Option<Vec<(String, f64)>>,
    /// Reasons that exclude the run from the leaderboard; empty if it takes part.
    pub ineligible_because: Vec<String>,
    /// True if the run is sealed: the organiser ran the agent without network access.
    pub sealed: bool,
    /// Effect on the team's quota.
    pub charge: Charge,
    /// Web page path; may be empty.
    pub url: String,
}

/// A stored episode's public result.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeOutcome {
    /// Public metrics: name and value.
    pub metrics: Vec<(String, f64)>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Facts of a run without an episode.
    fn unused(state: RunState) -> RunUse {
        let (run, created_unix_ms) = ("a".to_owned(), 0);
        RunUse { run, state, created_unix_ms, scored: 0, given_up: 0, server_faults: 0, in_progress: false }
    }

    #[test]
    fn runs_are_charged_from_their_first_episode_on() {
        let charged = |run: RunUse| run.charge().charged;
        for state in [RunState::Created, RunState::Running, RunState::Completed] {
            assert!(charged(unused(state)), "{state:?}");
        }
        for state in [RunState::Cancelled, RunState::Expired] {
            assert!(!charged(unused(state)), "{state:?}");
            assert!(charged(RunUse { scored: 1, ..unused(state) }), "{state:?}");
            assert!(charged(RunUse { in_progress: true, ..unused(state) }), "{state:?}");
            assert!(charged(RunUse { scored: 1, server_faults: 1, ..unused(state) }), "{state:?}");
        }
    }

    #[test]
    fn time_accounts_are_added_by_activity() {
        let account = |simulation_s, encoding_s, queue_s, thinking_s| TimeAccount {
            simulation_s,
            encoding_s,
            queue_s,
            thinking_s,
        };
        let sum = account(1.0, 2.0, 3.0, 4.0).plus(&account(10.0, 20.0, 30.0, 40.0));
        assert_eq!(sum, account(11.0, 22.0, 33.0, 44.0));
        assert_eq!(account(1.4, 1.6, 0.2, 7.0).rounded(), account(1.0, 2.0, 0.0, 7.0));
    }

    #[test]
    fn lost_episodes_free_a_run_after_its_end() {
        let lost = |state| RunUse { scored: 3, given_up: 1, ..unused(state) }.charge();
        assert!(lost(RunState::Running).charged);
        for state in [RunState::Completed, RunState::Cancelled, RunState::Expired] {
            assert_eq!(
                (lost(state).charged, lost(state).reason),
                (false, "the server lost an episode of it for good")
            );
        }
        let failed = RunUse { scored: 3, ..unused(RunState::Failed) }.charge();
        assert_eq!((failed.charged, failed.reason), (false, "the server failed"));
        let faults = RunUse { server_faults: 1, ..unused(RunState::Cancelled) }.charge();
        assert_eq!((faults.charged, faults.reason), (false, "the server lost every episode that began"));
        assert_eq!(unused(RunState::Cancelled).charge().reason, "it ended before its first episode");
    }
}
