//! Writing and signing run logs.

use crate::{
    clock::Clock,
    lock, now_unix_ms, private_file,
    runlog::{Entry, History, LogError, link},
};
use avln_grpc::{Acted, EpisodeLog};
use ring::signature::{ED25519, Ed25519KeyPair, KeyPair, UnparsedPublicKey};
use std::{
    collections::{BTreeMap, BTreeSet},
    fs::File,
    io::{self, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};
use tempfile::NamedTempFile;

/// The run logs in a folder.
#[derive(Debug)]
pub struct RunLogs {
    pub(crate) folder: PathBuf,
    /// Number of the server start; `None` outside a server.
    epoch: Option<u64>,
    opened: Mutex<OpenedLogs>,
}

#[derive(Debug, Default)]
struct OpenedLogs {
    /// Open logs by run.
    open: BTreeMap<String, Arc<RunLog>>,
    /// Runs whose log contains this server start.
    marked: BTreeSet<String>,
}

/// An open run log.
#[derive(Debug)]
pub struct RunLog {
    path: PathBuf,
    end: Mutex<End>,
    /// True for lines that may not be on disk yet.
    dirty: AtomicBool,
}

/// State after the last line.
#[derive(Debug)]
struct End {
    file: File,
    bytes: u64,
    head: String,
}

impl RunLogs {
    /// Opens the logs in `folder`, created on first use.
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), epoch: None, opened: Mutex::default() }
    }

    /// Adds the number of the server start, which is written before a run's first line since then.
    pub fn with_epoch(self, epoch: u64) -> Self {
        Self { epoch: Some(epoch), ..self }
    }

    /// Returns the path for a run.
    pub fn path(&self, run: &str) -> PathBuf {
        self.folder.join(format!("{run}.log"))
    }

    /// Reads a run's history; `None` without a log.
    pub fn history(&self, run: &str) -> Result<Option<History>, LogError> {
        let path = self.path(run);
        if path.exists() { History::read(&path).map(Some) } else { Ok(None) }
    }

    /// Opens a run's log for writing; `first` creates the first entry.
    pub fn open(&self, run: &str, first: impl FnOnce() -> Entry) -> Result<Arc<RunLog>, LogError> {
        let mut opened = lock(&self.opened);
        if let Some(log) = opened.open.get(run) {
            return Ok(log.clone());
        }
        let log = Arc::new(RunLog::open(&self.path(run), first)?);
        if let Some(epoch) = self.epoch.filter(|_| !opened.marked.contains(run)) {
            log.write(&Entry::ServerStarted { epoch, at_ms: now_unix_ms() })
                .map_err(|source| LogError::File { path: log.path.clone(), source })?;
            opened.marked.insert(run.to_owned());
        }
        opened.open.insert(run.to_owned(), log.clone());
        Ok(log)
    }

    /// Writes the loss of an attempt. Without a log, no restart could continue it.
    pub(crate) fn write_loss(&self, run: &str, handle: String, at_ms: i64) -> Result<(), String> {
        let history = self.history(run).map_err(|error| error.to_string())?;
        let Some(first) = history.and_then(|history| history.entries.into_iter().next()) else {
            return Ok(());
        };
        let log = self.open(run, || first).map_err(|error| error.to_string())?;
        log.write(&Entry::Lost { handle, at_ms }).map_err(|error| error.to_string())
    }

    /// Signs a run's log, if it has lines since the last signature.
    pub fn sign(&self, run: &str, key: &SigningKey) -> Result<(), String> {
        let Some(history) = self.history(run).map_err(|error| error.to_string())? else { return Ok(()) };
        let (Some(first), Some(last)) = (history.entries.first(), history.entries.last()) else {
            return Ok(());
        };
        if matches!(last, Entry::Signed { .. }) {
            return Ok(());
        }
        let log = self.open(run, || first.clone()).map_err(|error| error.to_string())?;
        log.sign(key).map_err(|error| error.to_string())
    }

    /// Syncs logs to disk and closes unused ones.
    pub fn sync(&self) {
        let mut opened = lock(&self.opened);
        // A log with unsynced lines stays open: closing it would skip the sync.
        opened.open.retain(|_, log| Arc::strong_count(log) > 1 || log.dirty.load(Ordering::Acquire));
        let logs: Vec<_> = opened.open.values().cloned().collect();
        // Without the lock: a sync waits for the disk, and runs must be able to open their logs meanwhile.
        drop(opened);
        for log in logs {
            if let Err(error) = log.sync() {
                tracing::error!(path = %log.path.display(), %error, "cannot sync a run log to disk");
            }
        }
    }
}

impl RunLog {
    fn open(path: &Path, first: impl FnOnce() -> Entry) -> Result<Self, LogError> {
        let failed = |source: io::Error| LogError::File { path: path.to_owned(), source };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(failed)?;
        }
        let history = if path.exists() { History::read(path)? } else { History::default() };
        let options = private_file().create(true).write(true).truncate(false).open(path);
        let mut file = options.map_err(failed)?;
        // A line that a server crash interrupted is removed: the next line must follow the hash chain.
        file.set_len(history.whole_bytes).map_err(failed)?;
        file.seek(SeekFrom::End(0)).map_err(failed)?;
        let end = End { file, bytes: history.whole_bytes, head: history.head };
        let log = Self { path: path.to_owned(), end: Mutex::new(end), dirty: AtomicBool::new(false) };
        if history.entries.is_empty() {
            log.write(&first()).map_err(failed)?;
        }
        Ok(log)
    }

    /// Signs all lines.
    pub fn sign(&self, key: &SigningKey) -> io::Result<()> {
        let head = lock(&self.end).head.clone();
        let signature = key.sign(&head);
        self.write(&Entry::Signed { head, key: key.public(), signature })?;
        self.sync()
    }

    /// Writes an entry. It survives a process crash, and after the next [`RunLog::sync`] a machine crash.
    /// After an error the log is unchanged.
    pub fn write(&self, entry: &Entry) -> io::Result<()> {
        let json = serde_json::to_string(entry)?;
        let mut end = lock(&self.end);
        let digits = link(&end.head, &json);
        let line = format!("{digits} {json}\n");
        // After a failure the rest of the line is removed, because the next line must follow the hash chain.
        if let Err(error) = end.file.write_all(line.as_bytes()) {
            let whole = end.bytes;
            end.file.set_len(whole)?;
            end.file.seek(SeekFrom::Start(whole))?;
            return Err(error);
        }
        end.bytes += line.len() as u64;
        end.head = digits;
        self.dirty.store(true, Ordering::Release);
        Ok(())
    }

    /// Syncs the lines to disk.
    pub fn sync(&self) -> io::Result<()> {
        // Cleared before the sync: a line that is written meanwhile sets it.
        if !self.dirty.swap(false, Ordering::AcqRel) {
            return Ok(());
        }
        // On another handle, so that writers do not wait for the disk.
        let file = lock(&self.end).file.try_clone()?;
        file.sync_data().inspect_err(|_| self.dirty.store(true, Ordering::Release))
    }
}

/// A slot's log.
#[derive(Debug)]
pub struct SlotLog {
    /// Run log.
    pub log: Arc<RunLog>,
    /// Slot.
    pub slot: u32,
    /// True for a restored episode before the first action.
    pub restored: bool,
    /// The arena's clock.
    pub clock: Clock,
}

impl EpisodeLog for SlotLog {
    fn acting(&mut self, step: u32) -> io::Result<()> {
        match std::mem::take(&mut self.restored) {
            true => {
                let at_ms = self.clock.now_unix_ms();
                self.log.write(&Entry::StepAttempted { slot: self.slot, step, at_ms })
            }
            false => Ok(()),
        }
    }

    fn acted(&mut self, acted: &Acted) -> io::Result<()> {
        self.log.write(&Entry::Acted {
            slot: self.slot,
            step: acted.step,
            action: acted.action,
            state: format!("{:016x}", acted.state_hash),
            thought_us: micros(acted.thought),
            bank_us: micros(acted.bank_left),
            at_ms: self.clock.now_unix_ms(),
        })
    }

    fn clock_restarted(&mut self, step: u32, away: Duration) -> io::Result<()> {
        let (slot, away_us) = (self.slot, micros(away));
        self.log.write(&Entry::ClockRestarted { slot, step, away_us, at_ms: self.clock.now_unix_ms() })
    }
}

fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}

const SEED_BYTES: usize = 32;

/// The server's Ed25519 key (RFC 8032).
#[derive(Debug)]
pub struct SigningKey(Ed25519KeyPair);

impl SigningKey {
    /// Reads a key of exactly 32 bytes, or creates it, readable by the owner only.
    pub fn at(path: &Path) -> io::Result<Self> {
        match std::fs::read(path) {
            Ok(seed) => Self::from_seed(&seed),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Self::make(path),
            Err(error) => Err(error),
        }
    }

    /// Creates a key. If programs create it at the same time, the first one wins.
    fn make(path: &Path) -> io::Result<Self> {
        let mut seed = [0; SEED_BYTES];
        getrandom::fill(&mut seed).map_err(io::Error::other)?;
        let folder = path.parent().unwrap_or(Path::new("."));
        // Temporary files are readable by their owner only.
        let mut file = NamedTempFile::new_in(folder)?;
        file.write_all(&seed)?;
        file.as_file().sync_all()?;
        match file.persist_noclobber(path) {
            Ok(_) => Self::from_seed(&seed),
            Err(refused) if refused.error.kind() == io::ErrorKind::AlreadyExists => Self::at(path),
            Err(refused) => Err(refused.error),
        }
    }

    fn from_seed(seed: &[u8]) -> io::Result<Self> {
        let pair = Ed25519KeyPair::from_seed_unchecked(seed);
        let damaged = |_| io::Error::new(io::ErrorKind::InvalidData, "a signing key has 32 bytes");
        pair.map(Self).map_err(damaged)
    }

    /// Returns the public key, hexadecimal.
    pub fn public(&self) -> String {
        hex::encode(self.0.public_key())
    }

    /// Returns the signature over `head`, a line's digits, hexadecimal.
    pub fn sign(&self, head: &str) -> String {
        hex::encode(self.0.sign(head.as_bytes()))
    }
}

/// Returns true for a valid signature of `public` over `head`; key and signature are hexadecimal.
pub fn is_signed(public: &str, head: &str, signature: &str) -> bool {
    let (Ok(public), Ok(signature)) = (hex::decode(public), hex::decode(signature)) else { return false };
    UnparsedPublicKey::new(&ED25519, public).verify(head.as_bytes(), &signature).is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_key_signs_identically() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("signing.key");
        let (made, found) = (SigningKey::at(&path).unwrap(), SigningKey::at(&path).unwrap());
        let signature = made.sign("abc");
        assert_eq!(signature, found.sign("abc"));
        assert!(is_signed(&made.public(), "abc", &signature));
        assert!(!is_signed(&made.public(), "abd", &signature));
        assert!(!is_signed(&signature, "abc", &made.public()));
        assert!(!is_signed("é", "abc", "x"));
        std::fs::write(&path, b"short").unwrap();
        assert!(SigningKey::at(&path).unwrap_err().to_string().contains("32 bytes"));
    }

    #[test]
    fn concurrent_programs_share_one_key() {
        for _ in 0..50 {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("signing.key");
            let key = || SigningKey::at(&path).unwrap().public();
            let keys = std::thread::scope(|scope| {
                let made = [(); 4].map(|()| scope.spawn(key));
                made.map(|made| made.join().unwrap())
            });
            assert!(keys.iter().all(|key| *key == keys[0]), "{keys:?}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn key_file_is_private() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("signing.key");
        SigningKey::at(&path).unwrap();
        assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o600);
    }
}
