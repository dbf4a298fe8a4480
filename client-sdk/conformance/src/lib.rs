//! Checks whether a server keeps `avln.v1`, by talking to it as an agent would: what it must answer, refuse and remember. And
//! whether a client does, by hosting it a run in which everything goes wrong that may.
//!
//! Start reading at [`check`], and at [`Host`] for clients. Each [`Check`] names the rule of `PROTOCOL.md` that it is about. It plays some episodes of one
//! run in a phase of the server's, which counts like any other.
//!
//! *Never*: needs to know anything about the server but its address, an account token and a phase.

mod book;
mod checks;
mod frames;
mod host;
mod talk;
mod trials;

pub use checks::{Check, Outcome, check};
pub use host::Host;
pub use talk::{Site, Trouble};
