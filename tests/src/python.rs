//! The Python that some tests run by.

use crate::skipped::skipped;
use std::{
    env,
    process::{Command, Stdio},
};

/// The Python to take, for those who do not have what is needed in `python3`.
const INTERPRETER: &str = "AVLN_PYTHON";

/// A command of Python; nothing, with a line on what `remedy` brings, where it lacks a module that `what` needs.
pub fn command(what: &str, modules: &[&str], remedy: &str) -> Option<Command> {
    let python = env::var(INTERPRETER).unwrap_or_else(|_| "python3".to_owned());
    let import = format!("import {}", modules.join(", "));
    let mut probe = Command::new(&python);
    let found = probe.args(["-c", &import]).stderr(Stdio::null()).status();
    if !found.is_ok_and(|status| status.success()) {
        let remedy = format!("`{remedy}` brings them, or set {INTERPRETER} to a Python that has them");
        skipped(&format!("{what}, for {python} lacks one of {modules:?}"), &remedy);
        return None;
    }
    let mut command = Command::new(&python);
    command.env("PYTHONDONTWRITEBYTECODE", "1").stdin(Stdio::null());
    Some(command)
}

/// Runs a command to its end; fails with all that it told if it fails.
pub fn succeeds(what: &str, mut command: Command) {
    let output = command.output().expect("Python starts");
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{what}: {told}\n{}", String::from_utf8_lossy(&output.stderr));
}
