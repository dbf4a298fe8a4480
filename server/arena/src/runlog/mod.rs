//! Run logs: what happens in a run, written down as it happens, so that a run outlives the server and can be checked later.
//!
//! `DATA/runs/<run>.log` is text, one line an [`Entry`]: 32 hexadecimal digits, a blank, and the entry as JSON. The digits are
//! the first 16 bytes of a BLAKE3 hash over the digits of the line before and this line's JSON: a line that was changed, left
//! out or put in shows. A last line that is not whole was being written when the server died, and counts for nothing.

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
