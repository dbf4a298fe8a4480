//! The random agent: the floor of every leaderboard.
//!
//! Start reading at [`RandomAgent`] and [`run`].
//!
//! *Never*: looks at a picture, a depth or a sound; links anything of the server.

mod agent;
mod options;
mod rng;

pub use agent::RandomAgent;
pub use options::{Options, run, run_with};
