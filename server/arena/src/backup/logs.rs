//! Run logs in a backup, truncated to the state of the database copy.

use super::{Out, unread};
use crate::{
    Failure,
    runlog::{Entry, History},
};
use avln_store::KeptRun;
use std::{collections::BTreeMap, fs, fs::File, io, path::Path};

/// Adds the logs of `runs` from `folder`.
pub(super) fn add(writer: &mut Out<'_>, folder: &Path, runs: &[KeptRun]) -> Result<(), Failure> {
    for run in runs {
        let path = folder.join(format!("{}.log", run.id));
        if !path.is_file() {
            continue;
        }
        let name = format!("runs/{}.log", run.id);
        let mut add = || {
            if run.is_settled {
                let file = File::open(&path)?;
                return writer.add(&name, file.metadata()?.len(), file);
            }
            let bytes = fs::read(&path)?;
            let known = known_bytes(&bytes, &run.attempts)
                .map_err(|(line, what)| io::Error::other(format!("line {line}: {what}")))?;
            writer.add(&name, known as u64, &bytes[..known])
        };
        add().map_err(unread(&path))?;
    }
    Ok(())
}

/// Length of a log before the first episode issued after the database copy.
///
/// The log is read after the database, so it is at least as new. Known episodes may have more steps, as after
/// a crash. An unknown episode would start twice after the server issues it again.
fn known_bytes(log: &[u8], attempts: &BTreeMap<u32, u32>) -> Result<usize, (usize, String)> {
    let history = History::parse(log)?;
    let (mut left, mut known) = (attempts.clone(), 0);
    for (entry, line) in history.entries.iter().zip(log.split_inclusive(|&byte| byte == b'\n')) {
        if let Entry::Began { ordinal, .. } = entry {
            match left.get_mut(ordinal).filter(|times| **times > 0) {
                Some(times) => *times -= 1,
                None => return Ok(known),
            }
        }
        known += line.len();
    }
    Ok(known)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runlog::RunLogs;
    use avln_episode::{Order, Sensors};

    fn began(ordinal: u32, handle: &str) -> Entry {
        let (handle, episode) = (handle.to_owned(), format!("house-{ordinal}"));
        Entry::Began { slot: 0, handle, ordinal, episode, sensors: Sensors::all(64, 64), at_ms: 2 }
    }

    #[test]
    fn a_log_ends_before_what_the_database_does_not_know() {
        let folder = tempfile::tempdir().unwrap();
        let logs = RunLogs::at(folder.path());
        let (run, phase) = ("run_1".to_owned(), "practice".to_owned());
        let first = Entry::Run {
            format: Entry::FORMAT,
            run,
            phase,
            order: Order::Ordered,
            digests: BTreeMap::new(),
            at_ms: 1,
        };
        let log = logs.open("run_1", || first).unwrap();
        for entry in [began(0, "ep_a"), began(1, "ep_b"), began(0, "ep_c")] {
            log.write(&entry).unwrap();
        }
        let bytes = fs::read(logs.path("run_1")).unwrap();
        let lines = |attempts: &[(u32, u32)]| {
            let known = known_bytes(&bytes, &attempts.iter().copied().collect()).unwrap();
            bytes[..known].iter().filter(|&&byte| byte == b'\n').count()
        };
        assert_eq!(lines(&[(0, 2), (1, 1)]), 4, "all of it");
        assert_eq!(lines(&[(0, 1), (1, 1)]), 3, "the second attempt at the first came later");
        assert_eq!(lines(&[(0, 1), (1, 0)]), 2);
        assert_eq!(lines(&[(0, 0), (1, 0)]), 1);
        assert_eq!(lines(&[]), 1);
        let half = &bytes[..bytes.len() - 3];
        assert_eq!(
            known_bytes(half, &[(0, 2), (1, 1)].into()).unwrap(),
            half.iter().rposition(|&b| b == b'\n').unwrap() + 1
        );
    }
}
