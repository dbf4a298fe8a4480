//! Namespaces: a machine of one's own, as far as the kernel tells.

use nix::{
    sched::{CloneFlags, unshare},
    unistd::{Gid, Uid},
};
use std::fs;

/// Who the inmate is while it arranges its mounts.
const ROOT: u32 = 0;
/// Who the agent is: nobody in particular.
const NOBODY: u32 = 1000;

/// Takes namespaces of every kind; what is started from now on is root in them, and alone.
pub(crate) fn take() -> Result<(), String> {
    let all = CloneFlags::CLONE_NEWUSER
        | CloneFlags::CLONE_NEWNS
        | CloneFlags::CLONE_NEWNET
        | CloneFlags::CLONE_NEWPID
        | CloneFlags::CLONE_NEWIPC
        | CloneFlags::CLONE_NEWUTS;
    become_in(all, ROOT)
}

/// Takes one more user namespace, in which it is nobody: what it may do there reaches no mount and no network, and exec takes
/// even that away.
pub(crate) fn drop_root() -> Result<(), String> {
    become_in(CloneFlags::CLONE_NEWUSER, NOBODY)
}

fn become_in(namespaces: CloneFlags, id: u32) -> Result<(), String> {
    let (uid, gid) = (Uid::effective(), Gid::effective());
    unshare(namespaces).map_err(|error| format!("the kernel gives no namespaces: {error}"))?;
    let map = |file: &str, text: String| {
        fs::write(file, text).map_err(|error| format!("cannot write {file}: {error}"))
    };
    map("/proc/self/setgroups", "deny".to_owned())?;
    map("/proc/self/uid_map", format!("{id} {uid} 1"))?;
    map("/proc/self/gid_map", format!("{id} {gid} 1"))
}
