//! Data folder: database, splits, recordings, heads, run logs, cache.

use crate::{
    Failure,
    audio::{HeadFolder, SoundFolder},
    cache::CacheFolder,
    dataset::{DatasetFiles, SplitFolder},
    private_file,
    runlog::{RunLogs, SigningKey},
    sync_folder,
};
use avln_dataset::Split;
use avln_episode::{HeadRule, Rules, Sounds};
use avln_referee::{Audio, Bank, Head, made_bank};
use avln_store::Store;
use avln_world::Cache;
use serde::{Deserialize, Serialize};
use std::{
    fs::{File, TryLockError},
    io::{self, Read, Seek, Write},
    path::{Path, PathBuf},
    sync::Arc,
    thread,
    time::Duration,
};

/// A server's data folder: `avln.db`, `epoch`, `splits/`, `sounds/`, `heads/`, `runs/`, and the reproducible `cache/`.
#[derive(Clone, Debug)]
pub struct DataFolder {
    root: PathBuf,
}

/// Next step for a volume of another owner.
pub(crate) const OWNER_HINT: &str = "the volume of a container belongs to user 10001: \
     docker run --rm --user 0 --volume VOLUME:/data avln-server chown -R 10001 /data";

impl DataFolder {
    /// Name of the lock file.
    pub(crate) const LOCK: &str = "server.lock";
    /// Name of the file with the number of server starts.
    pub(crate) const EPOCH: &str = "epoch";

    /// Opens the folder, or creates it. Removes other users' access to it; prints a warning where this is impossible.
    pub fn open(root: &Path) -> Result<Self, Failure> {
        let failed = |error: io::Error| {
            Failure::file("write to data folder", root, error).hinted(format!(
                "choose another folder with --data FOLDER, or add write permission; {OWNER_HINT}"
            ))
        };
        let folders = [root.to_owned(), root.join("splits")];
        folders.iter().try_for_each(|folder| create_folder(folder)).map_err(failed)?;
        probe(&root.join(".writable")).map_err(failed)?;
        if let Err(error) = folders.iter().try_for_each(|folder| make_private(folder)) {
            let root = root.display();
            eprintln!(
                "warning: other users may read data folder {root}: {error}; its owner can run: chmod -R go= {root}"
            );
        }
        let root = root.canonicalize().map_err(failed)?;
        Ok(Self { root })
    }

    /// Locks the folder for a server, until the file is closed or the process ends.
    ///
    /// Two servers would issue the same episodes twice. Containers of a machine share the lock on a common volume.
    pub fn lock(&self) -> Result<File, Failure> {
        let path = self.root.join(Self::LOCK);
        let failed = |error: io::Error| Failure::file("lock", &path, error);
        let opened = private_file().create(true).truncate(false).write(true).open(&path);
        let file = opened.map_err(failed)?;
        // A child of an ended server, such as a sealed agent that could not start, holds the lock for some milliseconds more.
        let mut waits = 25;
        loop {
            match file.try_lock() {
                Ok(()) => return Ok(file),
                Err(TryLockError::WouldBlock) if waits > 0 => {
                    waits -= 1;
                    thread::sleep(Duration::from_millis(20));
                }
                Err(TryLockError::WouldBlock) => {
                    let message =
                        format!("a server is already running on data folder {}", self.root.display());
                    return Err(Failure::data(message).hinted(
                        "stop that server, or choose another folder with --data FOLDER; sealed runs use it with --server ADDRESS",
                    ));
                }
                Err(TryLockError::Error(error)) => return Err(failed(error)),
            }
        }
    }

    /// Counts a server start; returns its number, from 1. `_lock` is the folder's lock.
    pub(crate) fn count_start(&self, _lock: &File) -> Result<u64, Failure> {
        let path = self.root.join(Self::EPOCH);
        let failed = |error: io::Error| Failure::file("count the server start in", &path, error);
        let opened = private_file().create(true).truncate(false).read(true).write(true).open(&path);
        let mut file = opened.map_err(failed)?;
        let mut text = String::new();
        file.read_to_string(&mut text).map_err(failed)?;
        let before = match text.trim() {
            "" => 0,
            number => number.parse::<u64>().map_err(|_| {
                Failure::data(format!("{} contains no number of server starts", path.display())).hinted(
                    "restore it from a backup; a smaller number would invalidate the logs of open runs",
                )
            })?,
        };
        let epoch = before.saturating_add(1);
        // In place and with a fixed width: the owner of the file stays, and a crash leaves the old or the new number.
        let written = file.rewind().and_then(|()| file.write_all(format!("{epoch:020}\n").as_bytes()));
        written.and_then(|()| file.sync_all()).and_then(|()| sync_folder(&self.root)).map_err(failed)?;
        Ok(epoch)
    }

    /// Returns the path.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Returns the sound clips.
    pub fn bank(&self, sounds: &Sounds) -> Result<Bank, Failure> {
        match sounds {
            Sounds::Own(digest) => self.sounds().bank(digest),
            made => Ok(made_bank(made).unwrap_or_default()),
        }
    }

    /// Returns the clips and head model for `rules`.
    pub fn audio(&self, rules: &Rules) -> Result<Audio, Failure> {
        let head = match &rules.head {
            HeadRule::Sphere => Head::Sphere,
            HeadRule::Measured(digest) => self.heads().head(digest)?,
        };
        Ok(Audio { bank: self.bank(&rules.sounds)?, head })
    }

    /// Returns the measured heads.
    pub fn heads(&self) -> HeadFolder {
        HeadFolder::at(&self.root.join("heads"))
    }

    /// Returns the recordings.
    pub fn sounds(&self) -> SoundFolder {
        SoundFolder::at(&self.root.join("sounds"))
    }

    /// Returns the run logs.
    pub fn run_logs(&self) -> RunLogs {
        RunLogs::at(&self.root.join("runs"))
    }

    /// Returns the server's signing key, created if missing.
    pub fn signing_key(&self) -> Result<SigningKey, Failure> {
        let path = self.root.join("signing.key");
        SigningKey::at(&path).map_err(|error| {
            Failure::file("use signing key", &path, error)
                .hinted("restore it from a backup; a new key would not fit the signatures of old logs")
        })
    }

    /// Returns the scene cache.
    pub fn cache(&self) -> Arc<dyn Cache> {
        Arc::new(self.cache_folder())
    }

    /// Returns the scene cache's folder.
    pub fn cache_folder(&self) -> CacheFolder {
        CacheFolder::at(&self.root.join(CacheFolder::IN_DATA))
    }

    /// Sets the cache limit in GiB; `None` changes nothing.
    pub fn limit_cache(&self, gib: Option<u32>) -> Result<(), Failure> {
        gib.map_or(Ok(()), |gib| CacheFolder::limit(&self.root.join(CacheFolder::IN_DATA), gib))
    }

    /// Opens the database, or creates it.
    pub async fn store(&self) -> Result<Store, Failure> {
        Ok(Store::open(&self.root.join("avln.db")).await?)
    }

    /// Stores a split as a data set, with the number for its draws; fails if other missions use the name.
    pub fn save_split(&self, split: &Split, seed: u64) -> Result<(), Failure> {
        let folder = self.split_folder(&split.name)?;
        if self.exists(&split.name)? && self.split(&split.name)? != *split {
            return Err(taken(&split.name));
        }
        DatasetFiles::at(&folder).write_split(split, Some(seed))
    }

    /// Returns the files of a split that does not exist yet.
    pub(crate) fn new_split(&self, name: &str) -> Result<DatasetFiles, Failure> {
        if self.exists(name)? { Err(taken(name)) } else { Ok(DatasetFiles::at(&self.split_folder(name)?)) }
    }

    /// Links a split from another data set; returns the derived name. Fails if another split uses it.
    pub fn link_split(&self, dataset: &Path, split: &str) -> Result<String, Failure> {
        let root = dataset.canonicalize().map_err(|error| Failure::file("find data set", dataset, error))?;
        let name = format!("{}-{split}", DatasetFiles::at(&root).manifest()?.name);
        self.link_split_as(&name, &root, split)?;
        Ok(name)
    }

    /// Links a split from another data set as `name`; fails if another split uses the name.
    pub fn link_split_as(&self, name: &str, dataset: &Path, split: &str) -> Result<(), Failure> {
        let root = dataset.canonicalize().map_err(|error| Failure::file("find data set", dataset, error))?;
        let (digest, path) = (SplitFolder::open(&root, split)?.digest().to_owned(), self.link_path(name)?);
        if self.exists(name)? && self.missions(name)?.digest() != digest {
            return Err(taken(name));
        }
        let link = Link { dataset: root, split: split.to_owned() };
        let json = serde_json::to_vec(&link).map_err(Failure::internal)?;
        let mut options = private_file();
        let written = options.create(true).truncate(true).write(true).open(&path);
        let written = written.and_then(|mut file| file.write_all(&json));
        written.map_err(|error| Failure::file("write", &path, error))
    }

    /// Opens a split; missions are loaded on demand.
    pub fn missions(&self, name: &str) -> Result<SplitFolder, Failure> {
        let (folder, path) = (self.split_folder(name)?, self.link_path(name)?);
        if folder.is_dir() {
            return SplitFolder::open(&folder, name);
        }
        let unreadable = |error: String| {
            Failure::file(&format!("read split '{name}' at"), &path, error).hinted(
                "make it with: avln data split make NAME, or open a phase on a data set with --dataset",
            )
        };
        let bytes = std::fs::read(&path).map_err(|error| unreadable(error.to_string()))?;
        let link: Link = serde_json::from_slice(&bytes).map_err(|error| unreadable(error.to_string()))?;
        SplitFolder::open(&link.dataset, &link.split)
    }

    /// Returns an own split's folder.
    pub fn own_split(&self, name: &str) -> Result<PathBuf, Failure> {
        let folder = self.split_folder(name)?;
        if folder.is_dir() {
            return Ok(folder);
        }
        Err(Failure::data(format!("the data folder contains no own split '{name}'"))
            .hinted("name its data set with --dataset"))
    }

    /// Loads a split with all missions.
    pub fn split(&self, name: &str) -> Result<Split, Failure> {
        Ok(Split { name: name.to_owned(), ..self.missions(name)?.load()? })
    }

    fn exists(&self, name: &str) -> Result<bool, Failure> {
        Ok(self.split_folder(name)?.is_dir() || self.link_path(name)?.is_file())
    }

    fn split_folder(&self, name: &str) -> Result<PathBuf, Failure> {
        check_name("split", name)?;
        Ok(self.root.join("splits").join(name))
    }

    fn link_path(&self, name: &str) -> Result<PathBuf, Failure> {
        check_name("split", name)?;
        Ok(self.root.join("splits").join(format!("{name}.link.json")))
    }
}

/// A linked split.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Link {
    dataset: PathBuf,
    split: String,
}

fn taken(name: &str) -> Failure {
    Failure::scene(format!("split '{name}' already exists with other missions"))
        .hinted("choose another name for the new split")
}

/// Checks that `name` has 1 to 64 letters, digits, `-` and `_`; `what` is the noun in the message.
pub fn check_name(what: &str, name: &str) -> Result<(), Failure> {
    const LONGEST: usize = 64;
    let fits = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
    if !name.is_empty() && name.len() <= LONGEST && name.chars().all(fits) {
        return Ok(());
    }
    Err(Failure::scene(format!("'{}' cannot be the name of a {what}", name.escape_debug()))
        .hinted(format!("use 1 to {LONGEST} letters, digits, - and _")))
}

/// Checks that the folder is writable by creating and deleting a file.
fn probe(file: &Path) -> io::Result<()> {
    std::fs::write(file, b"")?;
    match std::fs::remove_file(file) {
        // Deleted by a concurrent check.
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        removed => removed,
    }
}

/// Creates a folder and parents, without access for other users: the content includes ground truth.
fn create_folder(folder: &Path) -> io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.recursive(true).create(folder)
}

/// Removes other users' access to an existing folder.
#[cfg(unix)]
fn make_private(folder: &Path) -> io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    const OTHERS: u32 = 0o077;
    const STICKY: u32 = 0o1000;
    let mode = std::fs::metadata(folder)?.permissions().mode();
    match (mode & OTHERS, mode & STICKY) {
        (0, _) => Ok(()),
        (_, 0) => std::fs::set_permissions(folder, PermissionsExt::from_mode(0o700)),
        // Such as /tmp, given by mistake.
        _ => Err(io::Error::other("the folder is shared by several users")),
    }
}

#[cfg(not(unix))]
fn make_private(_: &Path) -> io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_has_one_server() {
        let folder = tempfile::tempdir().expect("a folder");
        let data = DataFolder::open(folder.path()).expect("writable");
        let lock = data.lock().expect("no other server");
        let refused = data.clone().lock().expect_err("locked").to_string();
        assert!(
            refused.contains("already running on data folder") && refused.contains("--data"),
            "{refused}"
        );
        drop(lock);
        data.lock().expect("the other server has stopped");
    }

    #[test]
    fn server_starts_are_counted() {
        let folder = tempfile::tempdir().expect("a folder");
        let data = DataFolder::open(folder.path()).expect("writable");
        let lock = data.lock().expect("no other server");
        let starts = [(); 3].map(|()| data.count_start(&lock).expect("a number"));
        assert_eq!(starts, [1, 2, 3]);
        std::fs::write(data.root().join(DataFolder::EPOCH), "many\n").expect("a file");
        let refused = data.count_start(&lock).expect_err("no number").to_string();
        assert!(refused.contains("epoch") && refused.contains("backup"), "{refused}");
    }

    #[cfg(unix)]
    #[test]
    fn shared_folders_keep_their_mode() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::set_permissions(folder.path(), PermissionsExt::from_mode(0o1777)).expect("our own");
        DataFolder::open(folder.path()).expect("writable");
        let mode = std::fs::metadata(folder.path()).expect("a folder").permissions().mode();
        assert_eq!(mode & 0o7777, 0o1777);
    }

    #[test]
    fn a_folder_can_be_opened_concurrently() {
        let folder = tempfile::tempdir().expect("a folder");
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    (0..200).for_each(|_| drop(DataFolder::open(folder.path()).expect("it is ours")))
                });
            }
        });
    }
}
