//! Backup file format: a tar archive with a manifest at the end.

use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    fs::File,
    io::{self, Read, Write},
    path::{Component, Path, PathBuf},
};

/// Layout version.
const FORMAT: u32 = 1;
/// Manifest file; the last one, so that truncated archives have none.
const MANIFEST: &str = "manifest.json";
/// Largest manifest, bytes: a million files.
const MAX_MANIFEST_BYTES: u64 = 256 << 20;

/// A backup's file list.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// Layout version.
    pub format: u32,
    /// Program version.
    pub server: String,
    /// Database schema version.
    pub schema: i64,
    /// Start time, Unix milliseconds.
    pub made_ms: i64,
    /// Files by path.
    pub files: BTreeMap<String, ArchivedFile>,
}

/// A file in a backup.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArchivedFile {
    /// Size in bytes.
    pub bytes: u64,
    /// BLAKE3 digest, hexadecimal.
    pub digest: String,
}

impl Manifest {
    pub(super) fn new(schema: i64, made_ms: i64) -> Self {
        let server = env!("CARGO_PKG_VERSION").to_owned();
        Self { format: FORMAT, server, schema, made_ms, files: BTreeMap::new() }
    }

    /// Returns the total size, bytes.
    pub fn bytes(&self) -> u64 {
        self.files.values().map(|kept| kept.bytes).sum()
    }
}

pub(super) struct Writer<W: Write> {
    archive: tar::Builder<W>,
    manifest: Manifest,
}

impl<W: Write> Writer<W> {
    pub(super) fn new(to: W, manifest: Manifest) -> Self {
        Self { archive: tar::Builder::new(to), manifest }
    }

    pub(super) fn add(&mut self, path: &str, bytes: u64, from: impl Read) -> io::Result<()> {
        let mut from = Hashed::new(from.take(bytes));
        self.archive.append_data(&mut self.header(bytes), path, &mut from)?;
        if from.bytes != bytes {
            return Err(io::Error::other(format!("{path} became shorter during the backup")));
        }
        self.manifest.files.insert(path.to_owned(), from.kept());
        Ok(())
    }

    /// Adds the manifest; returns the output.
    pub(super) fn finish(mut self) -> io::Result<(W, Manifest)> {
        let json = serde_json::to_vec_pretty(&self.manifest)?;
        self.archive.append_data(&mut self.header(json.len() as u64), MANIFEST, json.as_slice())?;
        Ok((self.archive.into_inner()?, self.manifest))
    }

    fn header(&self, bytes: u64) -> tar::Header {
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes);
        header.set_mode(0o600);
        header.set_mtime(self.manifest.made_ms.max(0) as u64 / 1000);
        header
    }
}

/// Reads and verifies an archive. Calls `take` with relative path and content for every file.
pub(super) fn read_archive(
    from: impl Read,
    mut take: impl FnMut(&Path, &mut dyn Read) -> io::Result<()>,
) -> io::Result<Manifest> {
    let mut archive = tar::Archive::new(from);
    let (mut found, mut manifest) = (BTreeMap::new(), None);
    for entry in archive.entries()? {
        let mut entry = entry?;
        let path = plain_path(&entry)?;
        if manifest.is_some() {
            return Err(damaged(format!("{path} follows the manifest")));
        }
        if path == MANIFEST {
            manifest = Some(read_manifest(&mut entry)?);
            continue;
        }
        let mut file = Hashed::new(&mut entry);
        take(Path::new(&path), &mut file)?;
        io::copy(&mut file, &mut io::sink())?;
        if found.insert(path.clone(), file.kept()).is_some() {
            return Err(damaged(format!("{path} occurs twice")));
        }
    }
    let manifest =
        manifest.ok_or_else(|| damaged("it is truncated, or not a backup: the manifest is missing"))?;
    match found.iter().find(|(path, kept)| manifest.files.get(*path) != Some(kept)) {
        Some((path, _)) => Err(damaged(format!("{path} differs from the manifest"))),
        None => match manifest.files.keys().find(|path| !found.contains_key(*path)) {
            Some(path) => Err(damaged(format!("{path} is missing"))),
            None => Ok(manifest),
        },
    }
}

pub(super) fn check(from: &File) -> io::Result<Manifest> {
    read_archive(io::BufReader::new(from), |_, _| Ok(()))
}

fn damaged(what: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, what.into())
}

fn plain_path(entry: &tar::Entry<'_, impl Read>) -> io::Result<String> {
    let path: PathBuf = entry.path()?.into_owned();
    let is_plain = path.components().all(|part| matches!(part, Component::Normal(_)));
    match path.to_str() {
        Some(text) if is_plain && !text.is_empty() && entry.header().entry_type().is_file() => {
            Ok(text.to_owned())
        }
        _ => Err(damaged(format!(
            "'{}' cannot be a file in a backup",
            path.display().to_string().escape_debug()
        ))),
    }
}

fn read_manifest(entry: impl Read) -> io::Result<Manifest> {
    let mut json = Vec::new();
    entry.take(MAX_MANIFEST_BYTES).read_to_end(&mut json)?;
    let manifest: Manifest = serde_json::from_slice(&json)
        .map_err(|error| damaged(format!("cannot parse the manifest: {error}")))?;
    match manifest.format {
        FORMAT => Ok(manifest),
        other => {
            Err(damaged(format!("its layout has version {other}, but this program reads version {FORMAT}")))
        }
    }
}

struct Hashed<R> {
    from: R,
    bytes: u64,
    hasher: blake3::Hasher,
}

impl<R> Hashed<R> {
    fn new(from: R) -> Self {
        Self { from, bytes: 0, hasher: blake3::Hasher::new() }
    }

    fn kept(&self) -> ArchivedFile {
        ArchivedFile { bytes: self.bytes, digest: self.hasher.finalize().to_hex().to_string() }
    }
}

impl<R: Read> Read for Hashed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.from.read(buffer)?;
        self.hasher.update(&buffer[..read]);
        self.bytes += read as u64;
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written() -> Vec<u8> {
        let mut writer = Writer::new(Vec::new(), Manifest::new(3, 1000));
        writer.add("avln.db", 5, &b"rows!"[..]).unwrap();
        writer.add("runs/run_1.log", 4, &b"line and more"[..]).unwrap();
        writer.finish().unwrap().0
    }

    #[test]
    fn written_files_are_read_back() {
        let mut files = BTreeMap::new();
        let manifest = read_archive(written().as_slice(), |path, from| {
            let mut text = String::new();
            from.read_to_string(&mut text)?;
            files.insert(path.display().to_string(), text);
            Ok(())
        });
        let manifest = manifest.unwrap();
        assert_eq!((manifest.schema, manifest.bytes(), manifest.files.len()), (3, 9, 2));
        let expected = [("avln.db", "rows!"), ("runs/run_1.log", "line")];
        assert_eq!(files, expected.map(|(path, text)| (path.to_owned(), text.to_owned())).into());
    }

    #[test]
    fn every_changed_byte_is_detected() {
        let whole = written();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x10;
            if let Ok(manifest) = read_archive(bytes.as_slice(), |_, _| Ok(())) {
                // Owner, time and padding are not covered by digests.
                assert_eq!(manifest.files.len(), 2, "byte {at}");
                let mut contents = Vec::new();
                let read =
                    read_archive(bytes.as_slice(), |_, from| from.read_to_end(&mut contents).map(drop));
                assert!(read.is_ok() && contents == b"rows!line", "byte {at}");
            }
        }
    }

    #[test]
    fn truncated_archives_are_refused() {
        let whole = written();
        for end in (0..whole.len() - 1024).step_by(64) {
            assert!(read_archive(&whole[..end], |_, _| Ok(())).is_err(), "{end} of {}", whole.len());
        }
    }

    #[test]
    fn paths_outside_the_folder_are_refused() {
        for name in ["../outside", "/etc/outside", "a/../../outside"] {
            let mut archive = tar::Builder::new(Vec::new());
            let mut header = tar::Header::new_old();
            header.set_size(1);
            header.as_old_mut().name[..name.len()].copy_from_slice(name.as_bytes());
            header.set_entry_type(tar::EntryType::Regular);
            header.set_cksum();
            archive.append(&header, &b"x"[..]).unwrap();
            let bytes = archive.into_inner().unwrap();
            let refused = read_archive(bytes.as_slice(), |_, _| panic!("{name} was handed out")).unwrap_err();
            assert!(refused.to_string().contains("cannot be a file in a backup"), "{refused}");
        }
    }

    #[test]
    fn shrinking_files_fail_the_backup() {
        let mut writer = Writer::new(Vec::new(), Manifest::new(3, 1000));
        let refused = writer.add("a", 9, &b"short"[..]).unwrap_err();
        assert!(refused.to_string().contains("became shorter"), "{refused}");
    }
}
