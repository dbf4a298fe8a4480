//! Run logs in backups, and pruning.

use crate::{
    Failure, actions,
    backup::{Out, cannot_back_up},
    challenge::actor,
    data::DataFolder,
    runlog::{Entry, History},
};
use avln_store::{AuditNote, KeptRun, calendar::rfc3339};
use std::{
    collections::BTreeMap,
    fs::{self, File},
    io,
    path::Path,
};

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
        add().map_err(cannot_back_up(&path))?;
    }
    Ok(())
}

/// Returns the log length known to the database copy, bytes: up to the first episode issued after the copy.
/// The log is at least as new as the copy. For known episodes, more steps do no harm, as after a crash. An
/// unknown episode would begin twice, because the restored server issues it again.
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

/// Options for pruning.
#[derive(Clone, Copy, Debug)]
pub struct PruneOptions {
    /// Minimum days since a run's end.
    pub older_than_days: u32,
    /// Also delete records and ground truth; the runs cannot be replayed or rescored then.
    pub records: bool,
    /// Only count.
    pub dry_run: bool,
}

impl PruneOptions {
    /// Returns the latest end time for pruned runs, Unix milliseconds.
    pub fn cutoff_ms(&self, now_unix_ms: i64) -> i64 {
        const DAY_MS: i64 = 86_400_000;
        now_unix_ms - i64::from(self.older_than_days) * DAY_MS
    }
}

/// Counts after pruning; in a dry run, of items to delete.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Ended runs.
    pub runs: usize,
    /// Run logs.
    pub logs: u32,
    /// Total log size, bytes.
    pub bytes: u64,
    /// Episode records; 0 unless requested.
    pub records: u64,
}

/// Deletes logs, and on request records, for runs before the cutoff; adds audit entries.
pub async fn prune(data: &Path, options: &PruneOptions, now_unix_ms: i64) -> Result<Pruned, Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    let logs = data.run_logs();
    let cutoff = options.cutoff_ms(now_unix_ms);
    let runs = store.runs_ended_before(cutoff).await?;
    let mut pruned = Pruned { runs: runs.len(), ..Pruned::default() };
    for path in runs.iter().map(|run| logs.path(run)) {
        let length = remove(&path, options.dry_run).map_err(|error| Failure::file("remove", &path, error))?;
        pruned.logs += u32::from(length.is_some());
        pruned.bytes += length.unwrap_or(0);
    }
    if options.records {
        pruned.records = store.old_records(cutoff).await?;
    }
    let note = |what: &str, number: u64| AuditNote {
        before: Some(number.to_string()),
        ..actions::note(&actor(), format!("runs before {}", rfc3339(cutoff)), what, "")
    };
    if pruned.logs > 0 && !options.dry_run {
        store.add_audit_note(note("logs pruned", u64::from(pruned.logs)), now_unix_ms).await?;
    }
    if pruned.records > 0 && !options.dry_run {
        store.prune_records(cutoff, note("records pruned", pruned.records), now_unix_ms).await?;
    }
    store.close().await;
    Ok(pruned)
}

/// Removes a file, except in a dry run. Returns the size, bytes; `None` for a missing file.
fn remove(path: &Path, dry_run: bool) -> io::Result<Option<u64>> {
    match path.metadata() {
        Ok(file) if dry_run => Ok(Some(file.len())),
        Ok(file) => fs::remove_file(path).map(|()| Some(file.len())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
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
    fn logs_end_before_unknown_episodes() {
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
