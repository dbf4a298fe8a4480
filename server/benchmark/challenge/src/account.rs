use crate::word::words;
use serde::{Deserialize, Serialize};

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
