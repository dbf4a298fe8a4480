//! Skipped tests without their runtime.

use std::{env, io::Write, process::Command};

/// `never` turns skipped tests into failures, as in `.ci/run`.
const SKIP: &str = "AVLN_SKIP";

/// The `docker` program; `None` if `AVLN_DOCKER` is `none`, which skips the container tests on machines without an engine.
pub fn docker() -> Option<Command> {
    let program = env::var_os("AVLN_DOCKER").unwrap_or_else(|| "docker".into());
    (program != "none").then(|| Command::new(program))
}

/// Prints the skipped test and the install hint, also for `AVLN_SKIP=never`.
pub fn excluded(part: &str, remedy: &str) {
    // Not `eprintln!`, which the test harness hides.
    let _ = writeln!(std::io::stderr(), "skipped: {part}; {remedy}");
}

/// Prints the skipped test and the install hint.
///
/// # Panics
/// With `AVLN_SKIP=never`.
pub fn skipped(part: &str, remedy: &str) {
    let line = format!("skipped: {part}; {remedy}");
    assert!(env::var_os(SKIP).is_none_or(|skip| skip != "never"), "{SKIP} is never, but {line}");
    excluded(part, remedy);
}
