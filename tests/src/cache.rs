//! Cache of scenes and sounds for all tests of a run: most of a short episode's time is the preparation of its sounds.

use avln_arena::cache::CacheFolder;
use std::{
    env, fs,
    os::unix::{fs::symlink, process::parent_id},
    path::{Path, PathBuf},
    sync::LazyLock,
    time::UNIX_EPOCH,
};

/// Start of the folders' names.
const NAME: &str = "avln-tests-cache-";

/// Folder of this run. Another build never uses it, because its preparation may differ.
static SHARED: LazyLock<PathBuf> = LazyLock::new(|| {
    let program = env::current_exe().and_then(fs::metadata).expect("this program");
    let built = program.modified().expect("a time").duration_since(UNIX_EPOCH).expect("after 1970");
    delete_old();
    // The parent is cargo, or another runner with a process per test.
    let folder = env::temp_dir().join(format!("{NAME}{}-{}", parent_id(), built.as_nanos()));
    fs::create_dir_all(&folder).expect("a folder for temporary files");
    folder
});

/// Lets a data folder, which has no cache yet, use the shared one.
pub fn share(data: &Path) {
    let link = data.join(CacheFolder::IN_DATA);
    fs::create_dir_all(link.parent().expect("a folder")).expect("a folder");
    symlink(&*SHARED, link).expect("a link");
}

/// Deletes the folders of ended runs, where the system lists its processes.
fn delete_old() {
    if !Path::new("/proc/self").exists() {
        return;
    }
    for entry in fs::read_dir(env::temp_dir()).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let run = name.strip_prefix(NAME).and_then(|rest| rest.split('-').next());
        if run.is_some_and(|process| !Path::new("/proc").join(process).exists()) {
            let _ = fs::remove_dir_all(entry.path());
        }
    }
}
