//! Files of a data folder: private to their owner, and compared with their digests at the start.

use avln_arena::{
    Arena, FailureKind,
    data::DataFolder,
    dataset::DatasetFiles,
    setup::{NewPhase, NewSplit, make_split, open_phase},
};
use avln_dataset::{Seed, SplitSecret};
use avln_store::Store;
use std::{fs, path::PathBuf};
use tempfile::TempDir;

const SPLIT: &str = "val";

/// A data folder with a phase on a secret split of one house.
struct Folder {
    _place: TempDir,
    data: DataFolder,
    store: Store,
}

impl Folder {
    /// Fills a folder that exists with the usual mode.
    async fn new() -> Self {
        let place = TempDir::new().expect("a folder");
        let root = place.path().join("data");
        fs::create_dir_all(root.join("splits")).expect("a folder");
        #[cfg(unix)]
        for folder in [root.clone(), root.join("splits")] {
            let mode: fs::Permissions = std::os::unix::fs::PermissionsExt::from_mode(0o755);
            fs::set_permissions(folder, mode).expect("our own");
        }
        let data = DataFolder::open(&root).expect("writable");
        let store = data.store().await.expect("a database");
        let make = NewSplit {
            name: SPLIT.to_owned(),
            houses: 1,
            scenes: vec![],
            missions: 1,
            seed: Seed::Secret(SplitSecret::new([5; 32])),
            rules: "lh-avln-v1".to_owned(),
        };
        make_split(&data, &store, make, |_| ()).await.expect("a house holds missions");
        open_phase(&data, &store, &NewPhase::public("practice", SPLIT)).await.expect("a phase");
        Self { _place: place, data, store }
    }

    /// Missions and ground truth of the house.
    fn split_files(&self) -> [PathBuf; 2] {
        let split = self.data.missions(SPLIT).expect("the split");
        let scene = &split.scenes().first().expect("a house").name;
        let files = DatasetFiles::at(&self.data.own_split(SPLIT).expect("its folder"));
        [files.missions_path(SPLIT, scene), files.sealed_path(SPLIT, scene)]
    }
}

#[cfg(unix)]
#[tokio::test]
async fn folders_and_files_are_private() {
    use avln_arena::runlog::Entry;
    use std::{collections::BTreeMap, os::unix::fs::PermissionsExt};
    let _memory = crate::MEMORY.read().await;
    let folder = Folder::new().await;
    let first = Entry::Run {
        format: Entry::FORMAT,
        run: "run_1".to_owned(),
        phase: "practice".to_owned(),
        order: avln_episode::Order::Ordered,
        digests: BTreeMap::new(),
        at_ms: 1,
    };
    let logs = folder.data.run_logs();
    logs.open("run_1", || first).expect("a log");
    let mode = |path: PathBuf| fs::metadata(&path).expect("it exists").permissions().mode() & 0o777;
    let root = folder.data.root();
    assert_eq!([root.to_owned(), root.join("splits")].map(mode), [0o700; 2]);
    let database = ["avln.db", "avln.db-wal", "avln.db-shm"].map(|name| root.join(name));
    for path in database.into_iter().chain(folder.split_files()).chain([logs.path("run_1")]) {
        assert_eq!(mode(path.clone()), 0o600, "{}", path.display());
    }
}

#[tokio::test]
async fn damaged_split_files_prevent_the_start() {
    let _memory = crate::MEMORY.read().await;
    let folder = Folder::new().await;
    let open = async || Arena::open(&folder.data, folder.store.clone(), 64).await;
    for path in folder.split_files() {
        let whole = fs::read(&path).expect("a file");
        let mut changed = whole.clone();
        changed[whole.len() / 2] ^= 1;
        fs::write(&path, changed).expect("writable");
        let refused = open().await.err().expect("damaged");
        assert_eq!(refused.kind(), FailureKind::Scene);
        let text = refused.to_string();
        assert!(text.contains(&path.display().to_string()) && text.contains("from a backup"), "{text}");
        fs::write(&path, whole).expect("writable");
    }
    assert!(open().await.is_ok(), "the files are whole");
}
