//! The baseline suite: all bundled agents play a public split.
//!
//! Start at [`run()`] and [`report()`]. The suite hosts the arena in the same process; the agents connect to the gRPC server like
//! any other client. *Privileged* variants also receive hints with ground truth, which never leave the process.

mod hints;
mod host;
mod oracle;
mod play;
mod report;
mod results;
mod variant;

pub use host::SuiteSize;
pub use oracle::{FloorPoint, Oracle, PASSED_M, Walker, distance_m, play_oracle};
pub use play::{SuiteOptions, run};
pub use report::{SuiteReport, report};
pub use results::{Cause, EpisodeKey, ResultLine, Results};
pub use variant::AgentVariant;
