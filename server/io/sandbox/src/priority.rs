//! Priority of the agent: others come first, for processor time and for memory.

use nix::unistd::{gettid, setsid};
use std::{
    fs, io,
    process::{self, Command, Stdio},
    thread,
    time::Duration,
};

// Restrictions in the report.
pub(crate) const LOWEST: &str = "lowest processor priority in its control group";
pub(crate) const FIRST_TO_END: &str = "first to be killed when memory runs out";

/// Priority of the session, where the kernel divides processor time among sessions first.
const SESSION: &str = "/proc/self/autogroup";
const BY_SESSION: &str = "/proc/sys/kernel/sched_autogroup_enabled";
const OOM_SCORE: &str = "/proc/self/oom_score_adj";

/// Lowest priority of a process or session.
const NICE: i32 = 19;
/// Score of the processes that the kernel kills first.
const HIGHEST_SCORE: &str = "1000";

/// Lowers this process and later children as far as the system permits; the checks below report the result.
pub(crate) fn lower() {
    // Within the organiser's session, the priority would not count against processes of other sessions.
    if setsid().is_ok() {
        lower_session();
    }
    lower_processor(&process::id().to_string());
    let _ = fs::write(OOM_SCORE, HIGHEST_SCORE);
}

/// Lowers the processor priority of the calling thread, as far as the system permits. Other threads keep theirs.
pub fn lower_thread() {
    lower_processor(&gettid().to_string());
}

/// Lowers the priority of a process with a single thread, or of a thread.
fn lower_processor(task: &str) {
    // Programs, because the safe wrappers of the C library lack these calls.
    run("renice", &["-n", &NICE.to_string(), "-p", task]);
    run("chrt", &["-i", "-p", "0", task]);
}

fn lower_session() {
    const ATTEMPTS: u32 = 50;
    // The kernel accepts a change per 0.1 s, from all users together.
    for _ in 0..ATTEMPTS {
        match fs::write(SESSION, NICE.to_string()) {
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                thread::sleep(Duration::from_millis(30))
            }
            _ => return,
        }
    }
}

fn run(program: &str, arguments: &[&str]) {
    let mut command = Command::new(program);
    command.args(arguments).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    let _ = command.status();
}

/// Returns an error unless this process and its session have the lowest priority.
pub(crate) fn check_processor() -> Result<(), String> {
    let stat = fs::read_to_string("/proc/self/stat").map_err(|error| error.to_string())?;
    if scheduling(&stat) != Some((NICE, libc::SCHED_IDLE)) {
        return Err("renice or chrt failed; install util-linux".to_owned());
    }
    match session_nice() {
        None | Some(NICE) => Ok(()),
        Some(nice) => Err(format!("the kernel schedules by session, and this one has the nice value {nice}")),
    }
}

/// Returns an error unless the kernel kills this process before others.
pub(crate) fn check_memory() -> Result<(), String> {
    let score = fs::read_to_string(OOM_SCORE).map_err(|error| error.to_string())?;
    if score.trim() == HIGHEST_SCORE { Ok(()) } else { Err(format!("its score is {}", score.trim())) }
}

/// Returns an error if this process can undo either: the kernel permits that without privileges.
pub(crate) fn check_files() -> Result<(), String> {
    let mut files = [SESSION, OOM_SCORE].into_iter();
    match files.find(|path| fs::File::options().write(true).open(path).is_ok()) {
        Some(path) => Err(format!("the agent can undo it in {path}")),
        None => Ok(()),
    }
}

/// Parses a line of `/proc/PID/stat`: nice value and scheduling policy.
fn scheduling(stat: &str) -> Option<(i32, i32)> {
    // After the program's name, which may contain spaces, comes field 3; these are 19 and 41 of proc_pid_stat(5).
    let fields: Vec<_> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    Some((fields.get(16)?.parse().ok()?, fields.get(38)?.parse().ok()?))
}

/// Returns the nice value of the session; `None` if the kernel does not schedule by session.
fn session_nice() -> Option<i32> {
    if fs::read_to_string(BY_SESSION).ok()?.trim() != "1" {
        return None;
    }
    nice_of(&fs::read_to_string(SESSION).ok()?)
}

/// Parses a session's line, such as `/autogroup-7 nice 19`.
fn nice_of(session: &str) -> Option<i32> {
    session.split_whitespace().last()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stat_lines_contain_nice_and_policy() {
        let line = "7 (a ) b) S 1 7 7 0 -1 4194304 9 0 0 0 0 0 0 0 39 19 1 0 55 2 3 \
                    18446744073709551615 1 1 0 0 0 0 0 0 0 0 0 0 17 1 0 5 0 0 0";
        assert_eq!(scheduling(line), Some((19, libc::SCHED_IDLE)));
        assert_eq!(scheduling("7 (a) S 1"), None);
    }

    #[test]
    fn session_lines_contain_nice() {
        assert_eq!(nice_of("/autogroup-12 nice 19\n"), Some(19));
        assert_eq!(nice_of("/autogroup-12 nice -5"), Some(-5));
        assert_eq!(nice_of(""), None);
    }
}
