//! File system view of the agent.

use crate::{Plan, Report};
use nix::mount::{MsFlags, mount};
use std::{fs, path::Path};

/// Words of the report.
pub(crate) const HIDDEN: &str = "data folder out of sight";
const READ_ONLY: &str = "read-only root";
const PROCESSES: &str = "own processes only in /proc";
const SCRATCH: &str = "scratch folder of 1 GiB in memory";
const SCRATCH_SIZE: &str = "size=1g,mode=700";
const NONE: Option<&str> = None;

/// Makes everything except the scratch folder read-only and hides the data folder, in a private mount
/// namespace.
pub(crate) fn arrange(plan: &Plan, report: &mut Report) {
    report.note(READ_ONLY, own().and_then(|()| read_only()));
    let plain = MsFlags::MS_NOSUID | MsFlags::MS_NODEV;
    let sight = plain | MsFlags::MS_NOEXEC;
    report.note(PROCESSES, put("proc", Path::new("/proc"), sight, NONE));
    report.note(HIDDEN, put("tmpfs", &plan.hidden, sight | MsFlags::MS_RDONLY, Some("size=4k")));
    report.note(SCRATCH, put("tmpfs", &Plan::scratch(&plan.folder), plain, Some(SCRATCH_SIZE)));
}

/// Separates mount propagation in both directions.
fn own() -> Result<(), String> {
    let flags = MsFlags::MS_REC | MsFlags::MS_PRIVATE;
    mount(NONE, "/", NONE, flags, NONE)
        .map_err(|error| format!("cannot part from the mounts outside: {error}"))
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

/// Mount point and flags of a mountinfo line; a remount must preserve the flags.
fn mounted(line: &str) -> Option<(String, MsFlags)> {
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

/// Decodes spaces and similar characters, escaped as `\040`.
fn unescape(place: &str) -> String {
    [("\\040", " "), ("\\011", "\t"), ("\\012", "\n"), ("\\134", "\\")]
        .iter()
        .fold(place.to_owned(), |text, (code, letter)| text.replace(code, letter))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_the_table_tell_place_and_flags() {
        let line =
            "36 35 98:0 /mnt1 /a\\040place rw,nosuid,relatime master:1 - ext3 /dev/root rw,errors=continue";
        let (place, flags) = mounted(line).unwrap();
        assert_eq!((place.as_str(), flags), ("/a place", MsFlags::MS_NOSUID | MsFlags::MS_RELATIME));
        assert!(mounted("36 35 98:0").is_none());
    }
}
