//! Building of data sets by recipe.

use crate::{
    format::{SceneFacts, SceneLine, write_scene},
    mission::{EpisodeSpec, MissionOptions, StepGoal, sample_missions},
    split::{DatasetError, SceneSource, SceneSpec},
    stats::Statistics,
    survey::{SurveyOptions, ThresholdsOnly, survey_with},
};
use avln_episode::Rules;
use avln_geom::Rng;
use avln_houses::Pool;
use avln_world::{Cache, SceneAssets};
use serde::{Deserialize, Serialize};
use std::{path::PathBuf, sync::Arc};

/// What a data set is made of: the same recipe gives the same bytes, on any number of threads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Name of the data set: 1 to 24 letters, digits, `-` and `_`; scenes and missions are named after it.
    pub name: String,
    /// Name of the rule set under which regions and references are computed.
    pub rules: String,
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// What makes a mission worth playing.
    pub missions: MissionRules,
    /// What counts as recognisable and as told apart; the defaults where a recipe does not say.
    #[serde(default)]
    pub survey: SurveyOptions,
    /// The splits, made in this order. No scene is in two of them.
    pub splits: Vec<SplitRecipe>,
}

/// What makes a mission worth playing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MissionRules {
    /// Fewest and most goals, 1 to 8; every number is as likely as the others.
    pub goals: [usize; 2],
    /// Least walking distance from the start to a success region, metres.
    pub min_start_m: f64,
    /// Least walking distance between two success regions of a mission, metres.
    pub min_separation_m: f64,
    /// Fewest and most other instances of a target's category in its scene, 0 to 255.
    pub distractors: [u8; 2],
    /// How long missions should be; as they come when there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<StepGoal>,
}

/// One split of a data set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SplitRecipe {
    /// Name of the split: 1 to 24 letters, digits, `-` and `_`.
    pub name: String,
    /// Where its scenes come from.
    pub scenes: SceneChoice,
    /// Missions in each scene, 1 to 9999.
    pub missions_per_scene: usize,
    /// What makes a mission of this split worth playing, where it differs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub missions: Option<MissionRules>,
}

/// Where the scenes of a split come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SceneChoice {
    /// Grown from seeds.
    Houses {
        /// How many.
        count: u32,
        /// Fewest and most rooms.
        rooms: [u8; 2],
        /// Fewest and most storeys.
        storeys: [u8; 2],
        /// What furniture is drawn from: `train`, `validation` or `test`.
        pool: String,
    },
    /// Read from files or folders.
    Files(Vec<PathBuf>),
}

impl Recipe {
    /// The recipes that come with the program, by name.
    pub const EMBEDDED: [(&str, &str); 2] =
        [("paper", include_str!("../recipes/paper.json")), ("mini", include_str!("../recipes/mini.json"))];

    /// Most scenes of a split.
    const MAX_SCENES: usize = 100_000;
    /// Most missions in a scene: their numbers have four digits.
    const MAX_MISSIONS: usize = 9_999;

    /// Reads a recipe, JSON.
    ///
    /// # Errors
    /// When it is none, or asks for what cannot be.
    pub fn from_json(text: &str) -> Result<Self, DatasetError> {
        let recipe: Self = serde_json::from_str(text).map_err(|error| refused(format!("{error}")))?;
        recipe.check()?;
        Ok(recipe)
    }

    /// The rule set of the recipe.
    ///
    /// # Errors
    /// When this version does not know it.
    pub fn rules(&self) -> Result<Rules, DatasetError> {
        Rules::named(&self.rules).map_err(|error| refused(format!("`rules`: {error}")))
    }

    /// What makes a mission of `split` worth playing.
    pub fn mission_rules<'a>(&'a self, split: &'a SplitRecipe) -> &'a MissionRules {
        split.missions.as_ref().unwrap_or(&self.missions)
    }

    fn check(&self) -> Result<(), DatasetError> {
        self.rules()?;
        check_name("name", &self.name)?;
        if self.splits.is_empty() {
            return Err(refused("`splits` is empty; list at least one".to_owned()));
        }
        self.missions.check()?;
        self.survey.check().map_err(refused)?;
        for (index, split) in self.splits.iter().enumerate() {
            check_name("splits.name", &split.name)?;
            if self.splits[..index].iter().any(|other| other.name == split.name) {
                return Err(refused(format!("two splits are called '{}'", split.name)));
            }
            limit("missions_per_scene", split.missions_per_scene, 1, Self::MAX_MISSIONS)?;
            limit("scenes", split.scene_count(), 1, Self::MAX_SCENES)?;
            split.scenes.check()?;
            split.missions.as_ref().map_or(Ok(()), MissionRules::check)?;
        }
        Ok(())
    }
}

impl SplitRecipe {
    /// How many scenes it has.
    pub fn scene_count(&self) -> usize {
        match &self.scenes {
            SceneChoice::Houses { count, .. } => *count as usize,
            SceneChoice::Files(files) => files.len(),
        }
    }
}

impl SceneChoice {
    fn check(&self) -> Result<(), DatasetError> {
        let Self::Houses { rooms, storeys, pool, .. } = self else { return Ok(()) };
        if Pool::from_name(pool).is_none() {
            return Err(refused(format!("`pool` is '{pool}'; use train, validation or test")));
        }
        range("rooms", rooms[0].into(), rooms[1].into(), 1, 64)?;
        range("storeys", storeys[0].into(), storeys[1].into(), 1, 4)
    }
}

impl MissionRules {
    /// The options with which `episodes` missions are drawn.
    pub fn options(&self, episodes: usize, seed: u64) -> MissionOptions {
        MissionOptions {
            episodes,
            goals: self.goals[0]..=self.goals[1],
            min_start_m: self.min_start_m,
            min_separation_m: self.min_separation_m,
            distractors: self.distractors[0]..=self.distractors[1],
            steps: self.steps,
            seed,
        }
    }

    fn check(&self) -> Result<(), DatasetError> {
        range("goals", self.goals[0], self.goals[1], 1, 8)?;
        range("distractors", self.distractors[0].into(), self.distractors[1].into(), 0, 255)?;
        metres("min_start_m", self.min_start_m)?;
        metres("min_separation_m", self.min_separation_m)?;
        let Some(steps) = &self.steps else { return Ok(()) };
        let fits = (1.0..=1e6).contains(&steps.mean) && (0.0..=1.0).contains(&steps.spread);
        if !fits || !(1..=1000).contains(&steps.draws) {
            let message = "`steps` needs a mean of 1 to 1000000, a spread of 0 to 1 and 1 to 1000 draws";
            return Err(refused(message.to_owned()));
        }
        Ok(())
    }
}

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

fn refused(reason: String) -> DatasetError {
    DatasetError::Recipe { reason }
}

fn check_name(field: &str, name: &str) -> Result<(), DatasetError> {
    let fits = |letter: char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
    if (1..=24).contains(&name.len()) && name.chars().all(fits) {
        return Ok(());
    }
    let name = name.escape_debug();
    Err(refused(format!("`{field}` is '{name}'; use 1 to 24 letters, digits, - and _")))
}

fn limit(field: &str, value: usize, least: usize, most: usize) -> Result<(), DatasetError> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(refused(format!("`{field}` is {value}; {least} to {most} are possible")))
}

fn range(field: &str, low: usize, high: usize, least: usize, most: usize) -> Result<(), DatasetError> {
    if least <= low && low <= high && high <= most {
        return Ok(());
    }
    Err(refused(format!("`{field}` is [{low}, {high}]; use [fewest, most] between {least} and {most}")))
}

fn metres(field: &str, value_m: f64) -> Result<(), DatasetError> {
    if (0.0..=1000.0).contains(&value_m) {
        return Ok(());
    }
    Err(refused(format!("`{field}` is {value_m}; 0 to 1000 metres are possible")))
}
