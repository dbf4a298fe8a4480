//! Our splits as others read them.

use crate::dataset::openness::Openness;
use avln_arena::{Failure, FailureKind, dataset::{SplitFolder, write_whole}};
use avln_dataset::SceneLine;
use avln_episode::Rules;
use avln_interchange::{ExportedFile, InterchangeError, SceneMissions, Tables, authors_index, authors_scene};
use std::path::Path;

/// Content and format of an export.
#[derive(Clone, Copy)]
pub struct Export<'a> {
    /// The split.
    pub split: &'a SplitFolder,
    /// Facts of the split that may be published.
    pub openness: Openness,
    /// As the authors of LH-AVLN publish theirs: an index, and a file of JSON for each scene, packed by gzip.
    pub authors: bool,
    /// As tables in Parquet.
    pub parquet: bool,
}

impl Export<'_> {
    /// Writes below `out`, scene by scene, and tells `watch` about each; gives back how many missions were written.
    ///
    /// # Errors
    /// When the split cannot be read or `out` cannot be written.
    pub fn run(&self, out: &Path, watch: impl Fn()) -> Result<usize, Failure> {
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
            watch();
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
