//! Challenge files, damaged files of every kind, and a simulation of the server. Here: files of a data folder, private to their
//! owner and compared with their digests at the start, and a data folder for tests of challenge files, made once and copied for each
//! test.

mod challenge;
mod mangled;
mod simulation;

use avln_arena::{
    Arena, Failure, FailureKind,
    actions::{self, Attribution},
    challenge::{ChallengeChanges, ChallengeFile, Fault, PlanError, Planner, actor},
    data::DataFolder,
    dataset::DatasetFiles,
    setup::{NewPhase, NewSplit, admit, make_split, open_phase},
};
use avln_dataset::{Seed, SplitSecret};
use avln_store::{AuditNote, Schedule, Store};
use challenge::TEAM;
use std::{
    fs,
    path::{Path, PathBuf},
};
use tempfile::TempDir;
use tokio::sync::{OnceCell, RwLock, RwLockReadGuard};

/// Memory of this process: exclusive for tests that measure it.
static MEMORY: RwLock<()> = RwLock::const_new(());

/// Makes a split of one house with a number of missions, and with a secret of equal bytes.
async fn make_secret(data: &DataFolder, store: &Store, (name, missions): (&str, usize), byte: u8) {
    let make = NewSplit {
        name: name.to_owned(),
        houses: 1,
        scenes: vec![],
        missions,
        seed: Seed::Secret(SplitSecret::new([byte; 32])),
        rules: "lh-avln-v1".to_owned(),
    };
    make_split(data, store, make, |_| ()).await.expect("a house holds missions");
}

/// Relative path and bytes of every file in a folder.
type Files = Vec<(PathBuf, Vec<u8>)>;

/// Paths of all files in a folder and its subfolders.
fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    entries.flat_map(|path| if path.is_dir() { files(&path) } else { vec![path] }).collect()
}

/// A data folder with a team and two splits.
pub(crate) struct Hall {
    _folder: TempDir,
    pub(crate) data: DataFolder,
    pub(crate) store: Store,
    /// Excludes tests that measure memory. `None` for the folder to copy, which is made inside a test with a guard: for a second
    /// guard it could wait for a writer that waits for the first.
    _memory: Option<RwLockReadGuard<'static, ()>>,
}

impl Hall {
    /// Returns a data folder with a team and the splits `val` and `hidden` with three missions each.
    pub(crate) async fn new() -> Self {
        // Houses and missions take most of a test's time: all tests copy the files of one folder.
        static FILES: OnceCell<Files> = OnceCell::const_new();
        let memory = MEMORY.read().await;
        let files = FILES.get_or_init(async || Self::make_files().await).await;
        let folder = TempDir::new().expect("a folder");
        for (path, bytes) in files {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            fs::write(path, bytes).expect("a copy");
        }
        Self::open(folder, Some(memory)).await
    }

    async fn open(folder: TempDir, memory: Option<RwLockReadGuard<'static, ()>>) -> Self {
        let data = DataFolder::open(folder.path()).expect("writable");
        let store = data.store().await.expect("a database");
        Self { _folder: folder, data, store, _memory: memory }
    }

    async fn make_files() -> Files {
        let hall = Self::open(TempDir::new().expect("a folder"), None).await;
        admit(&hall.store, TEAM, None).await.expect("a team");
        hall.make("val", 5, 3).await;
        hall.make("hidden", 6, 3).await;
        hall.store.close().await;
        let root = hall.data.root();
        let file = |path: PathBuf| {
            let bytes = fs::read(&path).expect("a file");
            (path.strip_prefix(root).expect("a file in the folder").to_owned(), bytes)
        };
        files(root).into_iter().map(file).collect()
    }

    /// Makes a split with a secret of equal bytes.
    pub(crate) async fn make(&self, name: &str, byte: u8, missions: usize) {
        make_secret(&self.data, &self.store, (name, missions), byte).await;
    }

    pub(crate) async fn reschedule(&self, id: &str, change: impl FnOnce(&mut Schedule)) {
        actions::reschedule(&self.store, id, Attribution { actor: &actor(), reason: "a test" }, change)
            .await
            .expect("rescheduled");
    }

    pub(crate) fn planner(&self) -> Planner<'_> {
        Planner { data: &self.data, store: &self.store, base: Path::new(""), reason: "a test" }
    }

    pub(crate) async fn plan(&self, text: &str) -> Result<ChallengeChanges, Failure> {
        let explain = |faults: Vec<Fault>| Fault::explain_all(&faults, Path::new("challenge.toml"), text);
        let file = ChallengeFile::parse(text).map_err(explain)?;
        self.planner().plan(&file).await.map_err(|unplanned| match unplanned {
            PlanError::File(faults) => explain(faults),
            PlanError::Other(failure) => failure,
        })
    }

    pub(crate) async fn refused(&self, text: &str) -> String {
        self.plan(text).await.expect_err(text).to_string()
    }

    pub(crate) async fn apply(&self, text: &str) -> Vec<AuditNote> {
        let plan = self.plan(text).await.expect("a good file");
        let notes = plan.notes.clone();
        self.planner().apply(plan).await.expect("applied");
        notes
    }

    pub(crate) async fn audit_lines(&self) -> usize {
        self.store.audit().await.expect("a list").len()
    }

    pub(crate) async fn shown(&self) -> String {
        ChallengeFile::of(&self.store.phases().await.expect("phases")).text().expect("TOML")
    }
}

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
        make_secret(&data, &store, (SPLIT, 1), 5).await;
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
    let _memory = MEMORY.read().await;
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
    let _memory = MEMORY.read().await;
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
