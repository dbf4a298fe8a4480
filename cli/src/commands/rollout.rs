//! Records demonstrations of the oracle, to learn from.

use super::{dataset::bar, split_export::Origin};
use crate::output::say;
use avln_arena::{
    Failure, FailureKind, data::DataFolder, dataset::SplitFolder, register, setup::sounds_for_phase,
};
use avln_episode::Order;
use avln_lab::rollout::{Plan, Sense, Tally};
use clap::Args;
use std::path::{Path, PathBuf};

/// What to record.
#[derive(Clone, Debug, Args)]
pub struct Options {
    /// The split, one that is there to learn from: of the data folder or, with --dataset, of a data set
    #[arg(long, value_name = "NAME")]
    pub split: String,
    #[command(flatten)]
    origin: Origin,
    /// Missions: the first of each scene, then the second of each, and so on; all by default
    #[arg(long, value_name = "COUNT")]
    pub episodes: Option<usize>,
    /// The folder for rollouts.json and a .npz file for each episode; episodes that are there are not played again
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// What is written down of each step
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST",
          default_values_t = [Sense::Rgb, Sense::Depth, Sense::Pose, Sense::Audio])]
    pub sensors: Vec<Sense>,
    /// Pixels along a side of pictures, 64 to 1024
    #[arg(long, value_name = "PIXELS", default_value_t = 256, value_parser = clap::value_parser!(u32).range(64..=1024))]
    pub size: u32,
    /// Whether goals are visited in their order: ordered or unordered
    #[arg(long, default_value = "unordered")]
    pub order: Order,
    /// Scenes at the same time; one for each processor by default. The bytes are the same for any number
    #[arg(long, visible_alias = "jobs", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
}

/// Records, shows how far it is, and tells how much was recorded.
///
/// # Errors
/// When the split is not one to learn from, the folder holds other rollouts, or a scene cannot be used.
pub async fn run(data: &Path, options: Options) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let (split, openness) = options.origin.open(&data, &options.split).await?;
    openness.check_training(&split)?;
    let done = tokio::task::spawn_blocking(move || record(&data, &split, &options)).await;
    done.map_err(|error| Failure::new(FailureKind::Internal, error))?
}

fn record(data: &DataFolder, split: &SplitFolder, options: &Options) -> Result<(), Failure> {
    let mut rules = register::rules_of(split.name(), split)?;
    rules.sounds = sounds_for_phase(data, None, split)?;
    let mut senses = options.sensors.clone();
    senses.sort_unstable();
    senses.dedup();
    let plan = Plan {
        split,
        audio: data.audio(&rules)?,
        rules,
        order: options.order,
        senses,
        side_px: options.size,
        episodes: options.episodes,
        threads: options.threads.map(usize::from),
        cache: data.cache(),
    };
    let bar = bar("{bar:30} {pos}/{len} episodes, {elapsed} gone, {eta} left");
    bar.set_length(plan.count() as u64);
    let Tally { before, now, incomplete } = plan.run(&options.out, || bar.inc(1))?;
    bar.finish_and_clear();
    say!("{now} episodes were recorded, {before} were there before, in {}", options.out.display());
    if incomplete > 0 {
        say!(
            "in {incomplete} of them a goal was not found; readers leave these out unless they are asked not to"
        );
    }
    Ok(())
}
