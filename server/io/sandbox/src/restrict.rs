//! System call and file restrictions of the agent.

use crate::Plan;
use landlock::{
    ABI, Access, AccessFs, AccessNet, CompatLevel, Compatible, Ruleset, RulesetAttr, RulesetCreatedAttr,
    RulesetStatus, Scope, path_beneath_rules,
};
use nix::sys::resource::{Resource, setrlimit};
use seccompiler::{
    BpfProgram, SeccompAction, SeccompCmpArgLen as Width, SeccompCmpOp as Op, SeccompCondition,
    SeccompFilter, SeccompRule, apply_filter,
};
use std::{collections::BTreeMap, path::PathBuf};

/// Paths required by every program.
const SYSTEM: [&str; 10] =
    ["/usr", "/bin", "/sbin", "/lib", "/lib32", "/lib64", "/opt", "/etc", "/proc", "/sys/devices/system"];
const HARMLESS_DEVICES: [&str; 5] = ["/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom"];

/// Most processes and threads of the agent.
const PROCESSES: u64 = 4096;
/// Limit of open files per process.
const FILES: u64 = 4096;
/// Limit of a written file, bytes: the size of the scratch folder.
const FILE_BYTES: u64 = 1 << 30;

/// Readable paths of the agent.
pub(crate) fn readable(plan: &Plan) -> Vec<PathBuf> {
    let own = [plan.workplace.clone(), plan.folder.clone()];
    SYSTEM.iter().map(PathBuf::from).chain(own).chain(plan.readable.clone()).collect()
}

/// Limits the agent to readable paths, the scratch folder and devices; no TCP, and no outside processes.
pub(crate) fn landlock(plan: &Plan) -> Result<(), String> {
    const FILES: ABI = ABI::V5;
    let build = || {
        Ruleset::default()
            .set_compatibility(CompatLevel::BestEffort)
            .handle_access(AccessFs::from_all(FILES))?
            .handle_access(AccessNet::from_all(FILES))?
            .scope(Scope::from_all(ABI::V6))?
            .create()?
            .add_rules(path_beneath_rules(readable(plan), AccessFs::from_read(FILES)))?
            .add_rules(path_beneath_rules([Plan::scratch(&plan.folder)], AccessFs::from_all(FILES)))?
            .add_rules(path_beneath_rules(HARMLESS_DEVICES, AccessFs::from_all(FILES)))?
            .add_rules(path_beneath_rules(&plan.devices, AccessFs::from_all(FILES)))?
            .restrict_self()
    };
    match build().map_err(|error: landlock::RulesetError| error.to_string())?.ruleset {
        RulesetStatus::FullyEnforced => Ok(()),
        RulesetStatus::PartiallyEnforced => Err("the kernel has an old Landlock; parts hold".to_owned()),
        RulesetStatus::NotEnforced => Err("the kernel has no Landlock".to_owned()),
    }
}

/// Numbers of processes, files and bytes.
pub(crate) fn limits(plan: &Plan) -> Result<(), String> {
    let memory = plan.memory_mib.map(|mib| (Resource::RLIMIT_AS, u64::from(mib) << 20));
    let fixed = [
        (Resource::RLIMIT_CORE, 0),
        (Resource::RLIMIT_NPROC, PROCESSES),
        (Resource::RLIMIT_NOFILE, FILES),
        (Resource::RLIMIT_FSIZE, FILE_BYTES),
    ];
    for (resource, most) in fixed.into_iter().chain(memory) {
        let (_, hard) = nix::sys::resource::getrlimit(resource).map_err(|error| error.to_string())?;
        let most = most.min(hard);
        setrlimit(resource, most, most).map_err(|error| format!("{resource:?}: {error}"))?;
    }
    Ok(())
}

/// Denied system calls, which reach beyond the process and are not needed by agents.
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
];

/// Namespaces that a new process could ask for.
const NAMESPACES: [i32; 7] = [
    libc::CLONE_NEWUSER,
    libc::CLONE_NEWNS,
    libc::CLONE_NEWNET,
    libc::CLONE_NEWPID,
    libc::CLONE_NEWIPC,
    libc::CLONE_NEWUTS,
    libc::CLONE_NEWCGROUP,
];

/// `ioctl` requests that inject keystrokes into a terminal, TIOCSTI and TIOCLINUX; their type depends on the
/// C library.
const KEYSTROKES: [u64; 2] = [0x5412, 0x541C];

type Rules = BTreeMap<i64, Vec<SeccompRule>>;

/// No socket but Unix ones, no call that reaches beyond the process, no keystroke put into the organiser's terminal.
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

fn denied() -> Result<Rules, seccompiler::BackendError> {
    let mut rules: Rules = DENIED.iter().map(|&call| (call, Vec::new())).collect();
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

fn compile(rules: Rules, answer: i32) -> Result<BpfProgram, seccompiler::BackendError> {
    let refuse = SeccompAction::Errno(answer.cast_unsigned());
    let filter = SeccompFilter::new(rules, SeccompAction::Allow, refuse, std::env::consts::ARCH.try_into()?)?;
    filter.try_into()
}
