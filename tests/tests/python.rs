//! The Python package does what it says: its tests pass over the program of this build, its types and its style hold.

use std::{
    env,
    path::{Path, PathBuf},
    process::{Command, Stdio},
};

/// The Python to take, for those who do not have what is needed in `python3`.
const INTERPRETER: &str = "AVLN_PYTHON";

fn package() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../client-sdk/python")
}

/// Runs a module of Python in the package's folder; nothing, with a line on what to do, where `needed` is not there.
fn run(module: &str, arguments: &[&str], needed: &[&str]) {
    let python = env::var(INTERPRETER).unwrap_or_else(|_| "python3".to_owned());
    let import = format!("import {}", needed.join(", "));
    let mut probe = Command::new(&python);
    let found =
        probe.args(["-c", &import]).stderr(Stdio::null()).status().is_ok_and(|status| status.success());
    if !found {
        eprintln!(
            "skipped: {module} of client-sdk/python, for {python} lacks one of {needed:?}; \
             `pip install -e \"client-sdk/python[dev]\"` brings them, or set {INTERPRETER} to a Python that has them"
        );
        return;
    }
    let mut command = Command::new(&python);
    command.args(["-m", module]).args(arguments).current_dir(package());
    command.env("AVLN_BIN", env!("CARGO_BIN_EXE_avln_under_test")).stdin(Stdio::null());
    for name in ["AVLN_SERVER", "AVLN_TOKEN", "AVLN_CA", "AVLN_DATA"] {
        command.env_remove(name);
    }
    let output = command.output().expect("Python starts");
    let told = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{module}: {told}\n{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn its_tests_pass_over_this_server() {
    let needed = ["avln", "pytest", "gymnasium", "grpc_tools", "msgpack", "zmq"];
    run("pytest", &["-q", "-p", "no:cacheprovider"], &needed);
}

#[test]
fn its_style_is_kept() {
    run("ruff", &["check", "--no-cache"], &["ruff"]);
    run("ruff", &["format", "--check", "--no-cache"], &["ruff"]);
}

#[test]
fn its_types_hold() {
    run("mypy", &["--cache-dir", "/dev/null"], &["avln", "mypy", "pytest", "gymnasium", "msgpack", "zmq"]);
}
