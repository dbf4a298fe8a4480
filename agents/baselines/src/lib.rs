//! Simple agents for comparison, built from the parts of `avln-kit`, and the random agent.
//!
//! Start reading at [`Baseline`] and [`RandomAgent`]. An agent modelled on a published method names it and lists the
//! differences; no agent here is a reimplementation.
//!
//! *Never*: links a server crate other than `avln-simd`; uses information beyond observations. [`RandomAgent`] uses neither
//! images nor sound.

mod args;
mod sound;
mod unguided;
mod visual;

pub use args::{Baseline, BaselineArgs, RandomArgs, run, run_random, run_random_with, run_with};
pub use sound::SoundFollower;
pub use unguided::{ForwardAndTurn, Frontier, RandomAgent};
pub use visual::{Detector, Snapshot};
