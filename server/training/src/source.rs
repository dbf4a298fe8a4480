//! Sources of training episodes.

use crate::explorer::FloorGrid;
use crate::map::Floor;
use crate::options::outside;
use crate::scenes::{FolderSplit, PreparedScene, RecipeHouses, Scan, Scenes};
use crate::{Curriculum, Goals, TrainingError};
use avln_episode::{Mission, Order, Rules};
use avln_truth::EpisodeTruth;
use avln_world::{Cache, Rng, SceneAssets};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError, Weak};

/// Scenes in a row that may have no mission within the curriculum.
const MOST_SCENES: u64 = 16;

/// Origin of training scenes.
#[derive(Clone, Debug, PartialEq)]
pub enum SourceChoice {
    /// Houses of a recipe's training split, drawn without end.
    Recipe(String),
    /// A split of a data set from `avln data dataset build`.
    Folder {
        /// Folder with `dataset.json`.
        path: PathBuf,
        /// Split name.
        split: String,
        /// True to confirm that scenes from files are for training.
        is_training: bool,
    },
    /// A scan: any supported scene file.
    Scan {
        /// File or folder.
        path: PathBuf,
        /// True to confirm that it is for training.
        is_training: bool,
    },
}

/// Settings of a source.
#[derive(Clone)]
pub struct SourceOptions {
    /// Scenes.
    pub choice: SourceChoice,
    /// Seed for all draws.
    pub seed: u64,
    /// Goal order.
    pub goals: Goals,
    /// Limits for missions.
    pub curriculum: Curriculum,
    /// Scenes in use at the same time; environments with equal numbers modulo this count share one.
    pub scenes: usize,
    /// Episodes of an environment before its next scene.
    pub episodes_per_scene: u64,
    /// Cache for expensive preparations.
    pub cache: Option<Arc<dyn Cache>>,
}

impl SourceOptions {
    /// Returns options for `choice` with 8 scenes in use, 64 episodes per scene and both orders.
    pub fn new(choice: SourceChoice, seed: u64) -> Self {
        Self {
            choice,
            seed,
            goals: Goals::Drawn,
            curriculum: Curriculum::default(),
            scenes: 8,
            episodes_per_scene: 64,
            cache: None,
        }
    }
}

/// An episode with its building.
#[derive(Clone)]
pub struct TrainingEpisode {
    /// Building.
    pub assets: Arc<SceneAssets>,
    /// Mission for the agent.
    pub mission: Mission,
    /// Ground truth.
    pub truth: EpisodeTruth,
    /// Keeps the scene loaded.
    scene: Arc<LoadedScene>,
}

impl TrainingEpisode {
    /// Returns the grid of the scene's floor, shared by its episodes.
    pub(crate) fn floor(&self) -> Arc<FloorGrid> {
        let grid = || Arc::new(FloorGrid::new(&self.assets.scene, &self.assets.navmesh));
        self.shared(|scene| &scene.floor, grid)
    }

    /// Returns the cells of the sense `map`, shared by the scene's episodes.
    pub(crate) fn cells(&self) -> Arc<Floor> {
        self.shared(|scene| &scene.cells, || Arc::new(Floor::new(&self.assets)))
    }

    /// Returns a part of the scene, made by its first user.
    fn shared<T>(
        &self,
        part: impl Fn(&PreparedScene) -> &OnceLock<Arc<T>>,
        make: impl FnOnce() -> Arc<T>,
    ) -> Arc<T> {
        match self.scene.0.get() {
            Some(Ok(scene)) => Arc::clone(part(scene).get_or_init(make)),
            _ => make(),
        }
    }
}

/// A scene, prepared by its first user while others wait.
#[derive(Default)]
struct LoadedScene(OnceLock<Result<PreparedScene, Unprepared>>);

/// A failed preparation, which all users share as text.
struct Unprepared {
    message: String,
    is_without_mission: bool,
}

impl Unprepared {
    fn shared(&self) -> TrainingError {
        TrainingError::Shared(self.message.clone())
    }
}

impl From<TrainingError> for Unprepared {
    fn from(error: TrainingError) -> Self {
        let is_without_mission = matches!(error, TrainingError::NoMission { .. });
        Self { message: error.to_string(), is_without_mission }
    }
}

/// A source of training episodes. The episode is a function of the seed, the environment and its episode number.
pub struct EpisodeSource {
    scenes: Box<dyn Scenes>,
    seed: u64,
    goals: Goals,
    in_use: u64,
    episodes_per_scene: u64,
    /// Unused scenes are dropped by their last user.
    loaded: Mutex<BTreeMap<u64, Weak<LoadedScene>>>,
    /// Scenes without a mission within the curriculum.
    without_mission: Mutex<BTreeSet<u64>>,
}

impl EpisodeSource {
    /// Opens a source.
    ///
    /// # Errors
    /// If the recipe is unknown, a pool is not for training, a split is sealed, a file cannot be read, or an option is out of
    /// range.
    pub fn open(options: &SourceOptions) -> Result<Self, TrainingError> {
        let SourceOptions { seed, curriculum, cache, .. } = options.clone();
        curriculum.check()?;
        crate::options::within("scenes", options.scenes as u32, 1, 4096)?;
        if options.episodes_per_scene == 0 {
            return Err(outside("episodes_per_scene", "0".to_owned(), "1 is the least"));
        }
        let scenes: Box<dyn Scenes> = match &options.choice {
            SourceChoice::Recipe(name) => Box::new(RecipeHouses::new(name, seed, curriculum, cache)?),
            SourceChoice::Folder { path, split, is_training } => {
                Box::new(FolderSplit::open(path, split, *is_training, curriculum, cache)?)
            }
            SourceChoice::Scan { path, is_training } => {
                Box::new(Scan::new(path, *is_training, seed, curriculum, cache)?)
            }
        };
        let in_use = scenes.count().unwrap_or(u64::MAX).min(options.scenes as u64).max(1);
        Ok(Self {
            scenes,
            seed,
            goals: options.goals,
            in_use,
            episodes_per_scene: options.episodes_per_scene,
            loaded: Mutex::default(),
            without_mission: Mutex::default(),
        })
    }

    /// Returns an error for rules that do not fit the missions and success regions. The horizon may differ.
    pub(crate) fn check_rules(&self, rules: &Rules) -> Result<(), TrainingError> {
        let of_source = self.scenes.rules();
        let compared = Rules { max_steps: of_source.max_steps, ..rules.clone() };
        if compared.fits_episodes_of(of_source) {
            return Ok(());
        }
        let limits = format!(
            "the missions of this source are built for '{}', and a rule set may differ only in noise, sounds, distractor sources \
             and claims; use a folder from a recipe with these rules",
            of_source.name
        );
        Err(outside("rules", rules.name.clone(), &limits))
    }

    /// Returns episode `number` of environment `env`; prepares its scene if no other environment uses it. A scene without a mission
    /// within the curriculum, or without enough distractor sources, is replaced by the next one.
    ///
    /// # Errors
    /// If a scene cannot be prepared, or none of 16 scenes has a mission within the curriculum and its distractor sources.
    pub fn episode(&self, env: u64, number: u64, rules: &Rules) -> Result<TrainingEpisode, TrainingError> {
        let first = self.scene_number(env, number);
        let loaded = self.next_with_mission(first, rules)?;
        let scene = match loaded.0.get() {
            Some(Ok(scene)) => scene,
            Some(Err(failure)) => return Err(failure.shared()),
            None => return Err(TrainingError::Shared(format!("scene {first} was not prepared"))),
        };
        let PreparedScene { assets, missions, episodes, .. } = scene;
        let mut rng = Rng::new(self.seed).fork(&format!("environment {env} episode {number}"));
        let drawn = rng.below(episodes.len());
        let from_drawn = episodes.iter().cycle().skip(drawn).take(episodes.len());
        let index = from_drawn.copied().find(|&index| scene.has_sources(index, rules));
        let index = index.ok_or_else(|| TrainingError::FewSources { rules: rules.name.clone() })?;
        let spec = &missions.episodes()[index];
        let order = match self.goals {
            Goals::Fixed(order) => order,
            Goals::Drawn if rng.chance(0.5) => Order::Ordered,
            Goals::Drawn => Order::Unordered,
        };
        Ok(TrainingEpisode {
            assets: Arc::clone(assets),
            mission: spec.mission(assets, rules, order),
            truth: missions.truth(spec, order, rules, assets),
            scene: Arc::clone(&loaded),
        })
    }

    /// Returns the scene of an environment's episode: neighbours share scenes, and each moves on after a fixed number.
    fn scene_number(&self, env: u64, number: u64) -> u64 {
        self.wrapped(env % self.in_use + self.in_use * (number / self.episodes_per_scene))
    }

    fn wrapped(&self, scene: u64) -> u64 {
        self.scenes.count().map_or(scene, |count| scene % count)
    }

    /// Returns the first prepared scene from `first` on that has a mission with its sources, or failed for another reason.
    fn next_with_mission(&self, first: u64, rules: &Rules) -> Result<Arc<LoadedScene>, TrainingError> {
        let mut failed = None;
        for step in 0..self.scenes.count().unwrap_or(MOST_SCENES).min(MOST_SCENES) {
            let number = self.wrapped(first + step);
            // Preparation takes seconds, and no environment holds such a scene.
            if self.without_mission().contains(&number) {
                continue;
            }
            let loaded = self.loaded(number);
            let scene = loaded.0.get_or_init(|| self.scenes.scene(number).map_err(Unprepared::from));
            match scene {
                Err(failure) if failure.is_without_mission => {
                    self.without_mission().insert(number);
                    failed = Some(failure.shared());
                }
                Ok(scene) if !scene.episodes.iter().any(|&index| scene.has_sources(index, rules)) => {
                    failed = Some(TrainingError::FewSources { rules: rules.name.clone() });
                }
                _ => return Ok(loaded),
            }
        }
        let known = || {
            TrainingError::Shared("no scene has a mission within the curriculum; widen its limits".to_owned())
        };
        Err(failed.unwrap_or_else(known))
    }

    fn without_mission(&self) -> MutexGuard<'_, BTreeSet<u64>> {
        self.without_mission.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn loaded(&self, number: u64) -> Arc<LoadedScene> {
        let mut loaded = self.loaded.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(scene) = loaded.get(&number).and_then(Weak::upgrade) {
            return scene;
        }
        loaded.retain(|_, scene| scene.strong_count() > 0);
        let scene = Arc::new(LoadedScene::default());
        loaded.insert(number, Arc::downgrade(&scene));
        scene
    }
}
