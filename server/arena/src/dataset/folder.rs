use super::files::{self, DatasetFiles};
use crate::{Failure, FailureKind};
use avln_dataset::{
    DatasetError, EpisodeSpec, PublicMission, SceneLine, SceneSpec, Split,
    format::{File, read_missions, read_scene},
};
use std::{
    collections::{BTreeMap, VecDeque},
    path::Path,
    sync::{Arc, Mutex, PoisonError},
};

/// Number of scenes with cached missions.
const SHELF: usize = 16;

/// A split on disk: the scene list is in memory, missions are read per scene on demand.
pub struct SplitFolder {
    files: DatasetFiles,
    /// Name of the split in its data set.
    split: String,
    rules: String,
    digest: String,
    is_sealed: bool,
    missions: usize,
    scenes: Vec<SceneLine>,
    by_name: BTreeMap<String, usize>,
    shelf: Mutex<VecDeque<(usize, Arc<Vec<EpisodeSpec>>)>>,
}

impl SplitFolder {
    /// Opens a split of the data set in `root` and reads the scene list.
    ///
    /// # Errors
    /// If the data set or split is missing, or its files differ from the manifest.
    pub fn open(root: &Path, split: &str) -> Result<Self, Failure> {
        let files = DatasetFiles::at(root);
        let manifest = files.manifest()?;
        let Some(line) = manifest.splits.iter().find(|line| line.name == split) else {
            let known: Vec<_> = manifest.splits.iter().map(|line| line.name.as_str()).collect();
            let message = format!("data set {} has no split '{split}'", root.display());
            return Err(Failure::new(FailureKind::Scene, message)
                .hinted(format!("its splits are: {}", known.join(", "))));
        };
        let (scenes, is_sealed) = (files.scenes(line)?, files.is_sealed(split)?);
        let by_name = scenes.iter().map(|scene| scene.name.clone()).zip(0..).collect();
        Ok(Self {
            files,
            split: line.name.clone(),
            rules: manifest.rules.clone(),
            digest: line.digest.clone(),
            is_sealed,
            missions: line.missions,
            scenes,
            by_name,
            shelf: Mutex::default(),
        })
    }

    /// Name of the rule set under which it was made.
    pub fn rules(&self) -> &str {
        &self.rules
    }

    /// Digest of everything in it.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// Name of the split in its data set.
    pub fn name(&self) -> &str {
        &self.split
    }

    /// Returns true if its files need a passphrase.
    pub fn is_sealed(&self) -> bool {
        self.is_sealed
    }

    /// Mission count.
    pub fn mission_count(&self) -> usize {
        self.missions
    }

    /// Scenes.
    pub fn scenes(&self) -> &[SceneLine] {
        &self.scenes
    }

    /// Specification of the scene `name`.
    pub fn scene(&self, name: &str) -> Option<SceneSpec> {
        self.by_name.get(name).map(|&index| self.scenes[index].spec())
    }

    /// Returns true if `id` can be a mission of `scene`, without reading files.
    pub fn may_hold(&self, scene: &str, id: &str) -> bool {
        self.by_name.contains_key(scene) && scene_of(id) == Some(scene)
    }

    /// Public part of the missions of a scene.
    ///
    /// # Errors
    /// If its file is invalid.
    pub fn public(&self, scene: &SceneLine) -> Result<Vec<PublicMission>, Failure> {
        let path = self.files.missions_path(&self.split, &scene.name);
        let (name, bytes) = (path.display().to_string(), files::read(&path)?);
        Ok(read_missions(File { name: &name, bytes: &bytes }, &scene.name).map_err(DatasetError::from)?)
    }

    /// Missions of a scene, both parts.
    ///
    /// # Errors
    /// If its files are invalid.
    pub fn episodes(&self, scene: &SceneLine) -> Result<Vec<EpisodeSpec>, Failure> {
        let public = self.files.missions_path(&self.split, &scene.name);
        let sealed = self.files.sealed_path(&self.split, &scene.name);
        let (public_bytes, sealed_bytes) = (files::read(&public)?, files::read(&sealed)?);
        let (public, sealed) = (public.display().to_string(), sealed.display().to_string());
        let public = File { name: &public, bytes: &public_bytes };
        let sealed = File { name: &sealed, bytes: &sealed_bytes };
        Ok(read_scene(scene, public, sealed).map_err(DatasetError::from)?)
    }

    /// The mission `id`; `None` if unknown.
    ///
    /// # Errors
    /// If the files of its scene are invalid.
    pub fn episode(&self, id: &str) -> Result<Option<EpisodeSpec>, Failure> {
        let Some(&index) = scene_of(id).and_then(|scene| self.by_name.get(scene)) else { return Ok(None) };
        let episodes = self.shelved(index)?;
        Ok(episodes.iter().find(|episode| episode.id == id).cloned())
    }

    /// The whole split in memory.
    ///
    /// # Errors
    /// When a file cannot be used.
    pub fn load(&self) -> Result<Split, Failure> {
        let mut episodes = Vec::new();
        for scene in &self.scenes {
            episodes.extend(self.episodes(scene)?);
        }
        let scenes = self.scenes.iter().map(SceneLine::spec).collect();
        Ok(Split { name: self.split.clone(), rules: self.rules.clone(), scenes, episodes })
    }

    fn shelved(&self, index: usize) -> Result<Arc<Vec<EpisodeSpec>>, Failure> {
        let lock = || self.shelf.lock().unwrap_or_else(PoisonError::into_inner);
        let found =
            lock().iter().find(|(shelved, _)| *shelved == index).map(|(_, episodes)| episodes.clone());
        if let Some(found) = found {
            return Ok(found);
        }
        let read = Arc::new(self.episodes(&self.scenes[index])?);
        let mut shelf = lock();
        shelf.push_front((index, read.clone()));
        shelf.truncate(SHELF);
        Ok(read)
    }
}

/// The scene that a mission's id names: all before the last `-`.
fn scene_of(id: &str) -> Option<&str> {
    id.rsplit_once('-').map(|(scene, _)| scene)
}
