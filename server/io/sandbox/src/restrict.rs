//! Restrictions of the agent: mounts, Landlock, seccomp, resource limits, and a priority below all others for processor time and
//! memory.

use crate::{SandboxPlan, SandboxReport};
use landlock::{
    ABI, Access, AccessFs, AccessNet, CompatLevel, Compatible, Ruleset, RulesetAttr, RulesetCreatedAttr,
    RulesetStatus, Scope, path_beneath_rules,
};
use nix::{
    mount::{MsFlags, mount},
    sys::resource::{Resource, setrlimit},
    unistd::{gettid, setsid},
};
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen as Width, SeccompCmpOp as Op, SeccompCondition,
    SeccompFilter, SeccompRule, apply_filter,
};
use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
    process::{self, Command, Stdio},
    thread,
    time::Duration,
};

/// Readable paths for every program.
const SYSTEM: [&str; 10] =
    ["/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/opt", "/etc", "/proc", "/sys/devices/system"];
const HARMLESS_DEVICES: [&str; 5] = ["/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom"];

/// Maximum open files per process.
const FILES: u64 = 4096;
/// Maximum size of a written file, bytes: the scratch folder's size.
const FILE_BYTES: u64 = 1 << 30;

/// Returns the agent's readable paths.
pub(crate) fn readable(plan: &SandboxPlan) -> Vec<PathBuf> {
    let own = [plan.workplace.clone(), plan.folder.clone()];
    SYSTEM.iter().map(PathBuf::from).chain(own).chain(plan.readable.clone()).collect()
}

/// Limits the agent to readable paths, the scratch folder and devices; no TCP, and no outside processes.
pub(crate) fn landlock(plan: &SandboxPlan) -> Result<(), String> {
    const FILES: ABI = ABI::V5;
    let build = || {
        Ruleset::default()
            .set_compatibility(CompatLevel::BestEffort)
            .handle_access(AccessFs::from_all(FILES))?
            .handle_access(AccessNet::from_all(FILES))?
            .scope(Scope::from_all(ABI::V6))?
            .create()?
            .add_rules(path_beneath_rules(readable(plan), AccessFs::from_read(FILES)))?
            .add_rules(path_beneath_rules([SandboxPlan::scratch(&plan.folder)], AccessFs::from_all(FILES)))?
            .add_rules(path_beneath_rules(HARMLESS_DEVICES, AccessFs::from_all(FILES)))?
            .add_rules(path_beneath_rules(&plan.devices, AccessFs::from_all(FILES)))?
            .restrict_self()
    };
    match build().map_err(|error: landlock::RulesetError| error.to_string())?.ruleset {
        RulesetStatus::FullyEnforced => Ok(()),
        RulesetStatus::PartiallyEnforced => {
            Err("the kernel's Landlock is old and enforces a part only".to_owned())
        }
        RulesetStatus::NotEnforced => Err("the kernel has no Landlock".to_owned()),
    }
}

/// Limits open files and written bytes; disables core dumps.
pub(crate) fn limit_files() -> Result<(), String> {
    limit(Resource::RLIMIT_CORE, 0)?;
    limit(Resource::RLIMIT_NOFILE, FILES)?;
    limit(Resource::RLIMIT_FSIZE, FILE_BYTES)
}

/// Limits the processes of this user, except root.
pub(crate) fn limit_processes(most: u32) -> Result<(), String> {
    limit(Resource::RLIMIT_NPROC, most.into())
}

/// Forbids this process to raise its priority.
pub(crate) fn limit_priority() -> Result<(), String> {
    limit(Resource::RLIMIT_NICE, 0)?;
    limit(Resource::RLIMIT_RTPRIO, 0)
}

/// Limits the memory per process.
pub(crate) fn limit_memory(mib: u32) -> Result<(), String> {
    limit(Resource::RLIMIT_AS, u64::from(mib) << 20)
}

fn limit(resource: Resource, most: u64) -> Result<(), String> {
    let (_, hard) = nix::sys::resource::getrlimit(resource).map_err(|error| error.to_string())?;
    let most = most.min(hard);
    setrlimit(resource, most, most).map_err(|error| format!("{resource:?}: {error}"))
}

/// Denied system calls: they reach beyond the process, and agents do not need them.
#[rustfmt::skip]
const DENIED: &[i64] = &[
    libc::SYS_ptrace, libc::SYS_process_vm_readv, libc::SYS_process_vm_writev, libc::SYS_kcmp, libc::SYS_pidfd_getfd,
    libc::SYS_mount, libc::SYS_umount2, libc::SYS_pivot_root, libc::SYS_chroot, libc::SYS_move_mount,
    libc::SYS_open_tree, libc::SYS_fsopen, libc::SYS_fsmount, libc::SYS_fsconfig, libc::SYS_fspick,
    libc::SYS_mount_setattr, libc::SYS_setns, libc::SYS_unshare, libc::SYS_name_to_handle_at,
    libc::SYS_open_by_handle_at, libc::SYS_bpf, libc::SYS_perf_event_open, libc::SYS_userfaultfd,
    libc::SYS_io_uring_setup, libc::SYS_io_uring_enter, libc::SYS_io_uring_register, libc::SYS_keyctl,
    libc::SYS_add_key, libc::SYS_request_key, libc::SYS_kexec_load, libc::SYS_init_module, libc::SYS_finit_module,
    libc::SYS_delete_module, libc::SYS_reboot, libc::SYS_swapon, libc::SYS_swapoff, libc::SYS_acct, libc::SYS_syslog,
    libc::SYS_settimeofday, libc::SYS_clock_settime, libc::SYS_adjtimex, libc::SYS_clock_adjtime,
    libc::SYS_sethostname, libc::SYS_setdomainname, libc::SYS_quotactl, libc::SYS_vhangup,
    // A new session would have ordinary priority, and the kernel permits a higher one for disks.
    libc::SYS_setsid, libc::SYS_ioprio_set,
];

/// Flags for namespaces in clone.
const NAMESPACES: [i32; 7] = [
    libc::CLONE_NEWUSER,
    libc::CLONE_NEWNS,
    libc::CLONE_NEWNET,
    libc::CLONE_NEWPID,
    libc::CLONE_NEWIPC,
    libc::CLONE_NEWUTS,
    libc::CLONE_NEWCGROUP,
];

/// `ioctl` requests TIOCSTI and TIOCLINUX, which inject keystrokes; their type depends on the C library.
const KEYSTROKES: [u64; 2] = [0x5412, 0x541C];

type CallRules = BTreeMap<i64, Vec<SeccompRule>>;

/// Denies sockets other than Unix ones, calls that reach beyond the process, and keystrokes into the organiser's terminal.
pub(crate) fn seccomp() -> Result<(), String> {
    // Without clone3 the C library uses clone, with flags that seccomp can inspect.
    let absent = BTreeMap::from([(libc::SYS_clone3, Vec::new())]);
    let wrong = |error: seccompiler::Error| error.to_string();
    let rules = denied().map_err(|error| error.to_string())?;
    for (rules, answer) in [(absent, libc::ENOSYS), (rules, libc::EPERM)] {
        let program = compile(rules, answer).map_err(|error| error.to_string())?;
        apply_filter(&program).map_err(wrong)?;
    }
    Ok(())
}

fn denied() -> Result<CallRules, seccompiler::BackendError> {
    let mut rules: CallRules = DENIED.iter().map(|&call| (call, Vec::new())).collect();
    rules.insert(libc::SYS_socket, vec![rule(0, Op::Ne, libc::AF_UNIX as u64)?]);
    let foreign = NAMESPACES.iter().map(|&flag| {
        let bit = u64::from(flag.cast_unsigned());
        rule(0, Op::MaskedEq(bit), bit)
    });
    rules.insert(libc::SYS_clone, foreign.collect::<Result<_, _>>()?);
    let keystrokes = KEYSTROKES.map(|request| rule(1, Op::Eq, request));
    rules.insert(libc::SYS_ioctl, keystrokes.into_iter().collect::<Result<_, _>>()?);
    Ok(rules)
}

fn rule(argument: u8, op: Op, value: u64) -> Result<SeccompRule, seccompiler::BackendError> {
    SeccompRule::new(vec![SeccompCondition::new(argument, Width::Dword, op, value)?])
}

fn compile(rules: CallRules, answer: i32) -> Result<BpfProgram, seccompiler::BackendError> {
    let refuse = SeccompAction::Errno(answer.cast_unsigned());
    let filter = SeccompFilter::new(rules, SeccompAction::Allow, refuse, std::env::consts::ARCH.try_into()?)?;
    filter.try_into()
}

pub(crate) const HIDDEN: &str = "data folder out of sight";
const READ_ONLY: &str = "read-only root";
const OWN_PROCESSES: &str = "own processes only in /proc";
const SCRATCH: &str = "scratch folder of 1 GiB in memory";
const SCRATCH_SIZE: &str = "size=1g,mode=700";
const NONE: Option<&str> = None;

/// Makes everything except the scratch folder read-only and hides the data folder, in a private mount namespace.
pub(crate) fn arrange(plan: &SandboxPlan, report: &mut SandboxReport) {
    report.note(READ_ONLY, make_private().and_then(|()| read_only()));
    let plain = MsFlags::MS_NOSUID | MsFlags::MS_NODEV;
    let sight = plain | MsFlags::MS_NOEXEC;
    report.note(OWN_PROCESSES, put("proc", Path::new("/proc"), sight, NONE));
    report.note(HIDDEN, put("tmpfs", &plan.hidden, sight | MsFlags::MS_RDONLY, Some("size=4k")));
    report.note(SCRATCH, put("tmpfs", &SandboxPlan::scratch(&plan.folder), plain, Some(SCRATCH_SIZE)));
}

/// Stops mount propagation in both directions.
fn make_private() -> Result<(), String> {
    let flags = MsFlags::MS_REC | MsFlags::MS_PRIVATE;
    mount(NONE, "/", NONE, flags, NONE)
        .map_err(|error| format!("cannot separate the mounts from those outside: {error}"))
}

fn put(kind: &str, place: &Path, flags: MsFlags, options: Option<&str>) -> Result<(), String> {
    mount(Some(kind), place, Some(kind), flags, options)
        .map_err(|error| format!("cannot mount {kind} on {}: {error}", place.display()))
}

fn read_only() -> Result<(), String> {
    let table = fs::read_to_string("/proc/self/mountinfo").map_err(|error| format!("mountinfo: {error}"))?;
    for (place, flags) in table.lines().filter_map(mounted) {
        let flags = flags | MsFlags::MS_BIND | MsFlags::MS_REMOUNT | MsFlags::MS_RDONLY;
        mount(NONE, place.as_str(), NONE, flags, NONE)
            .map_err(|error| format!("{place} stays writable: {error}"))?;
    }
    Ok(())
}

/// Parses a mountinfo line: mount point and flags.
fn mounted(line: &str) -> Option<(String, MsFlags)> {
    // A remount must repeat the flags: the kernel refuses to drop locked ones inside a user namespace.
    let mut fields = line.split(' ').skip(4);
    let (place, options) = (fields.next()?, fields.next()?);
    Some((unescape(place), options.split(',').filter_map(flag).collect()))
}

fn flag(option: &str) -> Option<MsFlags> {
    Some(match option {
        "nosuid" => MsFlags::MS_NOSUID,
        "nodev" => MsFlags::MS_NODEV,
        "noexec" => MsFlags::MS_NOEXEC,
        "noatime" => MsFlags::MS_NOATIME,
        "nodiratime" => MsFlags::MS_NODIRATIME,
        "relatime" => MsFlags::MS_RELATIME,
        _ => return None,
    })
}

/// Decodes escaped characters, such as `\040` for a space.
fn unescape(place: &str) -> String {
    [("\\040", " "), ("\\011", "\t"), ("\\012", "\n"), ("\\134", "\\")]
        .iter()
        .fold(place.to_owned(), |text, (code, letter)| text.replace(code, letter))
}

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
pub(crate) fn lower_priority() {
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
    fn mount_lines_contain_place_and_flags() {
        let line =
            "36 35 98:0 /mnt1 /a\\040place rw,nosuid,relatime master:1 - ext3 /dev/root rw,errors=continue";
        let (place, flags) = mounted(line).unwrap();
        assert_eq!((place.as_str(), flags), ("/a place", MsFlags::MS_NOSUID | MsFlags::MS_RELATIME));
        assert!(mounted("36 35 98:0").is_none());
    }

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
