//! Setup: splits, phases and teams.

use crate::{
    Failure, actions,
    challenge::{
        self, SOUND_SHARES,
        overlap::{Content, REMEDY, overlaps},
    },
    data::{DataFolder, check_name},
    dataset::SplitFolder,
    now_unix_ms,
    phases::{commit, map_of},
    run_blocking,
};
use avln_dataset::{
    BuiltScene, MissionOptions, MissionRules, PublicGoal, PublicMission, Recipe, SceneChoice, SceneFacts,
    SceneLine, SceneSource, Seed, Split, SplitRecipe, SplitSecret, SurveyOptions, build_scene,
};
use avln_episode::{FeedbackRule, HeadRule, Modality, Rules, Sensors, Sounds};
use avln_houses::{HouseOptions, Pool};
use avln_store::{
    GoalText, Phase, PhaseEpisode, QuotaLimits, Reference, Sampling, Scene, SceneMap, Store, StoreError,
    Visibility,
};
use avln_world::Cache;
use std::{
    path::{Path, PathBuf},
    sync::Arc,
};

/// A new split.
#[derive(Clone, Debug)]
pub struct NewSplit {
    /// Split name.
    pub name: String,
    /// Procedural houses, if `scenes` is empty.
    pub houses: u32,
    /// Scene files or folders.
    pub scenes: Vec<PathBuf>,
    /// Missions per scene.
    pub missions: usize,
    /// Seed for houses and missions.
    pub seed: Seed,
    /// Rule set.
    pub rules: String,
}

/// New or changed phase settings.
#[derive(Clone, Debug)]
pub struct NewPhase {
    /// Id, used in URLs and by agents.
    pub id: String,
    /// Split name.
    pub split: String,
    /// Data set folder; `None` for a split in the data folder.
    pub dataset: Option<PathBuf>,
    /// Heading on pages; the id if `None`.
    pub title: Option<String>,
    /// Score visibility.
    pub scores: Visibility,
    /// Visibility for paths, maps and targets.
    pub replays: Visibility,
    /// Rule set; by default the split's.
    pub rules: Option<String>,
    /// Target clips: a share (`all`, `train`, `validation`, `test`) or a folder with recordings.
    pub sounds: Option<String>,
    /// SOFA file with a measured head; a sphere if `None`.
    pub head: Option<PathBuf>,
    /// Feedback to a Submit; by default the rule set's.
    pub feedback: Option<FeedbackRule>,
    /// Charged runs per team; unlimited if `None`.
    pub quota: Option<u32>,
    /// Concurrent runs per team; unlimited if `None`.
    pub concurrent: Option<u32>,
    /// Uncharged runs per team; unlimited if `None`.
    pub uncharged: Option<u32>,
    /// Limit for parallel episodes.
    pub max_slots: u32,
    /// Largest picture side, pixels.
    pub max_side: u32,
}

impl NewPhase {
    /// Returns a public phase with the split's rules and sounds.
    pub fn public(id: &str, split: &str) -> Self {
        Self {
            id: id.to_owned(),
            split: split.to_owned(),
            dataset: None,
            title: None,
            scores: Visibility::Public,
            replays: Visibility::Public,
            rules: None,
            sounds: None,
            head: None,
            feedback: None,
            quota: None,
            concurrent: None,
            uncharged: None,
            max_slots: 16,
            max_side: 512,
        }
    }
}

/// Admits a team and returns a new account token. A team with a reference kind does not compete.
pub async fn admit(store: &Store, name: &str, reference: Option<Reference>) -> Result<String, Failure> {
    Ok(actions::admit(store, name, reference, now_unix_ms()).await?)
}

/// Makes, saves and registers a split. `report` receives a line per scene.
pub async fn make_split(
    data: &DataFolder,
    store: &Store,
    new: NewSplit,
    report: impl Fn(String) + Send + 'static,
) -> Result<Split, Failure> {
    check_name("split", &new.name)?;
    let (name, folder) = (new.name.clone(), data.clone());
    let maps = run_blocking(move || match new.seed {
        Seed::Number(seed) => make_numbered(&folder, &new, seed, report),
        Seed::Secret(ref secret) => make_secret(&folder, new.recipe(secret), report),
    });
    let maps = maps.await?;
    register_split(store, &name, &data.missions(&name)?, &maps).await?;
    data.split(&name)
}

/// Makes a split whose houses and missions anyone can repeat; returns the scenes' maps.
fn make_numbered(
    data: &DataFolder,
    new: &NewSplit,
    seed: u64,
    report: impl Fn(String),
) -> Result<Vec<SceneMap>, Failure> {
    let (split, maps) = build_split(new, seed, &data.cache(), report)?;
    data.save_split(&split, seed)?;
    Ok(maps)
}

/// Makes the only split of `recipe`; maps follow when a scene is first played.
fn make_secret(data: &DataFolder, recipe: Recipe, report: impl Fn(String)) -> Result<Vec<SceneMap>, Failure> {
    recipe.check()?;
    let files = data.new_split(&recipe.splits[0].name)?;
    let cache = data.cache();
    let scenes = recipe.jobs().map(|job| {
        let built = build_scene(&recipe, job, Some(&cache))?;
        report(described(&built));
        Ok(built)
    });
    let scenes = scenes.collect::<Result<Vec<_>, Failure>>()?;
    files.write_built(&recipe, &[scenes])?;
    Ok(Vec::new())
}

fn described(built: &BuiltScene) -> String {
    let SceneLine { name, missions, facts, .. } = &built.line;
    let SceneFacts { objects, area_m2, .. } = facts.unwrap_or_default();
    format!("  {name}: {objects} objects, {area_m2:.0} m2 to walk on, {missions} missions")
}

impl NewSplit {
    /// Returns the recipe for a secret split: equal houses and missions as with a number.
    fn recipe(&self, secret: &SplitSecret) -> Recipe {
        let HouseOptions { rooms, storeys, pool } = HouseOptions::small();
        let houses = SceneChoice::Houses {
            count: self.houses,
            rooms: [*rooms.start(), *rooms.end()],
            storeys: [*storeys.start(), *storeys.end()],
            pool: pool.name().to_owned(),
        };
        let scenes = if self.scenes.is_empty() { houses } else { SceneChoice::Files(self.scenes.clone()) };
        let split = SplitRecipe {
            name: self.name.clone(),
            scenes,
            missions_per_scene: self.missions,
            missions: None,
            secret: Some(secret.clone()),
        };
        Recipe {
            name: "secret".to_owned(),
            rules: self.rules.clone(),
            seed: None,
            missions: MissionRules::default(),
            survey: SurveyOptions::default(),
            verifier: None,
            splits: vec![split],
        }
    }
}

fn build_split(
    new: &NewSplit,
    seed: u64,
    cache: &Arc<dyn Cache>,
    report: impl Fn(String),
) -> Result<(Split, Vec<SceneMap>), Failure> {
    let rules = Rules::named(&new.rules).map_err(Failure::scene)?;
    let mut split = Split::new(&new.name, &rules);
    let mut maps = Vec::new();
    for (index, (name, source)) in scene_sources(new, seed)?.into_iter().enumerate() {
        let missions = MissionOptions::new(new.missions, seed.wrapping_add(index as u64));
        let before = split.episodes.len();
        let assets = split.add_scene(&name, source, &rules, &missions, Some(cache))?;
        report(format!(
            "  {name}: {} triangles, {} objects, {:.0} m2 to walk on, {} missions",
            assets.scene.mesh.triangles.len(),
            assets.scene.objects.len(),
            assets.navmesh.area_m2(),
            split.episodes.len() - before,
        ));
        maps.push(map_of(&assets));
    }
    Ok((split, maps))
}

/// Returns names and sources: the given files, or procedural houses by seed.
fn scene_sources(new: &NewSplit, seed: u64) -> Result<Vec<(String, SceneSource)>, Failure> {
    if !new.scenes.is_empty() {
        return new.scenes.iter().map(|path| file_source(&new.name, path)).collect();
    }
    let house = |number: u32| {
        let seed = seed.wrapping_mul(1000).wrapping_add(u64::from(number));
        let HouseOptions { rooms, storeys, pool } = HouseOptions::small();
        let source = SceneSource::Procedural { seed, rooms, storeys, pool };
        (format!("{}-house-{number:03}", new.name), source)
    };
    Ok((0..new.houses).map(house).collect())
}

fn file_source(split: &str, path: &Path) -> Result<(String, SceneSource), Failure> {
    let path = path.canonicalize().map_err(|error| {
        Failure::scene(format!("cannot find scene {}: {error}", path.display()))
            .hinted("name a .glb or .gltf file, or the folder of a scene")
    })?;
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let fits = |letter: &char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
    let name = format!("{split}-{}", stem.chars().filter(fits).take(40).collect::<String>());
    Ok((name, SceneSource::File { path }))
}

/// Opens or changes a phase.
pub async fn open_phase(data: &DataFolder, store: &Store, new: &NewPhase) -> Result<Phase, Failure> {
    check_name("phase", &new.id)?;
    let name = match &new.dataset {
        Some(dataset) => data.link_split(dataset, &new.split)?,
        None => new.split.clone(),
    };
    let split = data.missions(&name)?;
    split.check_seed(new.scores, new.replays)?;
    if new.dataset.is_some() {
        register_split(store, &name, &split, &[]).await?;
    }
    let mut rules = rules_for_phase(rules_of(&name, &split)?, new.rules.as_deref())?;
    rules.sounds = sounds_for_phase(data, new.sounds.as_deref(), &split)?;
    if let Some(file) = &new.head {
        rules.head = HeadRule::Measured(data.heads().import(file)?);
    }
    if let Some(feedback) = new.feedback {
        rules.feedback = feedback;
    }
    let phases = store.phases().await?;
    let before = phases.iter().find(|before| before.id == new.id);
    let drawn = Sampling { shuffle: new.replays != Visibility::Public, sample: None };
    let phase = Phase {
        title: new.title.clone().unwrap_or_else(|| new.id.clone()),
        sensors: Sensors::all(new.max_side, new.max_side),
        scores: new.scores,
        replays: new.replays,
        max_slots: new.max_slots,
        quotas: QuotaLimits {
            total: new.quota,
            concurrent: new.concurrent,
            uncharged: new.uncharged,
            ..QuotaLimits::default()
        },
        sampling: fixed(store, before).await?.map_or(drawn, |before| before.sampling),
        ..Phase::new(&new.id, &name, rules, phase_episodes(&split)?)
    };
    if phase.episodes.is_empty() {
        return Err(Failure::scene(format!("split '{name}' has no episodes")));
    }
    check_sounds(data, &phase)?;
    split.check_distractors(&phase.rules)?;
    store.published_splits().await?.check(&phase, split.digest(), now_unix_ms())?;
    check_overlap(data, &phases, &phase)?;
    let notes = challenge::notes(&challenge::actor(), before, &phase, "");
    store.change_phases(std::slice::from_ref(&phase), &notes, now_unix_ms()).await?;
    commit(store, &phase.id).await?;
    Ok(phase)
}

/// Returns the phase if it has runs, which fix its episodes and their draw.
pub(crate) async fn fixed<'a>(
    store: &Store,
    phase: Option<&'a Phase>,
) -> Result<Option<&'a Phase>, StoreError> {
    let Some(phase) = phase else { return Ok(None) };
    Ok(store.has_runs(&phase.id).await?.then_some(phase))
}

/// Rejects a hidden phase with scenes or missions of a public one, and the reverse. An overlap from before is only logged.
fn check_overlap(data: &DataFolder, before: &[Phase], phase: &Phase) -> Result<(), Failure> {
    let others = before.iter().filter(|other| other.id != phase.id);
    let after: Vec<Phase> = others.chain([phase]).cloned().collect();
    for overlap in overlaps(&after, now_unix_ms(), |split| Content::of(&data.missions(split)?))? {
        if !overlap.is_old(before) {
            return Err(Failure::scene(overlap).hinted(REMEDY));
        }
        tracing::warn!("{overlap}; {REMEDY}");
    }
    Ok(())
}

/// Returns the target clips for a share or a folder; by default the split pool's share.
pub fn sounds_for_phase(
    data: &DataFolder,
    choice: Option<&str>,
    split: &SplitFolder,
) -> Result<Sounds, Failure> {
    let Some(choice) = choice else { return Ok(sounds_of_pool(split)) };
    match SOUND_SHARES.into_iter().find(|(word, _)| *word == choice) {
        Some((_, share)) => Ok(share),
        None => data.sounds().import(Path::new(choice)).map(Sounds::Own),
    }
}

/// Returns the share for a split's house pool.
fn sounds_of_pool(split: &SplitFolder) -> Sounds {
    let of = |scene: &SceneLine| match scene.source {
        SceneSource::Procedural { pool: Pool::Train, .. } => Sounds::Train,
        SceneSource::Procedural { pool: Pool::Validation, .. } => Sounds::Validation,
        SceneSource::Procedural { pool: Pool::Test, .. } => Sounds::Test,
        SceneSource::File { .. } => Sounds::All,
    };
    // Test clips must not occur in training, so a split with one pool plays only the clips of that pool.
    let first = split.scenes().first().map_or(Sounds::All, of);
    if split.scenes().iter().all(|scene| of(scene) == first) { first } else { Sounds::All }
}

/// Rejects a bank with too few clips for an episode.
pub(crate) fn check_sounds(data: &DataFolder, phase: &Phase) -> Result<(), Failure> {
    let targets = phase.episodes.iter().map(|episode| episode.goals.len()).max().unwrap_or(0);
    let found = data.bank(&phase.rules.sounds)?.len();
    let needed = phase.rules.clips_of_episode(targets);
    if found >= needed {
        return Ok(());
    }
    let message = format!("rules '{}' need {needed} clips, but the bank has {found}", phase.rules.name);
    Err(Failure::data(message).hinted("add recordings, or omit --sounds"))
}

/// Returns the rule set `name`, by default the split's. The two may differ only in noise, sounds and claims.
pub(crate) fn rules_for_phase(of_split: Rules, name: Option<&str>) -> Result<Rules, Failure> {
    let Some(name) = name else { return Ok(of_split) };
    let rules = Rules::named(name).map_err(Failure::scene)?;
    if rules.fits_episodes_of(&of_split) {
        return Ok(rules);
    }
    let message = format!(
        "rule set '{name}' and the split's '{}' differ in more than noise, sounds and claims",
        of_split.name
    );
    Err(Failure::scene(message).hinted("make a split with: avln data split make NAME --rules RULES"))
}

/// Stores a split with scenes. Missing maps follow when a scene is first played.
pub async fn register_split(
    store: &Store,
    name: &str,
    split: &SplitFolder,
    maps: &[SceneMap],
) -> Result<(), Failure> {
    for (index, scene) in split.scenes().iter().enumerate() {
        let map = maps.get(index).cloned().unwrap_or_default();
        let row = Scene { name: scene.name.clone(), digest: scene.digest.clone(), map };
        store.upsert_scene(&row).await?;
    }
    let row = avln_store::Split {
        name: name.to_owned(),
        digest: split.digest().to_owned(),
        scenes: split.scenes().len() as u32,
        episodes: split.mission_count() as u32,
    };
    Ok(store.upsert_split(&row).await?)
}

/// Lists a split's episodes for a phase.
pub fn phase_episodes(split: &SplitFolder) -> Result<Vec<PhaseEpisode>, Failure> {
    let mut episodes = Vec::with_capacity(split.mission_count());
    for scene in split.scenes() {
        let episode = |mission: PublicMission| PhaseEpisode {
            episode: mission.id,
            scene: scene.name.clone(),
            goals: mission.goals.into_iter().map(goal_text).collect(),
        };
        episodes.extend(split.public(scene)?.into_iter().map(episode));
    }
    Ok(episodes)
}

fn goal_text(goal: PublicGoal) -> GoalText {
    let (modality, text) = match goal {
        PublicGoal::Category(label) => (Modality::Category, Some(label)),
        PublicGoal::Description(sentence) => (Modality::Description, Some(sentence)),
        PublicGoal::Image => (Modality::Image, None),
    };
    GoalText { modality, text }
}

/// Returns a split's rule set.
pub fn rules_of(name: &str, split: &SplitFolder) -> Result<Rules, Failure> {
    Rules::named(split.rules()).map_err(|error| {
        Failure::scene(format!("split '{name}': {error}"))
            .hinted("make the split again with: avln data split make NAME --rules RULES")
    })
}
