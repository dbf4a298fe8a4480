//! Demonstrations of the oracle, for imitation learning.

use super::split::SplitOrigin;
use crate::output::{progress_bar, say};
use avln_arena::{
    Failure, FailureKind,
    data::DataFolder,
    dataset::SplitFolder,
    setup::{self, sounds_for_phase},
};
use avln_episode::Order;
use avln_lab::rollout::{RolloutOptions, RolloutTally, Sense};
use clap::Args;
use std::path::{Path, PathBuf};

/// Arguments of `avln lab rollout`.
#[derive(Clone, Debug, Args)]
pub struct RolloutArgs {
    /// Training split, in the data folder or in the data set of --dataset
    #[arg(long, value_name = "NAME")]
    pub split: String,
    #[command(flatten)]
    origin: SplitOrigin,
    /// Number of missions, in turn from all scenes; all by default
    #[arg(long, value_name = "COUNT")]
    pub episodes: Option<usize>,
    /// Folder for rollouts.json and one .npz file per episode; existing episodes are skipped
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Recorded sensors
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST",
          default_values_t = [Sense::Rgb, Sense::Depth, Sense::Pose, Sense::Audio])]
    pub sensors: Vec<Sense>,
    /// Side of pictures in pixels, 64 to 1024
    #[arg(long, value_name = "PIXELS", default_value_t = 256, value_parser = clap::value_parser!(u32).range(64..=1024))]
    pub size: u32,
    /// Order of goals: ordered or unordered
    #[arg(long, default_value = "unordered")]
    pub order: Order,
    /// Threads, one per processor by default; files do not depend on it
    #[arg(long, visible_alias = "jobs", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

/// Records demonstrations and prints their number.
///
/// # Errors
/// If the split is not a training split, the folder contains other rollouts, or a scene cannot be used.
pub async fn run(data: &Path, args: RolloutArgs) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let (split, openness) = args.origin.open(&data, &args.split).await?;
    openness.check_training(&split)?;
    let done = tokio::task::spawn_blocking(move || record(&data, &split, &args)).await;
    done.map_err(|error| Failure::new(FailureKind::Internal, error))?
}

fn record(data: &DataFolder, split: &SplitFolder, args: &RolloutArgs) -> Result<(), Failure> {
    let mut rules = setup::rules_of(split.name(), split)?;
    rules.sounds = sounds_for_phase(data, None, split)?;
    let mut senses = args.sensors.clone();
    senses.sort_unstable();
    senses.dedup();
    let plan = RolloutOptions {
        split,
        audio: data.audio(&rules)?,
        rules,
        order: args.order,
        senses,
        side_px: args.size,
        episodes: args.episodes,
        threads: args.threads.map(usize::from),
        cache: data.cache(),
    };
    let bar = progress_bar("episodes", plan.count());
    let RolloutTally { before, now, incomplete } = plan.run(&args.out, || bar.inc(1))?;
    bar.finish_and_clear();
    say!("{now} episodes were recorded, {before} were there before, in {}", args.out.display());
    if incomplete > 0 {
        say!(
            "in {incomplete} of them a goal was not found; readers leave these out unless they are asked not to"
        );
    }
    Ok(())
}
