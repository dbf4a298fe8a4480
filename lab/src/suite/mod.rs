//! The ladder: every agent that comes with the arena plays one public split, so that one can see what the benchmark measures.
//!
//! Start reading at [`run()`] and [`report()`]. The ladder hosts the arena in its own process, and its agents play through the
//! agents' door like everyone else. Those that are marked *privileged* are told more than that by hints that never leave the
//! process.

mod causes;
mod host;
mod live_episodes;
mod oracle;
mod oracle_runs;
mod play;
mod report;
mod results;
mod traced;
mod variant;
pub mod walk;

pub use causes::Cause;
pub use host::SuiteSize;
pub use oracle::Oracle;
pub use oracle_runs::play_oracle;
pub use play::{SuiteOptions, run};
pub use report::{SuiteReport, report};
pub use results::{EpisodeKey, ResultLine, Results};
pub use variant::AgentVariant;
