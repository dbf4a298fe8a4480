//! Backup and restore of data folders, also while a server runs.
//!
//! A backup contains the identity of a server: database, run logs, signing key, splits, recordings and heads.
//! Reproducible data (`cache/`) and data outside the folder (data sets, scene files) are excluded.

mod archive;
mod logs;
mod prune;

pub use archive::{Kept, Manifest};
pub use prune::{PruneOptions, Pruned, prune};

use crate::{Failure, FailureKind, now_unix_ms};
use archive::Writer;
use avln_store::{Inventory, copy_database, inspect_database};
use std::{
    fs::{self, File, OpenOptions},
    io::{self, BufWriter, Read},
    path::{Path, PathBuf},
};

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
        return Err(Failure::new(FailureKind::Data, message).hinted("name the folder with --data FOLDER"));
    }
    if to.symlink_metadata().is_ok() {
        return Err(taken(to));
    }
    let folder = parent(to);
    let failed =
        |error: io::Error| Failure::new(FailureKind::Data, format!("cannot write {}: {error}", to.display()));
    let work = workplace(".avln-backup-", folder).map_err(failed)?;
    let copy = work.path().join(DATABASE);
    let made_ms = now_unix_ms();
    copy_database(&database, &copy).await?;
    let inventory = inspect_database(&copy).await?;
    let (data, to) = (data.to_owned(), to.to_owned());
    let written = tokio::task::spawn_blocking(move || {
        let manifest = write(&data, &copy, &inventory, made_ms, &to)?;
        Ok(Contents { manifest, left_out: left_out(&data), inventory })
    });
    written.await.map_err(|error| Failure::new(FailureKind::Internal, error))?
}

fn taken(path: &Path) -> Failure {
    Failure::new(FailureKind::Data, format!("{} exists and is not written over", path.display()))
        .hinted("name a new file")
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A private temporary folder next to the target.
fn workplace(prefix: &str, folder: &Path) -> io::Result<tempfile::TempDir> {
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
    let failed =
        |error: io::Error| Failure::new(FailureKind::Data, format!("cannot write {}: {error}", to.display()));
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
fn unread(path: &Path) -> impl Fn(io::Error) -> Failure + '_ {
    move |error| Failure::new(FailureKind::Data, format!("cannot back up {}: {error}", path.display()))
}

fn add_file(writer: &mut Out<'_>, name: &str, path: &Path) -> Result<(), Failure> {
    let mut add = || {
        let file = File::open(path)?;
        writer.add(name, file.metadata()?.len(), file)
    };
    add().map_err(unread(path))
}

fn add_folder(writer: &mut Out<'_>, name: &str, path: &Path) -> Result<(), Failure> {
    let mut entries: Vec<_> =
        fs::read_dir(path).and_then(|entries| entries.collect::<io::Result<_>>()).map_err(unread(path))?;
    entries.sort_by_key(fs::DirEntry::file_name);
    for entry in entries {
        let path = entry.path();
        let kind = entry.file_type().map_err(unread(&path))?;
        let file_name = entry.file_name();
        let Some(name) = file_name.to_str().map(|file_name| format!("{name}/{file_name}")) else {
            return Err(unread(&path)(io::Error::other("its name is not text")));
        };
        match (kind.is_dir(), kind.is_file()) {
            (true, _) => add_folder(writer, &name, &path)?,
            (_, true) => add_file(writer, &name, &path)?,
            _ => return Err(unread(&path)(io::Error::other("it is neither a file nor a folder"))),
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
    let failed = |error: io::Error| {
        Failure::new(FailureKind::Data, format!("cannot restore to {}: {error}", to.display()))
    };
    if is_occupied(to).map_err(failed)? {
        let message = format!("{} holds files, and a backup is never restored over them", to.display());
        return Err(Failure::new(FailureKind::Data, message).hinted(
            "name a new folder with --data FOLDER; start the server on it, and keep the old one until that is content",
        ));
    }
    // The parent of a volume is not writable, and a volume cannot be replaced.
    let place = if to.is_dir() { to } else { parent(to) };
    fs::create_dir_all(place).map_err(failed)?;
    let work = workplace(".avln-restore-", place).map_err(failed)?;
    let (backup, folder) = (from.to_owned(), work.path().to_owned());
    let unpacked = tokio::task::spawn_blocking(move || unpack(&backup, &folder)).await;
    let manifest = unpacked.map_err(|error| Failure::new(FailureKind::Internal, error))??;
    let inventory = inspect_database(&work.path().join(DATABASE)).await?;
    if inventory.schema != manifest.schema {
        let message = format!("{}: its manifest tells of another database", from.display());
        return Err(Failure::new(FailureKind::Data, message).hinted("take another backup"));
    }
    put(work, to).map_err(failed)?;
    Ok(Contents { manifest, inventory, left_out: left_out(to) })
}

/// Moves the unpacked files into place.
fn put(work: tempfile::TempDir, to: &Path) -> io::Result<()> {
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
        Failure::new(FailureKind::Data, message).hinted("take another backup; nothing was changed")
    };
    let file = File::open(from).map_err(failed)?;
    archive::go_through(io::BufReader::new(file), |path, read| unpack_file(&to.join(path), read))
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
mod tests;
