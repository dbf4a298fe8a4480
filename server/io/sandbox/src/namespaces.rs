//! Namespaces of the sandbox.

use nix::{
    sched::{CloneFlags, unshare},
    unistd::{Gid, Uid},
};
use std::fs;

/// User id during the mount setup.
const ROOT: u32 = 0;
/// User id of the agent.
const NOBODY: u32 = 1000;

/// Creates all kinds of namespaces; later processes are root inside them.
pub(crate) fn take() -> Result<(), String> {
    let all = CloneFlags::CLONE_NEWUSER
        | CloneFlags::CLONE_NEWNS
        | CloneFlags::CLONE_NEWNET
        | CloneFlags::CLONE_NEWPID
        | CloneFlags::CLONE_NEWIPC
        | CloneFlags::CLONE_NEWUTS;
    become_in(all, ROOT)
}

/// Creates a further user namespace without privileges over mounts and network; exec drops the rest.
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
