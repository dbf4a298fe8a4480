//! A data folder for tests of challenge files, made once and copied for each test.

use crate::challenge::TEAM;
use avln_arena::{
    Failure,
    actions::{self, Attribution},
    challenge::{ChallengeChanges, ChallengeFile, Fault, PlanError, Planner, actor},
    data::DataFolder,
    setup::{NewSplit, admit, make_split},
};
use avln_dataset::{Seed, SplitSecret};
use avln_store::{AuditNote, Schedule, Store};
use std::{
    fs,
    path::{Path, PathBuf},
};
use tempfile::TempDir;
use tokio::sync::OnceCell;

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
}

impl Hall {
    /// Returns a data folder with a team and the splits `val` and `hidden` with three missions each.
    pub(crate) async fn new() -> Self {
        // Houses and missions take most of a test's time: all tests copy the files of one folder.
        static FILES: OnceCell<Files> = OnceCell::const_new();
        let files = FILES.get_or_init(async || Self::make_files().await).await;
        let folder = TempDir::new().expect("a folder");
        for (path, bytes) in files {
            let path = folder.path().join(path);
            fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
            fs::write(path, bytes).expect("a copy");
        }
        Self::open(folder).await
    }

    async fn open(folder: TempDir) -> Self {
        let data = DataFolder::open(folder.path()).expect("writable");
        let store = data.store().await.expect("a database");
        Self { _folder: folder, data, store }
    }

    async fn make_files() -> Files {
        let hall = Self::open(TempDir::new().expect("a folder")).await;
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
        let make = NewSplit {
            name: name.to_owned(),
            houses: 1,
            scenes: vec![],
            missions,
            seed: Seed::Secret(SplitSecret::new([byte; 32])),
            rules: "lh-avln-v1".to_owned(),
        };
        make_split(&self.data, &self.store, make, |_| ()).await.expect("a house holds missions");
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
