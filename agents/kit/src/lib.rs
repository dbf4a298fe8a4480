//! What agents share: maps of what was seen and heard, ways through them, what pictures, sounds and cues say.
//!
//! Start reading at [`map`] and [`perception`]; [`path`] and [`Motion`] turn places into actions, [`Turns`] tells which
//! source sounds. An agent is put together from these parts and adds what it wants.
//!
//! *Never*: links anything of the server; decides where to go or what to submit; learns anything but what observations say.

pub mod map;
mod motion;
mod path;
pub mod perception;
mod turns;

pub use motion::Motion;
pub use path::{Path, path};
pub use turns::Turns;
