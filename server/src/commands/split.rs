//! Makes splits of scenes and missions.

use super::{
    split_export::{self, Export},
    split_prepare::{self, Prepare},
};
use crate::say::say;
use crate::{
    Failure, FailureKind,
    arena::{data::DataFolder, register},
    dataset::{DatasetFiles, Passphrase, Sealed},
};
use avln_dataset::{MissionOptions, SceneSource, Split};
use avln_episode::Rules;
use avln_houses::HouseOptions;
use avln_store::SceneMap;
use avln_world::Cache;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Commands about splits.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build scenes, find targets in them, draw missions
    Make(Make),
    /// Work out ahead of time what takes long in its episodes: light and textures, and how each target sounds everywhere
    Prepare(Prepare),
    /// Write the missions of a split as others read them: the layout of the LH-AVLN authors, and tables in Parquet
    Export(Export),
    /// Encrypt the files of a split in their places; the server opens them in memory, by AVLN_SEAL_KEY_FILE or AVLN_SEAL_KEY
    Seal(Seal),
}

/// What is encrypted, and under which passphrase.
#[derive(Clone, Debug, Args)]
pub struct Seal {
    /// Name of the split, one of the data folder or, with --dataset, of a data set
    pub name: String,
    /// The folder of a data set, as avln dataset build makes it
    #[arg(long, value_name = "DIR")]
    pub dataset: Option<PathBuf>,
    /// A file that holds the passphrase; by default AVLN_SEAL_KEY_FILE names it, or AVLN_SEAL_KEY is it
    #[arg(long, value_name = "FILE")]
    pub key_file: Option<PathBuf>,
}

/// What to make a split of.
#[derive(Clone, Debug, Args)]
pub struct Make {
    /// Name of the split
    pub name: String,
    /// Procedural houses to build
    #[arg(long, default_value_t = 2, conflicts_with = "scene")]
    pub houses: u32,
    /// A scene to use: a file or a folder in any layout that `avln scene import` reads (can be repeated)
    #[arg(long, value_name = "PATH")]
    pub scene: Vec<PathBuf>,
    /// Missions to draw in each scene
    #[arg(long, default_value_t = 4)]
    pub missions: usize,
    /// Seed of houses and missions
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// The rule set: lh-avln-v1, lh-avln-authors-v1, lh-avln-noisy-v1 or lh-avln-distinct-v1
    #[arg(long, default_value = Rules::PAPER)]
    pub rules: String,
}

/// Carries out a command about splits.
///
/// # Errors
/// When a scene cannot be used or the data folder cannot be written.
pub async fn run(data: &Path, command: Command) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let options = match command {
        Command::Make(options) => options,
        Command::Seal(options) => return seal(&data, &options),
        Command::Export(options) => return split_export::run(&data, options).await,
        Command::Prepare(options) => {
            let done = tokio::task::spawn_blocking(move || split_prepare::run(&data, &options)).await;
            return done.map_err(|error| Failure::new(FailureKind::Internal, error))?;
        }
    };
    let store = data.store().await?;
    let split = make(&data, &store, options, |line| say!("{line}")).await?;
    say!("split {}: {} scenes, {} missions", split.name, split.scenes.len(), split.episodes.len());
    say!("open a phase on it with: avln phase open ID --split {}", split.name);
    Ok(())
}

/// Encrypts the files of a split.
fn seal(data: &DataFolder, options: &Seal) -> Result<(), Failure> {
    let passphrase = match &options.key_file {
        Some(path) => Some(Passphrase::of_file(path)?),
        None => Passphrase::of_environment()?,
    };
    let passphrase = passphrase.ok_or_else(|| {
        Failure::new(FailureKind::Data, "there is no passphrase to seal with").hinted(
            "write one into a file of its own: head -c 24 /dev/urandom | base64 > FILE, then --key-file FILE",
        )
    })?;
    let files = match &options.dataset {
        Some(folder) => DatasetFiles::at(folder),
        None => DatasetFiles::at(&data.own_split(&options.name)?),
    };
    let Sealed { now, before } = files.seal(&options.name, passphrase)?;
    say!("split {}: {now} files are sealed now, {before} were before", options.name);
    say!(
        "what was kept of it elsewhere is not: copies, backups, the database and {}/cache",
        data.root().display()
    );
    Ok(())
}

/// Makes a split, saves it and makes it known to the database; `say` is told about each scene.
///
/// # Errors
/// When a scene cannot be used or the data folder cannot be written.
pub async fn make(
    data: &DataFolder,
    store: &avln_store::Store,
    options: Make,
    say: impl Fn(String) + Send + 'static,
) -> Result<Split, Failure> {
    crate::arena::data::check_name("split", &options.name)?;
    let cache = data.cache();
    let built = tokio::task::spawn_blocking(move || build(&options, &cache, say)).await;
    let (split, maps) = built.map_err(|error| Failure::new(FailureKind::Internal, error))??;
    data.save_split(&split)?;
    register::register_split(store, &split.name, &data.missions(&split.name)?, &maps).await?;
    Ok(split)
}

/// Builds the scenes one after the other and draws missions in each.
fn build(
    options: &Make,
    cache: &Arc<dyn Cache>,
    say: impl Fn(String),
) -> Result<(Split, Vec<SceneMap>), Failure> {
    let rules = Rules::named(&options.rules).map_err(|error| Failure::new(FailureKind::Scene, error))?;
    let mut split = Split::new(&options.name, &rules);
    let mut maps = Vec::new();
    for (index, (name, source)) in sources(options)?.into_iter().enumerate() {
        let missions = MissionOptions::new(options.missions, options.seed.wrapping_add(index as u64));
        let before = split.episodes.len();
        let assets = split.add_scene(&name, source, &rules, &missions, Some(cache))?;
        say(format!(
            "  {name}: {} triangles, {} objects, {:.0} m2 to walk on, {} missions",
            assets.scene.mesh.triangles.len(),
            assets.scene.objects.len(),
            assets.navmesh.area_m2(),
            split.episodes.len() - before,
        ));
        maps.push(register::map_of(&assets));
    }
    Ok((split, maps))
}

/// Names and origins of the scenes: the files that were given, or houses grown from the seed.
fn sources(options: &Make) -> Result<Vec<(String, SceneSource)>, Failure> {
    if options.scene.is_empty() {
        let house = |number: u32| {
            let seed = options.seed.wrapping_mul(1000).wrapping_add(u64::from(number));
            let HouseOptions { rooms, storeys, pool } = HouseOptions::small();
            let source = SceneSource::Procedural { seed, rooms, storeys, pool };
            (format!("{}-house-{number:03}", options.name), source)
        };
        return Ok((0..options.houses).map(house).collect());
    }
    options.scene.iter().map(|path| file_source(&options.name, path)).collect()
}

fn file_source(split: &str, path: &Path) -> Result<(String, SceneSource), Failure> {
    let path = path.canonicalize().map_err(|error| {
        Failure::new(FailureKind::Scene, format!("cannot find scene {}: {error}", path.display()))
            .hinted("name a .glb or .gltf file, or a folder that holds one with its semantics beside it")
    })?;
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let fits = |letter: &char| letter.is_ascii_alphanumeric() || matches!(letter, '-' | '_');
    let name = format!("{split}-{}", stem.chars().filter(fits).take(40).collect::<String>());
    Ok((name, SceneSource::File { path }))
}
