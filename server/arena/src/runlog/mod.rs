//! Run logs: append-only records of runs, for restart and verification.
//!
//! `DATA/runs/<run>.log` is text with a line per [`Entry`]: 32 hexadecimal digits, a space, and the entry as
//! JSON. The digits are the first 16 bytes of a BLAKE3 hash over the digits of the previous line and the JSON
//! of this line, so changed, removed or inserted lines are detectable. An incomplete last line was
//! interrupted by a crash and is ignored.

mod entry;
mod history;
mod seal;
mod writer;

pub use entry::Entry;
pub use history::{EpisodeHistory, History, LogError};
pub use seal::{SigningKey, is_signed};
pub use writer::{RunLog, RunLogs, SlotLog};

/// Digits of the hash in front of each line.
const DIGITS: usize = 32;

/// The digits in front of a line, after those of the line before; none before the first.
fn link(before: &str, json: &str) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update(before.as_bytes()).update(b"\n").update(json.as_bytes());
    hasher.finalize().to_hex()[..DIGITS].to_owned()
}

#[cfg(test)]
mod tests;
