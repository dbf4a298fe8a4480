//! The challenge file: splits and phases with dates, quotas, budgets and visibility.
//!
//! Start reading at [`ChallengeFile`], the file, and [`plan`], which computes the changes.

mod changes;
mod fault;
mod file;
mod plan;

pub use changes::{actor, notes};
pub use fault::{Fault, Place};
pub use file::{ChallengeFile, PhaseFile, SplitSource, json, moment_of};
pub use plan::{Plan, Planner, Unplanned};

#[cfg(test)]
mod tests;
