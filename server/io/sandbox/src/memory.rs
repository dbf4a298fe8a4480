//! Available memory of this machine.

use std::fs;

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
