//! Split export in other formats, and the facts that may be published.

use avln_arena::data::DataFolder;
use avln_arena::dataset::{SplitFolder, write_whole};
use avln_arena::{Failure, FailureKind};
use avln_dataset::{SceneLine, SceneSource};
use avln_episode::Rules;
use avln_houses::Pool;
use avln_interchange::{ExportedFile, InterchangeError, SceneMissions, Tables, authors_index, authors_scene};
use avln_store::{Phase, Visibility};
use std::path::Path;

/// Publication extent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Openness {
    /// Missions and ground truth: a training split.
    Training,
    /// Facts that agents receive anyway: a public evaluation split.
    Public,
}

impl Openness {
    /// Returns a split's openness, given all phases that play it. `is_training` is the organiser's statement about imported scenes.
    ///
    /// # Errors
    /// If the split is hidden: sealed, furnished from the test pool, or played by a phase with hidden targets.
    pub fn of(split: &SplitFolder, phases: &[Phase], is_training: bool) -> Result<Self, Failure> {
        if let Some(reason) = hidden(split, phases) {
            let message = format!("split '{}' is hidden: {reason}", split.name());
            return Err(Failure::new(FailureKind::Scene, message).hinted("choose a training or public split"));
        }
        let is_for_training = |scene: &SceneLine| scene.source.is_for_training(is_training);
        Ok(if split.scenes().iter().all(is_for_training) { Self::Training } else { Self::Public })
    }

    /// Rejects all but training splits.
    ///
    /// # Errors
    /// If the split is not for training.
    pub fn check_training(self, split: &SplitFolder) -> Result<(), Failure> {
        if self == Self::Training {
            return Ok(());
        }
        let message = format!("split '{}' is not for training", split.name());
        Err(Failure::new(FailureKind::Scene, message).hinted(
            "choose a split with houses of the training pool; for imported scenes, confirm their purpose with --training",
        ))
    }
}

/// Returns why a split is hidden; `None` for public splits.
fn hidden(split: &SplitFolder, phases: &[Phase]) -> Option<String> {
    if split.is_sealed() {
        return Some("its files are sealed".to_owned());
    }
    let is_for_tests =
        |scene: &SceneLine| matches!(scene.source, SceneSource::Procedural { pool: Pool::Test, .. });
    if split.scenes().iter().any(is_for_tests) {
        return Some("its houses contain furniture of the test pool".to_owned());
    }
    let phase = phases.iter().find(|phase| phase.replays != Visibility::Public)?;
    Some(format!("phase '{}' plays it with hidden targets", phase.id))
}

/// Returns the data folder's phases that play a split.
///
/// # Errors
/// If the database cannot be read.
pub async fn phases_of(data: &DataFolder, split: &SplitFolder) -> Result<Vec<Phase>, Failure> {
    if !data.root().join("avln.db").is_file() {
        return Ok(Vec::new());
    }
    let store = data.store().await?;
    let mut phases = Vec::new();
    for phase in store.phases().await? {
        // Digests are compared, since a copy of the split may have another name.
        if store.split_digest(&phase.split).await?.as_deref() == Some(split.digest()) {
            phases.push(phase);
        }
    }
    store.close().await;
    Ok(phases)
}

/// An export's content and formats.
#[derive(Clone, Copy)]
pub struct Export<'a> {
    /// The split.
    pub split: &'a SplitFolder,
    /// Exported facts.
    pub openness: Openness,
    /// `true` for the LH-AVLN authors' format: an index, and a gzipped JSON file per scene.
    pub authors: bool,
    /// `true` for Parquet tables.
    pub parquet: bool,
}

impl Export<'_> {
    /// Writes the files and returns the mission count; calls `on_scene` after every scene.
    ///
    /// # Errors
    /// If the split cannot be read or `out` cannot be written.
    pub fn run(&self, out: &Path, on_scene: impl Fn()) -> Result<usize, Failure> {
        let name = self.split.name();
        let rules =
            Rules::named(self.split.rules()).map_err(|error| Failure::new(FailureKind::Scene, error))?;
        let mut tables = Tables::new(name);
        let mut missions = 0;
        for scene in self.split.scenes() {
            let scene_missions = self.missions(scene)?;
            missions += scene_missions.count();
            if self.authors {
                write(out, authors_scene(name, &scene.name, &scene_missions, &rules))?;
            }
            if self.parquet {
                tables.add(&scene.name, &scene_missions).map_err(unwritable)?;
            }
            on_scene();
        }
        if self.authors {
            write(out, authors_index(name))?;
        }
        for file in tables.finish().map_err(unwritable)? {
            write(out, Ok(file))?;
        }
        Ok(missions)
    }

    fn missions(&self, scene: &SceneLine) -> Result<SceneMissions, Failure> {
        match self.openness {
            Openness::Training => self.split.episodes(scene).map(SceneMissions::Whole),
            Openness::Public => self.split.public(scene).map(SceneMissions::Public),
        }
    }
}

fn write(out: &Path, file: Result<ExportedFile, InterchangeError>) -> Result<(), Failure> {
    let file = file.map_err(unwritable)?;
    write_whole(&out.join(&file.path), &file.bytes)
}

fn unwritable(error: InterchangeError) -> Failure {
    Failure::new(FailureKind::Data, error)
}
