//! Building a data set by recipe: resumable, on all processors, one scene's missions in memory for each thread.

use crate::parallel;
use avln_arena::{Failure, FailureKind, dataset::{DatasetFiles, self}};
use avln_dataset::{
    BuiltScene, Job, Manifest, Recipe, SceneLine, Statistics, build_scene,
    format::{DATASET_VERSION, digest_of},
};
use avln_world::Cache;
use serde::{Deserialize, Serialize};
use std::{path::PathBuf, sync::Arc};

/// Facts of a scene that remain after its files are written.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct FinishedScene {
    line: SceneLine,
    statistics: Statistics,
}

/// A data set that is being built.
pub struct Builder {
    files: DatasetFiles,
    recipe: Recipe,
}

/// Progress of a build.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuildProgress {
    /// Missions in all.
    pub missions: usize,
    /// Missions of scenes that are done.
    pub done: usize,
}

impl Builder {
    /// Takes up the build of `recipe` in the folder of `files`, or begins it.
    ///
    /// # Errors
    /// When something else lies there, or it cannot be written.
    pub fn open(files: DatasetFiles, recipe: Recipe) -> Result<Self, Failure> {
        let builder = Self { files, recipe };
        let told =
            if builder.files.is_complete() { builder.files.manifest()?.recipe } else { builder.begun()? };
        match told {
            Some(told) if told == builder.recipe => {}
            Some(_) => return Err(builder.other("another recipe")),
            None if builder.files.is_complete() => return Err(builder.other("no recipe")),
            None => dataset::write_whole(&builder.building().join("recipe.json"), &json(&builder.recipe)?)?,
        }
        Ok(builder)
    }

    /// Makes all scenes that are not done and finishes the data set; `watch` hears how far it is. What pictures are made from
    /// is kept in `cache`.
    ///
    /// # Errors
    /// When a scene cannot be made or the folder cannot be written. What is done stays, and is not done again.
    pub fn run(
        &self,
        threads: Option<usize>,
        cache: Option<&Arc<dyn Cache>>,
        mut watch: impl FnMut(BuildProgress),
    ) -> Result<Vec<(String, Statistics)>, Failure> {
        if self.files.is_complete() {
            return self.recount();
        }
        let missions = |job: &Job| self.recipe.splits[job.split].missions_per_scene;
        let (done, left): (Vec<Job>, Vec<Job>) =
            self.recipe.jobs().partition(|&job| self.done(job).is_some());
        let mut progress = BuildProgress {
            missions: self.recipe.jobs().map(|job| missions(&job)).sum(),
            done: done.iter().map(missions).sum(),
        };
        watch(progress);
        let make = |job: &Job| -> Result<(), Failure> {
            let built = build_scene(&self.recipe, *job, cache)?;
            self.keep(*job, built)
        };
        parallel::share(&left, parallel::threads(threads), make, |index, ()| {
            progress.done += missions(&left[index]);
            watch(progress);
        })?;
        self.finish()
    }

    /// Writes the files of a scene; the note that it is done comes last.
    fn keep(&self, job: Job, built: BuiltScene) -> Result<(), Failure> {
        let (split, scene) = (&self.recipe.splits[job.split].name, &built.line.name);
        dataset::write_whole(&self.files.missions_path(split, scene), &built.missions)?;
        dataset::write_whole(&self.files.sealed_path(split, scene), &built.sealed)?;
        let done = FinishedScene { line: built.line, statistics: built.statistics };
        dataset::write_whole(&self.note_path(job), &json(&done)?)
    }

    /// Facts of a finished scene.
    fn done(&self, job: Job) -> Option<FinishedScene> {
        let split = &self.recipe.splits[job.split].name;
        let done: FinishedScene = serde_json::from_slice(&dataset::read(&self.note_path(job)).ok()?).ok()?;
        let same =
            |path: PathBuf, digest: &str| dataset::read(&path).is_ok_and(|bytes| digest_of(&bytes) == digest);
        let whole = same(self.files.missions_path(split, &done.line.name), &done.line.public)
            && same(self.files.sealed_path(split, &done.line.name), &done.line.sealed);
        whole.then_some(done)
    }

    /// Writes lists, statistics and, last of all, the manifest.
    fn finish(&self) -> Result<Vec<(String, Statistics)>, Failure> {
        let (mut lines, mut numbers) = (Vec::new(), Vec::new());
        for (split, recipe) in self.recipe.splits.iter().enumerate() {
            let (mut scenes, mut sum) = (Vec::new(), Statistics::default());
            for scene in 0..recipe.scene_count() {
                let job = Job { split, scene };
                let missing = || {
                    let path = self.note_path(job);
                    Failure::new(
                        FailureKind::Data,
                        format!("{} has gone while the data set was built", path.display()),
                    )
                };
                let done = self.done(job).ok_or_else(missing)?;
                sum.add(&done.statistics);
                scenes.push(done.line);
            }
            lines.push(self.files.write_scenes(&recipe.name, &scenes)?);
            numbers.push((recipe.name.clone(), sum));
        }
        self.files.write_statistics(&self.recipe.name, &numbers)?;
        self.files.write_manifest(&Manifest {
            format: Manifest::FORMAT.to_owned(),
            version: DATASET_VERSION,
            name: self.recipe.name.clone(),
            rules: self.recipe.rules.clone(),
            recipe: Some(self.recipe.clone()),
            splits: lines,
        })?;
        let building = self.building();
        std::fs::remove_dir_all(&building).map_err(|error| Failure::file("remove", &building, error))?;
        Ok(numbers)
    }

    /// The numbers of a data set that is complete.
    fn recount(&self) -> Result<Vec<(String, Statistics)>, Failure> {
        super::check::count(&self.files)
    }

    fn building(&self) -> PathBuf {
        self.files.root().join("building")
    }

    fn note_path(&self, job: Job) -> PathBuf {
        self.building().join(format!("{}.json", self.recipe.scene_name(job)))
    }

    /// The recipe of a build that was begun here.
    fn begun(&self) -> Result<Option<Recipe>, Failure> {
        let path = self.building().join("recipe.json");
        if !path.exists() {
            return Ok(None);
        }
        let recipe = serde_json::from_slice(&dataset::read(&path)?);
        recipe.map(Some).map_err(|error| {
            Failure::new(FailureKind::Data, format!("{} is no recipe: {error}", path.display()))
                .hinted("remove the folder and build again")
        })
    }

    fn other(&self, what: &str) -> Failure {
        let message = format!("{} holds a data set of {what}", self.files.root().display());
        Failure::new(FailureKind::Data, message)
            .hinted("choose another folder with --out, or remove that one")
    }
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, Failure> {
    serde_json::to_vec(value).map_err(|error| Failure::new(FailureKind::Internal, error))
}
