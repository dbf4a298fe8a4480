use crate::{CellError, Plan, Report, mounts, namespaces, restrict};
use nix::sys::{
    prctl::{set_no_new_privs, set_pdeathsig},
    signal::Signal,
};
use std::{
    convert::Infallible,
    fs,
    io::{BufRead, BufReader, Write},
    os::unix::{net::UnixStream, process::CommandExt},
    path::Path,
    process::Command,
};

const LANDLOCK: &str = "files and TCP by Landlock";
const SECCOMP: &str = "system calls by seccomp, Unix sockets only";
const LIMITS: &str = "limits on processes, files and memory";
const NO_PRIVILEGES: &str = "no new privileges";
const NO_CAPABILITIES: &str = "no capabilities";
const NAMESPACES: [&str; 4] =
    ["no network", "own processes", "own host name and shared memory", "own mounts and users"];

pub(crate) fn shut(plan: &Path, outside: Option<&str>) -> Result<Infallible, CellError> {
    let plan = Plan::read(plan)?;
    let gone = |error: std::io::Error| CellError::GivenUp(error.to_string());
    let mut organiser = UnixStream::connect(Plan::control_socket(&plan.folder)).map_err(gone)?;
    let report = restrict(&plan, outside)?;
    let line = serde_json::to_string(&report).map_err(|error| CellError::GivenUp(error.to_string()))?;
    writeln!(organiser, "{line}").map_err(gone)?;
    let mut token = String::new();
    BufReader::new(organiser).read_line(&mut token).map_err(gone)?;
    match token.trim() {
        "" => Err(CellError::GivenUp("no run was started".to_owned())),
        token => Err(become_agent(&plan, token)),
    }
}

/// Drops all privileges, in the order required by the remaining steps.
fn restrict(plan: &Plan, outside: Option<&str>) -> Result<Report, CellError> {
    let mut report = Report::default();
    for what in NAMESPACES {
        report.note(what, outside.map_or(Ok(()), Err));
    }
    if outside.is_none() {
        mounts::arrange(plan, &mut report);
    }
    report.note(
        NO_CAPABILITIES,
        if outside.is_none() { namespaces::drop_root() } else { has_no_capabilities() },
    );
    let _ = std::env::set_current_dir(&plan.workplace);
    report.note(LIMITS, restrict::limits(plan));
    report.note(NO_PRIVILEGES, set_no_new_privs());
    let _ = set_pdeathsig(Signal::SIGKILL);
    report.note(LANDLOCK, restrict::landlock(plan));
    refuse_exposure(plan, &report)?;
    report.note(SECCOMP, restrict::seccomp());
    Ok(report)
}

fn has_no_capabilities() -> Result<(), String> {
    let status = fs::read_to_string("/proc/self/status").map_err(|error| error.to_string())?;
    let held = status.lines().find_map(|line| line.strip_prefix("CapPrm:")).unwrap_or("?").trim();
    if held.bytes().all(|digit| digit == b'0') { Ok(()) } else { Err(format!("it holds {held}")) }
}

/// Refuses a run if neither mounts nor Landlock hide the ground truth.
fn refuse_exposure(plan: &Plan, report: &Report) -> Result<(), CellError> {
    if report.holds(mounts::HIDDEN) {
        return Ok(());
    }
    let unhidden = report.why(mounts::HIDDEN).or(report.why(NAMESPACES[0])).unwrap_or_default();
    let exposed = |why: String| Err(CellError::Exposed { hidden: plan.hidden.clone(), why });
    if !report.holds(LANDLOCK) {
        return exposed(format!("{unhidden}, and there is no Landlock"));
    }
    match restrict::readable(plan).into_iter().find(|readable| plan.hidden.starts_with(readable)) {
        Some(readable) => exposed(format!("it lies in {}, and {unhidden}", readable.display())),
        None => Ok(()),
    }
}

/// Variables that every program may know.
const VARIABLES: [&str; 4] = ["PATH", "LANG", "LC_ALL", "TERM"];

/// Returns only when it failed.
fn become_agent(plan: &Plan, token: &str) -> CellError {
    let program = plan.command.first().cloned().unwrap_or_default();
    let scratch = Plan::scratch(&plan.folder);
    let own = VARIABLES.iter().map(ToString::to_string).chain(plan.variables.iter().cloned());
    let error = Command::new(&program)
        .args(plan.command.iter().skip(1))
        .env_clear()
        .envs(own.filter_map(|name| std::env::var_os(&name).map(|value| (name, value))))
        .env("HOME", &scratch)
        .env("TMPDIR", &scratch)
        .env("AVLN_SERVER", format!("unix:{}", Plan::server_socket(&plan.folder).display()))
        .env("AVLN_TOKEN", token)
        .exec();
    CellError::Command { program, problem: error.to_string() }
}
