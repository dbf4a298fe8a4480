use crate::{Metrics, Summary};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// A metric by which entries can be compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Key {
    /// Share of episodes with every goal found.
    #[default]
    Sr,
    /// Mean share of goals found.
    Isr,
    /// Mean share of goals whose region was entered.
    Osr,
    /// Success weighted by path length.
    Spl,
    /// Goals found weighted by path length.
    SoftSpl,
    /// Success weighted by number of actions.
    Sna,
    /// Actions.
    Steps,
    /// Length of the walk.
    PathM,
    /// Collisions.
    Collisions,
    /// Claims that completed nothing.
    WrongSubmits,
}

/// Which end of a metric is good.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Direction {
    /// More is better.
    Higher,
    /// Less is better.
    Lower,
}

/// A word that names no key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "metric '{0}' cannot be ranked by; use sr, isr, osr, spl, soft_spl, sna, steps, path_m, collisions or wrong_submits"
)]
pub struct UnknownKey(pub String);

impl Key {
    /// All keys, in the order in which tables show them.
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

    /// The word used in files and URLs.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Sr => "sr",
            Self::Isr => "isr",
            Self::Osr => "osr",
            Self::Spl => "spl",
            Self::SoftSpl => "soft_spl",
            Self::Sna => "sna",
            Self::Steps => "steps",
            Self::PathM => "path_m",
            Self::Collisions => "collisions",
            Self::WrongSubmits => "wrong_submits",
        }
    }

    /// Which end is good.
    pub fn direction(self) -> Direction {
        match self {
            Self::Steps | Self::PathM | Self::Collisions | Self::WrongSubmits => Direction::Lower,
            _ => Direction::Higher,
        }
    }

    /// The metric of one episode.
    pub fn of(self, metrics: &Metrics) -> f64 {
        match self {
            Self::Sr => metrics.sr,
            Self::Isr => metrics.isr,
            Self::Osr => metrics.osr,
            Self::Spl => metrics.spl,
            Self::SoftSpl => metrics.soft_spl,
            Self::Sna => metrics.sna,
            Self::Steps => f64::from(metrics.steps),
            Self::PathM => metrics.path_m,
            Self::Collisions => f64::from(metrics.collisions),
            Self::WrongSubmits => f64::from(metrics.wrong_submits),
        }
    }

    /// The mean over an entry's episodes.
    pub fn mean_of(self, summary: &Summary) -> f64 {
        match self {
            Self::Sr => summary.sr.value,
            Self::Isr => summary.isr.value,
            Self::Osr => summary.osr.value,
            Self::Spl => summary.spl.value,
            Self::SoftSpl => summary.soft_spl.value,
            Self::Sna => summary.sna.value,
            Self::Steps => summary.steps,
            Self::PathM => summary.path_m,
            Self::Collisions => summary.collisions,
            Self::WrongSubmits => summary.wrong_submits,
        }
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
