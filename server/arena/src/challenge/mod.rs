//! The organiser's file: splits and phases with their dates, quotas, budgets and who sees what.
//!
//! Start reading at [`ChallengeFile`], which is the file, and [`plan`], which turns it into what is changed.

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
