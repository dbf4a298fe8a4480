//! Building of data sets by recipe.

use crate::{
    error::DatasetError,
    format::{SceneFacts, SceneLine, write_scene},
    recipe::{Recipe, SceneChoice, SplitRecipe},
    split::{DrawnScene, SceneSource},
    stats::Statistics,
    survey::{ThresholdsOnly, Verifier},
};
use avln_geom::Rng;
use avln_houses::Pool;
use avln_world::Cache;
use std::sync::Arc;

/// Build job for a scene, independent of other jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Job {
    /// Split index in the recipe.
    pub split: usize,
    /// Scene index in the split.
    pub scene: usize,
}

/// Finished scene: file contents and statistics.
#[derive(Clone, Debug, PartialEq)]
pub struct BuiltScene {
    /// Line in the scene list.
    pub line: SceneLine,
    /// Missions file (public).
    pub missions: Vec<u8>,
    /// Sealed file (hidden).
    pub sealed: Vec<u8>,
    /// Statistics.
    pub statistics: Statistics,
}

impl Recipe {
    /// Attempts per scene to draw a house with enough missions.
    pub const HOUSE_DRAWS: u32 = 12;

    /// Iterates over all jobs, split by split.
    pub fn jobs(&self) -> impl Iterator<Item = Job> {
        let scenes = |(split, recipe): (usize, &SplitRecipe)| {
            (0..recipe.scene_count()).map(move |scene| Job { split, scene })
        };
        self.splits.iter().enumerate().flat_map(scenes)
    }

    /// Returns the scene name: data set, split, and the number, or a keyed hash of the number for a secret split.
    pub fn scene_name(&self, job: Job) -> String {
        let SplitRecipe { name, secret, .. } = &self.splits[job.split];
        let number = match secret {
            Some(secret) => format!("{:016x}", secret.word(&["name", &job.scene.to_string()])),
            None => format!("{:04}", job.scene),
        };
        format!("{}-{name}-{number}", self.name)
    }

    /// Returns the house for a scene and an attempt, from 0, without missions; an error for splits with scene files.
    ///
    /// # Panics
    /// If the recipe has no such split.
    pub fn house(&self, job: Job, attempt: u32) -> Result<SceneSource, DatasetError> {
        Ok(self.drawn(job, attempt)?.0)
    }

    /// House with the seed for its missions.
    fn drawn(&self, job: Job, attempt: u32) -> Result<(SceneSource, u64), DatasetError> {
        let split = &self.splits[job.split];
        let SceneChoice::Houses { rooms, storeys, pool, .. } = &split.scenes else {
            let reason = format!("scenes of split '{}' come from files; none of them is drawn", split.name);
            return Err(DatasetError::Recipe(reason));
        };
        // A generator per attempt: the number of attempts in this scene changes no other scene.
        let mut rng = self.scene_rng(job)?.fork(&format!("house {attempt}"));
        let source = SceneSource::Procedural {
            seed: rng.next_u64(),
            rooms: rooms[0]..=rooms[1],
            storeys: storeys[0]..=storeys[1],
            pool: Pool::from_name(pool).unwrap_or_default(),
        };
        Ok((source, rng.next_u64()))
    }

    fn scene_rng(&self, job: Job) -> Result<Rng, DatasetError> {
        let SplitRecipe { name, secret, .. } = &self.splits[job.split];
        // Generators by name and number instead of a shared one: threads may build scenes in any order with equal
        // bytes.
        match (self.seed, secret) {
            (Some(seed), _) => Ok(Rng::new(seed).fork(name).fork(&format!("scene {}", job.scene))),
            (None, Some(secret)) => Ok(Rng::new(secret.word(&["scene", &job.scene.to_string()]))),
            (None, None) => {
                let reason = format!("split '{name}' has no secret, and the recipe has no `seed`");
                Err(DatasetError::Recipe(reason))
            }
        }
    }
}

/// Builds a scene as [`build_scene_with`], without a verifier.
///
/// # Errors
/// As [`build_scene_with`].
pub fn build_scene(
    recipe: &Recipe,
    job: Job,
    cache: Option<&Arc<dyn Cache>>,
) -> Result<BuiltScene, DatasetError> {
    build_scene_with(recipe, job, &ThresholdsOnly, cache)
}

/// Builds a scene: geometry, survey, missions, files. A pure function of recipe and job, apart from the render data
/// in `cache`.
///
/// # Errors
/// If the scene is unusable, a file has no mission, all draws of a house have too few, or the recipe has another verifier.
///
/// # Panics
/// If the recipe has no such split.
pub fn build_scene_with(
    recipe: &Recipe,
    job: Job,
    verifier: &dyn Verifier,
    cache: Option<&Arc<dyn Cache>>,
) -> Result<BuiltScene, DatasetError> {
    recipe.check_verifier(verifier)?;
    let split = &recipe.splits[job.split];
    let name = recipe.scene_name(job);
    let rules = recipe.rules()?;
    let build = |source, missions_seed, least| {
        let options = recipe.mission_rules(split).options(split.missions_per_scene, missions_seed);
        let drawn = DrawnScene::new(&name, source, &rules, &recipe.survey, &options, verifier, cache)?;
        if drawn.episodes.len() < least { Err(drawn.no_mission()) } else { finish(&drawn) }
    };
    match &split.scenes {
        SceneChoice::Files(files) => {
            let source = SceneSource::File { path: files[job.scene].clone() };
            // A file cannot be redrawn, so any mission count above 0 is accepted.
            build(source, recipe.scene_rng(job)?.fork("missions").next_u64(), 1)
        }
        SceneChoice::Houses { .. } => {
            let house = |attempt: u32| {
                let (source, missions_seed) = recipe.drawn(job, attempt)?;
                build(source, missions_seed, split.missions_per_scene)
            };
            // A house can lack instances for all missions, which only the survey detects. Another draw is cheaper than a
            // search for suitable limits.
            (1..Recipe::HOUSE_DRAWS).fold(house(0), |last, attempt| last.or_else(|_| house(attempt)))
        }
    }
}

fn finish(drawn: &DrawnScene) -> Result<BuiltScene, DatasetError> {
    let DrawnScene { spec, assets, instances, removals, episodes } = drawn;
    let storeys = assets.scene.regions.iter().map(|region| region.storey).max().map_or(1, |top| top + 1);
    let facts = SceneFacts {
        regions: assets.scene.regions.len() as u32,
        storeys: u32::from(storeys),
        objects: assets.scene.objects.len() as u32,
        instances: *instances as u32,
        area_m2: assets.navmesh.area_m2(),
        removed: Some(*removals),
    };
    let statistics = Statistics::of_scene(Some(facts), episodes);
    let written = write_scene(spec, Some(facts), episodes)?;
    Ok(BuiltScene { line: written.line, missions: written.missions, sealed: written.sealed, statistics })
}
