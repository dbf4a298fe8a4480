//! Checking and counting a data set that lies on disk.

use crate::parallel;
use avln_arena::{Failure, FailureKind, dataset::{DatasetFiles, SplitFolder}};
use avln_dataset::{Depth, Fault, Manifest, MissionRules, SceneLine, Statistics, check_scene};
use avln_episode::Rules;
use avln_world::Cache;
use std::{collections::BTreeMap, sync::Arc};

/// Goals from which on modalities must be near thirds.
const BALANCED_FROM: u64 = 300;
/// Least and greatest share of a modality then.
const THIRDS: std::ops::RangeInclusive<f64> = 0.28..=0.39;

/// Extent of a check.
#[derive(Clone, Copy, Debug)]
pub struct CheckScope<'a> {
    /// One split, or all.
    pub split: Option<&'a str>,
    /// Scenes of each split that are checked, spread evenly; all when none.
    pub scenes: Option<usize>,
    /// Every so manieth mission has its tours computed again and its pictures rendered; 1 for all of them.
    pub every: usize,
    /// Surveys the house again and compares each cue with it.
    pub cues: bool,
    /// Threads; one for each processor when none.
    pub threads: Option<usize>,
}

/// Result of a check.
#[derive(Clone, Debug, Default)]
pub struct CheckReport {
    /// Scenes that were checked.
    pub scenes: usize,
    /// Missions that were checked.
    pub missions: usize,
    /// Errors in the order of the data set.
    pub faults: Vec<String>,
}

/// Checks the data set against its scenes; `watch` hears how many scenes of how many are done. What pictures are made from
/// is looked for and kept in `cache`.
///
/// # Errors
/// When a file cannot be used or a scene cannot be made again.
pub fn run(
    files: &DatasetFiles,
    scope: &CheckScope,
    cache: Option<&Arc<dyn Cache>>,
    mut watch: impl FnMut(usize, usize),
) -> Result<CheckReport, Failure> {
    let manifest = files.manifest()?;
    let rules = Rules::named(&manifest.rules).map_err(|error| Failure::new(FailureKind::Scene, error))?;
    let mut report = CheckReport { faults: shared_scenes(files, &manifest)?, ..CheckReport::default() };
    let wanted = |name: &str| scope.split.is_none_or(|split| split == name);
    let mut work = Vec::new();
    for line in manifest.splits.iter().filter(|line| wanted(&line.name)) {
        let folder = SplitFolder::open(files.root(), &line.name)?;
        let limits = limits_of(&manifest, &line.name);
        let every = scope.scenes.map_or(1, |scenes| folder.scenes().len().div_ceil(scenes.max(1))).max(1);
        let chosen: Vec<SceneLine> = folder.scenes().iter().step_by(every).cloned().collect();
        let folder = Arc::new(folder);
        work.extend(chosen.into_iter().map(|scene| (folder.clone(), limits.clone(), scene)));
    }
    if work.is_empty() {
        SplitFolder::open(files.root(), scope.split.unwrap_or_default())?;
    }
    let survey = manifest.recipe.as_ref().map(|recipe| &recipe.survey).filter(|_| scope.cues);
    let depth = Depth { every: scope.every, survey };
    let mut found: BTreeMap<usize, (usize, Vec<Fault>)> = BTreeMap::new();
    type Work = (Arc<SplitFolder>, MissionRules, SceneLine);
    let check = |(folder, limits, scene): &Work| -> Result<_, Failure> {
        let assets = scene.spec().open_with(&rules, cache)?;
        let episodes = folder.episodes(scene)?;
        Ok((episodes.len(), check_scene(&assets, &rules, limits, &episodes, depth)))
    };
    let total = work.len();
    watch(0, total);
    parallel::share(&work, parallel::threads(scope.threads), check, |index, result| {
        found.insert(index, result);
        watch(found.len(), total);
    })?;
    for (missions, faults) in found.into_values() {
        report.scenes += 1;
        report.missions += missions;
        report.faults.extend(faults.iter().map(Fault::to_string));
    }
    report.faults.extend(unbalanced(files, &manifest, scope)?);
    Ok(report)
}

/// Recipe of the missions of a split; without one, every value is accepted.
fn limits_of(manifest: &Manifest, split: &str) -> MissionRules {
    let anything = MissionRules {
        goals: [1, 8],
        min_start_m: 0.0,
        min_separation_m: 0.0,
        distractors: [0, u8::MAX],
        steps: None,
    };
    let Some(recipe) = &manifest.recipe else { return anything };
    let found = recipe.splits.iter().find(|line| line.name == split);
    found.map_or(anything, |line| recipe.mission_rules(line).clone())
}

/// Scenes that are in two splits.
fn shared_scenes(files: &DatasetFiles, manifest: &Manifest) -> Result<Vec<String>, Failure> {
    let (mut seen, mut faults) = (BTreeMap::new(), Vec::new());
    for split in &manifest.splits {
        for scene in files.scenes(split)? {
            if let Some(before) = seen.insert(scene.digest, scene.name.clone()) {
                faults.push(format!("{}: disjoint-splits: it is the same scene as {before}", scene.name));
            }
        }
    }
    Ok(faults)
}

/// Splits whose modalities are far from thirds.
fn unbalanced(files: &DatasetFiles, manifest: &Manifest, scope: &CheckScope) -> Result<Vec<String>, Failure> {
    let mut faults = Vec::new();
    if manifest.recipe.is_none() {
        return Ok(faults);
    }
    let wanted = |name: &str| scope.split.is_none_or(|split| split == name);
    for split in manifest.splits.iter().filter(|split| wanted(&split.name)) {
        let numbers = count_split(files, &split.name)?;
        for modality in ["category", "description", "image"] {
            let share = numbers.share(modality);
            if numbers.goal_count() >= BALANCED_FROM && !THIRDS.contains(&share) {
                let percent = 100.0 * share;
                faults.push(format!(
                    "{}: modality-mix: {percent:.1} % of its goals are of modality {modality}",
                    split.name
                ));
            }
        }
    }
    Ok(faults)
}

/// Counts a data set, split by split.
///
/// # Errors
/// When a file cannot be used.
pub fn count(files: &DatasetFiles) -> Result<Vec<(String, Statistics)>, Failure> {
    let splits = files.manifest()?.splits;
    splits.iter().map(|split| Ok((split.name.clone(), count_split(files, &split.name)?))).collect()
}

fn count_split(files: &DatasetFiles, split: &str) -> Result<Statistics, Failure> {
    let folder = SplitFolder::open(files.root(), split)?;
    let mut sum = Statistics::default();
    for scene in folder.scenes() {
        sum.add(&Statistics::of_scene(scene.facts, &folder.episodes(scene)?));
    }
    Ok(sum)
}
