//! Resumable, parallel data set construction from recipes.

use super::{
    check,
    verifier::{self, BoxedVerifier},
};
use crate::{internal, parallel};
use avln_arena::dataset::{self, DatasetFiles};
use avln_arena::{Failure, FailureKind, ids};
use avln_dataset::format::digest_of;
use avln_dataset::{BuiltScene, Job, Recipe, SceneLine, SecretFile, Statistics, build_scene_with};
use avln_world::Cache;
use serde::{Deserialize, Serialize};
use std::{path::PathBuf, sync::Arc};

/// A finished scene's note in the folder `building`.
#[derive(Clone, Debug, Serialize, Deserialize)]
struct FinishedScene {
    line: SceneLine,
    statistics: Statistics,
}

/// A data set under construction.
pub struct Builder {
    files: DatasetFiles,
    recipe: Recipe,
    verifier: BoxedVerifier,
}

/// Build progress.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BuildProgress {
    /// Total missions.
    pub missions: usize,
    /// Missions in finished scenes.
    pub done: usize,
}

impl Builder {
    /// Begins or resumes a build with the recipe's verifier.
    ///
    /// # Errors
    /// If the verifier is not a part of this program, or the folder contains another data set or cannot be written.
    pub fn open(files: DatasetFiles, recipe: Recipe) -> Result<Self, Failure> {
        let verifier = verifier::recorded(recipe.verifier.as_ref(), None)?;
        Self::open_with(files, recipe, verifier)
    }

    /// Begins or resumes a build with `verifier`, which replaces the recipe's.
    ///
    /// # Errors
    /// If the folder contains another data set or cannot be written.
    pub fn open_with(files: DatasetFiles, recipe: Recipe, verifier: BoxedVerifier) -> Result<Self, Failure> {
        let recipe = Recipe { verifier: verifier.id(), ..recipe };
        let mut builder = Self { files, recipe, verifier };
        let is_complete = builder.files.is_complete();
        let known = if is_complete { builder.files.manifest()?.recipe } else { builder.begun()? };
        match known {
            Some(known) if known == builder.recipe => {}
            Some(_) => return Err(builder.conflict("another recipe or another verifier")),
            None if is_complete => return Err(builder.conflict("no recipe")),
            None => dataset::write_whole(&builder.building().join("recipe.json"), &json(&builder.recipe)?)?,
        }
        if !is_complete {
            builder.add_secrets()?;
        }
        Ok(builder)
    }

    /// Reads the secrets of an interrupted build, and draws missing ones.
    fn add_secrets(&mut self) -> Result<(), Failure> {
        for index in 0..self.recipe.splits.len() {
            let split = &mut self.recipe.splits[index];
            if self.recipe.seed.is_some() || split.secret.is_some() {
                continue;
            }
            let known = self.files.secret(&split.name)?.map(|known| known.secret);
            split.secret = Some(known.map_or_else(ids::random_secret, Ok)?);
        }
        Ok(())
    }

    /// Builds the missing scenes and completes the data set; calls `on_progress` before the first and after every scene.
    ///
    /// # Errors
    /// If a scene cannot be built or the folder cannot be written. Finished scenes remain.
    pub fn run(
        &self,
        threads: Option<usize>,
        cache: Option<&Arc<dyn Cache>>,
        mut on_progress: impl FnMut(BuildProgress),
    ) -> Result<Vec<(String, Statistics)>, Failure> {
        if self.files.is_complete() {
            return check::count(&self.files);
        }
        let missions = |job: &Job| self.recipe.splits[job.split].missions_per_scene;
        let (finished, missing): (Vec<Job>, Vec<Job>) =
            self.recipe.jobs().partition(|&job| self.finished(job).is_some());
        let mut progress = BuildProgress {
            missions: self.recipe.jobs().map(|job| missions(&job)).sum(),
            done: finished.iter().map(missions).sum(),
        };
        on_progress(progress);
        self.write_secrets()?;
        let make = |job: &Job| -> Result<(), Failure> {
            let built = build_scene_with(&self.recipe, *job, &*self.verifier, cache)?;
            self.write_scene(*job, built)
        };
        parallel::share(&missing, threads, make, |index, ()| {
            progress.done += missions(&missing[index]);
            on_progress(progress);
        })?;
        self.complete()
    }

    fn write_secrets(&self) -> Result<(), Failure> {
        let names = self.recipe.splits.iter().map(|split| &split.name);
        names
            .filter_map(|name| SecretFile::of(&self.recipe, name).map(|secret| (name, secret)))
            .try_for_each(|(name, secret)| self.files.write_secret(name, &secret))
    }

    fn write_scene(&self, job: Job, built: BuiltScene) -> Result<(), Failure> {
        self.files.write_built_scene(&self.recipe.splits[job.split].name, &built)?;
        // The note comes last: a killed process leaves no note, and the next call repeats the scene.
        let note = FinishedScene { line: built.line, statistics: built.statistics };
        dataset::write_whole(&self.note_path(job), &json(&note)?)
    }

    /// Returns a finished scene's note if its files match their digests.
    fn finished(&self, job: Job) -> Option<FinishedScene> {
        let split = &self.recipe.splits[job.split].name;
        let note: FinishedScene = serde_json::from_slice(&dataset::read(&self.note_path(job)).ok()?).ok()?;
        let is_same =
            |path: PathBuf, digest: &str| dataset::read(&path).is_ok_and(|bytes| digest_of(&bytes) == digest);
        let is_complete = is_same(self.files.missions_path(split, &note.line.name), &note.line.public)
            && is_same(self.files.sealed_path(split, &note.line.name), &note.line.sealed);
        is_complete.then_some(note)
    }

    /// Writes scene lists, statistics and the manifest.
    fn complete(&self) -> Result<Vec<(String, Statistics)>, Failure> {
        let (mut lines, mut numbers) = (Vec::new(), Vec::new());
        for (split, recipe) in self.recipe.splits.iter().enumerate() {
            let (mut scenes, mut sum) = (Vec::new(), Statistics::default());
            for scene in 0..recipe.scene_count() {
                let job = Job { split, scene };
                let Some(scene) = self.finished(job) else {
                    let path = self.note_path(job);
                    let message = format!("{} was deleted during the build", path.display());
                    return Err(Failure::new(FailureKind::Data, message).hinted("build again"));
                };
                sum.add(&scene.statistics);
                scenes.push(scene.line);
            }
            lines.push(scenes);
            numbers.push((recipe.name.clone(), sum));
        }
        self.files.write_statistics(&self.recipe.name, &numbers)?;
        // The manifest marks the data set as complete, so it comes last.
        self.files.complete(&self.recipe, &lines)?;
        let building = self.building();
        std::fs::remove_dir_all(&building).map_err(|error| Failure::file("remove", &building, error))?;
        Ok(numbers)
    }

    fn building(&self) -> PathBuf {
        self.files.root().join("building")
    }

    fn note_path(&self, job: Job) -> PathBuf {
        self.building().join(format!("{}.json", self.recipe.scene_name(job)))
    }

    /// Returns an interrupted build's recipe.
    fn begun(&self) -> Result<Option<Recipe>, Failure> {
        let path = self.building().join("recipe.json");
        if !path.exists() {
            return Ok(None);
        }
        let recipe = serde_json::from_slice(&dataset::read(&path)?);
        recipe.map(Some).map_err(|error| {
            Failure::new(FailureKind::Data, format!("{} is not a recipe: {error}", path.display()))
                .hinted("delete the folder and build again")
        })
    }

    fn conflict(&self, origin: &str) -> Failure {
        let message = format!("{} contains a data set from {origin}", self.files.root().display());
        Failure::new(FailureKind::Data, message)
            .hinted("choose another folder with --out, or delete this folder")
    }
}

fn json(value: &impl Serialize) -> Result<Vec<u8>, Failure> {
    serde_json::to_vec(value).map_err(internal)
}
