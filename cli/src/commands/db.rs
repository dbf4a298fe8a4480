//! The data folder as a whole: backups, and what need not be kept for ever.

use crate::output::say;
use avln_arena::{
    Failure,
    backup::{self, Contents, PruneOptions, Pruned},
    now_unix_ms,
};
use avln_store::calendar::rfc3339;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

/// Commands about the data folder as a whole.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write database, run logs, signing key, splits, recordings and heads into one file, while a server may host them
    Backup {
        /// The file, which must not exist
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
    /// Make the data folder out of a backup; the folder must not exist, or be empty
    Restore {
        /// A file that avln data db backup wrote
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
    /// Let go of the logs of runs that ended long ago, and on demand of their records; scores stay
    Prune(Prune),
}

/// What is old.
#[derive(Clone, Debug, Args)]
pub struct Prune {
    /// Days since a run ended, such as 90d
    #[arg(long, value_name = "DAYS", value_parser = days)]
    pub older_than: u32,
    /// Records and ground truth too: replays of these runs are shown no more, and they cannot be scored again
    #[arg(long)]
    pub records: bool,
    /// Tell what would go, and leave it
    #[arg(long)]
    pub dry_run: bool,
}

/// A number of days, written as 90d.
fn days(text: &str) -> Result<u32, String> {
    const MOST: u32 = 36_500;
    let days = text.strip_suffix('d').and_then(|days| days.parse().ok());
    days.filter(|days| (1..=MOST).contains(days))
        .ok_or_else(|| format!("write days such as 90d, 1d to {MOST}d"))
}

/// Carries out a command about the data folder.
///
/// # Errors
/// When something would be written over, cannot be read or written, or is damaged.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Backup { file } => {
            let made = backup::make(data, &file).await?;
            say!("backup    {}", file.display());
            show(&made);
            say!("It holds the signing key and ground truth: keep it where nobody else reads it.");
        }
        Command::Restore { file } => {
            let restored = backup::restore(&file, data).await?;
            say!("data      {}", data.display());
            say!("as of     {}", rfc3339(restored.manifest.made_ms));
            show(&restored);
            say!("host it with: avln --data {} serve", data.display());
        }
        Command::Prune(options) => {
            let now = now_unix_ms();
            let rule = PruneOptions::from(&options);
            let Pruned { runs, logs, bytes, records } = backup::prune(data, &rule, now).await?;
            let would = if options.dry_run { "would go" } else { "gone" };
            say!("{runs} runs ended before {}", rfc3339(rule.cutoff_ms(now)));
            say!("run logs  {logs} {would}, {:.1} MiB", bytes as f64 / f64::from(1 << 20));
            if options.records {
                say!("records   {records} {would}");
            }
            say!("scores    all stay");
        }
    }
    Ok(())
}

fn show(contents: &Contents) {
    let Contents { manifest, inventory, left_out } = contents;
    let open = inventory.runs.iter().filter(|run| !run.is_settled).count();
    let logs = manifest.files.keys().filter(|path| path.starts_with("runs/")).count();
    let mib = manifest.bytes() as f64 / f64::from(1 << 20);
    say!(
        "database  schema {}, {} teams, {} runs ({open} open), {} results",
        inventory.schema,
        inventory.teams,
        inventory.runs.len(),
        inventory.results
    );
    say!(
        "files     {} with {logs} run logs, {mib:.1} MiB, each read back and compared by hash",
        manifest.files.len()
    );
    for path in left_out {
        let state = if path.exists() { "" } else { ", which is not here" };
        say!("not in it {}{state}", path.display());
    }
}

impl From<&Prune> for PruneOptions {
    fn from(prune: &Prune) -> Self {
        Self { older_than_days: prune.older_than, records: prune.records, dry_run: prune.dry_run }
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
