//! The board as files: what everybody sees, for after the server.

mod check;
mod folder;

use crate::output::say;
use avln_arena::{Failure, FailureKind, data::DataFolder, now_unix_ms};
use avln_client::RunSummary;
use avln_episode::Order;
use avln_lab::suite::play_oracle;
use avln_web::{FreezeError, freeze};
use check::{Check, check};
use clap::{Args, Subcommand};
use folder::{Folder, SUMS, cannot_write};
use std::path::{Path, PathBuf};

/// Commands about the board.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a copy of what everybody sees of a phase, or of all of them: boards, runs, public replays, tables, and SHA256SUMS with
    /// the server's signature
    Freeze(Freeze),
    /// Check that a copy is whole, holds nothing else, and was signed by the server
    Check(Check),
    /// Let the oracle play a phase, so that its boards show what can be reached; no server may use the data folder meanwhile
    Oracle {
        /// Id of the phase
        #[arg(long)]
        phase: String,
    },
}

/// What is copied, and where to.
#[derive(Clone, Debug, Args)]
pub struct Freeze {
    /// An empty folder, which is made when it is not there
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Id of the phase; all that everybody may know of by default
    #[arg(long)]
    pub phase: Option<String>,
}

/// Carries out a command about the board.
///
/// # Errors
/// When the folder is not empty, cannot be written, or there is no such phase.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Freeze(options) => copy(data, options).await,
        Command::Check(options) => check(&options),
        Command::Oracle { phase } => {
            let tell = &mut |order, summary: &RunSummary| say!("{}", told(order, summary));
            play_oracle(&DataFolder::open(data)?, &phase, tell).await
        }
    }
}

/// What the oracle reached, where the phase shows scores.
fn told(order: Order, summary: &RunSummary) -> String {
    let mean = |name| summary.metric(name).map_or("-".to_owned(), |metric| format!("{:.3}", metric.value));
    format!(
        "{:<10} SR {}  SPL {}  {} episodes",
        order.as_str(),
        mean("sr"),
        mean("spl"),
        summary.progress.done
    )
}

async fn copy(data: &Path, options: Freeze) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let (store, key) = (data.store().await?, data.signing_key()?);
    let mut copy = Folder::begin(&options.out)?;
    let reader = store.reader();
    let keep = &mut |name: &str, bytes: &[u8]| copy.keep(name, bytes);
    let files = freeze(&reader, options.phase.as_deref(), now_unix_ms(), keep).await.map_err(failure)?;
    copy.end(&key).map_err(|error| cannot_write(&options.out, &error))?;
    store.close().await;
    say!("{files} files in {}", options.out.display());
    say!("look at      {}", options.out.join("index.html").display());
    say!("signed by    {}", key.public());
    say!("check with   avln challenge leaderboard check {} --key {}", options.out.display(), key.public());
    say!("or           cd {} && sha256sum --check --quiet {SUMS}", options.out.display());
    Ok(())
}

fn failure(error: FreezeError) -> Failure {
    let kind = match error {
        FreezeError::NoPhase(_) | FreezeError::File { .. } | FreezeError::Store(_) => FailureKind::Data,
        FreezeError::Page { .. } | FreezeError::Clash { .. } => FailureKind::Internal,
    };
    let failure = Failure::new(kind, &error);
    match error {
        FreezeError::NoPhase(_) => {
            failure.hinted("leave --phase out to copy all phases that everybody may know of")
        }
        FreezeError::File { .. } => failure.hinted("make room, or choose another folder with --out"),
        _ => failure,
    }
}
