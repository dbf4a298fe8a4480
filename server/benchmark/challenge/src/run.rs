use crate::{Charge, word::words};
use avln_episode::{EndReason, Order};
use serde::{Deserialize, Serialize};

/// State of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RunState {
    /// No episode was assigned yet.
    Created,
    /// Episodes remain.
    Running,
    /// All episodes are over.
    Completed,
    /// Ended by its team or the organiser.
    Cancelled,
    /// Ended by a server failure.
    Failed,
    /// Ended by its wall-time limit.
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

/// State of an episode of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EpisodeState {
    /// Not assigned yet.
    Pending,
    /// Assigned and not over.
    Running,
    /// Ended by the rules of the task.
    Terminated,
    /// Ended by a limit or the agent's absence.
    Truncated,
    /// Abandoned after repeated server failures; does not count.
    Infra,
}
words!(EpisodeState, "episode state", {
    Pending => "pending", Running => "running", Terminated => "terminated", Truncated => "truncated", Infra => "infra",
});

/// The method that plays a run, as described by its team.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MethodInfo {
    /// Name on the leaderboard.
    pub name: String,
    /// Version; may be empty.
    pub version: String,
    /// Text for people; may be empty, as the fields below.
    pub description: String,
    /// Address of the code.
    pub code_url: String,
    /// Address of the paper.
    pub paper_url: String,
    /// Licence of the weights.
    pub weights_licence: String,
    /// Training data other than the benchmark's.
    pub external_data: String,
}

impl MethodInfo {
    /// A method without a description.
    pub fn new(name: impl Into<String>, version: impl Into<String>) -> Self {
        Self { name: name.into(), version: version.into(), ..Self::default() }
    }
}

/// The organiser's ruling on a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Ruling {
    /// Whether the organiser verified the run.
    pub verified: bool,
    /// Public reason of a disqualification; `None` if the run is not disqualified.
    pub disqualified: Option<String>,
}

/// Wall-clock time of an episode by activity, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TimeAccount {
    /// Simulation of motion, vision and sound.
    pub simulation_s: f64,
    /// Encoding of observations.
    pub encoding_s: f64,
    /// Waiting for a simulation thread.
    pub queue_s: f64,
    /// Waiting for the agent, including the network in both directions.
    pub thinking_s: f64,
}

impl TimeAccount {
    /// Returns the sum of both accounts.
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            simulation_s: self.simulation_s + other.simulation_s,
            encoding_s: self.encoding_s + other.encoding_s,
            queue_s: self.queue_s + other.queue_s,
            thinking_s: self.thinking_s + other.thinking_s,
        }
    }
}

/// Status of a run, for its own team. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq)]
pub struct RunStatus {
    /// Id of the run.
    pub run: String,
    /// Id of the phase.
    pub phase: String,
    /// The method.
    pub method: MethodInfo,
    /// Order of the missions.
    pub order: Order,
    /// State of the run.
    pub state: RunState,
    /// Number of episodes.
    pub episodes: u32,
    /// Episodes with a stored result.
    pub done: u32,
    /// Episodes in progress.
    pub in_flight: u32,
    /// Start of the run.
    pub created_unix_ms: i64,
    /// Last change of state.
    pub updated_unix_ms: i64,
    /// Deadline of an open run; `None` for no deadline, or if the run is over.
    pub deadline_unix_ms: Option<i64>,
    /// Number of episodes by end reason; reasons without episodes are omitted.
    pub ends: Vec<(EndReason, u32)>,
    /// Name and mean of each public metric; `None` if the phase hides them from the team.
    pub metrics: Option<Vec<(String, f64)>>,
    /// Reasons that exclude the run from the leaderboard; empty if it takes part.
    pub ineligible_because: Vec<String>,
    /// Whether the run is sealed: the organiser ran the agent without network access.
    pub sealed: bool,
    /// Effect on the team's quota.
    pub charge: Charge,
    /// Path of the run's web page; may be empty.
    pub url: String,
}

/// Public result of a stored episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeOutcome {
    /// Name and value of each public metric.
    pub metrics: Vec<(String, f64)>,
}
