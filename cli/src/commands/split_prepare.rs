//! Works out ahead of time what takes long in the episodes of a split.

use crate::output::say;
use avln_arena::data::DataFolder;
use avln_arena::dataset::SplitFolder;
use avln_arena::{Failure, FailureKind};
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
    /// GiB on disk that prepared scenes and sounds may take, from now on and for all commands [default: 4]
    #[arg(long, value_name = "GIB", value_parser = clap::value_parser!(u32).range(1..=65536))]
    pub cache_size: Option<u32>,
}

/// About what a scene without large textures takes on disk, bytes.
const SCENE_BYTES: u64 = 4_000_000;

/// About what a source takes on disk, bytes.
const SOURCE_BYTES: u64 = 1_200_000;

/// A scene, and where targets sound in it.
struct Work {
    scene: SceneLine,
    positions: Vec<Point3<f32>>,
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
    data.limit_cache(options.cache_size)?;
    let works: Vec<Work> =
        split.scenes().iter().map(|scene| work(&split, scene, &rules)).collect::<Result<_, _>>()?;
    let sources = works.iter().map(|work| work.positions.len()).sum();
    if let Some(warning) = too_much(works.len(), sources, data.cache_folder().budget_bytes()) {
        say!("split {}: {warning}", options.name);
    }
    let (cache, bar) = (data.cache(), bar(works.len() + sources));
    for Work { scene, positions } in &works {
        let assets = open(scene, &rules, &cache)?;
        bar.inc(1);
        prepare(&assets, positions, threads.map_or(1, NonZero::get), &bar);
    }
    bar.finish_and_clear();
    let [scenes, sources] = [counted(works.len(), "scene"), counted(sources, "source")];
    say!("split {}: {scenes} and {sources} of sound are ready", options.name);
    Ok(())
}

fn work(split: &SplitFolder, scene: &SceneLine, rules: &Rules) -> Result<Work, Failure> {
    let episodes = split.episodes(scene)?;
    let goals = episodes.iter().flat_map(|episode| &episode.goals);
    let targets: Vec<_> = goals.map(|goal| goal.target.clone()).collect();
    Ok(Work { scene: scene.clone(), positions: distinct(source_positions(rules, &targets)) })
}

/// What to say where the first of it would make room for the last.
fn too_much(scenes: usize, sources: usize, budget_bytes: u64) -> Option<String> {
    let bytes = scenes as u64 * SCENE_BYTES + sources as u64 * SOURCE_BYTES;
    let gib = |bytes: u64| bytes as f64 / (1_u64 << 30) as f64;
    let (scenes, sources) = (counted(scenes, "scene"), counted(sources, "source"));
    (bytes > budget_bytes).then(|| {
        format!(
            "{scenes} and {sources} of sound take about {:.1} GiB, the cache holds {:.0}: what is prepared first is dropped \
             again. Stop with Ctrl-C and say --cache-size {}",
            gib(bytes),
            gib(budget_bytes),
            (gib(bytes) * 1.25).ceil()
        )
    })
}

/// A number with its noun, whose plural ends in s.
fn counted(count: usize, noun: &str) -> String {
    format!("{count} {noun}{}", if count == 1 { "" } else { "s" })
}

fn bar(steps: usize) -> ProgressBar {
    let template = "{bar:30} {pos}/{len} scenes and sources, {elapsed} gone, {eta} left";
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(steps as u64).with_style(style)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_told_with_what_would() {
        assert_eq!(too_much(100, 3000, 4 << 30), None);
        let told = too_much(1, 8000, 4 << 30).expect("twice as much");
        for part in ["1 scene and", "8000 sources", "8.9 GiB", "holds 4", "--cache-size 12"] {
            assert!(told.contains(part), "{part} in: {told}");
        }
        assert_eq!(too_much(1, 8000, 12 << 30), None);
    }
}
