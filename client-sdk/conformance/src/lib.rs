//! Checks whether a server keeps `avln.v1`, by talking to it as an agent would: what it must answer, refuse and remember.
//!
//! Start reading at [`check`]. Each [`Check`] names the rule of `PROTOCOL.md` that it is about. It plays some episodes of one
//! run in a phase of the server's, which counts like any other.
//!
//! *Never*: needs to know anything about the server but its address, an account token and a phase.

mod checks;
mod talk;

pub use checks::{Check, Outcome, check};
pub use talk::Trouble;
