//! Scores: metrics of an episode from its truth and record; means, intervals and ranks of runs.
//!
//! Entry points: [`score`], then [`summarise`], [`rank`] and [`compare`]. [`METRICS`] defines every metric once;
//! [`smallest_difference`] plans the size of a phase.
//! `docs/scoring.md` explains the formulas.
//!
//! This crate never does I/O, uses facts outside the truth and the record of an episode, or depends on the
//! order of its inputs.

mod compare;
mod metrics;
mod rank;
mod score;

pub use compare::{Comparison, Difference, common_episodes, compare, smallest_difference};
pub use metrics::{
    Direction, EpisodeValue, Key, METRICS, Metric, Prominence, SummaryValue, Unit, UnknownKey,
};
pub use rank::{Entry, RankedEntry, Standing, best_first, rank};
pub use score::{
    EpisodeScore, Estimate, FEW_SCENES, Metrics, Summary, distance_m, efficiency, score, summarise,
};
