//! Metric definitions: the table of all metrics.
//!
//! A new metric needs a row in [`METRICS`], fields in [`Metrics`] and [`Summary`], and formulas in `score.rs`. JSON keys, CSV
//! columns, tables and forms follow the table.

use crate::score::{Estimate, Metrics, Summary};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};
use utoipa::ToSchema;

/// Metric definition.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Name in JSON, CSV files, URLs and the database.
    pub id: &'static str,
    /// Column heading.
    pub label: &'static str,
    /// Explanation in a sentence.
    pub meaning: &'static str,
    /// Unit.
    pub unit: Unit,
    /// Better end; `None` for mission properties.
    pub direction: Option<Direction>,
    /// True for values that depend on the hidden truth: phases with hidden scores publish them after their reveal only.
    pub hidden_until_reveal: bool,
    /// Prominence in tables.
    pub prominence: Prominence,
    /// Ranking key; `None` if leaderboards cannot be sorted by this metric.
    pub key: Option<Key>,
    /// Value in an episode.
    pub episode: EpisodeValue,
    /// Value in a summary.
    pub summary: SummaryValue,
}

/// Metric unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// A share in [0, 1].
    Share,
    /// Goals, actions or claims.
    Count,
    /// Metres.
    Metres,
}

/// Better end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// More is better.
    Higher,
    /// Less is better.
    Lower,
}

/// Prominence in tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Prominence {
    /// In every table, and in the messages to agents.
    Headline,
    /// In a table with default columns.
    Default,
    /// On request, on detail pages and in files.
    Optional,
}

/// Accessor for the value in an episode.
#[derive(Clone, Copy, Debug)]
pub enum EpisodeValue {
    /// Single number.
    Number(fn(&Metrics) -> f64),
    /// Number per goal.
    PerGoal(fn(&Metrics) -> Vec<Option<f64>>),
    /// Defined for summaries only.
    None,
}

/// Accessor for the value in a summary.
#[derive(Clone, Copy, Debug)]
pub enum SummaryValue {
    /// Mean with an interval.
    Estimate(fn(&Summary) -> Estimate),
    /// Mean without an interval.
    Mean(fn(&Summary) -> f64),
    /// Mean over goals; absent without such goals.
    GoalMean(fn(&Summary) -> Option<f64>),
    /// Defined for episodes only.
    None,
}

/// All metrics, in JSON field and CSV column order.
pub const METRICS: [Metric; 18] = [
    Metric {
        direction: None,
        hidden_until_reveal: false,
        episode: EpisodeValue::Number(|m| f64::from(m.goals)),
        ..count("goals", "Goals", "Goals of the mission")
    },
    Metric {
        direction: Some(Direction::Higher),
        episode: EpisodeValue::Number(|m| f64::from(m.found)),
        ..count("found", "Found", "Goals found")
    },
    Metric {
        prominence: Prominence::Headline,
        key: Some(Key::Sr),
        episode: EpisodeValue::Number(|m| m.sr),
        summary: SummaryValue::Estimate(|s| s.sr),
        ..share("sr", "SR", "Success rate: share of episodes in which every goal was found")
    },
    Metric {
        prominence: Prominence::Headline,
        key: Some(Key::Isr),
        episode: EpisodeValue::Number(|m| m.isr),
        summary: SummaryValue::Estimate(|s| s.isr),
        ..share("isr", "ISR", "Share of the goals that were found, mean over episodes")
    },
    Metric {
        summary: SummaryValue::Mean(|s| s.isr_by_goal),
        ..share(
            "isr_by_goal",
            "ISR by goal",
            "Share of the goals that were found, over all goals of all episodes",
        )
    },
    Metric {
        prominence: Prominence::Headline,
        key: Some(Key::Osr),
        episode: EpisodeValue::Number(|m| m.osr),
        summary: SummaryValue::Estimate(|s| s.osr),
        ..share("osr", "OSR", "Share of the goals whose success region was entered, claimed or not")
    },
    Metric {
        episode: EpisodeValue::Number(|m| m.osr_all),
        summary: SummaryValue::Mean(|s| s.osr_all),
        ..share("osr_all", "OSR, all goals", "Share of episodes in which every success region was entered")
    },
    Metric {
        prominence: Prominence::Headline,
        key: Some(Key::Spl),
        episode: EpisodeValue::Number(|m| m.spl),
        summary: SummaryValue::Estimate(|s| s.spl),
        ..share(
            "spl",
            "SPL",
            "Success weighted by path length: SR times reference tour over the longer of tour and walk",
        )
    },
    Metric {
        prominence: Prominence::Headline,
        key: Some(Key::SoftSpl),
        episode: EpisodeValue::Number(|m| m.soft_spl),
        summary: SummaryValue::Estimate(|s| s.soft_spl),
        ..share(
            "soft_spl",
            "SoftSPL",
            "ISR weighted by path length: ISR times reference tour over the longer of tour and walk",
        )
    },
    Metric {
        key: Some(Key::Sna),
        episode: EpisodeValue::Number(|m| m.sna),
        summary: SummaryValue::Estimate(|s| s.sna),
        ..share("sna", "SNA", "Success weighted by the number of actions")
    },
    Metric {
        hidden_until_reveal: false,
        prominence: Prominence::Default,
        key: Some(Key::Steps),
        episode: EpisodeValue::Number(|m| f64::from(m.steps)),
        summary: SummaryValue::Mean(|s| s.steps),
        ..count("steps", "Steps", "Actions taken in an episode")
    },
    Metric {
        hidden_until_reveal: false,
        prominence: Prominence::Default,
        key: Some(Key::PathM),
        episode: EpisodeValue::Number(|m| m.path_m),
        summary: SummaryValue::Mean(|s| s.path_m),
        ..length("path_m", "Path", "Length of the walk, metres")
    },
    Metric {
        direction: None,
        episode: EpisodeValue::Number(|m| m.reference_m),
        ..length(
            "reference_m",
            "Reference tour",
            "Length of the shortest tour through all success regions, metres",
        )
    },
    Metric {
        hidden_until_reveal: false,
        prominence: Prominence::Default,
        key: Some(Key::Collisions),
        episode: EpisodeValue::Number(|m| f64::from(m.collisions)),
        summary: SummaryValue::Mean(|s| s.collisions),
        ..count("collisions", "Collisions", "Actions in which an obstacle held the body back")
    },
    Metric {
        prominence: Prominence::Default,
        key: Some(Key::WrongSubmits),
        episode: EpisodeValue::Number(|m| f64::from(m.wrong_submits)),
        summary: SummaryValue::Mean(|s| s.wrong_submits),
        ..count("wrong_submits", "Wrong submits", "Claims that completed no goal")
    },
    Metric {
        episode: EpisodeValue::Number(|m| f64::from(m.wrong_instance_submits)),
        summary: SummaryValue::Mean(|s| s.wrong_instance_submits),
        ..count(
            "wrong_instance_submits",
            "Wrong instances",
            "Wrong submits at another instance of a goal's category",
        )
    },
    Metric {
        episode: EpisodeValue::PerGoal(|m| m.steps_to_goal.iter().map(|step| step.map(f64::from)).collect()),
        summary: SummaryValue::GoalMean(|s| s.steps_to_goal),
        ..count(
            "steps_to_goal",
            "Steps to goal",
            "Number of the action that found a goal, mean over the goals found",
        )
    },
    Metric {
        episode: EpisodeValue::PerGoal(|m| m.final_distance_m.clone()),
        summary: SummaryValue::GoalMean(|s| s.final_distance_m),
        ..length(
            "final_distance_m",
            "Final distance",
            "Walking distance from the last pose to a goal, metres, mean over the reachable goals",
        )
    },
];

/// Returns a share with defaults.
const fn share(id: &'static str, label: &'static str, meaning: &'static str) -> Metric {
    Metric {
        id,
        label,
        meaning,
        unit: Unit::Share,
        direction: Some(Direction::Higher),
        hidden_until_reveal: true,
        prominence: Prominence::Optional,
        key: None,
        episode: EpisodeValue::None,
        summary: SummaryValue::None,
    }
}

/// Returns a count with defaults.
const fn count(id: &'static str, label: &'static str, meaning: &'static str) -> Metric {
    Metric { unit: Unit::Count, direction: Some(Direction::Lower), ..share(id, label, meaning) }
}

/// Returns a length with defaults.
const fn length(id: &'static str, label: &'static str, meaning: &'static str) -> Metric {
    Metric { unit: Unit::Metres, ..count(id, label, meaning) }
}

impl Metric {
    /// Returns the episode's number; `None` for lists per goal and for values defined on summaries only.
    pub fn of(&self, metrics: &Metrics) -> Option<f64> {
        match self.episode {
            EpisodeValue::Number(value) => Some(value(metrics)),
            EpisodeValue::PerGoal(_) | EpisodeValue::None => None,
        }
    }

    /// Returns the run's mean; `None` if the summary has none.
    pub fn mean_of(&self, summary: &Summary) -> Option<f64> {
        match self.summary {
            SummaryValue::Estimate(estimate) => Some(estimate(summary).value),
            SummaryValue::Mean(mean) => Some(mean(summary)),
            SummaryValue::GoalMean(mean) => mean(summary),
            SummaryValue::None => None,
        }
    }

    /// Returns the mean with the interval, if the metric has one.
    pub fn estimate_of(&self, summary: &Summary) -> Option<Estimate> {
        match self.summary {
            SummaryValue::Estimate(estimate) => Some(estimate(summary)),
            SummaryValue::Mean(_) | SummaryValue::GoalMean(_) | SummaryValue::None => None,
        }
    }

    /// Iterates over the metrics in every table and in messages to agents: SR, ISR, OSR, SPL and SoftSPL.
    pub fn headlines() -> impl Iterator<Item = &'static Self> {
        METRICS.iter().filter(|metric| metric.prominence == Prominence::Headline)
    }
}

/// Ranking metric.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Key {
    /// Share of episodes with every goal found.
    #[default]
    Sr,
    /// Mean goal share found.
    Isr,
    /// Mean goal share with a visited region.
    Osr,
    /// Success weighted by path length.
    Spl,
    /// Goals found weighted by path length.
    SoftSpl,
    /// Success weighted by action count.
    Sna,
    /// Actions.
    Steps,
    /// Path length.
    PathM,
    /// Collisions.
    Collisions,
    /// Submits and Stops that completed no goal.
    WrongSubmits,
}

/// Unknown ranking key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot rank by the metric '{0}'; use {choices}", choices = choices())]
pub struct UnknownKey(pub String);

/// Lists all key ids: "a, b or c".
fn choices() -> String {
    let [rest @ .., last] = Key::ALL.map(Key::as_str);
    format!("{} or {last}", rest.join(", "))
}

impl Key {
    /// All keys, in the order of [`METRICS`].
    pub const ALL: [Self; 10] = [
        Self::Sr,
        Self::Isr,
        Self::Osr,
        Self::Spl,
        Self::SoftSpl,
        Self::Sna,
        Self::Steps,
        Self::PathM,
        Self::Collisions,
        Self::WrongSubmits,
    ];

    /// Returns the metric definition.
    pub fn metric(self) -> &'static Metric {
        // The table has a row for every key: a test checks it.
        METRICS.iter().find(|metric| metric.key == Some(self)).unwrap_or(&METRICS[0])
    }

    /// Returns the metric id.
    pub fn as_str(self) -> &'static str {
        self.metric().id
    }

    /// Returns the better end.
    pub fn direction(self) -> Direction {
        self.metric().direction.unwrap_or(Direction::Higher)
    }

    /// Returns the episode's value.
    pub fn of(self, metrics: &Metrics) -> f64 {
        self.metric().of(metrics).unwrap_or(0.0)
    }

    /// Returns the run's mean.
    pub fn mean_of(self, summary: &Summary) -> f64 {
        self.metric().mean_of(summary).unwrap_or(0.0)
    }
}

impl FromStr for Key {
    type Err = UnknownKey;

    fn from_str(word: &str) -> Result<Self, UnknownKey> {
        Self::ALL.into_iter().find(|key| key.as_str() == word).ok_or_else(|| UnknownKey(word.to_owned()))
    }
}

impl fmt::Display for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
