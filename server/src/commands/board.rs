//! The board as files: what everybody sees, for after the server.

use crate::say::say;
use crate::{
    Failure, FailureKind,
    arena::{data::DataFolder, now_unix_ms},
    ladder::play_oracle,
};
use avln_client::RunSummary;
use avln_episode::Order;
use avln_web::{FreezeError, freeze};
use clap::{Args, Subcommand};
use sha2::{Digest, Sha256};
use std::{
    fmt::Write as _,
    fs, io,
    path::{Path, PathBuf},
};

/// Commands about the board.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a copy of what everybody sees of a phase, or of all of them: boards, runs, public replays, tables, and SHA256SUMS
    Freeze(Freeze),
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

/// The list of all other files and their digests.
const SUMS: &str = "SHA256SUMS";

/// Carries out a command about the board.
///
/// # Errors
/// When the folder is not empty, cannot be written, or there is no such phase.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Freeze(options) => copy(data, options).await,
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
    let store = DataFolder::open(data)?.store().await?;
    let mut copy = Folder::begin(&options.out)?;
    let reader = store.reader();
    let keep = &mut |name: &str, bytes: &[u8]| copy.keep(name, bytes);
    let files = freeze(&reader, options.phase.as_deref(), now_unix_ms(), keep).await.map_err(failure)?;
    copy.end().map_err(|error| cannot_write(&options.out, &error))?;
    store.close().await;
    say!("{files} files in {}", options.out.display());
    say!("look at      {}", options.out.join("index.html").display());
    say!("check with   cd {} && sha256sum --check --quiet {SUMS}", options.out.display());
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

fn cannot_write(folder: &Path, error: &io::Error) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot write to {}: {error}", folder.display()))
        .hinted("choose a folder of your own with --out")
}

/// Files that are written and counted.
struct Folder {
    folder: PathBuf,
    sums: Vec<(String, String)>,
}

impl Folder {
    /// A copy in `folder`, which must be empty.
    fn begin(folder: &Path) -> Result<Self, Failure> {
        let failed = |error| cannot_write(folder, &error);
        fs::create_dir_all(folder).map_err(failed)?;
        if fs::read_dir(folder).map_err(failed)?.next().is_some() {
            let message = format!("folder {} is not empty", folder.display());
            return Err(Failure::new(FailureKind::Data, message).hinted("choose an empty one with --out"));
        }
        Ok(Self { folder: folder.to_owned(), sums: vec![] })
    }

    fn keep(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        self.sums.push((name.to_owned(), hexadecimal(&Sha256::digest(bytes))));
        fs::write(path, bytes)
    }

    /// Writes the list of digests.
    fn end(mut self) -> io::Result<()> {
        self.sums.sort();
        let mut list = String::new();
        for (name, digest) in &self.sums {
            let _ = writeln!(list, "{digest}  {name}");
        }
        fs::write(self.folder.join(SUMS), list)
    }
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}
