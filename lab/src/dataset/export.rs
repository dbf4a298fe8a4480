//! Our splits as others read them.

use crate::dataset::openness::Openness;
use avln_arena::dataset::{SplitFolder, files::write_whole};
use avln_arena::{Failure, FailureKind};
use avln_dataset::{
    SceneLine,
    formats::{ExportedFile, FormatsError, Tables, Told, authors_index, authors_scene},
};
use avln_episode::Rules;
use std::path::Path;

/// What to write of a split, and how.
#[derive(Clone, Copy)]
pub struct Export<'a> {
    /// The split.
    pub split: &'a SplitFolder,
    /// How much may be told of it.
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
            let told = self.told(scene)?;
            missions += told.missions();
            if self.authors {
                write(out, authors_scene(name, &scene.name, &told, &rules))?;
            }
            if self.parquet {
                tables.add(&scene.name, &told).map_err(unwritable)?;
            }
            watch();
        }
        if self.authors {
            write(out, authors_index(name))?;
        }
        tables.finish().into_iter().try_for_each(|file| write(out, Ok(file)))?;
        Ok(missions)
    }

    fn told(&self, scene: &SceneLine) -> Result<Told, Failure> {
        match self.openness {
            Openness::Training => self.split.episodes(scene).map(Told::Whole),
            Openness::Public => self.split.public(scene).map(Told::Public),
        }
    }
}

fn write(out: &Path, file: Result<ExportedFile, FormatsError>) -> Result<(), Failure> {
    let file = file.map_err(unwritable)?;
    write_whole(&out.join(&file.path), &file.bytes)
}

fn unwritable(error: FormatsError) -> Failure {
    Failure::new(FailureKind::Data, error)
}
