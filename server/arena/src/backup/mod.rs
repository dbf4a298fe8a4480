//! Backup and restore of data folders, also while a server runs.
//!
//! A backup contains database, run logs, signing key, number of server starts, splits, recordings and heads. It excludes the
//! reproducible `cache/` and data outside the folder: data sets and scene files.

use crate::{
    Failure,
    data::{DataFolder, OWNER_HINT},
    now_unix_ms, private_file, sync_folder,
};
use archive::Writer;
pub use archive::{ArchivedFile, Manifest};
use avln_store::{Inventory, copy_database, inspect_database};
pub use logs::{PruneOptions, Pruned, prune};
use std::{
    fs::{self, File},
    io::{self, BufWriter, Read},
    path::{Path, PathBuf},
};

mod archive;
mod logs;

const DATABASE: &str = "avln.db";
/// Other files in a backup.
const FILES: [&str; 2] = ["signing.key", DataFolder::EPOCH];
/// Folders in a backup.
const FOLDERS: [&str; 3] = ["splits", "sounds", "heads"];
/// Other known names in a data folder; not copied as they are.
const OTHERS: [&str; 6] = ["avln.db-wal", "avln.db-shm", "runs", "cache", ".writable", DataFolder::LOCK];

/// Backup contents.
#[derive(Debug)]
pub struct Contents {
    /// File list.
    pub manifest: Manifest,
    /// Database statistics.
    pub inventory: Inventory,
    /// Paths outside the backup: data sets and unknown files.
    pub left_out: Vec<PathBuf>,
}

/// Writes a snapshot of the data folder `data` to the new file `to` and verifies it.
pub async fn make(data: &Path, to: &Path) -> Result<Contents, Failure> {
    let database = data.join(DATABASE);
    if !database.is_file() {
        let message = format!("{} is not a data folder: {DATABASE} is missing", data.display());
        return Err(Failure::data(message).hinted("name the folder with --data FOLDER"));
    }
    if to.symlink_metadata().is_ok() {
        return Err(taken(to));
    }
    let folder = parent(to);
    let failed = |error: io::Error| {
        Failure::file("write", to, error)
            .hinted(format!("choose another folder, or add write permission; {OWNER_HINT}"))
    };
    let left_out = left_out(data);
    let work = work_folder(".avln-backup-", folder).map_err(failed)?;
    let copy = work.path().join(DATABASE);
    let made_ms = now_unix_ms();
    copy_database(&database, &copy).await?;
    let inventory = inspect_database(&copy).await?;
    // Logs are read after the database copy: then they contain every episode in it.
    let (data, to) = (data.to_owned(), to.to_owned());
    let written = tokio::task::spawn_blocking(move || {
        let manifest = write(&data, &copy, &inventory, made_ms, &to)?;
        Ok(Contents { manifest, left_out, inventory })
    });
    written.await.map_err(Failure::internal)?
}

fn taken(path: &Path) -> Failure {
    Failure::data(format!("{} already exists", path.display())).hinted("choose a new file")
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn work_folder(prefix: &str, folder: &Path) -> io::Result<tempfile::TempDir> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix);
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
    builder.tempdir_in(folder)
}

/// Writes the archive to a temporary file, verifies and renames it.
fn write(
    data: &Path,
    copy: &Path,
    inventory: &Inventory,
    made_ms: i64,
    to: &Path,
) -> Result<Manifest, Failure> {
    let failed = |error: io::Error| Failure::file("write", to, error);
    let file = tempfile::Builder::new().prefix(".avln-backup-").tempfile_in(parent(to)).map_err(failed)?;
    let mut writer = Writer::new(BufWriter::new(file.as_file()), Manifest::new(inventory.schema, made_ms));
    add_file(&mut writer, DATABASE, copy)?;
    logs::add(&mut writer, &data.join("runs"), &inventory.runs)?;
    // After the logs: none of them then contains a later server start than the number in the backup.
    for name in FILES.into_iter().filter(|name| data.join(name).is_file()) {
        add_file(&mut writer, name, &data.join(name))?;
    }
    for name in FOLDERS.into_iter().filter(|name| data.join(name).is_dir()) {
        add_folder(&mut writer, name, &data.join(name))?;
    }
    let (out, manifest) = writer.finish().map_err(failed)?;
    out.into_inner().map_err(|error| failed(error.into_error()))?.sync_all().map_err(failed)?;
    let read = file.reopen().and_then(|file| archive::check(&file)).map_err(failed)?;
    if read != manifest {
        return Err(failed(io::Error::other("the written archive reads back differently")));
    }
    file.persist_noclobber(to).map_err(|error| match error.error.kind() {
        io::ErrorKind::AlreadyExists => taken(to),
        _ => failed(error.error),
    })?;
    sync_folder(parent(to)).map_err(failed)?;
    Ok(manifest)
}

type Out<'a> = Writer<BufWriter<&'a File>>;

fn cannot_back_up(path: &Path) -> impl Fn(io::Error) -> Failure + '_ {
    move |error| Failure::file("back up", path, error)
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
            return Err(cannot_back_up(&path)(io::Error::other("its name is not valid UTF-8")));
        };
        match (kind.is_dir(), kind.is_file()) {
            (true, _) => add_folder(writer, &name, &path)?,
            (_, true) => add_file(writer, &name, &path)?,
            _ => return Err(cannot_back_up(&path)(io::Error::other("it is neither a file nor a folder"))),
        }
    }
    Ok(())
}

/// Creates the data folder `to` from a backup, completely or not at all. An existing empty folder, such as a
/// container volume, receives the database last.
pub async fn restore(from: &Path, to: &Path) -> Result<Contents, Failure> {
    let failed = |error: io::Error| {
        Failure::file("restore to", to, error).hinted(format!(
            "choose another folder with --data FOLDER, or add write permission; {OWNER_HINT}"
        ))
    };
    if is_occupied(to).map_err(failed)? {
        let message =
            format!("{} is not empty; a backup is only restored into a new or empty folder", to.display());
        return Err(Failure::data(message).hinted(
            "choose a new folder with --data FOLDER, and keep the old one until the server runs on the new one",
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
        let message = format!("{}: the manifest belongs to another database", from.display());
        return Err(Failure::data(message).hinted("use another backup"));
    }
    move_into_place(work, to).map_err(failed)?;
    Ok(Contents { manifest, inventory, left_out: left_out(to) })
}

fn move_into_place(work: tempfile::TempDir, to: &Path) -> io::Result<()> {
    if !to.is_dir() {
        fs::rename(work.path(), to)?;
        // Renamed, so there is no temporary folder to delete.
        let _ = work.keep();
        return sync_folder(parent(to));
    }
    let names = fs::read_dir(work.path())?.map(|entry| Ok(entry?.file_name()));
    let mut names = names.collect::<io::Result<Vec<_>>>()?;
    // The database last: its presence marks a complete data folder.
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
        Failure::file("restore backup", from, error).hinted("use another backup; nothing was changed")
    };
    let file = File::open(from).map_err(failed)?;
    archive::read_archive(io::BufReader::new(file), |path, read| unpack_file(&to.join(path), read))
        .map_err(failed)
}

/// Writes a private file: backups contain ground truth, token hashes and the signing key.
fn unpack_file(path: &Path, from: &mut dyn Read) -> io::Result<()> {
    fs::create_dir_all(parent(path))?;
    let mut file = private_file().write(true).create_new(true).open(path)?;
    io::copy(from, &mut file)?;
    file.sync_all()
}

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
    use tempfile::TempDir;

    /// Creates a data folder with a team, a key, a split and a linked split.
    async fn example_folder() -> TempDir {
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
        fs::write(folder.path().join("cache/scenes/big"), "can be rebuilt").unwrap();
        folder
    }

    #[tokio::test]
    async fn restored_folder_is_equal_except_the_cache() {
        let (folder, place) = (example_folder().await, tempfile::tempdir().unwrap());
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

    #[tokio::test]
    async fn backup_into_data_folder_lists_no_temporary_file() {
        let folder = example_folder().await;
        let lock = DataFolder::open(folder.path()).unwrap().lock().unwrap();
        let made = make(folder.path(), &folder.path().join("before.tar")).await.unwrap();
        assert_eq!(made.left_out, [PathBuf::from("/far/away")]);
        drop(lock);
    }

    #[cfg(unix)]
    #[tokio::test]
    async fn backups_and_restored_files_are_private() {
        use std::os::unix::fs::PermissionsExt;
        let (folder, place) = (example_folder().await, tempfile::tempdir().unwrap());
        let (file, to) = (place.path().join("a.tar"), place.path().join("data"));
        make(folder.path(), &file).await.unwrap();
        restore(&file, &to).await.unwrap();
        for path in [file, to.clone(), to.join("signing.key"), to.join(DATABASE)] {
            let mode = fs::metadata(&path).unwrap().permissions().mode();
            assert_eq!(mode & 0o077, 0, "{}", path.display());
        }
    }

    #[tokio::test]
    async fn existing_files_are_never_overwritten() {
        let (folder, place) = (example_folder().await, tempfile::tempdir().unwrap());
        let file = place.path().join("a.tar");
        fs::write(&file, "mine").unwrap();
        let refused = make(folder.path(), &file).await.unwrap_err().to_string();
        assert!(refused.contains("already exists"), "{refused}");
        assert_eq!(fs::read(&file).unwrap(), b"mine");
        let refused = make(place.path(), &place.path().join("b.tar")).await.unwrap_err().to_string();
        assert!(refused.contains("is not a data folder"), "{refused}");

        let good = place.path().join("good.tar");
        make(folder.path(), &good).await.unwrap();
        let refused = restore(&good, folder.path()).await.unwrap_err().to_string();
        assert!(refused.contains("new or empty folder"), "{refused}");
    }

    #[cfg(unix)]
    #[tokio::test]
    async fn empty_folders_are_filled_in_place() {
        use std::os::unix::fs::MetadataExt;
        let (folder, place) = (example_folder().await, tempfile::tempdir().unwrap());
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
    async fn damaged_backups_leave_no_files() {
        let (folder, place) = (example_folder().await, tempfile::tempdir().unwrap());
        let (file, to) = (place.path().join("a.tar"), place.path().join("data"));
        make(folder.path(), &file).await.unwrap();
        let whole = fs::read(&file).unwrap();
        let at = whole.windows(9).position(|window| window == b"a mission").unwrap();
        let mut changed = whole.clone();
        changed[at] = b'A';
        for (what, bytes) in [
            ("splits/val/missions/house.jsonl differs from the manifest", changed.as_slice()),
            ("is truncated", &whole[..whole.len() / 2]),
            ("not a backup", b"hello"),
        ] {
            fs::write(&file, bytes).unwrap();
            let refused = restore(&file, &to).await.unwrap_err().to_string();
            assert!(refused.contains("cannot restore backup"), "{what}: {refused}");
            assert!(!to.exists(), "{what}");
            assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1, "{what}");
        }
    }
}
