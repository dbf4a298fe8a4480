use avln_episode::{Action, EndReason, Order, Sensors};
use avln_scoring::Metrics;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A line of a run log. Times are milliseconds since 1970-01-01 UTC (`_ms`) or durations in microseconds
/// (`_us`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Entry {
    /// The first line: whose log it is, and what was in force.
    Run {
        /// Version of this format.
        format: u32,
        /// Id of the run.
        run: String,
        /// Id of its phase.
        phase: String,
        /// Success criterion.
        order: Order,
        /// Digests and versions by name, as the store keeps them.
        digests: BTreeMap<String, String>,
        /// When the log was begun.
        at_ms: i64,
    },
    /// An episode was handed out to a slot.
    Began {
        /// The slot.
        slot: u32,
        /// The name that the agent sees.
        handle: String,
        /// Place in the run's list, from 0.
        ordinal: u32,
        /// Id of the episode inside the split.
        episode: String,
        /// Sensors of the agent.
        sensors: Sensors,
        /// When.
        at_ms: i64,
    },
    /// The slot's episode took a step.
    Acted {
        /// The slot.
        slot: u32,
        /// Number of the step, counted from 1.
        step: u32,
        /// The action.
        action: Action,
        /// Hash of the state that it led to, 16 hexadecimal digits.
        state: String,
        /// For how long the agent thought.
        thought_us: u64,
        /// Remaining time bank of the episode.
        bank_us: u64,
        /// When.
        at_ms: i64,
    },
    /// The server was stopped in the middle of the episode, and another goes on with it.
    TakenUp {
        /// The slot.
        slot: u32,
        /// The name that the agent sees.
        handle: String,
        /// When.
        at_ms: i64,
    },
    /// The episode is back where it was.
    Stands {
        /// The slot.
        slot: u32,
        /// When.
        at_ms: i64,
    },
    /// The first step since the episode was taken up is about to be carried out.
    Tries {
        /// The slot.
        slot: u32,
        /// Number of the step, counted from 1.
        step: u32,
        /// When.
        at_ms: i64,
    },
    /// An observation did not arrive, and the clock of its answer began again.
    ClockRestarted {
        /// The slot.
        slot: u32,
        /// Step of the observation.
        step: u32,
        /// For how long the connection was away.
        away_us: u64,
        /// When.
        at_ms: i64,
    },
    /// The run is over, and the server stands for the lines before.
    Signed {
        /// The digits in front of the line before.
        head: String,
        /// The server's public key, hexadecimal.
        key: String,
        /// Ed25519 signature over the digits, hexadecimal.
        signature: String,
    },
    /// The episode is over and scored; the store is told next.
    Ended {
        /// The slot.
        slot: u32,
        /// The name that the agent saw.
        handle: String,
        /// Why it ended.
        end: EndReason,
        /// Score of the episode.
        metrics: Box<Metrics>,
        /// When.
        at_ms: i64,
    },
}

impl Entry {
    /// Version of the format that this program writes.
    pub const FORMAT: u32 = 1;
}
