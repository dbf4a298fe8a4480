//! The Python package does what it says: its tests pass over the program of this build, its types and its style hold.

use avln_tests::{python, repository::root};

/// Runs a module of Python in the package's folder, where `needed` is there.
fn run(module: &str, arguments: &[&str], needed: &[&str]) {
    let what = format!("{module} of client-sdk/python");
    let Some(mut command) = python::command(&what, needed, "pip install -e \"client-sdk/python[dev]\"")
    else {
        return;
    };
    command.args(["-m", module]).args(arguments).current_dir(root().join("client-sdk/python"));
    command.env("AVLN_BIN", env!("CARGO_BIN_EXE_avln_under_test"));
    for name in ["AVLN_SERVER", "AVLN_TOKEN", "AVLN_CA", "AVLN_DATA"] {
        command.env_remove(name);
    }
    python::succeeds(&what, command);
}

#[test]
fn its_tests_pass_over_this_server() {
    let needed = ["avln", "pytest", "gymnasium", "grpc_tools", "msgpack", "zmq"];
    // A test that waits for ever ends the run, and tells where it waits.
    let ends = ["-o", "faulthandler_timeout=300", "-o", "faulthandler_exit_on_timeout=true"];
    run("pytest", &[&["-q", "-p", "no:cacheprovider"], &ends[..]].concat(), &needed);
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
