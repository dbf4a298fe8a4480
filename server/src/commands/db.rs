//! The data folder as a whole: backups, and what need not be kept for ever.

use crate::say::say;
use crate::{
    Failure,
    backup::{self, Contents},
};
use avln_store::calendar::rfc3339;
use clap::Subcommand;
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
        /// A file that avln db backup wrote
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
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
    say!("files     {} with {logs} run logs, {mib:.1} MiB, each read back and compared by hash", manifest.files.len());
    for path in left_out {
        let state = if path.exists() { "" } else { ", which is not here" };
        say!("not in it {}{state}", path.display());
    }
}
