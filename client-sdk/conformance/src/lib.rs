//! Conformance tests for servers and clients of `avln.v1`.
//!
//! [`check`] tests a server as a client, in a counted run; [`Host`] tests a client with a run full of faults.
//!
//! This crate never depends on server knowledge beyond address, account token and phase.

mod checks;
mod frames;
mod host;
mod scenario;
mod stream;
mod talk;
#[cfg(test)]
mod tests;
mod trials;

pub use checks::{Check, Outcome, check};
pub use host::Host;
pub use scenario::Scenario;
pub use talk::{Site, Trouble};
