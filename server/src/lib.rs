//! The binary `avln`: command line, configuration and wiring, and nothing else.
//!
//! Start reading at [`run`], then `arena`, where the agents' door meets the rules and the store.

pub mod admin;
pub mod arena;
pub mod backup;
pub mod cache;
pub mod calibration;
pub mod challenge;
mod cli;
pub mod commands;
pub mod dataset;
pub mod doctor;
pub mod doors;
mod failure;
pub mod heads;
pub mod ladder;
mod npy;
pub mod office;
pub mod preview;
pub mod rescoring;
pub mod rollout;
pub mod runlog;
mod say;
pub mod sounds;
pub mod studio;

pub use cli::{Cli, main, run};
pub use failure::{Failure, FailureKind};
