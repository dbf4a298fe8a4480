//! Data sets: building, statistics, checks, labelled frames and imports. Backup, restore and pruning of the data folder.

use crate::output::{progress_bar, say};
use avln_arena::{
    Failure,
    backup::{self, Contents, PruneOptions, Pruned},
    cache::CacheFolder,
    dataset::DatasetFiles,
    now_unix_ms,
};
use avln_dataset::{Recipe, SceneChoice, Statistics, summary};
use avln_episode::Rules;
use avln_interchange::{Format, Loss};
use avln_lab::dataset::{
    build::{BuildProgress, Builder},
    check::{self, CheckScope},
    frames::{self, FrameOptions, Purpose},
    import::Import,
    verifier::VerifierChoice,
};
use avln_store::{Inventory, calendar::rfc3339};
use clap::{Args, Subcommand};
use std::path::{Path, PathBuf};

const SHOWN_FAULTS: usize = 50;

#[derive(Debug, Subcommand)]
pub(crate) enum DatasetCommand {
    /// Build scenes and missions by a recipe; an interrupted build continues
    Build(BuildArgs),
    /// Count the missions, print the main numbers and write the statistics page
    Stats {
        /// Data set folder
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Render labelled pictures in houses of a split, to train perception
    Frames(FramesArgs),
    /// Verify all missions' constraints, from files and scenes only
    Check(CheckArgs),
    /// Import missions of another data set: LH-AVLN of its authors, GOAT-Bench, ObjectNav, InstanceImageNav, MultiON
    Import(ImportArgs),
}

#[derive(Debug, Args)]
pub(crate) struct BuildArgs {
    /// Recipe: a JSON file (see docs/DATASET.md), or a built-in name: paper, mini
    #[arg(value_name = "CONFIG")]
    config: String,
    /// Data set folder; dataset-NAME by default
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Ignore the recipe's seed: the program draws a secret for every split, which a phase with hidden scores or replays requires
    #[arg(long)]
    secret: bool,
    /// Detector that must recognise every target: network (the agents' bundled network), none, or a .toml file with ONNX models
    #[arg(long, value_name = "network|FILE.toml|none", default_value = "network")]
    verifier: VerifierChoice,
    /// Threads, one per processor by default; files do not depend on it
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

#[derive(Debug, Args)]
pub(crate) struct CheckArgs {
    /// Data set folder
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Split; all by default
    #[arg(long)]
    split: Option<String>,
    /// Approximate number of checked scenes per split, spread evenly; all by default
    #[arg(long, value_name = "COUNT")]
    scenes: Option<usize>,
    /// Recompute tours and render pictures of every COUNT-th mission
    #[arg(long, value_name = "COUNT", default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// Recompute all missions, compare all sentences and pictures with a survey of the scene, and verify all targets again
    #[arg(long, conflicts_with = "every")]
    full: bool,
    /// File with the ONNX models that verified the targets; not necessary for the bundled network
    #[arg(long, value_name = "FILE.toml")]
    verifier: Option<PathBuf>,
    /// Threads; one per processor by default
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) fn run(data: &Path, command: DatasetCommand) -> Result<(), Failure> {
    match command {
        DatasetCommand::Build(args) => build(data, &args),
        DatasetCommand::Stats { folder } => stats(&DatasetFiles::at(&folder)),
        DatasetCommand::Frames(args) => take_frames(&args),
        DatasetCommand::Check(args) => check(data, &args),
        DatasetCommand::Import(args) => import(&args),
    }
}

fn build(data: &Path, args: &BuildArgs) -> Result<(), Failure> {
    let mut recipe = recipe(&args.config)?;
    recipe.seed = recipe.seed.filter(|_| !args.secret);
    let folder = args.out.clone().unwrap_or_else(|| PathBuf::from(format!("dataset-{}", recipe.name)));
    let files = DatasetFiles::at(&folder);
    let builder = Builder::open_with(files.clone(), recipe, args.verifier.load()?)?;
    let bar = progress_bar("missions", 0);
    let watch = |progress: BuildProgress| {
        if bar.length() != Some(progress.missions as u64) {
            // Missions of an earlier, interrupted build would distort the estimated time.
            bar.set_length(progress.missions as u64);
            bar.set_position(progress.done as u64);
            bar.reset_eta();
        }
        bar.set_position(progress.done as u64);
    };
    let numbers = builder.run(args.threads.map(usize::from), CacheFolder::of_data(data).as_ref(), watch)?;
    bar.finish_and_clear();
    print_numbers(&numbers);
    say!("\nData set     {}", folder.display());
    say!("Statistics   {}", folder.join("statistics.html").display());
    say!("Check it     avln data dataset check {}", folder.display());
    say!("Play it      avln challenge phase open ID --dataset {} --split {}", folder.display(), numbers[0].0);
    Ok(())
}

/// Reads a recipe by name or file. Paths of scene files are relative to the file.
fn recipe(config: &str) -> Result<Recipe, Failure> {
    if let Some(text) = Recipe::embedded(config) {
        return Ok(Recipe::from_json(text)?);
    }
    let names: Vec<_> = Recipe::EMBEDDED.iter().map(|(name, _)| *name).collect();
    let text = std::fs::read_to_string(config).map_err(|error| {
        Failure::data(format!("cannot read recipe {config}: {error}"))
            .hinted(format!("name a JSON file, or one of: {}", names.join(", ")))
    })?;
    let mut recipe = Recipe::from_json(&text).map_err(|error| {
        Failure::from(error).hinted(format!("correct {config}; docs/DATASET.md lists the fields"))
    })?;
    let beside = Path::new(config).parent().unwrap_or(Path::new("."));
    for split in &mut recipe.splits {
        if let SceneChoice::Files(files) = &mut split.scenes {
            for file in files {
                let path = beside.join(&*file);
                *file = path.canonicalize().map_err(|error| {
                    Failure::scene(format!("cannot find scene {}: {error}", path.display()))
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

fn check(data: &Path, args: &CheckArgs) -> Result<(), Failure> {
    let scope = CheckScope {
        split: args.split.as_deref(),
        scenes: args.scenes,
        every: if args.full { 1 } else { args.every as usize },
        cues: args.full,
        models: args.verifier.as_deref(),
        threads: args.threads.map(usize::from),
    };
    let bar = progress_bar("scenes", 0);
    let (files, cache) = (DatasetFiles::at(&args.folder), CacheFolder::of_data(data));
    let report = check::run(&files, &scope, cache.as_ref(), |done, of| {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
    })?;
    bar.finish_and_clear();
    say!("checked {} missions in {} scenes", report.missions, report.scenes);
    say!("verification of targets: {}", report.verification);
    if report.faults.is_empty() {
        say!("every constraint holds");
        return Ok(());
    }
    report.faults.iter().take(SHOWN_FAULTS).for_each(|fault| say!("  {fault}"));
    let message = format!("{} faults in {}", report.faults.len(), args.folder.display());
    Err(Failure::scene(message)
        .hinted("each line names the mission, the constraint and the finding; build the data set again"))
}

fn print_numbers(numbers: &[(String, Statistics)]) {
    for (split, numbers) in numbers {
        say!("{split}");
        for (label, value) in summary(numbers) {
            say!("  {label:<30} {value}");
        }
    }
}

#[derive(Debug, Args)]
pub(crate) struct FramesArgs {
    /// Recipe of the houses: a JSON file, or a built-in name: paper, mini
    #[arg(long, value_name = "CONFIG", default_value = "paper")]
    recipe: String,
    /// Split with training-pool furniture
    #[arg(long, default_value = "train")]
    split: String,
    /// Render measurement pictures from a validation-pool split; training refuses these files
    #[arg(long)]
    measure: bool,
    /// Houses, from the first in the split
    #[arg(long, value_name = "COUNT", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..))]
    houses: u32,
    /// Pictures per house
    #[arg(long, value_name = "COUNT", default_value_t = 80, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    views: u32,
    /// Picture side in pixels, 16 to 1024
    #[arg(long, value_name = "PIXELS", default_value_t = 192, value_parser = clap::value_parser!(u32).range(16..=1024))]
    size: u32,
    /// Folder for frames.json and one .npy file of records per house; existing houses are skipped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Threads, one per processor by default; files do not depend on it
    #[arg(long, value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

fn take_frames(args: &FramesArgs) -> Result<(), Failure> {
    let wanted = FrameOptions {
        recipe: recipe(&args.recipe)?,
        split: args.split.clone(),
        purpose: if args.measure { Purpose::Measurement } else { Purpose::Training },
        houses: args.houses as usize,
        views: args.views as usize,
        side_px: args.size,
        threads: args.threads.map(usize::from),
    };
    let bar = progress_bar("houses", args.houses as usize);
    frames::take(&wanted, &args.out, || bar.inc(1))?;
    bar.finish_and_clear();
    say!("{} pictures in {}", args.houses * args.views, args.out.display());
    Ok(())
}

const SHOWN_LOSSES: usize = 20;

#[derive(Debug, Args)]
pub(crate) struct ImportArgs {
    /// auto, authors, goat, objectnav, instanceimagenav or multion
    #[arg(value_name = "FORMAT", value_parser = foreign_format)]
    format: ForeignFormat,
    /// A .json or .json.gz file next to its folder content, or a folder of such files
    #[arg(value_name = "SRC")]
    source: PathBuf,
    /// Scene folder
    #[arg(long, value_name = "DIR")]
    scenes: PathBuf,
    /// Folder for the data set
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Name for the new split
    #[arg(long, default_value = "val")]
    split: String,
    /// Rule set for success regions and reference tours
    #[arg(long, default_value = Rules::PAPER)]
    rules: String,
    /// Seed for the draws in episodes
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// A format; `None` to detect it from the keys of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ForeignFormat(Option<Format>);

fn import(args: &ImportArgs) -> Result<(), Failure> {
    let rules = Rules::named(&args.rules).map_err(Failure::scene)?;
    let import = Import {
        format: args.format.0,
        source: &args.source,
        scenes: &args.scenes,
        out: &args.out,
        split: &args.split,
        rules: &rules,
        seed: args.seed,
    };
    let account = import.run(|scene| say!("scene {scene}"))?;
    let (read, kept) = (account.episodes, account.missions);
    let (files, scenes) = (account.files, account.scenes);
    say!("read {read} episodes in {files} files, kept {kept} missions in {scenes} scenes");
    account.notes.iter().for_each(|(note, times)| say!("  {times} x {note}"));
    show_losses(&account.losses);
    if !account.losses.is_empty() {
        say!("All of it      {}", import.report_path().display());
    }
    let (out, split) = (args.out.display(), &args.split);
    say!("Data set       {out}");
    say!("Play it        avln challenge phase open ID --dataset {out} --split {split}");
    Ok(())
}

fn show_losses(losses: &[Loss]) {
    let goals = losses.iter().filter(|loss| !loss.goal.is_empty()).count();
    if losses.is_empty() {
        return;
    }
    say!("left out {} goals and {} whole episodes:", goals, losses.len() - goals);
    losses.iter().take(SHOWN_LOSSES).for_each(|loss| say!("  {loss}"));
}

fn foreign_format(name: &str) -> Result<ForeignFormat, String> {
    if name == "auto" {
        return Ok(ForeignFormat(None));
    }
    let known = Format::ALL.map(Format::name).join(", ");
    Format::from_name(name)
        .map(|format| ForeignFormat(Some(format)))
        .ok_or_else(|| format!("use auto or one of: {known}"))
}

#[derive(Debug, Subcommand)]
pub(crate) enum DbCommand {
    /// Write database, run logs, signing key, splits, recordings and heads to a file; a server may be running
    Backup {
        /// New file
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
    /// Create the data folder from a backup; it must be new or empty
    Restore {
        /// File written by avln data db backup
        #[arg(value_name = "FILE")]
        file: PathBuf,
    },
    /// Delete old run logs, and on request old records; scores remain
    Prune(PruneArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct PruneArgs {
    /// Minimum age since the run's end, such as 90d
    #[arg(long, value_name = "DAYS", value_parser = days)]
    older_than: u32,
    /// Delete records and ground truth too: these runs can no longer be replayed or rescored
    #[arg(long)]
    records: bool,
    /// Only print what would be deleted
    #[arg(long)]
    dry_run: bool,
}

fn days(text: &str) -> Result<u32, String> {
    const MOST: u32 = 36_500;
    let days = text.strip_suffix('d').and_then(|days| days.parse().ok());
    days.filter(|days| (1..=MOST).contains(days))
        .ok_or_else(|| format!("write days such as 90d, 1d to {MOST}d"))
}

pub(crate) async fn maintain(data: &Path, command: DbCommand) -> Result<(), Failure> {
    match command {
        DbCommand::Backup { file } => {
            let made = backup::make(data, &file).await?;
            say!("backup    {}", file.display());
            show_contents(&made);
            say!("It contains the signing key and ground truth: keep it private.");
        }
        DbCommand::Restore { file } => {
            let restored = backup::restore(&file, data).await?;
            say!("data      {}", data.display());
            say!("as of     {}", rfc3339(restored.manifest.made_ms));
            show_contents(&restored);
            say!("host it with: avln --data {} serve", data.display());
        }
        DbCommand::Prune(args) => {
            let now = now_unix_ms();
            let PruneArgs { older_than, records, dry_run } = args;
            let rule = PruneOptions { older_than_days: older_than, records, dry_run };
            let pruned = backup::prune(data, &rule, now).await?;
            let Pruned { runs, logs, bytes, records } = pruned;
            let would = if dry_run { "would be deleted" } else { "deleted" };
            say!("{runs} runs ended before {}", rfc3339(rule.cutoff_ms(now)));
            say!("run logs  {logs} {would}, {:.1} MiB", bytes as f64 / f64::from(1 << 20));
            if rule.records {
                say!("records   {records} {would}");
            }
            say!("scores    unchanged");
        }
    }
    Ok(())
}

fn show_contents(contents: &Contents) {
    let Contents { manifest, inventory, left_out } = contents;
    let open = inventory.runs.iter().filter(|run| !run.is_settled).count();
    let logs = manifest.files.keys().filter(|path| path.starts_with("runs/")).count();
    let mib = manifest.bytes() as f64 / f64::from(1 << 20);
    let Inventory { schema, teams, results, runs, .. } = inventory;
    let (runs, files) = (runs.len(), manifest.files.len());
    say!("database  schema {schema}, {teams} teams, {runs} runs ({open} open), {results} results");
    say!("files     {files} with {logs} run logs, {mib:.1} MiB, each read back and compared by hash");
    for path in left_out {
        let state = if path.exists() { "" } else { ", which does not exist" };
        say!("not in it {}{state}", path.display());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_numbers_with_a_d() {
        assert_eq!(days("90d"), Ok(90));
        for wrong in ["90", "0d", "-1d", "d", "36501d", "9h", "1.5d"] {
            assert!(days(wrong).unwrap_err().contains("90d"), "{wrong}");
        }
    }
}
