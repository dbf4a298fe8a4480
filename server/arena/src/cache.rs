//! Disk cache of render models and sound sources, shared by runs and processes.
//!
//! All files can be recomputed, so every problem is a warning, never an error.

use crate::{Failure, FailureKind, secret};
use avln_render::{Model, ModelCache};
use avln_simd::Mapped;
use avln_world::{Cache, SoundCache};
use std::{
    fs::{self, File},
    io::{self, Write},
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::SystemTime,
};

/// Default size limit, GiB: a hundred scans, a thousand procedural houses or 3,500 sound sources.
const BUDGET_GIB: u32 = 4;

/// File with a different limit, GiB in digits.
const LIMIT_FILE: &str = "limit_gib";

/// Hash prefix of files without an internal hash, bytes.
const HASH_BYTES: usize = 32;

/// A folder of render models and sound sources. A file is written under a temporary name, moved into place
/// when complete, and never modified.
pub struct CacheFolder {
    folder: PathBuf,
    budget_bytes: u64,
    /// True after the first warning about unwritable files.
    complained: AtomicBool,
}

impl CacheFolder {
    /// Path of the cache in a data folder.
    pub const IN_DATA: &str = "cache/scenes";

    /// Creates the cache in `folder` (created on first use) with the limit of [`CacheFolder::limit`], by
    /// default 4 GiB. The least recently used files are evicted first.
    pub fn at(folder: &Path) -> Self {
        Self::with_budget(folder, u64::from(limit_gib(folder)) << 30)
    }

    /// Lets the cache in `folder` take `gib` GiB from now on, for all programs that start from now on.
    ///
    /// # Errors
    /// When the folder cannot be written.
    pub fn limit(folder: &Path, gib: u32) -> Result<(), Failure> {
        let written =
            fs::create_dir_all(folder).and_then(|()| fs::write(folder.join(LIMIT_FILE), gib.to_string()));
        written.map_err(|error| {
            let message = format!("cannot set the size of the cache in {}: {error}", folder.display());
            Failure::new(FailureKind::Data, message).hinted("give the folder write permission")
        })
    }

    /// Bytes of all files together, at most.
    pub fn budget_bytes(&self) -> u64 {
        self.budget_bytes
    }

    /// [`CacheFolder::at`], with another limit.
    pub fn with_budget(folder: &Path, budget_bytes: u64) -> Self {
        Self { folder: folder.to_owned(), budget_bytes, complained: AtomicBool::new(false) }
    }

    /// The cache of an existing data folder; optional commands do not create it.
    pub fn of_data(data: &Path) -> Option<Arc<dyn Cache>> {
        data.is_dir().then(|| Arc::new(Self::at(&data.join(Self::IN_DATA))) as Arc<dyn Cache>)
    }

    /// Path of the model `name`. Program versions have separate files.
    fn model_path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}-{}.model", Model::VERSION))
    }

    fn sound_path(&self, name: &str) -> PathBuf {
        self.folder.join(format!("{name}.sound"))
    }

    /// Writes the file `path` with `bytes` bytes.
    fn write(&self, path: &Path, bytes: u64, content: impl FnOnce(File) -> io::Result<()>) -> io::Result<()> {
        fs::create_dir_all(&self.folder)?;
        self.make_room(bytes)?;
        let random = secret::random_hex().map_err(io::Error::other)?;
        let unfinished = self.folder.join(format!("{random}.part"));
        let written =
            File::create_new(&unfinished).and_then(content).and_then(|()| fs::rename(&unfinished, path));
        if written.is_err() {
            let _ = fs::remove_file(&unfinished);
        }
        written
    }

    /// Deletes files, those that were used least recently first, until `bytes` more fit.
    fn make_room(&self, bytes: u64) -> io::Result<()> {
        let mut files = self.files()?;
        let mut sum = files.iter().map(|file| file.bytes).sum::<u64>().saturating_add(bytes);
        files.sort();
        for file in files {
            if sum <= self.budget_bytes {
                break;
            }
            // Another process may have deleted it.
            let _ = fs::remove_file(&file.path);
            sum -= file.bytes;
        }
        Ok(())
    }

    /// All files of this kind of folder, those that were left unfinished too.
    fn files(&self) -> io::Result<Vec<Kept>> {
        let is_ours = |path: &PathBuf| {
            path.extension().is_some_and(|end| end == "model" || end == "sound" || end == "part")
        };
        let paths = fs::read_dir(&self.folder)?.filter_map(|entry| Some(entry.ok()?.path()));
        Ok(paths.filter(is_ours).filter_map(Kept::at).collect())
    }

    /// Warns once that nothing is cached.
    fn complain(&self, error: &io::Error) {
        if !self.complained.swap(true, Ordering::Relaxed) {
            let folder = self.folder.display();
            tracing::warn!(%folder, %error, "cannot store prepared scenes, so each start prepares them; give the folder write permission and space");
        }
    }
}

/// GiB that the cache in `folder` may take.
fn limit_gib(folder: &Path) -> u32 {
    let path = folder.join(LIMIT_FILE);
    let Ok(text) = fs::read_to_string(&path) else { return BUDGET_GIB };
    text.trim().parse().unwrap_or_else(|error| {
        let file = path.display();
        tracing::warn!(%file, %error, "the file does not contain a number of GiB; the limit is {BUDGET_GIB}; set --cache-size");
        BUDGET_GIB
    })
}

/// A file, ordered by when it was last used.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Kept {
    used: SystemTime,
    path: PathBuf,
    bytes: u64,
}

impl Kept {
    /// The file at `path`; `None` when it has just gone.
    fn at(path: PathBuf) -> Option<Self> {
        let about = fs::metadata(&path).ok()?;
        Some(Self { used: about.modified().unwrap_or(SystemTime::UNIX_EPOCH), bytes: about.len(), path })
    }
}

impl ModelCache for CacheFolder {
    fn find(&self, name: &str) -> Option<Model> {
        let path = self.model_path(name);
        let read = match Mapped::open(&path) {
            Ok(bytes) => Model::read(bytes).map_err(|error| error.to_string()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => Err(error.to_string()),
        };
        read.inspect(|_| touch(&path)).inspect_err(|error| discard(&path, error)).ok()
    }

    fn keep(&self, name: &str, model: Model) -> Model {
        if model.byte_count() as u64 > self.budget_bytes {
            return model;
        }
        let (path, bytes) = (self.model_path(name), model.byte_count() as u64);
        let written = self.write(&path, bytes, |file| model.write(file));
        match written.and_then(|()| Mapped::open(&path)) {
            Ok(bytes) => Model::read(bytes).unwrap_or(model),
            Err(error) => {
                self.complain(&error);
                model
            }
        }
    }
}

impl SoundCache for CacheFolder {
    fn load_sound(&self, name: &str) -> Option<Vec<u8>> {
        let path = self.sound_path(name);
        let mut bytes = match fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return None,
            Err(error) => {
                discard(&path, &error.to_string());
                return None;
            }
        };
        let content = bytes.split_off(HASH_BYTES.min(bytes.len()));
        if blake3::hash(&content).as_bytes()[..] != bytes[..] {
            discard(&path, "its bytes are not those that were written");
            return None;
        }
        touch(&path);
        Some(content)
    }

    fn store_sound(&self, name: &str, bytes: &[u8]) {
        let count = (HASH_BYTES + bytes.len()) as u64;
        if count > self.budget_bytes {
            return;
        }
        let content = |mut file: File| {
            file.write_all(blake3::hash(bytes).as_bytes())?;
            file.write_all(bytes)
        };
        if let Err(error) = self.write(&self.sound_path(name), count, content) {
            self.complain(&error);
        }
    }
}

/// Updates the access time. If that fails, the file may be evicted earlier, which affects no result.
fn touch(path: &Path) {
    let _ = File::open(path).and_then(|file| file.set_modified(SystemTime::now()));
}

/// Deletes a damaged file.
fn discard(path: &Path, error: &str) {
    let file = path.display();
    tracing::warn!(%file, %error, "cannot use a file in the cache; it is deleted and regenerated");
    let _ = fs::remove_file(path);
}

#[cfg(test)]
mod tests;
