//! Data set checks and statistics.

use super::verifier::{self, BoxedVerifier};
use crate::parallel;
use avln_arena::dataset::{DatasetFiles, SplitFolder};
use avln_arena::{Failure, FailureKind};
use avln_dataset::{
    Depth, Fault, Manifest, MissionRules, SceneLine, Statistics, Verifier, check_recognition, check_scene,
};
use avln_episode::Rules;
use avln_world::Cache;
use std::{collections::BTreeMap, fmt, ops::RangeInclusive, path::Path, sync::Arc};

/// Fewest goals for a check on modality shares.
const BALANCED_FROM: u64 = 300;
/// Accepted share per modality.
const THIRDS: RangeInclusive<f64> = 0.28..=0.39;

/// Check extent.
#[derive(Clone, Copy, Debug)]
pub struct CheckScope<'a> {
    /// Split; `None` for all splits.
    pub split: Option<&'a str>,
    /// Checked scenes per split, spread evenly; `None` for all scenes.
    pub scenes: Option<usize>,
    /// Interval between missions with recomputed tours and rendered pictures; 1 for every mission.
    pub every: usize,
    /// `true` to repeat the survey, compare all cues, and verify all targets again.
    pub cues: bool,
    /// The user's file with models, for data sets that were verified by it.
    pub models: Option<&'a Path>,
    /// Thread count; `None` for one per processor.
    pub threads: Option<usize>,
}

impl CheckScope<'_> {
    fn includes(&self, split: &str) -> bool {
        self.split.is_none_or(|wanted| wanted == split)
    }
}

/// Check result.
#[derive(Clone, Debug, Default)]
pub struct CheckReport {
    /// Checked scenes.
    pub scenes: usize,
    /// Checked missions.
    pub missions: usize,
    /// Repetition of the verification.
    pub verification: Verification,
    /// Errors, in data set order.
    pub faults: Vec<String>,
}

/// Repetition of the verification of targets.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Verification {
    /// The data set has no verifier.
    #[default]
    None,
    /// Repeated by this verifier.
    Repeated(String),
    /// Not repeated, with the reason.
    Skipped(String),
}

impl fmt::Display for Verification {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::None => write!(f, "the data set was built without a verifier"),
            Self::Repeated(verifier) => write!(f, "repeated by {verifier}"),
            Self::Skipped(reason) => write!(f, "not repeated: {reason}"),
        }
    }
}

struct CheckJob {
    split: Arc<SplitFolder>,
    rules: MissionRules,
    scene: SceneLine,
}

/// Checks a data set against the scenes; calls `on_scene` with the finished and total scene counts.
///
/// # Errors
/// If a file cannot be read or a scene cannot be built.
pub fn run(
    files: &DatasetFiles,
    scope: &CheckScope,
    cache: Option<&Arc<dyn Cache>>,
    mut on_scene: impl FnMut(usize, usize),
) -> Result<CheckReport, Failure> {
    let manifest = files.manifest()?;
    let rules = Rules::named(&manifest.rules).map_err(|error| Failure::new(FailureKind::Scene, error))?;
    let mut report = CheckReport { faults: shared_scenes(files, &manifest)?, ..CheckReport::default() };
    let jobs = jobs(files, scope, &manifest)?;
    let survey = manifest.recipe.as_ref().map(|recipe| &recipe.survey).filter(|_| scope.cues);
    let depth = Depth { every: scope.every, survey };
    let (verifier, verification) = verification(&manifest, scope);
    report.verification = verification;
    let check = |job: &CheckJob| -> Result<_, Failure> {
        let assets = job.scene.spec().open_with(&rules, cache)?;
        let episodes = job.split.episodes(&job.scene)?;
        let mut faults = check_scene(&assets, &rules, &job.rules, &episodes, depth);
        if let (Some(verifier), Some(survey)) = (&verifier, survey) {
            let recognition = (survey, &**verifier as &dyn Verifier);
            faults.extend(check_recognition(&assets, &rules, &job.rules, &episodes, recognition)?);
        }
        Ok((episodes.len(), faults))
    };
    // Results arrive in any order; the report lists them by scene.
    let mut results: BTreeMap<usize, (usize, Vec<Fault>)> = BTreeMap::new();
    on_scene(0, jobs.len());
    parallel::share(&jobs, scope.threads, check, |index, result| {
        results.insert(index, result);
        on_scene(results.len(), jobs.len());
    })?;
    for (missions, faults) in results.into_values() {
        report.scenes += 1;
        report.missions += missions;
        report.faults.extend(faults.iter().map(Fault::to_string));
    }
    report.faults.extend(unbalanced(files, &manifest, scope)?);
    Ok(report)
}

/// Loads the data set's verifier, if it is available and the check includes cues.
fn verification(manifest: &Manifest, scope: &CheckScope) -> (Option<BoxedVerifier>, Verification) {
    let Some(id) = manifest.recipe.as_ref().and_then(|recipe| recipe.verifier.as_ref()) else {
        return (None, Verification::None);
    };
    if !scope.cues {
        return (None, Verification::Skipped(format!("add --full to repeat the verification by {id}")));
    }
    match verifier::recorded(Some(id), scope.models) {
        Ok(verifier) => (Some(verifier), Verification::Repeated(id.to_string())),
        Err(failure) => (None, Verification::Skipped(failure.to_string())),
    }
}

fn jobs(files: &DatasetFiles, scope: &CheckScope, manifest: &Manifest) -> Result<Vec<CheckJob>, Failure> {
    let mut jobs = Vec::new();
    for line in manifest.splits.iter().filter(|line| scope.includes(&line.name)) {
        let split = Arc::new(SplitFolder::open(files.root(), &line.name)?);
        let rules = mission_rules(manifest, &line.name);
        let every = scope.scenes.map_or(1, |scenes| split.scenes().len().div_ceil(scenes.max(1))).max(1);
        jobs.extend(split.scenes().iter().step_by(every).map(|scene| CheckJob {
            split: split.clone(),
            rules: rules.clone(),
            scene: scene.clone(),
        }));
    }
    if jobs.is_empty() {
        // An unknown split results in an error with the known names.
        SplitFolder::open(files.root(), scope.split.unwrap_or_default())?;
    }
    Ok(jobs)
}

/// Returns a split's mission rules; without a recipe, every value is accepted.
fn mission_rules(manifest: &Manifest, split: &str) -> MissionRules {
    let any = MissionRules {
        goals: [1, 8],
        min_start_m: 0.0,
        min_separation_m: 0.0,
        distractors: [0, u8::MAX],
        steps: None,
    };
    let Some(recipe) = &manifest.recipe else { return any };
    let found = recipe.splits.iter().find(|line| line.name == split);
    found.map_or(any, |line| recipe.mission_rules(line).clone())
}

/// Reports scenes in more than one split.
fn shared_scenes(files: &DatasetFiles, manifest: &Manifest) -> Result<Vec<String>, Failure> {
    let (mut seen, mut faults) = (BTreeMap::new(), Vec::new());
    for split in &manifest.splits {
        for scene in files.scenes(split)? {
            if let Some(before) = seen.insert(scene.digest, scene.name.clone()) {
                faults.push(format!("{}: disjoint-splits: equal to scene {before}", scene.name));
            }
        }
    }
    Ok(faults)
}

/// Reports splits with modality shares far from thirds.
fn unbalanced(files: &DatasetFiles, manifest: &Manifest, scope: &CheckScope) -> Result<Vec<String>, Failure> {
    let mut faults = Vec::new();
    if manifest.recipe.is_none() {
        return Ok(faults);
    }
    for split in manifest.splits.iter().filter(|split| scope.includes(&split.name)) {
        let statistics = count_split(files, &split.name)?;
        for modality in ["category", "description", "image"] {
            let share = statistics.share(modality);
            if statistics.goal_count() >= BALANCED_FROM && !THIRDS.contains(&share) {
                let (name, percent) = (&split.name, 100.0 * share);
                faults.push(format!("{name}: modality-mix: {percent:.1} % {modality} goals"));
            }
        }
    }
    Ok(faults)
}

/// Returns statistics by split.
///
/// # Errors
/// If a file cannot be read.
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
