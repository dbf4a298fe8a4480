use crate::{EpisodeSpec, MissionOptions, sample_missions, survey};
use avln_episode::Rules;
use avln_formats::open::open;
use avln_houses::{HouseOptions, Pool};
use avln_scene::{Scene, SceneError, digest::digest};
use avln_world::{Body, Cache, Cached, PrepareError, SceneAssets};
use serde::{Deserialize, Serialize};
use std::{ops::RangeInclusive, path::PathBuf, sync::Arc};

/// Scenes and the missions in them. Splits are disjoint by scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Split {
    /// Name of the split.
    pub name: String,
    /// The rules under which success regions and references were computed.
    pub rules: String,
    /// The scenes, each with what it takes to make it again.
    pub scenes: Vec<SceneSpec>,
    /// The missions, scene by scene.
    pub episodes: Vec<EpisodeSpec>,
}

/// A scene of a split.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneSpec {
    /// Its name.
    pub name: String,
    /// Where it comes from.
    pub source: SceneSource,
    /// Digest of its content; checked when it is opened again.
    pub digest: String,
}

/// Where a scene comes from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SceneSource {
    /// Grown from a seed.
    Procedural {
        /// The seed.
        seed: u64,
        /// Fewest and most rooms.
        rooms: RangeInclusive<u8>,
        /// Fewest and most storeys; one where a file does not say.
        #[serde(default = "one_storey")]
        storeys: RangeInclusive<u8>,
        /// What its furniture is drawn from; the training pool where a file does not say.
        #[serde(default)]
        pool: Pool,
    },
    /// Read from a file or a folder.
    File {
        /// Where it lies.
        path: PathBuf,
    },
}

/// Why a split could not be made or used.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// A scene could not be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A scene was read, and no body can move in it.
    #[error("scene {scene}: {source}")]
    Prepare {
        /// Its name.
        scene: String,
        /// What is wrong.
        source: PrepareError,
    },
    /// A scene holds no mission that the options allow.
    #[error(
        "scene {scene} holds no mission: {instances} of its {objects} labelled instances can be targets, and no two \
         or more of them are far enough from a start and from each other; use a larger scene or one with more labels"
    )]
    NoMission {
        /// Its name.
        scene: String,
        /// Instances that can be targets.
        instances: usize,
        /// Labelled instances.
        objects: usize,
    },
    /// A scene is not what it was when the split was made.
    #[error(
        "scene {scene} has digest {found}, the split was made with {expected}; restore the file or make the split again"
    )]
    Changed {
        /// Its name.
        scene: String,
        /// Digest now.
        found: String,
        /// Digest then.
        expected: String,
    },
    /// A recipe asks for what cannot be.
    #[error("recipe cannot be used: {reason}")]
    Recipe {
        /// Which field, with its value and what is possible.
        reason: String,
    },
    /// A file of a data set cannot be used.
    #[error(transparent)]
    Format(#[from] crate::format::FormatError),
    /// A split file is not one that this version reads.
    #[error("split file cannot be used: {reason}")]
    Malformed {
        /// What is wrong with it.
        reason: String,
    },
}

impl SceneSpec {
    /// Makes or reads the scene called `name` and notes its digest.
    ///
    /// # Errors
    /// When its file cannot be read.
    pub fn new(name: &str, source: SceneSource) -> Result<(Self, Scene), DatasetError> {
        let scene = source.make(name)?;
        Ok((Self { name: name.to_owned(), source, digest: digest(&scene) }, scene))
    }

    /// Makes or reads the scene again and prepares it for bodies of the rules' size.
    ///
    /// # Errors
    /// When it cannot be read, has changed, or no body can move in it.
    pub fn open(&self, rules: &Rules) -> Result<SceneAssets, DatasetError> {
        self.open_with(rules, None)
    }

    /// [`SceneSpec::open`], with what pictures are made from looked for and kept in `cache` under the scene's digest.
    ///
    /// # Errors
    /// When it cannot be read, has changed, or no body can move in it.
    pub fn open_with(
        &self,
        rules: &Rules,
        cache: Option<&Arc<dyn Cache>>,
    ) -> Result<SceneAssets, DatasetError> {
        let scene = self.source.make(&self.name)?;
        let found = digest(&scene);
        if found != self.digest {
            return Err(DatasetError::Changed {
                scene: self.name.clone(),
                found,
                expected: self.digest.clone(),
            });
        }
        self.prepare(scene, rules, cache)
    }

    /// Prepares `scene`, which is the one meant, for bodies of the rules' size.
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

fn one_storey() -> RangeInclusive<u8> {
    1..=1
}

impl SceneSource {
    fn make(&self, name: &str) -> Result<Scene, DatasetError> {
        match self {
            Self::Procedural { seed, rooms, storeys, pool } => {
                let (rooms, storeys) = (rooms.clone(), storeys.clone());
                let options = HouseOptions { rooms, storeys, pool: *pool };
                Ok(avln_houses::house(name, *seed, &options))
            }
            Self::File { path } => Ok(Scene { name: name.to_owned(), ..open(path)? }),
        }
    }
}

impl Split {
    /// An empty split.
    pub fn new(name: &str, rules: &Rules) -> Self {
        Self { name: name.to_owned(), rules: rules.name.clone(), scenes: Vec::new(), episodes: Vec::new() }
    }

    /// Adds a scene and missions drawn in it; gives back the prepared scene. What its pictures are made from is looked for
    /// and kept in `cache`.
    ///
    /// # Errors
    /// When the scene cannot be used or holds no mission.
    pub fn add_scene(
        &mut self,
        name: &str,
        source: SceneSource,
        rules: &Rules,
        options: &MissionOptions,
        cache: Option<&Arc<dyn Cache>>,
    ) -> Result<SceneAssets, DatasetError> {
        let (spec, scene) = SceneSpec::new(name, source)?;
        let assets = spec.prepare(scene, rules, cache)?;
        let instances = survey(&assets, rules);
        let episodes = sample_missions(&assets, &instances, rules, options);
        if episodes.is_empty() {
            let objects = assets.scene.objects.len();
            return Err(DatasetError::NoMission {
                scene: name.to_owned(),
                instances: instances.len(),
                objects,
            });
        }
        self.scenes.push(spec);
        self.episodes.extend(episodes);
        Ok(assets)
    }

    /// The scene that an episode plays in.
    pub fn scene(&self, name: &str) -> Option<&SceneSpec> {
        self.scenes.iter().find(|scene| scene.name == name)
    }
}
