//! Hosted phases, reloaded after changes by the organiser.

use crate::{
    BENCHMARK_VERSION, Failure, budget::scene_allowance, data::DataFolder, dataset::SplitFolder, ids,
    lru::LruCache, now_unix_ms, run_blocking,
};
use avln_dataset::{DatasetError, EpisodeSpec, SceneSource, SceneSpec};
use avln_episode::{Order, Rules};
use avln_geom::Point3;
use avln_referee::Audio;
use avln_store::{Phase, PhaseEpisode, Run, Scene, SceneMap, Store, Visibility};
use avln_truth::EpisodeTruth;
use avln_world::{Cache, SceneAssets};
use std::{collections::BTreeMap, sync::Arc};
use tokio::sync::Mutex;

pub(crate) struct HostedPhase {
    pub(crate) settings: Phase,
    pub(crate) split: Arc<SplitFolder>,
    /// Bytes charged for the scene of an open episode.
    pub(crate) scene_allowance: usize,
    pub(crate) audio: Audio,
}

/// All phases in the organiser's order.
pub(crate) type PhaseList = Arc<Vec<Arc<HostedPhase>>>;

pub(crate) fn find_phase(phases: &PhaseList, id: &str) -> Option<Arc<HostedPhase>> {
    phases.iter().find(|phase| phase.settings.id == id).cloned()
}

pub(crate) struct PhaseCatalog {
    pub(crate) data: DataFolder,
    /// Id of the only hosted phase; `None` for all phases.
    only: Option<String>,
    /// Newest audit entry at the last reading, and the phases.
    read: Mutex<(i64, PhaseList)>,
}

impl PhaseCatalog {
    /// Reads all phases, or only the phase `only`. Splits of other phases are not opened.
    pub(crate) async fn open(data: &DataFolder, store: &Store, only: Option<&str>) -> Result<Self, Failure> {
        // Before the phases: a change during the reading leads to another reading.
        let change = store.newest_audit_id().await?;
        let mut phases = Vec::new();
        for phase in committed(store, only).await? {
            phases.push(Arc::new(HostedPhase::read(data, phase, &[])?));
        }
        let only = only.map(str::to_owned);
        Ok(Self { data: data.clone(), only, read: Mutex::new((change, Arc::new(phases))) })
    }

    /// Returns false for a phase that this catalog leaves to other servers.
    pub(crate) fn selects(&self, phase: &str) -> bool {
        self.only.as_deref().is_none_or(|only| only == phase)
    }

    /// Returns the present phases. If a changed phase cannot be hosted, the previous version stays.
    pub(crate) async fn now(&self, store: &Store) -> Result<PhaseList, Failure> {
        let mut read = self.read.lock().await;
        // Every change by the organiser adds an audit entry, so the newest id is a cheap change counter.
        let change = store.newest_audit_id().await?;
        if change != read.0 {
            *read = (change, self.reload(store, &read.1).await?);
        }
        Ok(read.1.clone())
    }

    async fn reload(&self, store: &Store, before: &PhaseList) -> Result<PhaseList, Failure> {
        let phases = committed(store, self.only.as_deref()).await?;
        let (data, before) = (self.data.clone(), before.clone());
        run_blocking(move || {
            let reloaded = phases.into_iter().filter_map(|phase| reload_phase(&data, phase, &before));
            Ok(Arc::new(reloaded.collect()))
        })
        .await
    }
}

fn reload_phase(data: &DataFolder, phase: Phase, before: &[Arc<HostedPhase>]) -> Option<Arc<HostedPhase>> {
    let previous = before.iter().find(|hosted| hosted.settings.id == phase.id);
    if let Some(unchanged) = previous.filter(|hosted| hosted.settings == phase) {
        return Some(unchanged.clone());
    }
    let id = phase.id.clone();
    match HostedPhase::read(data, phase, before) {
        Ok(hosted) => Some(Arc::new(hosted)),
        Err(failure) => {
            tracing::error!(phase = id, %failure, "cannot host a changed phase; the previous version stays");
            previous.cloned()
        }
    }
}

/// Returns all phases, or only the phase `only`, committed to episodes, scorer and a secret.
async fn committed(store: &Store, only: Option<&str>) -> Result<Vec<Phase>, Failure> {
    let mut phases = store.phases().await?;
    phases.retain(|phase| only.is_none_or(|only| phase.id == only));
    for phase in &phases {
        commit(store, &phase.id).await?;
    }
    Ok(phases)
}

/// Commits a phase to episodes, scorer and a secret, unless already committed.
pub(crate) async fn commit(store: &Store, phase: &str) -> Result<(), Failure> {
    let random = || ids::random_hex().map_err(Failure::internal);
    let new_secret = random()? + &random()?;
    store.commit_phase(phase, &new_secret, BENCHMARK_VERSION, now_unix_ms()).await?;
    Ok(())
}

/// Returns the seed file of a phase's split, to be published with the commitment; `None` unless the split is secret.
pub async fn seed_to_publish(
    data: &DataFolder,
    store: &Store,
    phase: &str,
) -> Result<Option<serde_json::Value>, Failure> {
    let seed = data.missions(&store.phase(phase).await?.split)?.secret()?;
    seed.map(serde_json::to_value).transpose().map_err(Failure::internal)
}

impl HostedPhase {
    /// Reads a phase; open splits are reused from `before`.
    pub(crate) fn read(data: &DataFolder, settings: Phase, before: &[Arc<Self>]) -> Result<Self, Failure> {
        let split = match before.iter().find(|hosted| hosted.settings.split == settings.split) {
            Some(hosted) => hosted.split.clone(),
            None => {
                let split = data.missions(&settings.split)?;
                // At the start: a damaged file would otherwise interrupt the runs that reach its scene.
                split.check_files()?;
                Arc::new(split)
            }
        };
        let unknown = |episode: &&PhaseEpisode| !split.may_hold(&episode.scene, &episode.episode);
        if let Some(missing) = settings.episodes.iter().find(unknown) {
            let Phase { id, split, .. } = &settings;
            let message =
                format!("phase '{id}' lists episode {}, but split '{split}' has none", missing.episode);
            return Err(Failure::scene(message).hinted("restore the split's files from a backup"));
        }
        if let Err(failure) = split.check_seed(settings.scores, settings.replays) {
            tracing::warn!(phase = settings.id, %failure, "a hidden phase can be guessed");
        }
        let audio = data.audio(&settings.rules)?;
        let scene_allowance = scene_allowance(&split);
        Ok(Self { settings, split, scene_allowance, audio })
    }

    /// Returns the mission `id`, from the cache or the scene's files.
    pub(crate) fn episode(&self, id: &str) -> Result<EpisodeSpec, Failure> {
        let missing = || Failure::scene(format!("no episode {id} in split '{}'", self.settings.split));
        self.split.episode(id)?.ok_or_else(missing)
    }

    /// Returns a mission's ground truth for the phase's rules.
    pub(crate) fn truth(
        &self,
        episode: &EpisodeSpec,
        order: Order,
        assets: &SceneAssets,
    ) -> Result<EpisodeTruth, Failure> {
        self.split.truth(episode, order, self.rules(), assets)
    }

    /// Returns an episode's scene file size, bytes; 0 if missing or not accessible.
    pub(crate) fn scene_file_bytes(&self, episode: &str) -> Result<u64, Failure> {
        let scene = self.episode(episode)?.scene;
        let source = self.split.scene(&scene).map(|spec| spec.source);
        let Some(SceneSource::File { path }) = source else { return Ok(0) };
        Ok(std::fs::metadata(path).map_or(0, |file| file.len()))
    }

    /// Returns the scene `name`, prepared for the rules, and a new scene's map.
    pub(crate) fn scene(
        &self,
        name: &str,
        scenes: &SceneCache,
    ) -> Result<(Arc<SceneAssets>, Option<Scene>), Failure> {
        let missing = || Failure::scene(format!("no scene {name} in split '{}'", self.settings.split));
        let spec = self.split.scene(name).ok_or_else(missing)?;
        let (assets, is_new) = scenes.get(&spec, self.rules())?;
        let map = is_new.then(|| map_of(&assets));
        Ok((assets, map.map(|map| Scene { name: spec.name, digest: spec.digest, map })))
    }

    pub(crate) fn rules(&self) -> &Rules {
        &self.settings.rules
    }

    /// Returns true if agents receive metrics.
    pub(crate) fn shows_metrics(&self) -> bool {
        // Path lengths reveal target positions, so metrics require visible replays too.
        ![self.settings.scores, self.settings.replays].contains(&Visibility::Organiser)
    }

    /// Returns the digests and versions for a run's record.
    pub(crate) fn digests(&self) -> BTreeMap<String, String> {
        let digests = [
            ("benchmark", BENCHMARK_VERSION.to_owned()),
            ("server", env!("CARGO_PKG_VERSION").to_owned()),
            (Run::SPLIT, self.split.digest().to_owned()),
            ("config", self.config_digest()),
        ];
        digests.into_iter().map(|(name, digest)| (name.to_owned(), digest)).collect()
    }

    /// Compares a run's digests `names` with the present ones; the error describes a difference.
    pub(crate) fn check_digests(
        &self,
        then: &BTreeMap<String, String>,
        names: &[&str],
    ) -> Result<(), String> {
        let now = self.digests();
        let Some(name) = names.iter().find(|name| then.get(**name) != now.get(**name)) else { return Ok(()) };
        let word = |digests: &BTreeMap<String, String>| digests.get(*name).cloned().unwrap_or_default();
        Err(format!("the run was played with {name} '{}'; here it is '{}'", word(then), word(&now)))
    }

    pub(crate) fn config_digest(&self) -> String {
        let rules = serde_json::to_vec(self.rules()).unwrap_or_default();
        blake3::hash(&rules).to_hex().to_string()
    }
}

/// Returns the floor plan for pages.
pub(crate) fn map_of(assets: &SceneAssets) -> SceneMap {
    let bounds = assets.scene.bounds();
    let corner = |point: Point3<f32>| [point.x, point.y, point.z];
    let polygons = assets.navmesh.polygons();
    SceneMap {
        min: bounds.map_or([0.0; 3], |b| corner(b.min)),
        max: bounds.map_or([0.0; 3], |b| corner(b.max)),
        polygons: polygons.into_iter().map(|polygon| polygon.into_iter().map(corner).collect()).collect(),
    }
}

/// Prepared scenes by digest and rules.
pub(crate) struct SceneCache {
    memory: LruCache<(String, String), SceneAssets>,
    disk: Arc<dyn Cache>,
}

impl SceneCache {
    /// Creates a cache with `budget_bytes` in memory; `disk` stores render data.
    pub(crate) fn new(budget_bytes: usize, disk: Arc<dyn Cache>) -> Self {
        Self { memory: LruCache::new(budget_bytes, SceneAssets::resident_bytes), disk }
    }

    /// Returns the scenes' total size, bytes.
    pub(crate) fn bytes(&self) -> usize {
        self.memory.bytes()
    }

    /// Returns a scene, prepared for the rules' body, and true if it was prepared now, with much processor time.
    pub(crate) fn get(
        &self,
        scene: &SceneSpec,
        rules: &Rules,
    ) -> Result<(Arc<SceneAssets>, bool), DatasetError> {
        let key = (scene.digest.clone(), rules.name.clone());
        self.memory.get(key, || scene.open_with(rules, Some(&self.disk)))
    }
}
