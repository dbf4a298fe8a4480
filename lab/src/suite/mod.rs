//! The baseline suite: all bundled agents play a public split.
//!
//! Start at [`run()`] and [`report()`]. The suite hosts the arena in its own process, and its agents connect to the gRPC server as
//! any other client. *Privileged* variants also receive hints with ground truth, which never leave the process.

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
