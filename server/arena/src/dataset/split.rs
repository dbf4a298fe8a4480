//! A split on disk: missions with their ground truth, read scene by scene, and knowledge about the seed.

use super::{DatasetFiles, parsed, read};
use crate::{Failure, lru::LruCache};
use avln_dataset::{
    EpisodeSpec, Manifest, PublicMission, SceneLine, SceneMissions, SceneSource, SceneSpec, SecretFile,
    Split,
    format::{File, digest_of, read_missions, read_scene},
};
use avln_episode::{Order, Rules};
use avln_store::Visibility;
use avln_truth::EpisodeTruth;
use avln_world::SceneAssets;
use std::{collections::BTreeMap, path::Path, sync::Arc};

/// Knowledge about a split's seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KnownSeed {
    /// 256 secret bits.
    Secret,
    /// A number, or houses of a number that is not recorded.
    Number(Option<u64>),
    /// No procedural houses and no recorded seed, such as imported missions.
    None,
}

impl KnownSeed {
    fn of(manifest: &Manifest, scenes: &[SceneLine]) -> Self {
        let seed = manifest.seed.or_else(|| manifest.recipe.as_ref().and_then(|recipe| recipe.seed));
        let is_house = |scene: &SceneLine| matches!(scene.source, SceneSource::Procedural { .. });
        if seed.is_some() || scenes.iter().any(is_house) { Self::Number(seed) } else { Self::None }
    }

    /// Fails for a number. `missions` names the hidden missions in the message.
    ///
    /// Anyone can generate the missions of all small numbers, and compare them with an observation.
    pub fn check_secret(self, missions: &str) -> Result<(), Failure> {
        let Self::Number(seed) = self else { return Ok(()) };
        let number = seed.map_or_else(|| "a number".to_owned(), |seed| format!("the number {seed}"));
        Err(Failure::scene(format!(
            "{missions} cannot be hidden: they were drawn with {number}, which participants can guess"
        ))
        .hinted("make a split with a secret seed: avln data split make NAME, without --seed"))
    }
}

const CACHED_SCENES: usize = 16;

/// A split on disk. Missions are read per scene on demand.
pub struct SplitFolder {
    files: DatasetFiles,
    /// Name in the data set.
    split: String,
    rules: String,
    digest: String,
    is_sealed: bool,
    seed: KnownSeed,
    missions: usize,
    scenes: Vec<SceneLine>,
    by_name: BTreeMap<String, usize>,
    cache: LruCache<usize, SceneMissions>,
}

impl SplitFolder {
    /// Opens a split and reads the scene list.
    pub fn open(root: &Path, split: &str) -> Result<Self, Failure> {
        let files = DatasetFiles::at(root);
        let manifest = files.manifest()?;
        let Some(line) = manifest.splits.iter().find(|line| line.name == split) else {
            let known: Vec<_> = manifest.splits.iter().map(|line| line.name.as_str()).collect();
            return Err(files.missing(split).hinted(format!("its splits are: {}", known.join(", "))));
        };
        let (scenes, is_sealed) = (files.scenes(line)?, files.is_sealed(split)?);
        let seed = if files.secret_path(split).is_file() {
            KnownSeed::Secret
        } else {
            KnownSeed::of(&manifest, &scenes)
        };
        let by_name = scenes.iter().map(|scene| scene.name.clone()).zip(0..).collect();
        Ok(Self {
            files,
            split: line.name.clone(),
            rules: manifest.rules.clone(),
            digest: line.digest.clone(),
            is_sealed,
            seed,
            missions: line.missions,
            scenes,
            by_name,
            cache: LruCache::new(CACHED_SCENES, |_| 1),
        })
    }

    /// Returns the rule set's name.
    pub fn rules(&self) -> &str {
        &self.rules
    }

    /// Returns the digest over all files.
    pub fn digest(&self) -> &str {
        &self.digest
    }

    /// Name in the data set.
    pub fn name(&self) -> &str {
        &self.split
    }

    /// Returns true if the files need a passphrase.
    pub fn is_sealed(&self) -> bool {
        self.is_sealed
    }

    /// Reads the secret and recipe of a secret split; `None` for other splits.
    pub fn secret(&self) -> Result<Option<SecretFile>, Failure> {
        self.files.secret(&self.split)
    }

    /// Returns the mission count.
    pub fn mission_count(&self) -> usize {
        self.missions
    }

    /// Returns the scenes.
    pub fn scenes(&self) -> &[SceneLine] {
        &self.scenes
    }

    /// Returns a scene's specification.
    pub fn scene(&self, name: &str) -> Option<SceneSpec> {
        self.by_name.get(name).map(|&index| self.scenes[index].spec())
    }

    /// Returns true if `id` can be a mission in `scene`; reads no files.
    pub fn may_hold(&self, scene: &str, id: &str) -> bool {
        self.by_name.contains_key(scene) && scene_of(id) == Some(scene)
    }

    /// Reads a scene's missions, the public part.
    pub fn public(&self, scene: &SceneLine) -> Result<Vec<PublicMission>, Failure> {
        let path = self.files.missions_path(&self.split, &scene.name);
        parsed(&path, &read(&path)?, |file| read_missions(file, &scene.name))
    }

    /// Reads a scene's missions, both parts.
    pub fn episodes(&self, scene: &SceneLine) -> Result<Vec<EpisodeSpec>, Failure> {
        let public = self.files.missions_path(&self.split, &scene.name);
        let sealed = self.files.sealed_path(&self.split, &scene.name);
        let (public_bytes, sealed_bytes) = (read(&public)?, read(&sealed)?);
        parsed(&public, &public_bytes, |public| {
            let name = sealed.display().to_string();
            read_scene(scene, public, File { name: &name, bytes: &sealed_bytes })
        })
    }

    /// Compares all files with the digests in the scene list; fails at the first difference.
    pub fn check_files(&self) -> Result<(), Failure> {
        for scene in &self.scenes {
            let public = (self.files.missions_path(&self.split, &scene.name), &scene.public);
            let sealed = (self.files.sealed_path(&self.split, &scene.name), &scene.sealed);
            for (path, digest) in [public, sealed] {
                let found = digest_of(&read(&path)?);
                if found != *digest {
                    let message =
                        format!("{} has digest {found}, but the scene list has {digest}", path.display());
                    return Err(Failure::scene(message).hinted("restore the split's files from a backup"));
                }
            }
        }
        Ok(())
    }

    /// Returns a mission; `None` if unknown.
    pub fn episode(&self, id: &str) -> Result<Option<EpisodeSpec>, Failure> {
        let scene = self.scene_of_mission(id)?;
        Ok(scene.and_then(|missions| missions.episodes().iter().find(|episode| episode.id == id).cloned()))
    }

    /// Loads all missions.
    pub fn load(&self) -> Result<Split, Failure> {
        let mut episodes = Vec::new();
        for scene in &self.scenes {
            episodes.extend(self.episodes(scene)?);
        }
        let scenes = self.scenes.iter().map(SceneLine::spec).collect();
        Ok(Split { name: self.split.clone(), rules: self.rules.clone(), scenes, episodes })
    }

    /// Rejects hidden scores or replays of a split that participants can generate.
    pub(crate) fn check_seed(&self, scores: Visibility, replays: Visibility) -> Result<(), Failure> {
        if [scores, replays] == [Visibility::Public; 2] {
            return Ok(());
        }
        self.seed.check_secret(&format!("the missions of split '{}'", self.split))
    }

    /// Returns a mission's ground truth, with the distractor sources of `rules`.
    pub fn truth(
        &self,
        episode: &EpisodeSpec,
        order: Order,
        rules: &Rules,
        assets: &SceneAssets,
    ) -> Result<EpisodeTruth, Failure> {
        // The other missions of the scene are read only if they are needed.
        let count = rules.distractor_sources.count(episode.goals.len());
        let scene = if count > 0 { self.scene_of_mission(&episode.id)? } else { None };
        Ok(scene.map_or_else(|| episode.truth(order), |scene| scene.truth(episode, order, rules, assets)))
    }

    /// Rejects rules with more distractor sources than a mission's scene has other targets.
    pub fn check_distractors(&self, rules: &Rules) -> Result<(), Failure> {
        if rules.distractor_sources.count(1) == 0 {
            return Ok(());
        }
        for scene in self.scenes() {
            let missions = SceneMissions::new(self.episodes(scene)?);
            for episode in missions.episodes() {
                let needed = rules.distractor_sources.count(episode.goals.len());
                let found = missions.distractor_candidates(episode);
                if found < needed {
                    return Err(too_few(&rules.name, &episode.id, needed, found));
                }
            }
        }
        Ok(())
    }

    /// Returns all missions in a mission's scene; `None` if unknown.
    fn scene_of_mission(&self, id: &str) -> Result<Option<Arc<SceneMissions>>, Failure> {
        let Some(&index) = scene_of(id).and_then(|scene| self.by_name.get(scene)) else { return Ok(None) };
        let (episodes, _) =
            self.cache.get(index, || self.episodes(&self.scenes[index]).map(SceneMissions::new))?;
        Ok(Some(episodes))
    }
}

fn too_few(rules: &str, episode: &str, needed: usize, found: usize) -> Failure {
    let message = format!(
        "rules '{rules}' need {needed} distractor sources in mission {episode}, but its scene has {found} other targets"
    );
    Failure::scene(message).hinted("make a split with more missions per scene, or use the rules lh-avln-v1")
}

/// Returns the scene in a mission id: the part before the last `-`.
fn scene_of(id: &str) -> Option<&str> {
    id.rsplit_once('-').map(|(scene, _)| scene)
}
