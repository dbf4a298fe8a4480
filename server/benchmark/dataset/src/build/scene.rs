use super::{Recipe, SceneChoice, SplitRecipe};
use crate::{
    EpisodeSpec, SceneLine, SceneSource, SceneSpec, Statistics, ThresholdsOnly,
    format::{SceneFacts, write_scene},
    sample_missions,
    split::DatasetError,
    survey_with,
};
use avln_episode::Rules;
use avln_geom::Rng;
use avln_houses::Pool;
use avln_world::{Cache, SceneAssets};
use std::sync::Arc;

/// One scene to be made: a unit of work that depends on nothing but the recipe.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Job {
    /// Which split of the recipe.
    pub split: usize,
    /// Which scene of the split, from 0.
    pub scene: usize,
}

/// A finished scene: what is written to disk, and what is counted.
#[derive(Clone, Debug, PartialEq)]
pub struct BuiltScene {
    /// Its line in the list of scenes.
    pub line: SceneLine,
    /// What an agent may know: the missions file.
    pub missions: Vec<u8>,
    /// What it may not: the sealed file.
    pub sealed: Vec<u8>,
    /// Its numbers.
    pub statistics: Statistics,
}

impl Recipe {
    /// Houses that are drawn for a scene, one after the other, until one holds all missions that are asked for.
    pub const HOUSE_DRAWS: u32 = 12;

    /// All scenes to be made, split by split.
    pub fn jobs(&self) -> impl Iterator<Item = Job> {
        let scenes = |(split, recipe): (usize, &SplitRecipe)| {
            (0..recipe.scene_count()).map(move |scene| Job { split, scene })
        };
        self.splits.iter().enumerate().flat_map(scenes)
    }

    /// Name of a scene: that of the data set, of the split, and a number.
    pub fn scene_name(&self, job: Job) -> String {
        format!("{}-{}-{:04}", self.name, self.splits[job.split].name, job.scene)
    }

    /// The house that is drawn for a scene at the `attempt`, from 0; without missions, which may ask for a later one.
    ///
    /// # Errors
    /// When the scenes of its split come from files.
    ///
    /// # Panics
    /// When the recipe has no such split.
    pub fn house(&self, job: Job, attempt: u32) -> Result<SceneSource, DatasetError> {
        Ok(self.drawn(job, attempt)?.0)
    }

    /// A house, and the seed of the missions in it.
    fn drawn(&self, job: Job, attempt: u32) -> Result<(SceneSource, u64), DatasetError> {
        let split = &self.splits[job.split];
        let SceneChoice::Houses { rooms, storeys, pool, .. } = &split.scenes else {
            let reason = format!("scenes of split '{}' come from files; none of them is drawn", split.name);
            return Err(DatasetError::Recipe { reason });
        };
        let mut rng = self.scene_rng(job).fork(&format!("house {attempt}"));
        let source = SceneSource::Procedural {
            seed: rng.next_u64(),
            rooms: rooms[0]..=rooms[1],
            storeys: storeys[0]..=storeys[1],
            pool: Pool::from_name(pool).unwrap_or_default(),
        };
        Ok((source, rng.next_u64()))
    }

    fn scene_rng(&self, job: Job) -> Rng {
        Rng::new(self.seed).fork(&self.splits[job.split].name).fork(&format!("scene {}", job.scene))
    }
}

/// Makes one scene: building, survey, missions, files. A pure function of recipe and job; what pictures are made from is
/// looked for and kept in `cache`.
///
/// # Errors
/// When the scene cannot be used or holds no mission. Files may hold fewer missions than asked for; houses are drawn
/// again until one holds all.
///
/// # Panics
/// When the recipe has no such split.
pub fn build_scene(
    recipe: &Recipe,
    job: Job,
    cache: Option<&Arc<dyn Cache>>,
) -> Result<BuiltScene, DatasetError> {
    let split = &recipe.splits[job.split];
    let (name, rules) = (recipe.scene_name(job), recipe.rules()?);
    let maker = Maker { recipe, split, rules, cache };
    match &split.scenes {
        SceneChoice::Files(files) => {
            let source = SceneSource::File { path: files[job.scene].clone() };
            let missions_seed = recipe.scene_rng(job).fork("missions").next_u64();
            maker.build(&name, source, missions_seed, 1)
        }
        SceneChoice::Houses { .. } => {
            let house = |attempt: u32| {
                let (source, missions_seed) = recipe.drawn(job, attempt)?;
                maker.build(&name, source, missions_seed, split.missions_per_scene)
            };
            let mut last = house(0);
            for attempt in 1..Recipe::HOUSE_DRAWS {
                if last.is_ok() {
                    break;
                }
                last = house(attempt);
            }
            last
        }
    }
}

/// What the scenes of a split have in common.
struct Maker<'a> {
    recipe: &'a Recipe,
    split: &'a SplitRecipe,
    rules: Rules,
    cache: Option<&'a Arc<dyn Cache>>,
}

impl Maker<'_> {
    /// Makes the scene of `source`; refuses it when it holds fewer than `least` missions.
    fn build(
        &self,
        name: &str,
        source: SceneSource,
        missions_seed: u64,
        least: usize,
    ) -> Result<BuiltScene, DatasetError> {
        let Self { recipe, split, rules, cache } = self;
        let (spec, scene) = SceneSpec::new(name, source)?;
        let assets = spec.prepare(scene, rules, *cache)?;
        let instances = survey_with(&assets, rules, &recipe.survey, &ThresholdsOnly);
        let options = recipe.mission_rules(split).options(split.missions_per_scene, missions_seed);
        let episodes = sample_missions(&assets, &instances, rules, &options);
        if episodes.len() < least {
            let objects = assets.scene.objects.len();
            let (scene, instances) = (name.to_owned(), instances.len());
            return Err(DatasetError::NoMission { scene, instances, objects });
        }
        finish(&assets, spec, instances.len(), &episodes)
    }
}

fn finish(
    assets: &SceneAssets,
    spec: SceneSpec,
    instances: usize,
    episodes: &[EpisodeSpec],
) -> Result<BuiltScene, DatasetError> {
    let storeys = assets.scene.regions.iter().map(|region| region.storey).max().map_or(1, |top| top + 1);
    let facts = SceneFacts {
        regions: assets.scene.regions.len() as u32,
        storeys: u32::from(storeys),
        objects: assets.scene.objects.len() as u32,
        instances: instances as u32,
        area_m2: assets.navmesh.area_m2(),
    };
    let statistics = Statistics::of_scene(Some(facts), episodes);
    let written = write_scene(&spec, Some(facts), episodes)?;
    Ok(BuiltScene { line: written.line, missions: written.missions, sealed: written.sealed, statistics })
}
