//! Simple agents that others are compared with, each a file on the parts of `avln-kit`.
//!
//! Start reading at [`Baseline`]. Where an agent follows the published core of a method, its documentation names the method
//! and says what differs; none of them is that method.
//!
//! *Never*: links anything of the server; learns anything but what observations say.

mod allowance;
mod detector;
mod forward;
mod frontier;
mod memory;
mod name;
mod options;
mod snapshot;
mod sound;

pub use detector::Detector;
pub use forward::ForwardAndTurn;
pub use frontier::Frontier;
pub use name::Baseline;
pub use options::{Options, run, run_with};
pub use snapshot::Snapshot;
pub use sound::SoundFollower;
