//! Episodes and limits of a toy host.

use super::Quirk;
use avln_episode::TimeLimits;

/// A minute per action, and no time for lost connections.
pub(crate) const PATIENT: TimeLimits =
    TimeLimits { step_ms: 60_000, bank_ms: 0, run_s: 0, disconnect_s: 0, disconnect_total_s: 0 };

/// Episodes and limits of the toy host.
pub(crate) struct Plan {
    /// One entry per episode.
    pub(crate) episodes: Vec<Quirk>,
    pub(crate) max_steps: u32,
    /// Episodes that fit into the memory.
    pub(crate) most_open: usize,
    pub(crate) shows_metrics: bool,
    pub(crate) time: TimeLimits,
}

impl Plan {
    pub(crate) fn plain(episodes: usize) -> Self {
        Self::odd((0..episodes).map(|_| Quirk::None).collect())
    }

    pub(crate) fn odd(episodes: Vec<Quirk>) -> Self {
        Self { episodes, max_steps: 10, most_open: usize::MAX, shows_metrics: true, time: PATIENT }
    }

    /// Plain episodes with time limits.
    pub(crate) fn timed(episodes: usize, time: TimeLimits) -> Self {
        Self { time, ..Self::plain(episodes) }
    }
}
