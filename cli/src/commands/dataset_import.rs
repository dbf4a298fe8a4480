//! Imports missions of other data sets.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_episode::Rules;
use avln_interchange::{Format, Loss};
use avln_lab::dataset::import::Import;
use clap::Args;
use std::path::PathBuf;

/// Losses that are printed one by one.
const SHOWN: usize = 20;

/// What to import.
#[derive(Debug, Args)]
pub struct Options {
    /// auto, authors, goat, objectnav, instanceimagenav or multion
    #[arg(value_name = "FORMAT", value_parser = format)]
    pub format: Choice,
    /// A .json or .json.gz file, with the folder content beside it, or a folder of such files
    #[arg(value_name = "SRC")]
    pub source: PathBuf,
    /// Folder of the scenes that the missions name
    #[arg(long, value_name = "DIR")]
    pub scenes: PathBuf,
    /// Folder of the data set that is written
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Name of the split that the missions become
    #[arg(long, default_value = "val")]
    pub split: String,
    /// The rule set by which success regions and reference tours are computed
    #[arg(long, default_value = Rules::PAPER)]
    pub rules: String,
    /// Seed of what is drawn while episodes run
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

/// A format, or whatever the keys of a file say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice(Option<Format>);

/// Imports and tells what was kept and what was not.
///
/// # Errors
/// When a file is malformed, nothing can be kept, or the folder cannot be written.
pub fn run(options: &Options) -> Result<(), Failure> {
    let rules = Rules::named(&options.rules).map_err(|error| Failure::new(FailureKind::Scene, error))?;
    let import = Import {
        format: options.format.0,
        source: &options.source,
        scenes: &options.scenes,
        out: &options.out,
        split: &options.split,
        rules: &rules,
        seed: options.seed,
    };
    let account = import.run(|scene| say!("scene {scene}"))?;
    let (read, kept) = (account.episodes, account.missions);
    say!(
        "read {read} episodes in {} files, kept {kept} missions in {} scenes",
        account.files,
        account.scenes
    );
    account.notes.iter().for_each(|(note, times)| say!("  {times} x {note}"));
    show_losses(&account.losses);
    if !account.losses.is_empty() {
        say!("All of it      {}", import.report_path().display());
    }
    say!("Data set       {}", options.out.display());
    say!(
        "Play it        avln challenge phase open ID --dataset {} --split {}",
        options.out.display(),
        options.split
    );
    Ok(())
}

fn show_losses(losses: &[Loss]) {
    let goals = losses.iter().filter(|loss| !loss.goal.is_empty()).count();
    if losses.is_empty() {
        return;
    }
    say!("left out {} goals and {} whole episodes:", goals, losses.len() - goals);
    losses.iter().take(SHOWN).for_each(|loss| say!("  {loss}"));
}

fn format(name: &str) -> Result<Choice, String> {
    if name == "auto" {
        return Ok(Choice(None));
    }
    let known = Format::ALL.map(Format::name).join(", ");
    Format::from_name(name)
        .map(|format| Choice(Some(format)))
        .ok_or_else(|| format!("use auto or one of: {known}"))
}
