//! The processes of a sandbox: the supervisor, which creates namespaces, and the child, which becomes the agent.

use crate::{
    MAX_PROCESSES, SandboxError, SandboxPlan, SandboxReport, group::ControlGroup, max_processes, restrict,
};
use nix::{
    errno::Errno,
    sched::{CloneFlags, unshare},
    sys::{
        prctl::{set_no_new_privs, set_pdeathsig},
        signal::Signal,
    },
    unistd::{Gid, Uid, close},
};
use std::{
    convert::Infallible,
    fs,
    io::{self, BufRead, BufReader, Write},
    os::{
        fd::RawFd,
        unix::{
            net::UnixStream,
            process::{CommandExt, ExitStatusExt},
        },
    },
    path::{Path, PathBuf},
    process::Command,
};

// Restrictions in the report, which results record.
const LANDLOCK: &str = "files and TCP by Landlock";
const SECCOMP: &str = "system calls by seccomp, Unix sockets only";
const FILE_LIMITS: &str = "limits on open files and written bytes";
const NO_INHERITED_FILES: &str = "no inherited files";
const NO_PRIVILEGES: &str = "no new privileges";
const NO_CAPABILITIES: &str = "no capabilities";
const NAMESPACES: [&str; 4] =
    ["no network", "own processes", "own host name and shared memory", "own mounts and users"];

/// Environment variables that the agent keeps.
const VARIABLES: [&str; 4] = ["PATH", "LANG", "LC_ALL", "TERM"];

/// User id during the mount setup.
const ROOT: u32 = 0;
/// User id of the agent.
const AGENT: u32 = 1000;

pub(crate) fn supervise(plan: &Path, program: &Path, child_arguments: &[String]) -> Result<u8, SandboxError> {
    // The child closes them too, and reports the result.
    let _ = close_inherited_files();
    let folder = SandboxPlan::read(plan)?.folder;
    // Fails without a group; the child checks and reports that.
    let _ = ControlGroup::join(&folder);
    restrict::lower_priority();
    let mut child = Command::new(program);
    child.args(child_arguments);
    // A process ID namespace holds only later children, so the child is a further process.
    if let Err(why) = create_namespaces() {
        child.arg("--outside").arg(why);
    }
    // If the supervisor is killed, the agent and all its processes die as well.
    let _ = set_pdeathsig(Signal::SIGKILL);
    let status = child.status().map_err(|error| SandboxError::Command {
        program: program.display().to_string(),
        problem: error.to_string(),
    })?;
    let code = status.code().unwrap_or_else(|| 128 + status.signal().unwrap_or(0));
    Ok(u8::try_from(code).unwrap_or(u8::MAX))
}

/// Closes all files except standard input, output and error: the caller of the program may have opened secrets.
fn close_inherited_files() -> Result<(), String> {
    const STANDARD_ERROR: RawFd = 2;
    let listed = fs::read_dir("/proc/self/fd").map_err(|error| format!("cannot list open files: {error}"))?;
    let open: Vec<RawFd> = listed.filter_map(|file| file.ok()?.file_name().to_str()?.parse().ok()).collect();
    for file in open.into_iter().filter(|&file| file > STANDARD_ERROR) {
        match close(file) {
            // The list contains the folder of the list, which is closed already.
            Ok(()) | Err(Errno::EBADF) => {}
            Err(error) => return Err(format!("cannot close file {file}: {error}")),
        }
    }
    Ok(())
}

/// Creates namespaces of all kinds. Later processes are root inside them.
fn create_namespaces() -> Result<(), String> {
    let all = CloneFlags::CLONE_NEWUSER
        | CloneFlags::CLONE_NEWNS
        | CloneFlags::CLONE_NEWNET
        | CloneFlags::CLONE_NEWPID
        | CloneFlags::CLONE_NEWIPC
        | CloneFlags::CLONE_NEWUTS;
    become_in(all, ROOT)
}

/// Creates an inner user namespace without privileges over mounts and network. Exec drops the rest.
fn drop_root() -> Result<(), String> {
    become_in(CloneFlags::CLONE_NEWUSER, AGENT)
}

fn become_in(namespaces: CloneFlags, id: u32) -> Result<(), String> {
    let (uid, gid) = (Uid::effective(), Gid::effective());
    unshare(namespaces).map_err(|error| format!("the kernel creates no namespaces: {error}"))?;
    let map = |file: &str, text: String| {
        fs::write(file, text).map_err(|error| format!("cannot write {file}: {error}"))
    };
    // Without privileges, the kernel accepts a group map only after setgroups is denied: user_namespaces(7).
    map("/proc/self/setgroups", "deny".to_owned())?;
    map("/proc/self/uid_map", format!("{id} {uid} 1"))?;
    map("/proc/self/gid_map", format!("{id} {gid} 1"))
}

pub(crate) fn enter(plan: &Path, outside: Option<&str>) -> Result<Infallible, SandboxError> {
    let closed = close_inherited_files();
    let plan = SandboxPlan::read(plan)?;
    let gone = |error: io::Error| SandboxError::GivenUp(error.to_string());
    let mut organiser = UnixStream::connect(SandboxPlan::control_socket(&plan.folder)).map_err(gone)?;
    let mut report = restrict_process(&plan, outside)?;
    report.note(NO_INHERITED_FILES, closed);
    let line = serde_json::to_string(&report).map_err(|error| SandboxError::GivenUp(error.to_string()))?;
    writeln!(organiser, "{line}").map_err(gone)?;
    let mut token = String::new();
    BufReader::new(organiser).read_line(&mut token).map_err(gone)?;
    match token.trim() {
        "" => Err(SandboxError::GivenUp("no run was started".to_owned())),
        token => Err(become_agent(&plan, token)),
    }
}

/// Drops all privileges.
fn restrict_process(plan: &SandboxPlan, outside: Option<&str>) -> Result<SandboxReport, SandboxError> {
    let mut report = SandboxReport::default();
    for what in NAMESPACES {
        report.note(what, outside.map_or(Ok(()), Err));
    }
    // Before a second user namespace hides the user outside.
    let bound = bound_by_process_limit(plan);
    // Without namespaces, the limit counts the user's other processes too.
    let most_processes = if outside.is_none() { max_processes() } else { MAX_PROCESSES };
    // Mounts need root of the namespace, which the next step drops.
    if outside.is_none() {
        restrict::arrange(plan, &mut report);
    }
    let dropped = if outside.is_none() { drop_root() } else { has_no_capabilities() };
    report.note(NO_CAPABILITIES, dropped.clone());
    let _ = std::env::set_current_dir(&plan.workplace);
    set_limits(plan, &dropped, (most_processes, bound), &mut report);
    // Landlock and seccomp require it from processes without privileges.
    report.note(NO_PRIVILEGES, set_no_new_privs());
    // A new process starts without the signal, and a change of user clears it.
    let _ = set_pdeathsig(Signal::SIGKILL);
    let lowest = dropped.and(restrict::limit_priority()).and(restrict::check_processor());
    let first_to_end = restrict::check_memory();
    report.note(LANDLOCK, restrict::landlock(plan));
    refuse_exposure(plan, &report)?;
    check_program(plan)?;
    // Landlock makes these files read-only.
    let fixed = restrict::check_files();
    // Last, because the filter denies calls of the earlier steps, such as mount and unshare.
    let filtered = restrict::seccomp();
    report.note(restrict::LOWEST, lowest.and(fixed.clone()).and(filtered.clone()));
    report.note(restrict::FIRST_TO_END, first_to_end.and(fixed));
    report.note(SECCOMP, filtered);
    Ok(report)
}

/// Returns an error if neither RLIMIT_NPROC nor a control group limits the processes of this user.
fn bound_by_process_limit(plan: &SandboxPlan) -> Result<(), String> {
    if !is_root_outside() || ControlGroup::is_joined(&plan.folder) {
        return Ok(());
    }
    Err("the kernel does not bind root; start the command as another user".to_owned())
}

/// Returns true if the user outside this user namespace is root, or unknown.
fn is_root_outside() -> bool {
    let own = Uid::effective().as_raw();
    let Ok(map) = fs::read_to_string("/proc/self/uid_map") else { return true };
    map.lines().any(|line| {
        let numbers: Vec<u32> = line.split_whitespace().filter_map(|number| number.parse().ok()).collect();
        // First user inside, first user outside, length.
        matches!(numbers[..], [inside, ROOT, _] if inside == own)
    })
}

/// Sets the limits. With capabilities the agent could raise them, so they count only if these were `dropped`.
fn set_limits(
    plan: &SandboxPlan,
    dropped: &Result<(), String>,
    (most_processes, bound): (u32, Result<(), String>),
    report: &mut SandboxReport,
) {
    let mut note = |what: &str, set: Result<(), String>| report.note(what, dropped.clone().and(set));
    note(FILE_LIMITS, restrict::limit_files());
    let processes = format!("at most {most_processes} processes");
    note(&processes, restrict::limit_processes(most_processes).and(bound));
    if let Some(mib) = plan.memory_mib {
        note(&format!("memory limit of {mib} MiB per process"), restrict::limit_memory(mib));
    }
}

fn has_no_capabilities() -> Result<(), String> {
    let status = fs::read_to_string("/proc/self/status").map_err(|error| error.to_string())?;
    let held = status.lines().find_map(|line| line.strip_prefix("CapPrm:")).unwrap_or("?").trim();
    if held.bytes().all(|digit| digit == b'0') {
        Ok(())
    } else {
        Err(format!("the process has the capabilities {held}"))
    }
}

/// Refuses a run if neither mounts nor Landlock hide the ground truth.
fn refuse_exposure(plan: &SandboxPlan, report: &SandboxReport) -> Result<(), SandboxError> {
    if report.holds(restrict::HIDDEN) {
        return Ok(());
    }
    let unhidden = report.why(restrict::HIDDEN).or(report.why(NAMESPACES[0])).unwrap_or_default();
    let exposed = |why: String| Err(SandboxError::Exposed { hidden: plan.hidden.clone(), why });
    if !report.holds(LANDLOCK) {
        return exposed(format!("{unhidden}, and Landlock is missing"));
    }
    match restrict::readable(plan).into_iter().find(|readable| plan.hidden.starts_with(readable)) {
        Some(readable) => exposed(format!("the agent may read {}, and {unhidden}", readable.display())),
        None => Ok(()),
    }
}

/// Checks that the agent's program can be opened: otherwise a run would start and end without an agent.
fn check_program(plan: &SandboxPlan) -> Result<(), SandboxError> {
    let program = plan.command.first().cloned().unwrap_or_default();
    let candidates = if program.contains('/') {
        vec![PathBuf::from(&program)]
    } else {
        // Without PATH, exec searches these folders.
        let folders = std::env::var_os("PATH").unwrap_or_else(|| "/bin:/usr/bin".into());
        std::env::split_paths(&folders).map(|folder| folder.join(&program)).collect()
    };
    let mut problem = "there is no such program".to_owned();
    for path in candidates.iter().filter(|path| path.is_file()) {
        match fs::File::open(path) {
            Ok(_) => return Ok(()),
            Err(error) => problem = format!("{}: {error}", path.display()),
        }
    }
    Err(SandboxError::Command { program, problem })
}

/// Replaces this process by the agent. Returns only after an error.
fn become_agent(plan: &SandboxPlan, token: &str) -> SandboxError {
    let program = plan.command.first().cloned().unwrap_or_default();
    let scratch = SandboxPlan::scratch(&plan.folder);
    let own = VARIABLES.iter().map(ToString::to_string).chain(plan.variables.iter().cloned());
    let error = Command::new(&program)
        .args(plan.command.iter().skip(1))
        .env_clear()
        .envs(own.filter_map(|name| std::env::var_os(&name).map(|value| (name, value))))
        .env("HOME", &scratch)
        .env("TMPDIR", &scratch)
        .env("AVLN_SERVER", format!("unix:{}", SandboxPlan::server_socket(&plan.folder).display()))
        .env("AVLN_TOKEN", token)
        .exec();
    SandboxError::Command { program, problem: error.to_string() }
}
