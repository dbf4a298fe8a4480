//! Backup, restore and pruning of the data folder.

use crate::output::say;
use avln_arena::{
    Failure,
    backup::{self, Contents, PruneOptions, Pruned},
    now_unix_ms,
};
use avln_store::{Inventory, calendar::rfc3339};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

#[derive(Debug, Subcommand)]
pub(crate) enum DbCommand {
    /// Write database, run logs, signing key, splits, recordings and heads to a file; a server may be running
    Backup {
        /// New file
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
    /// Create the data folder from a backup; it must be new or empty
    Restore {
        /// File written by avln data db backup
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
    /// Delete old run logs, and on request old records; scores remain
    Prune(PruneArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct PruneArgs {
    /// Minimum age since the run's end, such as 90d
    #[arg(long, value_name = "DAYS", value_parser = days)]
    older_than: u32,
    /// Delete records and ground truth too: these runs can no longer be replayed or rescored
    #[arg(long)]
    records: bool,
    /// Only print what would be deleted
    #[arg(long)]
    dry_run: bool,
}

fn days(text: &str) -> Result<u32, String> {
    const MOST: u32 = 36_500;
    let days = text.strip_suffix('d').and_then(|days| days.parse().ok());
    days.filter(|days| (1..=MOST).contains(days))
        .ok_or_else(|| format!("write days such as 90d, 1d to {MOST}d"))
}

pub(crate) async fn run(data: &Path, command: DbCommand) -> Result<(), Failure> {
    match command {
        DbCommand::Backup { file } => {
            let made = backup::make(data, &file).await?;
            say!("backup    {}", file.display());
            show(&made);
            say!("It contains the signing key and ground truth: keep it private.");
        }
        DbCommand::Restore { file } => {
            let restored = backup::restore(&file, data).await?;
            say!("data      {}", data.display());
            say!("as of     {}", rfc3339(restored.manifest.made_ms));
            show(&restored);
            say!("host it with: avln --data {} serve", data.display());
        }
        DbCommand::Prune(args) => {
            let now = now_unix_ms();
            let PruneArgs { older_than, records, dry_run } = args;
            let rule = PruneOptions { older_than_days: older_than, records, dry_run };
            let pruned = backup::prune(data, &rule, now).await?;
            let Pruned { runs, logs, bytes, records } = pruned;
            let would = if dry_run { "would be deleted" } else { "deleted" };
            say!("{runs} runs ended before {}", rfc3339(rule.cutoff_ms(now)));
            say!("run logs  {logs} {would}, {:.1} MiB", bytes as f64 / f64::from(1 << 20));
            if rule.records {
                say!("records   {records} {would}");
            }
            say!("scores    unchanged");
        }
    }
    Ok(())
}

fn show(contents: &Contents) {
    let Contents { manifest, inventory, left_out } = contents;
    let open = inventory.runs.iter().filter(|run| !run.is_settled).count();
    let logs = manifest.files.keys().filter(|path| path.starts_with("runs/")).count();
    let mib = manifest.bytes() as f64 / f64::from(1 << 20);
    let Inventory { schema, teams, results, runs, .. } = inventory;
    let (runs, files) = (runs.len(), manifest.files.len());
    say!("database  schema {schema}, {teams} teams, {runs} runs ({open} open), {results} results");
    say!("files     {files} with {logs} run logs, {mib:.1} MiB, each read back and compared by hash");
    for path in left_out {
        let state = if path.exists() { "" } else { ", which does not exist" };
        say!("not in it {}{state}", path.display());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_numbers_with_a_d() {
        assert_eq!(days("90d"), Ok(90));
        for wrong in ["90", "0d", "-1d", "d", "36501d", "9h", "1.5d"] {
            assert!(days(wrong).unwrap_err().contains("90d"), "{wrong}");
        }
    }
}
