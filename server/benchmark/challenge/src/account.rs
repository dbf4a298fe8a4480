use crate::word::words;
use serde::{Deserialize, Serialize};

/// The purpose of a team's runs that are shown for comparison. They have no rank.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
    /// A run's token: plays the episodes of this run.
    Run,
}
words!(TokenScope, "token kind", {
    Participant => "account", ReadOnly => "read_only", Organiser => "organiser", Run => "run",
});

/// The owner of a token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Account {
    /// Name of the team; empty for an organiser.
    pub team: String,
    /// Rights of the token.
    pub scope: TokenScope,
    /// Name of the token; may be empty.
    pub token_name: String,
    /// Expiry time of the token, milliseconds since 1970-01-01 UTC; `None` if it never expires.
    pub expires_unix_ms: Option<i64>,
}
