//! Python commands in tests.

use crate::skipped::skipped;
use std::{
    env,
    path::PathBuf,
    process::{Command, Stdio},
};

/// Environment variable with the Python interpreter's path; by default `python3`.
const INTERPRETER: &str = "AVLN_PYTHON";

/// A Python command; `None` with the hint `remedy` if a module needed by `what` is missing.
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

/// Runs a command and returns its standard output; panics with all output if it fails.
pub fn succeeds(what: &str, mut command: Command) -> String {
    let output = command.output().expect("the command starts");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{what}: {text}\n{}", String::from_utf8_lossy(&output.stderr));
    text
}

/// The module `avln.sim._native`, which Cargo builds next to the test program.
pub fn native_module() -> PathBuf {
    let folder = env::current_exe().expect("a path").parent().expect("a folder").to_owned();
    folder.join(format!("{}_native{}", env::consts::DLL_PREFIX, env::consts::DLL_SUFFIX))
}
