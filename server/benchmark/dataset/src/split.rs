//! Splits: scenes with their missions.

use crate::{
    error::DatasetError,
    mission::{EpisodeSpec, MissionOptions, sample_missions},
    survey::{Removals, Survey, SurveyOptions, ThresholdsOnly, Verifier, survey_with},
};
use avln_episode::Rules;
use avln_formats::open::open;
use avln_houses::{HouseOptions, Pool};
use avln_scene::{Scene, digest::digest};
use avln_world::{Body, Cache, Cached, SceneAssets};
use serde::{Deserialize, Serialize};
use std::{ops::RangeInclusive, path::PathBuf, sync::Arc};

/// Scenes with their missions. Splits have disjoint scenes.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// Split name.
    pub name: String,
    /// Rule set name for regions and references.
    pub rules: String,
    /// Scenes.
    pub scenes: Vec<SceneSpec>,
    /// Missions, scene by scene.
    pub episodes: Vec<EpisodeSpec>,
}

/// Scene in a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSpec {
    /// Scene name.
    pub name: String,
    /// Scene source.
    pub source: SceneSource,
    /// Content digest, checked on every open.
    pub digest: String,
}

/// Scene source.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneSource {
    /// Procedural house.
    Procedural {
        /// Seed.
        seed: u64,
        /// Minimum and maximum rooms.
        rooms: RangeInclusive<u8>,
        /// Minimum and maximum storeys; default 1.
        #[serde(default = "one_storey")]
        storeys: RangeInclusive<u8>,
        /// Furniture pool; default training.
        #[serde(default)]
        pool: Pool,
    },
    /// File or folder.
    File {
        /// Path.
        path: PathBuf,
    },
}

impl SceneSpec {
    /// Builds or reads the scene `name` and records the digest; an error if the file cannot be read.
    pub fn new(name: &str, source: SceneSource) -> Result<(Self, Scene), DatasetError> {
        let scene = source.make(name)?;
        // Success regions and reference tours depend on the geometry. A changed file must be an error, not a wrong
        // score.
        Ok((Self { name: name.to_owned(), source, digest: digest(&scene) }, scene))
    }

    /// Opens the scene as [`SceneSpec::open_with`], without a cache.
    pub fn open(&self, rules: &Rules) -> Result<SceneAssets, DatasetError> {
        self.open_with(rules, None)
    }

    /// Rebuilds or rereads the scene and prepares it for the rules; caches render data in `cache` by scene digest.
    ///
    /// # Errors
    /// If it cannot be read, has changed, or has no walkable floor.
    pub fn open_with(
        &self,
        rules: &Rules,
        cache: Option<&Arc<dyn Cache>>,
    ) -> Result<SceneAssets, DatasetError> {
        let scene = self.source.make(&self.name)?;
        let found = digest(&scene);
        if found != self.digest {
            let (scene, expected) = (self.name.clone(), self.digest.clone());
            return Err(DatasetError::Changed { scene, found, expected });
        }
        self.prepare(scene, rules, cache)
    }

    pub(crate) fn prepare(
        &self,
        scene: Scene,
        rules: &Rules,
        cache: Option<&Arc<dyn Cache>>,
    ) -> Result<SceneAssets, DatasetError> {
        let body = Body { radius_m: rules.body_radius_m, height_m: rules.body_height_m, ..Body::default() };
        let cached = cache.map(|cache| Cached { cache: Arc::clone(cache), name: self.digest.clone() });
        SceneAssets::prepare_cached(scene, &body, cached)
            .map_err(|source| DatasetError::Prepare { scene: self.name.clone(), source })
    }
}

pub(crate) struct DrawnScene {
    pub(crate) spec: SceneSpec,
    pub(crate) assets: SceneAssets,
    pub(crate) instances: usize,
    pub(crate) removals: Removals,
    pub(crate) episodes: Vec<EpisodeSpec>,
}

impl DrawnScene {
    /// Builds or reads a scene, surveys it, and draws missions, possibly none.
    pub(crate) fn new(
        name: &str,
        source: SceneSource,
        rules: &Rules,
        survey: &SurveyOptions,
        missions: &MissionOptions,
        verifier: &dyn Verifier,
        cache: Option<&Arc<dyn Cache>>,
    ) -> Result<Self, DatasetError> {
        let (spec, scene) = SceneSpec::new(name, source)?;
        let assets = spec.prepare(scene, rules, cache)?;
        let Survey { instances, removals } =
            survey_with(&assets, rules, survey, verifier, &missions.distractors)?;
        let episodes = sample_missions(&assets, &instances, rules, missions);
        Ok(Self { spec, assets, instances: instances.len(), removals, episodes })
    }

    pub(crate) fn no_mission(&self) -> DatasetError {
        DatasetError::NoMission {
            scene: self.spec.name.clone(),
            instances: self.instances,
            objects: self.assets.scene.objects.len(),
        }
    }
}

fn one_storey() -> RangeInclusive<u8> {
    1..=1
}

impl SceneSource {
    /// Returns true for a training scene. A procedural house records its pool; `is_confirmed` is the statement about a scene file,
    /// whose purpose only its owner knows.
    pub fn is_for_training(&self, is_confirmed: bool) -> bool {
        match self {
            Self::Procedural { pool, .. } => *pool == Pool::Train,
            Self::File { .. } => is_confirmed,
        }
    }

    #[tracing::instrument(level = "debug", name = "load_scene", skip_all, fields(scene = name))]
    fn make(&self, name: &str) -> Result<Scene, DatasetError> {
        match self {
            Self::Procedural { seed, rooms, storeys, pool } => {
                let options = HouseOptions { rooms: rooms.clone(), storeys: storeys.clone(), pool: *pool };
                Ok(avln_houses::house(name, *seed, &options))
            }
            Self::File { path } => Ok(Scene { name: name.to_owned(), ..open(path)? }),
        }
    }
}

impl Split {
    /// Returns an empty split.
    pub fn new(name: &str, rules: &Rules) -> Self {
        Self { name: name.to_owned(), rules: rules.name.clone(), scenes: Vec::new(), episodes: Vec::new() }
    }

    /// Adds a scene with drawn missions and returns it, prepared; an error if it is unusable or has no mission.
    pub fn add_scene(
        &mut self,
        name: &str,
        source: SceneSource,
        rules: &Rules,
        options: &MissionOptions,
        cache: Option<&Arc<dyn Cache>>,
    ) -> Result<SceneAssets, DatasetError> {
        let survey = SurveyOptions::default();
        let drawn = DrawnScene::new(name, source, rules, &survey, options, &ThresholdsOnly, cache)?;
        if drawn.episodes.is_empty() {
            return Err(drawn.no_mission());
        }
        self.scenes.push(drawn.spec);
        self.episodes.extend(drawn.episodes);
        Ok(drawn.assets)
    }

    /// Returns the scene called `name`.
    pub fn scene(&self, name: &str) -> Option<&SceneSpec> {
        self.scenes.iter().find(|scene| scene.name == name)
    }
}
