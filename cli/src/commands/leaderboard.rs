//! Frozen copies of leaderboards, and the oracle's row.

use crate::{documents, output::say};
use avln_arena::{
    Failure,
    data::DataFolder,
    now_unix_ms,
    runlog::{SigningKey, is_signed},
};
use avln_client::RunSummary;
use avln_episode::Order;
use avln_lab::suite::play_oracle;
use avln_web::{FreezeError, freeze};
use clap::{Args, Subcommand};
use sha2::{Digest, Sha256};
use std::{
    collections::BTreeSet,
    fmt::Write as _,
    fs, io,
    path::{Path, PathBuf},
};

/// File with all other files' digests.
const SUMS: &str = "SHA256SUMS";
/// File with public key and signature for [`SUMS`], hexadecimal, on two lines.
const SIGNATURE: &str = "SHA256SUMS.sig";

#[derive(Debug, Subcommand)]
pub(crate) enum LeaderboardCommand {
    /// Write the public pages of one or all phases as static files: leaderboards, runs, replays, tables, and a signed SHA256SUMS
    Freeze(FreezeArgs),
    /// Check that a frozen copy is complete, unchanged, and signed by the server
    Check(CheckCopyArgs),
    /// Play a phase with the oracle, as upper bound on leaderboards, in the orders without a run of it; stop the
    /// server first
    Oracle {
        /// Phase id
        #[arg(long)]
        phase: String,
    },
}

#[derive(Clone, Debug, Args)]
pub(crate) struct FreezeArgs {
    /// Folder for the copy, new or empty
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Phase id; all public phases by default
    #[arg(long)]
    phase: Option<String>,
}

#[derive(Clone, Debug, Args)]
pub(crate) struct CheckCopyArgs {
    /// Folder with the copy
    folder: PathBuf,
    /// Expected public server key, hexadecimal, as log_key in /api/v1/status; by default any valid signature
    /// is accepted and the key printed
    #[arg(long, value_name = "KEY")]
    key: Option<String>,
}

pub(crate) async fn run(data: &Path, command: LeaderboardCommand) -> Result<(), Failure> {
    match command {
        LeaderboardCommand::Freeze(args) => freeze_copy(data, args).await,
        LeaderboardCommand::Check(args) => check_copy(&args),
        LeaderboardCommand::Oracle { phase } => {
            let report = &mut |order, summary: Option<&RunSummary>| say!("{}", oracle_line(order, summary));
            play_oracle(&DataFolder::open(data)?, &phase, report).await
        }
    }
}

/// Returns the oracle's result; `-` for scores that the phase hides.
fn oracle_line(order: Order, summary: Option<&RunSummary>) -> String {
    let Some(summary) = summary else {
        return format!("{:<10} already on the leaderboard", order.as_str());
    };
    let mean = |name| summary.metric(name).map_or("-".to_owned(), |metric| format!("{:.3}", metric.value));
    let (sr, spl, done) = (mean("sr"), mean("spl"), summary.progress.done);
    format!("{:<10} SR {sr}  SPL {spl}  {done} episodes", order.as_str())
}

async fn freeze_copy(data: &Path, args: FreezeArgs) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    let key = data.signing_key()?;
    let mut copy = FrozenCopy::begin(&args.out)?;
    let reader = store.reader();
    let keep = &mut |name: &str, bytes: &[u8]| copy.add(name, bytes);
    let files = freeze(&reader, documents(), args.phase.as_deref(), now_unix_ms(), keep).await;
    let files = files.map_err(freeze_failure)?;
    copy.sign(&key).map_err(|error| cannot_write(&args.out, &error))?;
    store.close().await;
    say!("{files} files in {}", args.out.display());
    say!("look at      {}", args.out.join("index.html").display());
    say!("signed by    {}", key.public());
    say!("check with   avln challenge leaderboard check {} --key {}", args.out.display(), key.public());
    say!("or           cd {} && sha256sum --check --quiet {SUMS}", args.out.display());
    Ok(())
}

fn freeze_failure(error: FreezeError) -> Failure {
    match &error {
        FreezeError::NoPhase(_) => {
            Failure::data(&error).hinted("leave --phase out to copy all public phases")
        }
        FreezeError::File { .. } => {
            Failure::data(&error).hinted("make room, or choose another folder with --out")
        }
        FreezeError::Store(_) => Failure::data(error),
        FreezeError::Page { .. } | FreezeError::Clash { .. } => Failure::internal(error),
    }
}

struct FrozenCopy {
    folder: PathBuf,
    sums: Vec<(String, String)>,
}

impl FrozenCopy {
    fn begin(folder: &Path) -> Result<Self, Failure> {
        let failed = |error| cannot_write(folder, &error);
        fs::create_dir_all(folder).map_err(failed)?;
        if fs::read_dir(folder).map_err(failed)?.next().is_some() {
            let message = format!("folder {} is not empty", folder.display());
            return Err(Failure::data(message).hinted("choose an empty one with --out"));
        }
        Ok(Self { folder: folder.to_owned(), sums: vec![] })
    }

    fn add(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let path = self.folder.join(name);
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)?;
        }
        self.sums.push((name.to_owned(), sha256(bytes)));
        fs::write(path, bytes)
    }

    fn sign(mut self, key: &SigningKey) -> io::Result<()> {
        self.sums.sort();
        let mut list = String::new();
        for (name, digest) in &self.sums {
            let _ = writeln!(list, "{digest}  {name}");
        }
        let signature = format!("{}\n{}\n", key.public(), key.sign(&signed_statement(&list)));
        fs::write(self.folder.join(SUMS), list)?;
        fs::write(self.folder.join(SIGNATURE), signature)
    }
}

fn signed_statement(list: &str) -> String {
    // The prefix separates it from run logs, which the same key signs.
    format!("frozen board {}", sha256(list.as_bytes()))
}

fn sha256(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Checks the signature, then all listed files, then for files that are not listed.
fn check_copy(args: &CheckCopyArgs) -> Result<(), Failure> {
    let folder = &args.folder;
    let list = read(folder, SUMS)?;
    let key = signer(&list, &read(folder, SIGNATURE)?)?;
    if let Some(wanted) = args.key.as_ref().filter(|wanted| **wanted != key) {
        return Err(Failure::run(format!("the copy is signed by {key}, not by {wanted}")));
    }
    let listed = check_files(folder, &list)?;
    let found = files(folder).map_err(|error| cannot_read(folder, &error))?;
    let is_known = |name: &&String| listed.contains(*name) || [SUMS, SIGNATURE].contains(&name.as_str());
    if let Some(other) = found.iter().find(|name| !is_known(name)) {
        return Err(Failure::run(format!("{other} is not in {SUMS}: the server did not write it")));
    }
    say!("files      {}, unchanged", listed.len());
    match args.key {
        Some(_) => say!("signature  {key}, as expected"),
        None => say!("signature  {key}; compare it with log_key in the server's /api/v1/status"),
    }
    Ok(())
}

fn signer(list: &str, signed: &str) -> Result<String, Failure> {
    let (key, signature) = signed.trim_end().split_once('\n').unwrap_or((signed, ""));
    if !is_signed(key, &signed_statement(list), signature) {
        let message =
            format!("the signature does not fit {SUMS}: it was changed, or another server wrote it");
        return Err(Failure::run(message));
    }
    Ok(key.to_owned())
}

/// Compares all listed files with their digests and returns their names.
fn check_files(folder: &Path, list: &str) -> Result<BTreeSet<String>, Failure> {
    let mut names = BTreeSet::new();
    for line in list.lines() {
        let Some((wanted, name)) = line.split_once("  ") else {
            return Err(Failure::run(format!("{SUMS} has a line without a name: {line}")));
        };
        let path = folder.join(name);
        let bytes = fs::read(&path).map_err(|error| cannot_read(&path, &error))?;
        if sha256(&bytes) != wanted {
            return Err(Failure::run(format!("{name} was changed: its digest is not that of {SUMS}")));
        }
        names.insert(name.to_owned());
    }
    Ok(names)
}

/// Lists all files below `folder`, separated by slashes.
fn files(folder: &Path) -> io::Result<BTreeSet<String>> {
    let mut found = BTreeSet::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next)? {
            let entry = entry?;
            let path = entry.path();
            // A link counts as a file: following it could leave the folder.
            if entry.file_type()?.is_dir() {
                open.push(path);
            } else {
                let parts = path.strip_prefix(folder).unwrap_or(&path).iter();
                found.insert(parts.map(|part| part.to_string_lossy()).collect::<Vec<_>>().join("/"));
            }
        }
    }
    Ok(found)
}

fn read(folder: &Path, name: &str) -> Result<String, Failure> {
    let path = folder.join(name);
    fs::read_to_string(&path).map_err(|error| cannot_read(&path, &error))
}

fn cannot_read(path: &Path, error: &io::Error) -> Failure {
    Failure::file("read", path, error)
        .hinted("name the folder that `avln challenge leaderboard freeze --out` wrote")
}

fn cannot_write(folder: &Path, error: &io::Error) -> Failure {
    Failure::file("write to", folder, error).hinted("choose a folder of your own with --out")
}
