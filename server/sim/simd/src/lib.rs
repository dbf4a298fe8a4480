//! What only `unsafe` code can ask of the machine: its widest vector instructions, and files as memory.
//!
//! `README.md` beside this crate tells why each use is sound.
//!
//! *Never*: knows what it is used for.

mod mapped;
mod widest;

pub use mapped::Mapped;
pub use widest::{Width, Work, run_at};
