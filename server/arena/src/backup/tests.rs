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
        assert_eq!(fs::read(to.join(name)).unwrap(), fs::read(folder.path().join(name)).unwrap(), "{name}");
    }
    assert!(!to.join("cache").exists());
    let store = DataFolder::open(&to).unwrap().store().await.unwrap();
    assert!(store.team("red").await.unwrap().is_some());
    let names: Vec<_> = fs::read_dir(place.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
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
    let mut names: Vec<_> =
        fs::read_dir(&to).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
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
