//! Command line of `avln`: arguments, output and wiring, and nothing else.
//!
//! Start at [`run`]. Each file of `commands` is one command.

mod args;
pub mod commands;
mod output;

pub use args::{Cli, main, run};
