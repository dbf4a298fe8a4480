//! Backup and restore of data folders, also while a server runs.
//!
//! A backup contains the identity of a server: database, run logs, signing key, splits, recordings and heads.
//! Reproducible data (`cache/`) and data outside the folder (data sets, scene files) are excluded.

use crate::{Failure, now_unix_ms};
use archive::Writer;
pub use archive::{ArchivedFile, Manifest};
use avln_store::{Inventory, copy_database, inspect_database};
pub use logs::{PruneOptions, Pruned, prune};
use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, Read},
    path::{Path, PathBuf},
};

mod archive;
mod logs;

/// The database in a data folder.
const DATABASE: &str = "avln.db";
/// Single files in a backup, if present.
const FILES: [&str; 1] = ["signing.key"];
/// Folders in a backup, with their content.
const FOLDERS: [&str; 3] = ["splits", "sounds", "heads"];
/// Other content of a data folder, not copied as is.
const OTHERS: [&str; 5] = ["avln.db-wal", "avln.db-shm", "runs", "cache", ".writable"];

/// Content of a backup.
#[derive(Debug)]
pub struct Contents {
    /// File list.
    pub manifest: Manifest,
    /// Database statistics.
    pub inventory: Inventory,
    /// Referenced but excluded paths: data sets and files.
    pub left_out: Vec<PathBuf>,
}

/// Writes a snapshot of the data folder `data` to the new file `to` and verifies it. A server may run
/// meanwhile.
///
/// # Errors
/// If the data folder is missing, `to` exists, or a file is unreadable, unwritable or damaged.
pub async fn make(data: &Path, to: &Path) -> Result<Contents, Failure> {
    let database = data.join(DATABASE);
    if !database.is_file() {
        let message = format!("{} is no data folder: it holds no {DATABASE}", data.display());
        return Err(Failure::data(message).hinted("name the folder with --data FOLDER"));
    }
    if to.symlink_metadata().is_ok() {
        return Err(taken(to));
    }
    let folder = parent(to);
    let failed = |error: io::Error| Failure::data(format!("cannot write {}: {error}", to.display()));
    let work = work_folder(".avln-backup-", folder).map_err(failed)?;
    let copy = work.path().join(DATABASE);
    let made_ms = now_unix_ms();
    copy_database(&database, &copy).await?;
    let inventory = inspect_database(&copy).await?;
    let (data, to) = (data.to_owned(), to.to_owned());
    let written = tokio::task::spawn_blocking(move || {
        let manifest = write(&data, &copy, &inventory, made_ms, &to)?;
        Ok(Contents { manifest, left_out: left_out(&data), inventory })
    });
    written.await.map_err(Failure::internal)?
}

fn taken(path: &Path) -> Failure {
    Failure::data(format!("{} exists and is not written over", path.display())).hinted("name a new file")
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A private temporary folder next to the target.
fn work_folder(prefix: &str, folder: &Path) -> io::Result<tempfile::TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
    builder.tempdir_in(folder)
}

/// Writes the archive next to its target, verifies it and moves it into place.
fn write(
    data: &Path,
    copy: &Path,
    inventory: &Inventory,
    made_ms: i64,
    to: &Path,
) -> Result<Manifest, Failure> {
    let failed = |error: io::Error| Failure::data(format!("cannot write {}: {error}", to.display()));
    let file = tempfile::Builder::new().prefix(".avln-backup-").tempfile_in(parent(to)).map_err(failed)?;
    let mut writer = Writer::new(BufWriter::new(file.as_file()), Manifest::new(inventory.schema, made_ms));
    add_file(&mut writer, DATABASE, copy)?;
    for name in FILES.into_iter().filter(|name| data.join(name).is_file()) {
        add_file(&mut writer, name, &data.join(name))?;
    }
    logs::add(&mut writer, &data.join("runs"), &inventory.runs)?;
    for name in FOLDERS.into_iter().filter(|name| data.join(name).is_dir()) {
        add_folder(&mut writer, name, &data.join(name))?;
    }
    let (out, manifest) = writer.finish().map_err(failed)?;
    out.into_inner().map_err(|error| failed(error.into_error()))?.sync_all().map_err(failed)?;
    let read = file.reopen().and_then(|file| archive::check(&file)).map_err(failed)?;
    if read != manifest {
        return Err(failed(io::Error::other("what was written is not what can be read")));
    }
    file.persist_noclobber(to).map_err(|error| match error.error.kind() {
        io::ErrorKind::AlreadyExists => taken(to),
        _ => failed(error.error),
    })?;
    sync_folder(parent(to)).map_err(failed)?;
    Ok(manifest)
}

type Out<'a> = Writer<BufWriter<&'a File>>;

/// Adds the file name to an I/O error.
fn cannot_back_up(path: &Path) -> impl Fn(io::Error) -> Failure + '_ {
    move |error| Failure::data(format!("cannot back up {}: {error}", path.display()))
}

fn add_file(writer: &mut Out<'_>, name: &str, path: &Path) -> Result<(), Failure> {
    let mut add = || {
        let file = File::open(path)?;
        writer.add(name, file.metadata()?.len(), file)
    };
    add().map_err(cannot_back_up(path))
}

fn add_folder(writer: &mut Out<'_>, name: &str, path: &Path) -> Result<(), Failure> {
    let mut entries: Vec<_> = fs::read_dir(path)
        .and_then(|entries| entries.collect::<io::Result<_>>())
        .map_err(cannot_back_up(path))?;
    entries.sort_by_key(fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        let kind = entry.file_type().map_err(cannot_back_up(&path))?;
        let file_name = entry.file_name();
        let Some(name) = file_name.to_str().map(|file_name| format!("{name}/{file_name}")) else {
            return Err(cannot_back_up(&path)(io::Error::other("its name is not text")));
        };
        match (kind.is_dir(), kind.is_file()) {
            (true, _) => add_folder(writer, &name, &path)?,
            (_, true) => add_file(writer, &name, &path)?,
            _ => return Err(cannot_back_up(&path)(io::Error::other("it is neither a file nor a folder"))),
        }
    }
    Ok(())
}

/// Creates the data folder `to` from the backup `from`, completely or not at all. In an existing empty
/// folder, such as a container volume, the database is written last.
///
/// # Errors
/// If `to` is not empty, the backup is damaged or too new, or the folder is not writable.
pub async fn restore(from: &Path, to: &Path) -> Result<Contents, Failure> {
    let failed = |error: io::Error| Failure::data(format!("cannot restore to {}: {error}", to.display()));
    if is_occupied(to).map_err(failed)? {
        let message = format!("{} holds files, and a backup is never restored over them", to.display());
        return Err(Failure::data(message).hinted(
            "name a new folder with --data FOLDER; start the server on it, and keep the old one until that is content",
        ));
    }
    // The parent of a volume is not writable, and a volume cannot be replaced.
    let place = if to.is_dir() { to } else { parent(to) };
    fs::create_dir_all(place).map_err(failed)?;
    let work = work_folder(".avln-restore-", place).map_err(failed)?;
    let (backup, folder) = (from.to_owned(), work.path().to_owned());
    let unpacked = tokio::task::spawn_blocking(move || unpack(&backup, &folder)).await;
    let manifest = unpacked.map_err(Failure::internal)??;
    let inventory = inspect_database(&work.path().join(DATABASE)).await?;
    if inventory.schema != manifest.schema {
        let message = format!("{}: its manifest tells of another database", from.display());
        return Err(Failure::data(message).hinted("take another backup"));
    }
    move_into_place(work, to).map_err(failed)?;
    Ok(Contents { manifest, inventory, left_out: left_out(to) })
}

/// Moves the unpacked files into place.
fn move_into_place(work: tempfile::TempDir, to: &Path) -> io::Result<()> {
    if !to.is_dir() {
        fs::rename(work.path(), to)?;
        // It has another name now.
        let _ = work.keep();
        return sync_folder(parent(to));
    }
    let names = fs::read_dir(work.path())?.map(|entry| Ok(entry?.file_name()));
    let mut names = names.collect::<io::Result<Vec<_>>>()?;
    names.sort_by_key(|name| name == DATABASE);
    for name in names {
        fs::rename(work.path().join(&name), to.join(&name))?;
    }
    drop(work);
    sync_folder(to)
}

fn is_occupied(folder: &Path) -> io::Result<bool> {
    match fs::read_dir(folder) {
        Ok(mut entries) => Ok(entries.next().is_some()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(false),
        Err(error) => Err(error),
    }
}

fn unpack(from: &Path, to: &Path) -> Result<Manifest, Failure> {
    let failed = |error: io::Error| {
        let message = format!("backup {} cannot be restored: {error}", from.display());
        Failure::data(message).hinted("take another backup; nothing was changed")
    };
    let file = File::open(from).map_err(failed)?;
    archive::read_archive(io::BufReader::new(file), |path, read| unpack_file(&to.join(path), read))
        .map_err(failed)
}

/// Files are private to their owner: they contain ground truth, token hashes and the signing key.
fn unpack_file(path: &Path, from: &mut dyn Read) -> io::Result<()> {
    fs::create_dir_all(parent(path))?;
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    let mut file = options.open(path)?;
    io::copy(from, &mut file)?;
    file.sync_all()
}

/// Syncs the names in a folder to disk, if supported.
fn sync_folder(folder: &Path) -> io::Result<()> {
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

/// Referenced data outside the backup.
fn left_out(data: &Path) -> Vec<PathBuf> {
    let names =
        |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let known = |path: &PathBuf| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        [DATABASE].iter().chain(&FILES).chain(&FOLDERS).chain(&OTHERS).any(|known| *known == name)
    };
    let links = names(&data.join("splits")).filter_map(|path| {
        let link: serde_json::Value = serde_json::from_slice(&fs::read(path).ok()?).ok()?;
        link["dataset"].as_str().map(PathBuf::from)
    });
    let mut left: Vec<PathBuf> = names(data).filter(|path| !known(path)).chain(links).collect();
    left.sort();
    left.dedup();
    left
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::DataFolder;
    use tempfile::TempDir;

    /// A data folder with a team, a key, a split and a linked split.
    async fn furnished() -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        let data = DataFolder::open(folder.path()).unwrap();
        let store = data.store().await.unwrap();
        store.create_team("red", None, 1).await.unwrap();
        store.close().await;
        data.signing_key().unwrap();
        fs::create_dir_all(folder.path().join("splits/val/missions")).unwrap();
        fs::write(folder.path().join("splits/val/missions/house.jsonl"), "a mission\n").unwrap();
        fs::write(folder.path().join("splits/far.link.json"), r#"{"dataset":"/far/away","split":"val"}"#)
            .unwrap();
        fs::create_dir_all(folder.path().join("cache/scenes")).unwrap();
        fs::write(folder.path().join("cache/scenes/big"), "can be made anew").unwrap();
        folder
    }

    #[tokio::test]
    async fn a_folder_comes_back_as_it_was_without_its_cache() {
        let (folder, place) = (furnished().await, tempfile::tempdir().unwrap());
        let (file, to) = (place.path().join("a.tar"), place.path().join("deep/er"));
        let open = DataFolder::open(folder.path()).unwrap().store().await.unwrap();
        let made = make(folder.path(), &file).await.unwrap();
        open.close().await;
        assert_eq!((made.inventory.teams, made.inventory.runs.len()), (1, 0));
        assert_eq!(made.left_out, [PathBuf::from("/far/away")]);
        let restored = restore(&file, &to).await.unwrap();
        assert_eq!(restored.manifest, made.manifest);
        for name in ["signing.key", "splits/val/missions/house.jsonl"] {
            assert_eq!(
                fs::read(to.join(name)).unwrap(),
                fs::read(folder.path().join(name)).unwrap(),
                "{name}"
            );
        }
        assert!(!to.join("cache").exists());
        let store = DataFolder::open(&to).unwrap().store().await.unwrap();
        assert!(store.team("red").await.unwrap().is_some());
        let names: Vec<_> =
            fs::read_dir(place.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names.len(), 2, "nothing else is left: {names:?}");
    }

    #[cfg(unix)]
    #[tokio::test]
    async fn nobody_else_can_read_a_backup_or_what_comes_out_of_it() {
        use std::os::unix::fs::PermissionsExt;
        let (folder, place) = (furnished().await, tempfile::tempdir().unwrap());
        let (file, to) = (place.path().join("a.tar"), place.path().join("data"));
        make(folder.path(), &file).await.unwrap();
        restore(&file, &to).await.unwrap();
        for path in [file, to.clone(), to.join("signing.key"), to.join(DATABASE)] {
            let mode = fs::metadata(&path).unwrap().permissions().mode();
            assert_eq!(mode & 0o077, 0, "{}", path.display());
        }
    }

    #[tokio::test]
    async fn nothing_is_written_over() {
        let (folder, place) = (furnished().await, tempfile::tempdir().unwrap());
        let file = place.path().join("a.tar");
        fs::write(&file, "mine").unwrap();
        let refused = make(folder.path(), &file).await.unwrap_err().to_string();
        assert!(refused.contains("exists and is not written over"), "{refused}");
        assert_eq!(fs::read(&file).unwrap(), b"mine");
        let refused = make(place.path(), &place.path().join("b.tar")).await.unwrap_err().to_string();
        assert!(refused.contains("is no data folder"), "{refused}");

        let good = place.path().join("good.tar");
        make(folder.path(), &good).await.unwrap();
        let refused = restore(&good, folder.path()).await.unwrap_err().to_string();
        assert!(refused.contains("never restored over"), "{refused}");
    }

    #[cfg(unix)]
    #[tokio::test]
    async fn an_empty_folder_is_filled_where_it_is() {
        use std::os::unix::fs::MetadataExt;
        let (folder, place) = (furnished().await, tempfile::tempdir().unwrap());
        let (file, to) = (place.path().join("a.tar"), place.path().join("volume"));
        make(folder.path(), &file).await.unwrap();
        fs::create_dir(&to).unwrap();
        let is = fs::metadata(&to).unwrap().ino();
        restore(&file, &to).await.unwrap();
        assert_eq!(fs::metadata(&to).unwrap().ino(), is, "a volume stays the volume that it is");
        let mut names: Vec<_> = fs::read_dir(&to)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        assert_eq!(names, ["avln.db", "signing.key", "splits"]);
        let store = DataFolder::open(&to).unwrap().store().await.unwrap();
        assert!(store.team("red").await.unwrap().is_some());
    }

    #[tokio::test]
    async fn a_damaged_backup_leaves_nothing_behind() {
        let (folder, place) = (furnished().await, tempfile::tempdir().unwrap());
        let (file, to) = (place.path().join("a.tar"), place.path().join("data"));
        make(folder.path(), &file).await.unwrap();
        let whole = fs::read(&file).unwrap();
        let at = whole.windows(9).position(|window| window == b"a mission").unwrap();
        let mut changed = whole.clone();
        changed[at] = b'A';
        for (what, bytes) in [
            ("splits/val/missions/house.jsonl is not what was written", changed.as_slice()),
            ("was cut off", &whole[..whole.len() / 2]),
            ("no backup", b"hello"),
        ] {
            fs::write(&file, bytes).unwrap();
            let refused = restore(&file, &to).await.unwrap_err().to_string();
            assert!(refused.contains("cannot be restored"), "{what}: {refused}");
            assert!(!to.exists(), "{what}");
            assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1, "{what}");
        }
    }
}
