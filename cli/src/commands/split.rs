//! Splits: scenes with missions.

use crate::output::{counted, processors, progress_bar, say};
use avln_arena::{
    Failure,
    data::DataFolder,
    dataset::{DatasetFiles, Passphrase, Sealed, SplitFolder},
    ids, run_blocking,
    setup::{NewSplit, make_split},
};
use avln_dataset::{SceneLine, Seed};
use avln_episode::Rules;
use avln_geom::Point3;
use avln_lab::dataset::export::{Export, Openness, phases_of};
use avln_referee::source_positions;
use avln_world::{Cache, SceneAssets};
use clap::{Args, Subcommand, ValueEnum};
use indicatif::ProgressBar;
use std::{
    collections::BTreeMap,
    num::NonZero,
    path::{Path, PathBuf},
    sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    },
    thread,
};

#[derive(Debug, Subcommand)]
pub(crate) enum SplitCommand {
    /// Build scenes, find targets in them, draw missions
    Make(MakeSplitArgs),
    /// Precompute light, textures and sound of a split's scenes, so that the first episodes start at once
    Prepare(PrepareArgs),
    /// Write a split's missions in the LH-AVLN authors' layout, and as Parquet tables
    Export(ExportArgs),
    /// Encrypt a split's files in place; the server decrypts them in memory with AVLN_SEAL_KEY_FILE or AVLN_SEAL_KEY
    Seal(SealArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct MakeSplitArgs {
    /// Split name
    name: String,
    /// Procedural houses
    #[arg(long, default_value_t = 2, conflicts_with = "scene")]
    houses: u32,
    /// Scene file or folder, in any layout that `avln scene import` reads (can be repeated)
    #[arg(long, value_name = "PATH")]
    scene: Vec<PathBuf>,
    /// Missions per scene
    #[arg(long, default_value_t = 4)]
    missions: usize,
    /// Number for a practice split: anyone can make the same houses and missions from it. Without a number, the program draws 256
    /// secret bits, which a phase with hidden scores or replays requires
    #[arg(long)]
    seed: Option<u64>,
    /// Rule set: lh-avln-v1, lh-avln-authors-v1, lh-avln-noisy-v1, lh-avln-distinct-v1, lh-avln-hard-v1 or lh-avln-mesh-v1
    #[arg(long, default_value = Rules::PAPER)]
    rules: String,
}

#[derive(Clone, Debug, Args)]
pub(crate) struct PrepareArgs {
    /// Split name
    name: String,
    /// Phase rule set; the split's by default
    #[arg(long)]
    rules: Option<String>,
    /// Threads; one per processor by default
    #[arg(long)]
    threads: Option<NonZero<usize>>,
    /// Disk cache size for scenes and sounds in GiB; stored for all commands [default: 4]
    #[arg(long, value_name = "GIB", value_parser = clap::value_parser!(u32).range(1..=65536))]
    cache_size: Option<u32>,
}

#[derive(Clone, Debug, Args)]
pub(crate) struct ExportArgs {
    /// Split name, in the data folder or in the data set of --dataset
    name: String,
    #[command(flatten)]
    origin: SplitOrigin,
    /// Formats
    #[arg(long, value_enum, value_delimiter = ',', default_values_t = [ExportFormat::Authors, ExportFormat::Parquet], value_name = "LIST")]
    format: Vec<ExportFormat>,
    /// Folder for the files
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ExportFormat {
    /// Gzipped JSON in the LH-AVLN authors' layout
    Authors,
    /// Parquet tables with plain columns
    Parquet,
}

/// A split's data set, and the permission to publish ground truth.
#[derive(Clone, Debug, Args)]
pub(super) struct SplitOrigin {
    /// Data set folder made by avln data dataset build
    #[arg(long, value_name = "DIR")]
    dataset: Option<PathBuf>,
    /// Treat scenes from files as training scenes, with publishable ground truth
    #[arg(long)]
    training: bool,
}

#[derive(Clone, Debug, Args)]
pub(crate) struct SealArgs {
    /// Split name, in the data folder or in the data set of --dataset
    name: String,
    /// Data set folder made by avln data dataset build
    #[arg(long, value_name = "DIR")]
    dataset: Option<PathBuf>,
    /// File with the passphrase; by default AVLN_SEAL_KEY_FILE names the file, or AVLN_SEAL_KEY contains the passphrase
    #[arg(long, value_name = "FILE")]
    key_file: Option<PathBuf>,
}

pub(crate) async fn run(data: &Path, command: SplitCommand) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    match command {
        SplitCommand::Make(args) => make(&data, args).await,
        SplitCommand::Seal(args) => seal(&data, &args),
        SplitCommand::Export(args) => {
            let (split, openness) = args.origin.open(&data, &args.name).await?;
            run_blocking(move || export(&args, &split, openness)).await
        }
        SplitCommand::Prepare(args) => run_blocking(move || prepare(&data, &args)).await,
    }
}

async fn make(data: &DataFolder, args: MakeSplitArgs) -> Result<(), Failure> {
    let store = data.store().await?;
    let new = NewSplit {
        name: args.name,
        houses: args.houses,
        scenes: args.scene,
        missions: args.missions,
        seed: args
            .seed
            .map_or_else(|| ids::random_secret().map(Seed::Secret), |seed| Ok(Seed::Number(seed)))?,
        rules: args.rules,
    };
    let split = make_split(data, &store, new, |line| say!("{line}")).await?;
    say!("split {}: {} scenes, {} missions", split.name, split.scenes.len(), split.episodes.len());
    say!("open a phase on it with: avln challenge phase open ID --split {}", split.name);
    Ok(())
}

fn seal(data: &DataFolder, args: &SealArgs) -> Result<(), Failure> {
    let passphrase = match &args.key_file {
        Some(path) => Some(Passphrase::of_file(path)?),
        None => Passphrase::of_environment()?,
    };
    let passphrase = passphrase.ok_or_else(|| {
        Failure::data("there is no passphrase to seal with").hinted(
            "write one into a file of its own: head -c 24 /dev/urandom | base64 > FILE, then --key-file FILE",
        )
    })?;
    let files = match &args.dataset {
        Some(folder) => DatasetFiles::at(folder),
        None => DatasetFiles::at(&data.own_split(&args.name)?),
    };
    let Sealed { now, before } = files.seal(&args.name, passphrase)?;
    say!("split {}: {now} files are sealed now, {before} were before", args.name);
    let cache = data.root().join("cache");
    say!("other copies are not sealed: backups, the database and {}", cache.display());
    Ok(())
}

impl SplitOrigin {
    pub(super) async fn open(
        &self,
        data: &DataFolder,
        name: &str,
    ) -> Result<(SplitFolder, Openness), Failure> {
        let split = match &self.dataset {
            Some(dataset) => SplitFolder::open(dataset, name)?,
            None => data.missions(name)?,
        };
        let phases = phases_of(data, &split).await?;
        let openness = Openness::of(&split, &phases, self.training)?;
        Ok((split, openness))
    }
}

fn export(args: &ExportArgs, split: &SplitFolder, openness: Openness) -> Result<(), Failure> {
    let bar = progress_bar("scenes", split.scenes().len());
    let authors = args.format.contains(&ExportFormat::Authors);
    let parquet = args.format.contains(&ExportFormat::Parquet);
    let missions = Export { split, openness, authors, parquet }.run(&args.out, || bar.inc(1))?;
    bar.finish_and_clear();
    let with = match openness {
        Openness::Training => "with ground truth",
        Openness::Public => "without ground truth, which only training splits publish",
    };
    say!("wrote {missions} missions to {}, {with}", args.out.join(split.name()).display());
    Ok(())
}

/// Approximate size for a scene without large textures in the cache, bytes.
const SCENE_BYTES: u64 = 4_000_000;

/// Approximate size for a sound source in the cache, bytes.
const SOURCE_BYTES: u64 = 1_200_000;

struct PreparedScene {
    scene: SceneLine,
    positions: Vec<Point3<f32>>,
}

fn prepare(data: &DataFolder, args: &PrepareArgs) -> Result<(), Failure> {
    let split = data.missions(&args.name)?;
    let rules = args.rules.as_deref().unwrap_or(split.rules());
    let rules = Rules::named(rules).map_err(Failure::scene)?;
    let threads = args.threads.map_or_else(processors, NonZero::get);
    data.limit_cache(args.cache_size)?;
    let scenes = split.scenes().iter().map(|scene| sources_of(&split, scene, &rules));
    let scenes = scenes.collect::<Result<Vec<_>, _>>()?;
    let sources = scenes.iter().map(|scene| scene.positions.len()).sum();
    if let Some(warning) = cache_warning(scenes.len(), sources, data.cache_folder().budget_bytes()) {
        say!("split {}: {warning}", args.name);
    }
    let cache: Arc<dyn Cache> = data.cache();
    let bar = progress_bar("scenes and sources", scenes.len() + sources);
    for PreparedScene { scene, positions } in &scenes {
        let assets = scene.spec().open_with(&rules, Some(&cache))?;
        assets.prepare_pictures();
        bar.inc(1);
        prepare_sources(&assets, positions, threads, &bar);
    }
    bar.finish_and_clear();
    let ready = format!("{} and {}", counted(scenes.len(), "scene"), counted(sources, "source"));
    say!("split {}: {ready} of sound are ready", args.name);
    Ok(())
}

fn sources_of(split: &SplitFolder, scene: &SceneLine, rules: &Rules) -> Result<PreparedScene, Failure> {
    let episodes = split.episodes(scene)?;
    let goals = episodes.iter().flat_map(|episode| &episode.goals);
    let targets: Vec<_> = goals.map(|goal| goal.target.clone()).collect();
    Ok(PreparedScene { scene: scene.clone(), positions: distinct(source_positions(rules, &targets)) })
}

/// Returns a warning for a cache below the split's size: it would drop the first entries to store the last.
fn cache_warning(scenes: usize, sources: usize, budget_bytes: u64) -> Option<String> {
    let bytes = scenes as u64 * SCENE_BYTES + sources as u64 * SOURCE_BYTES;
    if bytes <= budget_bytes {
        return None;
    }
    let gib = |bytes: u64| bytes as f64 / (1_u64 << 30) as f64;
    Some(format!(
        "{} and {} of sound take about {:.1} GiB, but the cache holds {:.0}, so the first entries would be dropped. \
         Stop with Ctrl-C and add --cache-size {}",
        counted(scenes, "scene"),
        counted(sources, "source"),
        gib(bytes),
        gib(budget_bytes),
        (gib(bytes) * 1.25).ceil()
    ))
}

fn distinct(positions: Vec<Point3<f32>>) -> Vec<Point3<f32>> {
    let bits = |position: &Point3<f32>| [0, 1, 2].map(|axis| position[axis].to_bits());
    let by_bits: BTreeMap<_, _> = positions.into_iter().map(|position| (bits(&position), position)).collect();
    by_bits.into_values().collect()
}

fn prepare_sources(assets: &SceneAssets, positions: &[Point3<f32>], threads: usize, bar: &ProgressBar) {
    // Sources take different times, so threads fetch them from a shared counter.
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(position) = positions.get(next.fetch_add(1, Ordering::Relaxed)) {
            assets.prepare_sound(position);
            bar.inc(1);
        }
    };
    thread::scope(|scope| {
        for _ in 0..threads.min(positions.len()) {
            scope.spawn(work);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cache_warning_names_a_sufficient_size() {
        assert_eq!(cache_warning(100, 3000, 4 << 30), None);
        let warning = cache_warning(1, 8000, 4 << 30).expect("twice as much");
        for part in ["1 scene and", "8000 sources", "8.9 GiB", "holds 4", "--cache-size 12"] {
            assert!(warning.contains(part), "{part} in: {warning}");
        }
        assert_eq!(cache_warning(1, 8000, 12 << 30), None);
    }
}
