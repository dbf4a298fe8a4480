//! Parts whose runtime is missing.

use std::env;

/// Set to `never` where everything must be there, as in `.ci/run`.
const SKIP: &str = "AVLN_SKIP";

/// Tells which part is skipped, and what to install.
///
/// # Panics
/// Where nothing may be skipped.
pub fn skipped(part: &str, remedy: &str) {
    let line = format!("skipped: {part}; {remedy}");
    assert!(env::var_os(SKIP).is_none_or(|skip| skip != "never"), "{SKIP} is never, but {line}");
    eprintln!("{line}");
}
