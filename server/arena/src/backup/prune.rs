//! Deletes run logs and records of runs that ended long ago.

use crate::{Failure, FailureKind, challenge::actor, data::DataFolder};
use avln_store::{AuditNote, calendar::rfc3339};
use std::{fs, io, path::Path};

/// The runs to prune, and the extent.
#[derive(Clone, Copy, Debug)]
pub struct PruneOptions {
    /// Days since the end of a run.
    pub older_than_days: u32,
    /// Delete records and ground truth too: the runs can no longer be replayed or rescored.
    pub records: bool,
    /// Count only.
    pub dry_run: bool,
}

impl PruneOptions {
    /// Returns the moment before which a run must have ended, Unix milliseconds.
    pub fn cutoff_ms(&self, now_unix_ms: i64) -> i64 {
        const DAY_MS: i64 = 86_400_000;
        now_unix_ms - i64::from(self.older_than_days) * DAY_MS
    }
}

/// Numbers of deleted items; in a dry run, of items to delete.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pruned {
    /// Runs that ended before the cutoff.
    pub runs: usize,
    /// Run logs.
    pub logs: u32,
    /// Total size of the run logs, bytes.
    pub bytes: u64,
    /// Episode records; 0 unless requested.
    pub records: u64,
}

/// Deletes logs, and on request records, of runs that ended before the cutoff; adds entries to the audit list.
///
/// # Errors
/// If the data folder cannot be used or a file cannot be removed.
pub async fn prune(data: &Path, options: &PruneOptions, now_unix_ms: i64) -> Result<Pruned, Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    let logs = data.run_logs();
    let cutoff = options.cutoff_ms(now_unix_ms);
    let runs = store.runs_ended_before(cutoff).await?;
    let mut pruned = Pruned { runs: runs.len(), ..Pruned::default() };
    for path in runs.iter().map(|run| logs.path(run)) {
        let length = remove(&path, options.dry_run).map_err(|error| {
            Failure::new(FailureKind::Data, format!("cannot remove {}: {error}", path.display()))
        })?;
        pruned.logs += u32::from(length.is_some());
        pruned.bytes += length.unwrap_or(0);
    }
    if options.records {
        pruned.records = store.old_records(cutoff).await?;
    }
    let note = |what: &str, number: u64| AuditNote {
        actor: actor(),
        subject: format!("runs before {}", rfc3339(cutoff)),
        what: what.to_owned(),
        before: Some(number.to_string()),
        ..AuditNote::default()
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

/// Removes a file, or only measures it in a dry run. Returns its size in bytes; `None` if missing.
fn remove(path: &Path, dry_run: bool) -> io::Result<Option<u64>> {
    match path.metadata() {
        Ok(file) if dry_run => Ok(Some(file.len())),
        Ok(file) => fs::remove_file(path).map(|()| Some(file.len())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}
