//! Makes splits of scenes and missions.

use super::{
    split_export::{self, Export},
    split_prepare::{self, Prepare},
};
use crate::output::say;
use avln_arena::{
    Failure, FailureKind,
    data::DataFolder,
    dataset::{DatasetFiles, Passphrase, Sealed},
    setup::{NewSplit, make_split},
};
use avln_episode::Rules;
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

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
    /// The folder of a data set, as avln data dataset build makes it
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
    let split = make_split(&data, &store, options.into(), |line| say!("{line}")).await?;
    say!("split {}: {} scenes, {} missions", split.name, split.scenes.len(), split.episodes.len());
    say!("open a phase on it with: avln challenge phase open ID --split {}", split.name);
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

impl From<Make> for NewSplit {
    fn from(make: Make) -> Self {
        Self {
            name: make.name,
            houses: make.houses,
            scenes: make.scene,
            missions: make.missions,
            seed: make.seed,
            rules: make.rules,
        }
    }
}
