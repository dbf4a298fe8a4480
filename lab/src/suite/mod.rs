//! The baseline suite: all bundled agents play public splits.
//!
//! A [`Track`] selects split and rules. The main track is the validation split of the recipe `paper`; the hard track has the same
//! missions and harder rules; the quick track has small houses. Start at [`run()`] and [`report()`]. The suite hosts the arena in the
//! same process; the agents connect to the gRPC server like any other client. *Privileged* variants also receive hints with ground truth, which never leave the process.

mod hints;
mod host;
mod oracle;
mod play;
mod report;
mod results;
mod table;
mod track;
mod variant;

pub use oracle::{FloorPoint, Oracle, PASSED_M, Walker, distance_m, play_oracle};
pub use play::{SuiteOptions, run};
pub use report::{SuiteReport, report};
pub use results::{Cause, EpisodeKey, MissionFacts, ResultLine, Results};
pub use table::{MergeTally, merge};
pub use track::{SuiteShard, SuiteSize, Track};
pub use variant::AgentVariant;
