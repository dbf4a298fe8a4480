//! Control group (cgroup version 2) of an agent: RLIMIT_NPROC does not bind root.

use crate::plan::MAX_PROCESSES;
use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

const HIERARCHY: &str = "/sys/fs/cgroup";

/// A control group that limits the number of processes, deleted on drop.
#[derive(Debug)]
pub struct ControlGroup {
    path: PathBuf,
}

impl ControlGroup {
    /// Creates the group for the sandbox in `folder`; `None` if the user may not, or the system has no writable cgroup version 2.
    pub fn create(folder: &Path) -> Option<Self> {
        put(&Path::new(HIERARCHY).join("cgroup.subtree_control"), "+pids").ok()?;
        let path = path_of(folder)?;
        fs::create_dir(&path).ok()?;
        let group = Self { path };
        put(&group.path.join("pids.max"), &MAX_PROCESSES.to_string()).ok()?;
        Some(group)
    }

    /// Moves this process into the group for the sandbox in `folder`.
    #[cfg(target_os = "linux")]
    pub(crate) fn join(folder: &Path) -> io::Result<()> {
        let path = path_of(folder).ok_or(io::ErrorKind::InvalidInput)?;
        put(&path.join("cgroup.procs"), "0")
    }

    /// Returns true if this process is in the group for the sandbox in `folder`.
    #[cfg(target_os = "linux")]
    pub(crate) fn is_joined(folder: &Path) -> bool {
        let groups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
        let own = groups.lines().find_map(|line| line.strip_prefix("0::"));
        own.is_some_and(|own| Path::new(own).file_name() == folder.file_name())
    }
}

impl Drop for ControlGroup {
    fn drop(&mut self) {
        const ATTEMPTS: u32 = 100;
        let _ = put(&self.path.join("cgroup.kill"), "1");
        // Killed processes leave the group a moment later.
        for _ in 0..ATTEMPTS {
            if fs::remove_dir(&self.path).is_ok() {
                return;
            }
            thread::sleep(Duration::from_millis(10));
        }
    }
}

fn path_of(folder: &Path) -> Option<PathBuf> {
    folder.file_name().map(|name| Path::new(HIERARCHY).join(name))
}

/// Writes an existing file: with cgroup version 1, the folder of the hierarchies accepts new ones.
fn put(path: &Path, text: &str) -> io::Result<()> {
    fs::File::options().write(true).open(path)?.write_all(text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_control_files_are_not_created() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("pids.max");
        assert_eq!(put(&file, "1").unwrap_err().kind(), io::ErrorKind::NotFound);
        assert!(!file.exists());
    }

    #[test]
    fn dropped_groups_leave_no_folder() {
        let folder = tempfile::tempdir().unwrap();
        let place = path_of(folder.path()).unwrap();
        match ControlGroup::create(folder.path()) {
            Some(group) => drop(group),
            None => eprintln!("skipped: cgroup version 2 is missing or not writable"),
        }
        assert!(!place.exists());
    }
}
