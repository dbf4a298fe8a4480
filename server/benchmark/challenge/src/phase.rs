//! Phases, admission of teams, accounts and visibility.

use crate::{sampling::CommitmentValues, words};
use avln_episode::{FeedbackRule, Order, Sensors, TimeLimits};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

/// A group with access to scores or replays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Visibility {
    /// Everybody.
    Public,
    /// The run's team, and the organiser.
    Team,
    /// The organiser.
    Organiser,
}
words!(Visibility, "visibility", { Public => "public", Team => "team", Organiser => "organiser" });

/// A phase's state at a given time. It decides over new runs; a started run has full wall time in every state. A run
/// without wall time ends with the phase.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum PhaseState {
    /// Runs cannot start yet.
    Upcoming,
    /// Runs can start.
    Open,
    /// The organiser paused the phase; runs cannot start until it is resumed.
    Paused,
    /// Runs cannot start any more.
    Closed,
}
words!(PhaseState, "phase state", {
    Upcoming => "upcoming", Open => "open", Paused => "paused", Closed => "closed",
});

/// Selection rule for the leaderboard run of a team's method.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum RunChoice {
    /// The run with the best rank.
    #[default]
    Best,
    /// The run that was completed last.
    Latest,
}
words!(RunChoice, "choice of runs", { Best => "best", Latest => "latest" });

/// The period for starting runs. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Schedule {
    /// Opening time; `None` if the phase is open from the beginning.
    pub opens_unix_ms: Option<i64>,
    /// Closing time; `None` if it never closes.
    pub closes_unix_ms: Option<i64>,
    /// Pause reason; `None` if the phase is not paused.
    pub paused: Option<String>,
    /// True if the organiser closed the phase by hand.
    pub closed: bool,
}

impl Schedule {
    /// Returns the state at `now_unix_ms`.
    pub fn state(&self, now_unix_ms: i64) -> PhaseState {
        // The test order is a rule: closing beats dates, and dates beat a pause.
        if self.closed || self.closes_unix_ms.is_some_and(|closes| closes <= now_unix_ms) {
            PhaseState::Closed
        } else if self.opens_unix_ms.is_some_and(|opens| now_unix_ms < opens) {
            PhaseState::Upcoming
        } else if self.paused.is_some() {
            PhaseState::Paused
        } else {
            PhaseState::Open
        }
    }
}

/// The teams that can play a phase.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Admission {
    /// True if teams need the organiser's approval before the first run.
    pub approval: bool,
    /// The teams that see the phase; empty for all teams.
    pub allow: Vec<String>,
    /// Teams that cannot play.
    pub deny: Vec<String>,
}

impl Admission {
    /// Returns whether `team` sees the phase; `None` is an anonymous visitor.
    pub fn shows_to(&self, team: Option<&str>) -> bool {
        self.allow.is_empty() || team.is_some_and(|team| self.allow.iter().any(|allowed| allowed == team))
    }
}

/// A phase's public description, for agents. Times are milliseconds since 1970-01-01 UTC.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseInfo {
    /// Phase id.
    pub id: String,
    /// Title for people.
    pub title: String,
    /// Text for people; may be empty.
    pub description: String,
    /// Agent time limits.
    pub time: TimeLimits,
    /// Playable mission orders.
    pub orders: Vec<Order>,
    /// Rule set name.
    pub rules: String,
    /// Episodes per run.
    pub episode_count: u32,
    /// Feedback to a Submit.
    pub feedback: FeedbackRule,
    /// Maximum parallel episodes per run.
    pub max_slots: u32,
    /// Available sensors; width and height are maxima.
    pub sensors: Sensors,
    /// Phase state.
    pub state: PhaseState,
    /// Pause reason; `None` in other states.
    pub state_reason: Option<String>,
    /// Opening time; `None` if the phase is open from the beginning.
    pub opens_unix_ms: Option<i64>,
    /// Closing time; `None` if it never closes.
    pub closes_unix_ms: Option<i64>,
    /// Result visibility.
    pub results: Visibility,
    /// True if the phase accepts sealed runs only: the organiser runs the agents.
    pub sealed: bool,
    /// Commitment made before the phase, hex; `None` before it.
    pub commitment: Option<String>,
    /// The committed values; `None` before they are published.
    pub revealed: Option<CommitmentValues>,
}

/// The kind of a reference team. Its runs are shown for comparison, without rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reference {
    /// An agent for comparison.
    Baseline,
    /// An agent with the ground truth: an upper bound.
    Oracle,
    /// People.
    Human,
}
words!(Reference, "reference", { Baseline => "baseline", Oracle => "oracle", Human => "human" });

/// The rights that a token grants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TokenScope {
    /// A team's token: starts runs and reads the team's results.
    Participant,
    /// A team's token that reads the team's results and starts no runs.
    ReadOnly,
    /// An organiser's token: reads everything.
    Organiser,
    /// A run's token: plays this run's episodes.
    Run,
}
// The word `account` dates from the first schema.
words!(TokenScope, "token kind", {
    Participant => "account", ReadOnly => "read_only", Organiser => "organiser", Run => "run",
});

/// A token's owner.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Account {
    /// Team name; empty for an organiser.
    pub team: String,
    /// Granted rights.
    pub scope: TokenScope,
    /// Token name; may be empty.
    pub token_name: String,
    /// Expiry time, milliseconds since 1970-01-01 UTC; `None` if it never expires.
    pub expires_unix_ms: Option<i64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn state_follows_dates_pause_and_closing() {
        let dated = Schedule { opens_unix_ms: Some(10), closes_unix_ms: Some(20), ..Schedule::default() };
        let states = [9, 10, 19, 20].map(|now| dated.state(now));
        assert_eq!(states, [PhaseState::Upcoming, PhaseState::Open, PhaseState::Open, PhaseState::Closed]);
        let paused = Schedule { paused: Some("maintenance".to_owned()), ..dated.clone() };
        let states = [9, 10, 20].map(|now| paused.state(now));
        assert_eq!(states, [PhaseState::Upcoming, PhaseState::Paused, PhaseState::Closed]);
        let closed = Schedule { closed: true, ..paused };
        assert_eq!([9, 10].map(|now| closed.state(now)), [PhaseState::Closed; 2]);
        assert_eq!(Schedule::default().state(0), PhaseState::Open);
    }

    #[test]
    fn allow_list_hides_phase() {
        let open = Admission::default();
        assert!(open.shows_to(None) && open.shows_to(Some("red")));
        let closed = Admission { allow: vec!["red".to_owned()], ..open };
        assert_eq!([None, Some("blue"), Some("red")].map(|team| closed.shows_to(team)), [false, false, true]);
    }
}
