//! Scenes by number: houses of a recipe, a split in a folder, or one scan.

use crate::explorer::FloorGrid;
use crate::map::Floor;
use crate::{Curriculum, TrainingError};
use avln_dataset::{
    DatasetError, EpisodeSpec, Job, Manifest, MissionOptions, Recipe, SceneChoice, SceneLine, SceneMissions,
    SceneSource, SceneSpec, SplitLine, SurveyOptions, ThresholdsOnly,
    format::{File, read_manifest, read_scene, read_scenes},
    sample_missions, survey_with,
};
use avln_episode::Rules;
use avln_houses::Pool;
use avln_world::{Body, Cache, Cached, SceneAssets};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// A scene with its missions.
pub(crate) struct PreparedScene {
    pub(crate) assets: Arc<SceneAssets>,
    pub(crate) missions: SceneMissions,
    /// Missions within the curriculum, by index.
    pub(crate) episodes: Vec<usize>,
    /// Places for the explorer, made on first use.
    pub(crate) floor: OnceLock<Arc<FloorGrid>>,
    /// Cells of the sense `map`, made on first use.
    pub(crate) cells: OnceLock<Arc<Floor>>,
}

impl PreparedScene {
    /// Returns true if the scene has the distractor sources of `rules` for a mission: targets of other missions.
    pub(crate) fn has_sources(&self, index: usize, rules: &Rules) -> bool {
        let episode = &self.missions.episodes()[index];
        match rules.distractor_sources.count(episode.goals.len()) {
            0 => true,
            needed => self.missions.distractor_candidates(episode) >= needed,
        }
    }
}

/// Numbered scenes. Equal numbers give equal scenes.
pub(crate) trait Scenes: Send + Sync {
    /// Returns the rules for which missions and success regions are built.
    fn rules(&self) -> &Rules;

    /// Returns the scene count; `None` for an endless list.
    fn count(&self) -> Option<u64>;

    /// Builds or reads a scene.
    fn scene(&self, number: u64) -> Result<PreparedScene, TrainingError>;
}

/// Missions drawn per house.
const MISSIONS_PER_HOUSE: usize = 48;

/// Houses of a recipe's training split, without end.
pub(crate) struct RecipeHouses {
    recipe: Recipe,
    rules: Rules,
    split: usize,
    curriculum: Curriculum,
    cache: Option<Arc<dyn Cache>>,
}

/// Name of the split with training houses in recipes.
const SPLIT: &str = "train";

fn training_split(recipe: &Recipe) -> Option<usize> {
    recipe.splits.iter().position(|split| split.name == SPLIT)
}

/// Names of the recipes with training houses.
fn names_with_training() -> Vec<&'static str> {
    let has_training =
        |text: &str| Recipe::from_json(text).is_ok_and(|recipe| training_split(&recipe).is_some());
    let suitable = Recipe::EMBEDDED.into_iter().filter(|(_, text)| has_training(text));
    suitable.map(|(name, _)| name).collect()
}

impl RecipeHouses {
    /// Finds the recipe `name` and checks the pool.
    pub(crate) fn new(
        name: &str,
        seed: u64,
        curriculum: Curriculum,
        cache: Option<Arc<dyn Cache>>,
    ) -> Result<Self, TrainingError> {
        let text = Recipe::embedded(name).ok_or_else(|| {
            let known = names_with_training().join(", ");
            TrainingError::UnknownRecipe { name: name.to_owned(), known }
        })?;
        // A verifier would take most of the time of a start.
        let mut recipe = Recipe { seed: Some(seed), verifier: None, ..Recipe::from_json(text)? };
        let split = training_split(&recipe).ok_or_else(|| {
            let pool = "validation".to_owned();
            TrainingError::Pool { source_name: format!("recipe '{name}'"), pool }
        })?;
        if let SceneChoice::Houses { pool, rooms, storeys, .. } = &mut recipe.splits[split].scenes {
            if pool != Pool::Train.name() {
                let source_name = format!("recipe '{name}'");
                return Err(TrainingError::Pool { source_name, pool: pool.clone() });
            }
            *rooms = curriculum.rooms.unwrap_or(*rooms);
            *storeys = curriculum.storeys.unwrap_or(*storeys);
        }
        recipe.check()?;
        let rules = recipe.rules()?;
        Ok(Self { recipe, rules, split, curriculum, cache })
    }

    /// Returns the options for missions within the curriculum. The default curriculum keeps the recipe's lengths.
    fn missions(&self, seed: u64) -> MissionOptions {
        let rules = self.recipe.mission_rules(&self.recipe.splits[self.split]);
        let options = rules.options(MISSIONS_PER_HOUSE, seed);
        if self.curriculum == Curriculum::default() { options } else { narrowed(options, &self.curriculum) }
    }

    fn drawn(&self, job: Job, attempt: u32) -> Result<PreparedScene, TrainingError> {
        let house = self.recipe.house(job, attempt)?;
        let (spec, assets) = opened(&self.recipe.scene_name(job), house, &self.rules, &self.cache)?;
        let options = self.missions(job.scene as u64);
        furnished(&spec, assets, &self.rules, &self.recipe.survey, &options, &self.curriculum)
    }
}

impl Scenes for RecipeHouses {
    fn rules(&self) -> &Rules {
        &self.rules
    }

    fn count(&self) -> Option<u64> {
        None
    }

    fn scene(&self, number: u64) -> Result<PreparedScene, TrainingError> {
        let job = Job { split: self.split, scene: number as usize };
        // As in data sets, an unsuitable house is drawn again; without a mission within the curriculum, the next house is as good.
        (1..Recipe::HOUSE_DRAWS).fold(self.drawn(job, 0), |last, attempt| match last {
            Ok(_) | Err(TrainingError::NoMission { .. }) => last,
            Err(_) => self.drawn(job, attempt),
        })
    }
}

/// One scan by path.
pub(crate) struct Scan {
    path: PathBuf,
    rules: Rules,
    seed: u64,
    curriculum: Curriculum,
    cache: Option<Arc<dyn Cache>>,
}

impl Scan {
    /// `is_training` confirms the purpose of the scene.
    pub(crate) fn new(
        path: &Path,
        is_training: bool,
        seed: u64,
        curriculum: Curriculum,
        cache: Option<Arc<dyn Cache>>,
    ) -> Result<Self, TrainingError> {
        let path = path.to_owned();
        check_pool(
            &format!("scan {}", path.display()),
            &SceneSource::File { path: path.clone() },
            is_training,
        )?;
        Ok(Self { path, rules: Rules::paper(), seed, curriculum, cache })
    }
}

impl Scenes for Scan {
    fn rules(&self) -> &Rules {
        &self.rules
    }

    fn count(&self) -> Option<u64> {
        Some(1)
    }

    fn scene(&self, _number: u64) -> Result<PreparedScene, TrainingError> {
        let name = self.path.file_stem().map_or_else(|| "scan".into(), |stem| stem.to_string_lossy());
        let source = SceneSource::File { path: self.path.clone() };
        let (spec, assets) = opened(&name, source, &self.rules, &self.cache)?;
        let options = narrowed(MissionOptions::new(MISSIONS_PER_HOUSE, self.seed), &self.curriculum);
        furnished(&spec, assets, &self.rules, &SurveyOptions::default(), &options, &self.curriculum)
    }
}

/// A split of a data set in a folder.
pub(crate) struct FolderSplit {
    root: PathBuf,
    split: String,
    rules: Rules,
    scenes: Vec<SceneLine>,
    curriculum: Curriculum,
    cache: Option<Arc<dyn Cache>>,
}

impl FolderSplit {
    /// Opens a split. `is_training` confirms the purpose of scenes from files; houses record their pool.
    pub(crate) fn open(
        root: &Path,
        split: &str,
        is_training: bool,
        curriculum: Curriculum,
        cache: Option<Arc<dyn Cache>>,
    ) -> Result<Self, TrainingError> {
        let manifest = manifest(root)?;
        let line = manifest.splits.iter().find(|line| line.name == split).ok_or_else(|| {
            let known = manifest.splits.iter().map(|line| line.name.as_str()).collect::<Vec<_>>().join(", ");
            TrainingError::UnknownSplit { path: root.to_owned(), split: split.to_owned(), known }
        })?;
        let scenes = scene_lines(root, line)?;
        let name = format!("split '{split}'");
        scenes.iter().try_for_each(|scene| check_pool(&name, &scene.source, is_training))?;
        let rules = Rules::named(&manifest.rules)
            .map_err(|error| TrainingError::Dataset(DatasetError::Recipe(error.to_string())))?;
        let root = root.to_owned();
        Ok(Self { root, split: split.to_owned(), rules, scenes, curriculum, cache })
    }

    fn file(&self, kind: &str, scene: &str) -> PathBuf {
        self.root.join(&self.split).join(kind).join(format!("{scene}.jsonl"))
    }
}

impl Scenes for FolderSplit {
    fn rules(&self) -> &Rules {
        &self.rules
    }

    fn count(&self) -> Option<u64> {
        Some(self.scenes.len() as u64)
    }

    fn scene(&self, number: u64) -> Result<PreparedScene, TrainingError> {
        let line = &self.scenes[number as usize];
        let paths = ["missions", "sealed"].map(|kind| self.file(kind, &line.name));
        let [missions, sealed] = [read(&paths[0])?, read(&paths[1])?];
        let names = paths.map(|path| path.display().to_string());
        let missions = File { name: &names[0], bytes: &missions };
        let sealed = File { name: &names[1], bytes: &sealed };
        let episodes = read_scene(line, missions, sealed).map_err(DatasetError::from)?;
        let assets = line.spec().open_with(&self.rules, self.cache.as_ref())?;
        prepared(&line.name, assets, episodes, &self.curriculum)
    }
}

fn manifest(root: &Path) -> Result<Manifest, TrainingError> {
    let path = root.join("dataset.json");
    let (name, bytes) = (path.display().to_string(), read(&path)?);
    Ok(read_manifest(File { name: &name, bytes: &bytes }).map_err(DatasetError::from)?)
}

fn scene_lines(root: &Path, split: &SplitLine) -> Result<Vec<SceneLine>, TrainingError> {
    let path = root.join(&split.name).join("scenes.jsonl");
    let (name, bytes) = (path.display().to_string(), read(&path)?);
    // Open files are JSON lines; sealed ones start with a magic number.
    if !bytes.starts_with(b"{") {
        return Err(TrainingError::Sealed(root.join(&split.name)));
    }
    Ok(read_scenes(File { name: &name, bytes: &bytes }, &split.digest).map_err(DatasetError::from)?)
}

fn check_pool(name: &str, source: &SceneSource, is_training: bool) -> Result<(), TrainingError> {
    if source.is_for_training(is_training) {
        return Ok(());
    }
    let source_name = name.to_owned();
    Err(match source {
        SceneSource::Procedural { pool, .. } => {
            TrainingError::Pool { source_name, pool: pool.name().to_owned() }
        }
        SceneSource::File { .. } => TrainingError::Unconfirmed { source_name },
    })
}

fn read(path: &Path) -> Result<Vec<u8>, TrainingError> {
    fs::read(path).map_err(|source| TrainingError::Read { path: path.to_owned(), source })
}

/// Builds or reads a scene and prepares it for the rules.
fn opened(
    name: &str,
    source: SceneSource,
    rules: &Rules,
    cache: &Option<Arc<dyn Cache>>,
) -> Result<(SceneSpec, SceneAssets), TrainingError> {
    let (spec, scene) = SceneSpec::new(name, source)?;
    let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
    let cached = cache.as_ref().map(|cache| Cached { cache: Arc::clone(cache), name: spec.digest.clone() });
    let assets = SceneAssets::prepare_cached(scene, &body, cached)
        .map_err(|source| DatasetError::Prepare { scene: name.to_owned(), source })?;
    Ok((spec, assets))
}

/// Surveys a scene and draws missions.
fn furnished(
    spec: &SceneSpec,
    assets: SceneAssets,
    rules: &Rules,
    survey: &SurveyOptions,
    missions: &MissionOptions,
    curriculum: &Curriculum,
) -> Result<PreparedScene, TrainingError> {
    let survey = survey_with(&assets, rules, survey, &ThresholdsOnly, &missions.distractors)?;
    let episodes = sample_missions(&assets, &survey.instances, rules, missions);
    prepared(&spec.name, assets, episodes, curriculum)
}

/// Keeps the missions within the curriculum.
fn prepared(
    scene: &str,
    assets: SceneAssets,
    missions: Vec<EpisodeSpec>,
    curriculum: &Curriculum,
) -> Result<PreparedScene, TrainingError> {
    let [fewest, most] = curriculum.goals;
    let [nearest_m, farthest_m] = curriculum.distance_m;
    let is_within = |episode: &EpisodeSpec| {
        let mut distances_m = episode.goals.iter().map(|goal| goal.target.start_distance_m);
        (fewest..=most).contains(&episode.goals.len())
            && distances_m.all(|distance_m| (nearest_m..=farthest_m).contains(&distance_m))
    };
    let episodes: Vec<_> = (0..missions.len()).filter(|index| is_within(&missions[*index])).collect();
    if episodes.is_empty() {
        let curriculum = format!("{fewest} to {most} goals, {nearest_m} to {farthest_m} m from the start");
        return Err(TrainingError::NoMission { scene: scene.to_owned(), curriculum });
    }
    let (assets, missions) = (Arc::new(assets), SceneMissions::new(missions));
    Ok(PreparedScene { assets, missions, episodes, floor: OnceLock::new(), cells: OnceLock::new() })
}

fn narrowed(options: MissionOptions, curriculum: &Curriculum) -> MissionOptions {
    MissionOptions {
        goals: curriculum.goals[0]..=curriculum.goals[1],
        min_start_m: curriculum.distance_m[0],
        steps: None,
        ..options
    }
}
