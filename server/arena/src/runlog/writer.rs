use super::{Entry, History, LogError, SigningKey, link};
use crate::now_unix_ms;
use avln_grpc::{Acted, EpisodeLog};
use std::{
    collections::BTreeMap,
    fs::{File, OpenOptions},
    io::{self, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

/// The run logs of a data folder.
#[derive(Debug)]
pub struct RunLogs {
    folder: PathBuf,
    open: Mutex<BTreeMap<String, Arc<RunLog>>>,
}

/// The log of a run, open for writing.
#[derive(Debug)]
pub struct RunLog {
    path: PathBuf,
    end: Mutex<End>,
    /// True if lines may not be on disk yet.
    dirty: AtomicBool,
}

/// Position of the next line.
#[derive(Debug)]
struct End {
    file: File,
    bytes: u64,
    head: String,
}

impl RunLogs {
    /// The logs in `folder`, which is made when the first is written.
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), open: Mutex::default() }
    }

    /// Folder of the logs.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Path of the log of `run`.
    pub fn path(&self, run: &str) -> PathBuf {
        self.folder.join(format!("{run}.log"))
    }

    /// History of `run`; `None` without a log.
    ///
    /// # Errors
    /// If the log is unreadable or modified.
    pub fn history(&self, run: &str) -> Result<Option<History>, LogError> {
        let path = self.path(run);
        if path.exists() { History::read(&path).map(Some) } else { Ok(None) }
    }

    /// Opens the log of `run` for writing; `first` creates the first entry of a new log.
    ///
    /// # Errors
    /// If it cannot be read or written.
    pub fn open(&self, run: &str, first: impl FnOnce() -> Entry) -> Result<Arc<RunLog>, LogError> {
        let mut open = self.opened();
        if let Some(log) = open.get(run) {
            return Ok(log.clone());
        }
        let log = Arc::new(RunLog::open(&self.path(run), first)?);
        open.insert(run.to_owned(), log.clone());
        Ok(log)
    }

    /// Signs the log of `run`, if it exists and has changed since the last signature.
    ///
    /// # Errors
    /// If it cannot be read or written, with the reason.
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
        let mut open = self.opened();
        open.retain(|_, log| Arc::strong_count(log) > 1 || log.dirty.load(Ordering::Acquire));
        let logs: Vec<_> = open.values().cloned().collect();
        drop(open);
        for log in logs {
            if let Err(error) = log.sync() {
                tracing::error!(path = %log.path.display(), %error, "cannot write a run log to the disk");
            }
        }
    }

    fn opened(&self) -> MutexGuard<'_, BTreeMap<String, Arc<RunLog>>> {
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl RunLog {
    fn open(path: &Path, first: impl FnOnce() -> Entry) -> Result<Self, LogError> {
        let failed = |source: io::Error| LogError::File { path: path.to_owned(), source };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(failed)?;
        }
        let history = if path.exists() { History::read(path)? } else { History::default() };
        let options = OpenOptions::new().create(true).write(true).truncate(false).open(path);
        let mut file = options.map_err(failed)?;
        // The rest of a line that was being written when the server died.
        file.set_len(history.whole_bytes).map_err(failed)?;
        file.seek(SeekFrom::End(0)).map_err(failed)?;
        let end = End { file, bytes: history.whole_bytes, head: history.head };
        let log = Self { path: path.to_owned(), end: Mutex::new(end), dirty: AtomicBool::new(false) };
        if history.entries.is_empty() {
            log.write(&first()).map_err(failed)?;
        }
        Ok(log)
    }

    /// Signs the lines so far.
    ///
    /// # Errors
    /// If the signature cannot be written or synced.
    pub fn sign(&self, key: &SigningKey) -> io::Result<()> {
        let head = self.end.lock().unwrap_or_else(PoisonError::into_inner).head.clone();
        let signature = key.sign(&head);
        self.write(&Entry::Signed { head, key: key.public(), signature })?;
        self.sync()
    }

    /// Writes an entry. When this returns, it survives the death of this process; with the next [`RunLog::sync`], that of the
    /// machine.
    ///
    /// # Errors
    /// When it cannot be written; the log is then as it was.
    pub fn write(&self, entry: &Entry) -> io::Result<()> {
        let json = serde_json::to_string(entry)?;
        let mut end = self.end.lock().unwrap_or_else(PoisonError::into_inner);
        let digits = link(&end.head, &json);
        let line = format!("{digits} {json}\n");
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

    /// Syncs to disk.
    ///
    /// # Errors
    /// If the sync fails.
    pub fn sync(&self) -> io::Result<()> {
        if !self.dirty.swap(false, Ordering::AcqRel) {
            return Ok(());
        }
        let file = self.end.lock().unwrap_or_else(PoisonError::into_inner).file.try_clone()?;
        file.sync_data().inspect_err(|_| self.dirty.store(true, Ordering::Release))
    }
}

/// Log of a slot.
#[derive(Debug)]
pub struct SlotLog {
    /// The run's log.
    pub log: Arc<RunLog>,
    /// The slot.
    pub slot: u32,
    /// True if the episode was restored and has had no action since.
    pub taken_up: bool,
}

impl EpisodeLog for SlotLog {
    fn acting(&mut self, step: u32) -> io::Result<()> {
        match std::mem::take(&mut self.taken_up) {
            true => self.log.write(&Entry::Tries { slot: self.slot, step, at_ms: now_unix_ms() }),
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
            at_ms: now_unix_ms(),
        })
    }

    fn clock_restarted(&mut self, step: u32, away: Duration) -> io::Result<()> {
        let (slot, away_us) = (self.slot, micros(away));
        self.log.write(&Entry::ClockRestarted { slot, step, away_us, at_ms: now_unix_ms() })
    }
}

fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}
