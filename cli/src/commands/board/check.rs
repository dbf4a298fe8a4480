//! Whether a copy is what the server wrote.

use super::folder::{SIGNATURE, SUMS, digest, statement};
use crate::output::say;
use avln_arena::{Failure, FailureKind, runlog::is_signed};
use clap::Args;
use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

/// Which copy, and whose it should be.
#[derive(Clone, Debug, Args)]
pub struct Check {
    /// The folder of the copy
    pub folder: PathBuf,
    /// Public key of the server that signed it, hexadecimal, as /api/v1/status tells it in log_key; by default any signature
    /// that fits is taken, and its key told
    #[arg(long, value_name = "KEY")]
    pub key: Option<String>,
}

/// Checks the signature, then each file, then that there is no other.
pub(super) fn check(options: &Check) -> Result<(), Failure> {
    let folder = &options.folder;
    let list = read(folder, SUMS)?;
    let key = signer(&list, &read(folder, SIGNATURE)?)?;
    if let Some(wanted) = options.key.as_ref().filter(|wanted| **wanted != key) {
        return Err(refused(format!("the copy is signed by {key}, not by {wanted}")));
    }
    let listed = check_files(folder, &list)?;
    let found = files(folder).map_err(|error| unreadable(folder, &error))?;
    let is_known = |name: &&String| listed.contains(*name) || [SUMS, SIGNATURE].contains(&name.as_str());
    if let Some(other) = found.iter().find(|name| !is_known(name)) {
        return Err(refused(format!("{other} is not in {SUMS}: the server did not write it")));
    }
    say!("files      {}, as they were written", listed.len());
    match options.key {
        Some(_) => say!("signature  {key}, as asked for"),
        None => say!("signature  {key}; whose key that is, the server's /api/v1/status tells"),
    }
    Ok(())
}

/// The key that signed the list.
fn signer(list: &str, signed: &str) -> Result<String, Failure> {
    let (key, signature) = signed.trim_end().split_once('\n').unwrap_or((signed, ""));
    if !is_signed(key, &statement(list), signature) {
        let message =
            format!("the signature does not fit {SUMS}: it was changed, or another server wrote it");
        return Err(refused(message));
    }
    Ok(key.to_owned())
}

/// The names of the list, each file of which has the digest that stands beside it.
fn check_files(folder: &Path, list: &str) -> Result<BTreeSet<String>, Failure> {
    let mut names = BTreeSet::new();
    for line in list.lines() {
        let Some((wanted, name)) = line.split_once("  ") else {
            return Err(refused(format!("{SUMS} has a line without a name: {line}")));
        };
        let bytes = fs::read(folder.join(name)).map_err(|error| unreadable(&folder.join(name), &error))?;
        if digest(&bytes) != wanted {
            return Err(refused(format!("{name} was changed: its digest is not that of {SUMS}")));
        }
        names.insert(name.to_owned());
    }
    Ok(names)
}

/// Names of all files below `folder`, parts separated by slashes. A link is a file, wherever it leads.
fn files(folder: &Path) -> io::Result<BTreeSet<String>> {
    let (mut found, mut open) = (BTreeSet::new(), vec![folder.to_owned()]);
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(next)? {
            let entry = entry?;
            let path = entry.path();
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
    fs::read_to_string(&path).map_err(|error| unreadable(&path, &error))
}

fn unreadable(path: &Path, error: &io::Error) -> Failure {
    Failure::new(FailureKind::Data, format!("cannot read {}: {error}", path.display()))
        .hinted("name the folder that `avln challenge leaderboard freeze --out` wrote")
}

fn refused(what: String) -> Failure {
    Failure::new(FailureKind::Run, what)
}
