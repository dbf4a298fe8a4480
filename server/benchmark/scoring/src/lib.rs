//! Pure: (truth, record) to metrics; aggregates, intervals, ranks.
//!
//! Start reading at [`score`], then [`summarise`], [`rank`] and [`compare`]. Every formula stands in `docs/scoring.md`.
//!
//! *Never*: does I/O; knows more of an episode than its truth and its record; depends on the order of its inputs.

mod bootstrap;
mod compare;
mod key;
mod metrics;
mod rank;
mod standing;
mod summary;

pub use compare::{Comparison, Difference, compare};
pub use key::{Direction, Key, UnknownKey};
pub use metrics::{Metrics, score};
pub use rank::{Entry, Place, Standing, best_first, rank};
pub use summary::{EpisodeScore, Estimate, Summary, summarise};
