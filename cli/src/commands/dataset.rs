//! Builds data sets by recipe, counts them and checks them.

use crate::{
    commands::{dataset_frames, dataset_import},
    output::say,
};
use avln_arena::{Failure, FailureKind, cache::CacheFolder, dataset::DatasetFiles};
use avln_dataset::{Recipe, SceneChoice, Statistics, summary};
use avln_lab::dataset::{
    build::{Builder, Progress},
    check::{self, Scope},
};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use std::path::{Path, PathBuf};

/// Faults that are printed one by one.
const SHOWN_FAULTS: usize = 50;

/// Commands about data sets.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Build scenes and missions by recipe; a build that was stopped goes on where it was
    Build(Build),
    /// Count a data set again, print the main numbers and write its statistics page
    Stats {
        /// The folder of the data set
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Take pictures in houses of a split, with what every pixel shows, to train perception on
    Frames(dataset_frames::Options),
    /// Verify every mission against its constraints, from the files and the scenes alone
    Check(Check),
    /// Take in missions of another data set: LH-AVLN as its authors publish it, GOAT-Bench, ObjectNav, InstanceImageNav, MultiON
    Import(dataset_import::Options),
}

/// What to build, and where.
#[derive(Debug, Args)]
pub struct Build {
    /// The recipe: a JSON file as docs/DATASET.md says, or the name of one that comes with avln: paper, mini
    #[arg(value_name = "CONFIG")]
    pub config: String,
    /// Folder of the data set; dataset-NAME by default
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Threads; one for each processor by default. The bytes are the same for any number
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

/// What to check, and how thoroughly.
#[derive(Debug, Args)]
pub struct Check {
    /// The folder of the data set
    #[arg(value_name = "DIR")]
    pub folder: PathBuf,
    /// One split; all by default
    #[arg(long)]
    pub split: Option<String>,
    /// Check about so many scenes of each split, spread evenly; all by default
    #[arg(long, value_name = "COUNT")]
    pub scenes: Option<usize>,
    /// Compute the tours of one mission in so many again, and render its pictures
    #[arg(long, value_name = "COUNT", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    pub every: u32,
    /// Do so for every mission, and hold every sentence and picture against a survey of the scene
    #[arg(long, conflicts_with = "every")]
    pub full: bool,
    /// Threads; one for each processor by default
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

/// Carries out a command about data sets.
///
/// # Errors
/// When a recipe, a scene or a file cannot be used, or when a check finds faults.
pub fn run(data: &Path, command: Command) -> Result<(), Failure> {
    match command {
        Command::Build(options) => build(data, &options),
        Command::Stats { folder } => stats(&DatasetFiles::at(&folder)),
        Command::Frames(options) => dataset_frames::run(&options),
        Command::Check(options) => check(data, &options),
        Command::Import(options) => dataset_import::run(&options),
    }
}

fn build(data: &Path, options: &Build) -> Result<(), Failure> {
    let recipe = recipe(&options.config)?;
    let folder = options.out.clone().unwrap_or_else(|| PathBuf::from(format!("dataset-{}", recipe.name)));
    let files = DatasetFiles::at(&folder);
    let builder = Builder::open(files.clone(), recipe)?;
    let bar = bar("{bar:30} {pos}/{len} missions, {elapsed} gone, {eta} left");
    let watch = |progress: Progress| {
        if bar.length() != Some(progress.missions as u64) {
            // What an earlier build did says nothing about the speed of this one.
            bar.set_length(progress.missions as u64);
            bar.set_position(progress.done as u64);
            bar.reset_eta();
        }
        bar.set_position(progress.done as u64);
    };
    let numbers =
        builder.run(options.threads.map(usize::from), CacheFolder::of_data(data).as_ref(), watch)?;
    bar.finish_and_clear();
    print_numbers(&numbers);
    say!("\nData set     {}", folder.display());
    say!("Statistics   {}", folder.join("statistics.html").display());
    say!("Check it     avln data dataset check {}", folder.display());
    say!("Play it      avln challenge phase open ID --dataset {} --split {}", folder.display(), numbers[0].0);
    Ok(())
}

/// The recipe of a name or a file; scene files named in it lie beside it.
pub(super) fn recipe(config: &str) -> Result<Recipe, Failure> {
    if let Some((_, text)) = Recipe::EMBEDDED.iter().find(|(name, _)| *name == config) {
        return Ok(Recipe::from_json(text)?);
    }
    let names: Vec<_> = Recipe::EMBEDDED.iter().map(|(name, _)| *name).collect();
    let text = std::fs::read_to_string(config).map_err(|error| {
        Failure::new(FailureKind::Data, format!("cannot read recipe {config}: {error}"))
            .hinted(format!("name a JSON file, or one of: {}", names.join(", ")))
    })?;
    let mut recipe = Recipe::from_json(&text).map_err(|error| {
        Failure::from(error).hinted(format!("correct {config}; docs/DATASET.md tells the fields"))
    })?;
    let beside = Path::new(config).parent().unwrap_or(Path::new("."));
    for split in &mut recipe.splits {
        if let SceneChoice::Files(files) = &mut split.scenes {
            for file in files {
                let path = beside.join(&*file);
                *file = path.canonicalize().map_err(|error| {
                    Failure::new(FailureKind::Scene, format!("cannot find scene {}: {error}", path.display()))
                })?;
            }
        }
    }
    Ok(recipe)
}

fn stats(files: &DatasetFiles) -> Result<(), Failure> {
    let numbers = check::count(files)?;
    print_numbers(&numbers);
    let page = files.write_statistics(&files.manifest()?.name, &numbers)?;
    say!("\nStatistics   {}", page.display());
    Ok(())
}

fn check(data: &Path, options: &Check) -> Result<(), Failure> {
    let scope = Scope {
        split: options.split.as_deref(),
        scenes: options.scenes,
        every: if options.full { 1 } else { options.every as usize },
        cues: options.full,
        threads: options.threads.map(usize::from),
    };
    let bar = bar("{bar:30} {pos}/{len} scenes, {elapsed} gone, {eta} left");
    let (files, cache) = (DatasetFiles::at(&options.folder), CacheFolder::of_data(data));
    let report = check::run(&files, &scope, cache.as_ref(), |done, of| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    say!("checked {} missions in {} scenes", report.missions, report.scenes);
    if report.faults.is_empty() {
        say!("every constraint holds");
        return Ok(());
    }
    report.faults.iter().take(SHOWN_FAULTS).for_each(|fault| say!("  {fault}"));
    let message = format!("{} faults in {}", report.faults.len(), options.folder.display());
    Err(Failure::new(FailureKind::Scene, message)
        .hinted("each line names mission, constraint and what was found; build the data set again"))
}

pub(super) fn bar(template: &str) -> ProgressBar {
    let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(0).with_style(style)
}

fn print_numbers(numbers: &[(String, Statistics)]) {
    for (split, numbers) in numbers {
        say!("{split}");
        for (label, value) in summary(numbers) {
            say!("  {label:<30} {value}");
        }
    }
}
