//! What agents share: maps of what was seen and heard, ways through them, what pictures, sounds and cues say.
//!
//! Start reading at [`map`] and [`perception`]; [`path()`] and [`Motion`] turn places into actions, which [`Scout`] puts
//! together for agents that explore; [`Turns`] tells which source sounds, [`Aftermath`] what
//! became of a Submit. [`Hints`] are for agents whose host tells them more
//! than an agent may know. An agent is put together from these parts and adds what it wants; [`shell`] makes a program of it.
//!
//! *Never*: links anything of the server; decides where to go or what to submit; learns anything but what observations say.

mod aftermath;
mod course;
mod hints;
pub mod map;
mod motion;
mod path;
pub mod perception;
mod scout;
pub mod shell;
mod turns;

pub use aftermath::Aftermath;
pub use course::Course;
pub use hints::{Hints, Sight, Told};
pub use motion::Motion;
pub use path::{Path, path};
pub use scout::Scout;
pub use turns::Turns;

/// Agents look at a thing within this distance to tell what it is, metres.
pub const LOOK_M: f32 = 2.8;
