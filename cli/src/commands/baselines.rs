//! Baseline suite, and demonstrations of the oracle for imitation learning.

use crate::{
    commands::split::SplitOrigin,
    output::{processors, progress_bar, say, write_file},
};
use avln_arena::{
    Failure,
    data::DataFolder,
    dataset::SplitFolder,
    run_blocking,
    setup::{self, sounds_for_phase},
};
use avln_episode::Order;
use avln_lab::{
    rollout::{RolloutOptions, RolloutTally, Sense},
    suite::{self, AgentVariant, SuiteOptions, SuiteSize},
};
use clap::{Args, Subcommand, ValueEnum};
use std::path::{Path, PathBuf};

#[derive(Debug, Subcommand)]
pub(crate) enum BaselinesCommand {
    /// Play the missions that are not yet in the results; can be stopped and continued at any time
    Run(BaselinesRunArgs),
    /// Write the page of results, and next to it results.csv with all episodes
    Report(BaselinesReportArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct BaselinesRunArgs {
    /// Agents; all by default
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    agents: Vec<AgentVariant>,
    /// Goal order
    #[arg(long, value_enum, default_value_t = OrderChoice::Both)]
    orders: OrderChoice,
    /// Missions per agent and order, spread evenly over the houses; all by default
    #[arg(long, value_name = "MISSIONS")]
    episodes: Option<usize>,
    /// Folder of the split, the server's data and the results
    #[arg(long, default_value = "avln-ladder", value_name = "FOLDER")]
    out: PathBuf,
    /// Parallel episodes; one per processor by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16))]
    slots: Option<u32>,
    /// Seed for the random agents
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Picture side in pixels, 64 to 512
    #[arg(long, default_value_t = 128, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=512))]
    size: u32,
    /// Play again what is in the results, for changed agents
    #[arg(long)]
    again: bool,
    /// Houses in the split; another number makes another split, which needs another --out
    #[arg(long, default_value_t = SuiteSize::default().houses)]
    houses: u32,
    /// Missions per house
    #[arg(long, default_value_t = SuiteSize::default().missions)]
    missions: usize,
    /// Folder for traces of PAG-Nav and its variants without privileges: a folder per variant and order, a file per mission
    #[arg(long, value_name = "FOLDER")]
    trace: Option<PathBuf>,
    /// Use houses of the training pool, to tune agents; needs another --out
    #[arg(long)]
    practice: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum OrderChoice {
    /// Both orders.
    Both,
    /// The given order.
    Ordered,
    /// Any order.
    Unordered,
}

#[derive(Clone, Debug, Args)]
pub(crate) struct BaselinesReportArgs {
    /// Suite folder
    #[arg(long, default_value = "avln-ladder", value_name = "FOLDER")]
    out: PathBuf,
    /// Page file
    #[arg(long, default_value = "docs/results.md", value_name = "FILE")]
    to: PathBuf,
}

pub(crate) async fn run(command: BaselinesCommand) -> Result<(), Failure> {
    match command {
        BaselinesCommand::Run(args) => {
            let played = suite::run(&args.out, &args.options()).await?;
            say!("{played} episodes were played; the results are in {}", args.out.display());
            say!("write the page with: avln lab baselines report --out {}", args.out.display());
            Ok(())
        }
        BaselinesCommand::Report(args) => {
            let report = suite::report(&args.out)?;
            let table = args.to.with_file_name("results.csv");
            for (path, text) in [(args.to, report.page), (table, report.episodes)] {
                write_file(&path, text)
                    .map_err(|failure| failure.hinted("choose another file with --to FILE"))?;
                say!("written to {}", path.display());
            }
            Ok(())
        }
    }
}

impl BaselinesRunArgs {
    fn options(&self) -> SuiteOptions {
        let (all, slots) = (AgentVariant::value_variants(), || processors().min(16) as u32);
        SuiteOptions {
            agents: if self.agents.is_empty() { all.to_vec() } else { self.agents.clone() },
            orders: match self.orders {
                OrderChoice::Both => vec![Order::Ordered, Order::Unordered],
                OrderChoice::Ordered => vec![Order::Ordered],
                OrderChoice::Unordered => vec![Order::Unordered],
            },
            episodes: self.episodes.unwrap_or(usize::MAX),
            slots: self.slots.unwrap_or_else(slots),
            seed: self.seed,
            side: self.size,
            again: self.again,
            size: SuiteSize { houses: self.houses, missions: self.missions, practice: self.practice },
            trace: self.trace.clone(),
        }
    }
}

#[derive(Clone, Debug, Args)]
pub(crate) struct RolloutArgs {
    /// Training split, in the data folder or in the data set of --dataset
    #[arg(long, value_name = "NAME")]
    split: String,
    #[command(flatten)]
    origin: SplitOrigin,
    /// Missions, in turn from all scenes; all by default
    #[arg(long, value_name = "COUNT")]
    episodes: Option<usize>,
    /// Folder for rollouts.json and one .npz file per episode; existing episodes are skipped
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Recorded sensors
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST",
          default_values_t = [Sense::Rgb, Sense::Depth, Sense::Pose, Sense::Audio])]
    sensors: Vec<Sense>,
    /// Picture side in pixels, 64 to 1024
    #[arg(long, value_name = "PIXELS", default_value_t = 256, value_parser = clap::value_parser!(u32).range(64..=1024))]
    size: u32,
    /// Goal order: ordered or unordered
    #[arg(long, default_value = "unordered")]
    order: Order,
    /// Threads, one per processor by default; files do not depend on it
    #[arg(long, visible_alias = "jobs", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
}

pub(crate) async fn roll_out(data: &Path, args: RolloutArgs) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let (split, openness) = args.origin.open(&data, &args.split).await?;
    openness.check_training(&split)?;
    run_blocking(move || record(&data, &split, &args)).await
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
