//! The ladder: every agent that comes with the arena plays one public split, so that one can see what the benchmark measures.
//!
//! Start reading at [`run()`] and [`report()`]. The ladder hosts the arena in its own process, and its agents play through the
//! agents' door like everyone else. Those that are marked *privileged* are told more than that by hints that never leave the
//! process.

mod board;
mod causes;
mod host;
mod oracle;
mod play;
mod report;
mod results;
mod rung;
mod standard;
mod traced;
pub mod walk;

pub use causes::Cause;
pub use host::Size;
pub use oracle::Oracle;
pub use play::{Plan, run};
pub use report::{Report, report};
pub use results::{Key, Line, Results};
pub use rung::Rung;
pub use standard::play_oracle;
