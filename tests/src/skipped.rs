//! Skipped tests without their runtime.

use std::env;

/// `never` turns skipped tests into failures, as in `.ci/run`.
const SKIP: &str = "AVLN_SKIP";

/// Prints the skipped test and the install hint.
///
/// # Panics
/// With `AVLN_SKIP=never`.
pub fn skipped(part: &str, remedy: &str) {
    let line = format!("skipped: {part}; {remedy}");
    assert!(env::var_os(SKIP).is_none_or(|skip| skip != "never"), "{SKIP} is never, but {line}");
    eprintln!("{line}");
}
