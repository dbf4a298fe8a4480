//! Control group (cgroup version 2) of an agent: RLIMIT_NPROC does not bind root, and only groups limit memory in total; and the
//! available memory of this machine.

use crate::max_processes;
use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
    thread,
    time::Duration,
};

const HIERARCHY: &str = "/sys/fs/cgroup";

/// A control group that limits processes and memory and yields processor time to other groups, deleted on drop.
#[derive(Debug)]
pub struct ControlGroup {
    path: PathBuf,
}

impl ControlGroup {
    /// Creates the group for the sandbox in `folder`, with at most `memory_mib`; `None` if the user may not, or the system has no
    /// writable cgroup version 2.
    pub fn create(folder: &Path, memory_mib: Option<u64>) -> Option<Self> {
        let controllers = Path::new(HIERARCHY).join("cgroup.subtree_control");
        put(&controllers, "+pids").ok()?;
        // Each by itself: a system may lack either.
        let _ = put(&controllers, "+cpu");
        let _ = put(&controllers, "+memory");
        let path = path_of(folder)?;
        fs::create_dir(&path).ok()?;
        let group = Self { path };
        group.set("pids.max", &max_processes().to_string()).ok()?;
        group.yield_to_others(memory_mib);
        Some(group)
    }

    /// Lowers the priority of the group and limits its memory, as far as the controllers exist.
    fn yield_to_others(&self, memory_mib: Option<u64>) {
        // Before Linux 5.15, the least weight is the closest.
        if self.set("cpu.idle", "1").is_err() {
            let _ = self.set("cpu.weight", "1");
        }
        if let Some(mib) = memory_mib {
            let _ = self.set("memory.max", &format!("{mib}M"));
            let _ = self.set("memory.swap.max", "0");
            let _ = self.set("memory.oom.group", "1");
        }
    }

    /// Returns whether the kernel has killed the agent at the memory limit.
    pub fn is_out_of_memory(&self) -> bool {
        let events = fs::read_to_string(self.path.join("memory.events")).unwrap_or_default();
        events.lines().any(|line| line.strip_prefix("oom_kill ").is_some_and(|count| count != "0"))
    }

    fn set(&self, file: &str, value: &str) -> io::Result<()> {
        put(&self.path.join(file), value)
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

/// Share of the machine's memory that sealed agents leave to others by default.
const RESERVE: u64 = 8;

/// Returns the memory that programs can still use without swapping, MiB; `None` if the system does not report it.
pub fn available_mib() -> Option<u64> {
    reported("MemAvailable:")
}

/// Returns the default reserve, MiB: an eighth of the machine's memory; 0 if the system does not report it.
pub fn default_reserve_mib() -> u64 {
    reported("MemTotal:").unwrap_or(0) / RESERVE
}

fn reported(name: &str) -> Option<u64> {
    parse_mib(&fs::read_to_string("/proc/meminfo").ok()?, name)
}

/// Parses a line such as `MemTotal:  2048 kB`.
fn parse_mib(lines: &str, name: &str) -> Option<u64> {
    let line = lines.lines().find_map(|line| line.strip_prefix(name))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib >> 10)
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
        match ControlGroup::create(folder.path(), Some(512)) {
            Some(group) => drop(group),
            // Not `eprintln!`, which the test harness hides.
            None => drop(writeln!(
                std::io::stderr(),
                "skipped: a control group; cgroup version 2 is missing or not writable"
            )),
        }
        assert!(!place.exists());
    }

    #[test]
    fn memory_is_read_in_mib() {
        let lines = "MemTotal:       24683008 kB\nMemFree:        1 kB\nMemAvailable:   2049 kB\n";
        assert_eq!(parse_mib(lines, "MemTotal:"), Some(24_104));
        assert_eq!(parse_mib(lines, "MemAvailable:"), Some(2));
        assert_eq!(parse_mib(lines, "SwapFree:"), None);
    }

    #[test]
    fn reserve_is_below_the_memory() {
        let total = reported("MemTotal:").unwrap_or(0);
        assert!(default_reserve_mib() <= total / 2 && available_mib().unwrap_or(0) <= total);
    }
}
