//! Works out ahead of time what takes long in the episodes of a split.

use crate::arena::data::DataFolder;
use crate::say::say;
use crate::{Failure, FailureKind};
use avln_dataset::SceneLine;
use avln_episode::Rules;
use avln_geom::Point3;
use avln_referee::source_positions;
use avln_world::{Cache, SceneAssets};
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};
use std::collections::BTreeMap;
use std::num::NonZero;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// What to prepare.
#[derive(Clone, Debug, Args)]
pub struct Prepare {
    /// Name of the split
    pub name: String,
    /// The rule set that it is played by; the one it was made for if left out
    #[arg(long)]
    pub rules: Option<String>,
    /// Sources that are worked out at the same time; as many as there are processors if left out
    #[arg(long)]
    pub threads: Option<NonZero<usize>>,
}

/// Prepares every scene of a split, and every source of sound in it, and keeps them in the data folder.
///
/// # Errors
/// When there is no such split, or a scene of it cannot be used.
pub(super) fn run(data: &DataFolder, options: &Prepare) -> Result<(), Failure> {
    let split = data.missions(&options.name)?;
    let rules = options.rules.as_deref().unwrap_or(split.rules());
    let rules = Rules::named(rules).map_err(|error| Failure::new(FailureKind::Scene, error))?;
    let threads = options.threads.or_else(|| std::thread::available_parallelism().ok());
    let (cache, mut sources) = (data.cache(), 0);
    let bar = bar(split.scenes().len());
    for scene in split.scenes() {
        let episodes = split.episodes(scene)?;
        let targets: Vec<_> =
            episodes.iter().flat_map(|episode| &episode.goals).map(|goal| goal.target.clone()).collect();
        let positions = distinct(source_positions(&rules, &targets));
        bar.inc_length(positions.len() as u64);
        let assets = open(scene, &rules, &cache)?;
        bar.inc(1);
        prepare(&assets, &positions, threads.map_or(1, NonZero::get), &bar);
        sources += positions.len();
    }
    bar.finish_and_clear();
    say!("split {}: {} scenes and {sources} sources of sound are ready", options.name, split.scenes().len());
    Ok(())
}

fn bar(scenes: usize) -> ProgressBar {
    let template = "{bar:30} {pos}/{len} scenes and sources, {elapsed} gone, {eta} left";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(scenes as u64).with_style(style)
}

fn open(scene: &SceneLine, rules: &Rules, cache: &Arc<dyn Cache>) -> Result<SceneAssets, Failure> {
    let assets = scene.spec().open_with(rules, Some(cache))?;
    assets.prepare_pictures();
    Ok(assets)
}

/// Each place once.
fn distinct(positions: Vec<Point3<f32>>) -> Vec<Point3<f32>> {
    let bits = |position: &Point3<f32>| [0, 1, 2].map(|axis| position[axis].to_bits());
    let by_bits: BTreeMap<_, _> = positions.into_iter().map(|position| (bits(&position), position)).collect();
    by_bits.into_values().collect()
}

/// Works out sources on some threads.
fn prepare(assets: &SceneAssets, positions: &[Point3<f32>], threads: usize, bar: &ProgressBar) {
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(position) = positions.get(next.fetch_add(1, Ordering::Relaxed)) {
            assets.prepare_sound(position);
            bar.inc(1);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads.min(positions.len()) {
            scope.spawn(work);
        }
    });
}
