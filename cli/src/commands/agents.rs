//! Bundled agents: a run of one agent, the baseline suite, and demonstrations of the oracle for imitation learning.

use crate::{
    commands::{phase::FeedbackLevel, split::SplitOrigin},
    output::{processors, progress_bar, say, write_file},
};
use avln_arena::{
    Failure,
    data::DataFolder,
    dataset::SplitFolder,
    run_blocking,
    setup::{self, sounds_for_phase},
};
use avln_episode::{FeedbackRule, Order};
use avln_human::HumanError;
use avln_lab::{
    rollout::{RolloutOptions, RolloutTally, Sense},
    suite::{self, AgentVariant, MergeTally, SuiteOptions, SuiteReport, SuiteShard, SuiteSize, Track},
};
use clap::{Args, Subcommand, ValueEnum};
use std::path::{Path, PathBuf};

#[derive(Debug, Subcommand)]
pub(crate) enum BaselinesCommand {
    /// Play the missions that are not yet in the results; can be stopped and continued at any time
    Run(BaselinesRunArgs),
    /// Add the results of other folders, such as the shards of several machines
    Merge(BaselinesMergeArgs),
    /// Write the page of results, and next to it results.csv with all episodes and the charts in images/
    Report(BaselinesReportArgs),
}

#[derive(Clone, Debug, Args)]
pub(crate) struct BaselinesRunArgs {
    /// Split and rules
    #[arg(long, value_enum, default_value_t = Track::Main, conflicts_with_all = ["quick", "hard"])]
    track: Track,
    /// Short for --track quick: 200 missions in small houses
    #[arg(long, conflicts_with = "hard")]
    quick: bool,
    /// Short for --track hard: the rule set lh-avln-hard-v1
    #[arg(long)]
    hard: bool,
    /// Agents; all rows of the track by default
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    agents: Vec<AgentVariant>,
    /// Goal order
    #[arg(long, value_enum, default_value_t = OrderChoice::Both)]
    orders: OrderChoice,
    /// Missions per agent and order, spread evenly over the houses; by default all or a sample of at least 200, depending on the agent
    #[arg(long, value_name = "MISSIONS")]
    episodes: Option<usize>,
    /// Part I of N of the missions, for several machines; join the results with merge
    #[arg(long, value_name = "I/N", default_value = "1/1", hide_default_value = true)]
    shard: SuiteShard,
    /// Feedback to Submits, a study of its own; the rule set's by default
    #[arg(long, value_enum)]
    feedback: Option<FeedbackLevel>,
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
    /// Houses in the split, by default 11, or 25 with --quick; another number makes another split, which needs another --out
    #[arg(long)]
    houses: Option<u32>,
    /// Missions per house, by default 50, or 8 with --quick
    #[arg(long)]
    missions: Option<usize>,
    /// Seed for houses and missions, by default the recipe's; another seed makes another split, which needs another --out
    #[arg(long, value_name = "SEED")]
    split_seed: Option<u64>,
    /// Folder for traces of PAG-Nav and its variants without privileges: a folder per variant and order, a file per mission
    #[arg(long, value_name = "FOLDER")]
    trace: Option<PathBuf>,
    /// TOML file of ONNX models; adds the row pag-nav-models. docs/models.md documents it
    #[arg(long, value_name = "FILE")]
    models: Option<PathBuf>,
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
pub(crate) struct BaselinesMergeArgs {
    /// Suite folders, results.jsonl files of such folders, or results.csv of a report
    #[arg(required = true, value_name = "FOLDER")]
    sources: Vec<PathBuf>,
    /// Suite folder of the joint results
    #[arg(long, default_value = "avln-ladder", value_name = "FOLDER")]
    out: PathBuf,
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
        BaselinesCommand::Merge(args) => {
            let MergeTally { added, known } = suite::merge(&args.out, &args.sources)?;
            say!("{added} results were added to {}, {known} were there before", args.out.display());
            Ok(())
        }
        BaselinesCommand::Report(args) => {
            let SuiteReport { page, episodes, charts, left_out } = suite::report(&args.out)?;
            let images = args.to.with_file_name("images");
            let mut files = vec![(args.to.with_file_name("results.csv"), episodes)];
            files.extend(charts.into_iter().map(|(name, svg)| (images.join(name), svg)));
            files.push((args.to, page));
            std::fs::create_dir_all(&images).map_err(|error| Failure::file("create", &images, error))?;
            for (path, text) in files {
                write_file(&path, text)
                    .map_err(|failure| failure.hinted("choose another file with --to FILE"))?;
                say!("written to {}", path.display());
            }
            if left_out > 0 {
                say!(
                    "{left_out} results of another version, seed, split, rule set or image size are not on the page; report them \
                     from a folder of their own"
                );
            }
            Ok(())
        }
    }
}

impl BaselinesRunArgs {
    fn track(&self) -> Track {
        match (self.quick, self.hard) {
            (true, _) => Track::Quick,
            (_, true) => Track::Hard,
            (false, false) => self.track,
        }
    }

    fn agents(&self, feedback: Option<FeedbackRule>) -> Vec<AgentVariant> {
        if !self.agents.is_empty() {
            return self.agents.clone();
        }
        let mut rows = self.track().rows(feedback);
        rows.extend(self.models.is_some().then_some(AgentVariant::PagNavModels));
        rows
    }

    fn options(&self) -> SuiteOptions {
        let (track, slots) = (self.track(), || processors().min(16) as u32);
        let feedback = self.feedback.map(FeedbackRule::from);
        let SuiteSize { houses, missions, .. } = track.size();
        SuiteOptions {
            track,
            agents: self.agents(feedback),
            orders: match self.orders {
                OrderChoice::Both => vec![Order::Ordered, Order::Unordered],
                OrderChoice::Ordered => vec![Order::Ordered],
                OrderChoice::Unordered => vec![Order::Unordered],
            },
            episodes: self.episodes,
            shard: self.shard,
            slots: self.slots.unwrap_or_else(slots),
            seed: self.seed,
            side: self.size,
            feedback,
            again: self.again,
            size: SuiteSize {
                houses: self.houses.unwrap_or(houses),
                missions: self.missions.unwrap_or(missions),
                practice: self.practice,
                split_seed: self.split_seed,
            },
            trace: self.trace.clone(),
            models: self.models.clone(),
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

/// The bundled agents; they connect as any other client.
#[derive(Debug, Subcommand)]
pub(crate) enum AgentCommand {
    /// Walk at random: the lower bound of every leaderboard
    Random(avln_baselines::RandomArgs),
    /// Run a simple agent for comparison
    Baseline(avln_baselines::BaselineArgs),
    /// Run PAG-Nav, the reference agent
    PagNav(avln_pag_nav::PagNavArgs),
    /// Play in a browser on this machine, with the senses and actions of an agent
    Human(avln_human::HumanArgs),
}

impl AgentCommand {
    pub(crate) fn slots(&self) -> u32 {
        match self {
            Self::Random(_) | Self::Human(_) => 1,
            Self::Baseline(options) => options.run.slots,
            Self::PagNav(options) => options.run.slots,
        }
    }
}

pub(crate) async fn play(agent: AgentCommand) -> Result<(), Failure> {
    let summary = match agent {
        AgentCommand::Random(options) => avln_baselines::run_random(options).await.map_err(Failure::run)?,
        AgentCommand::Baseline(options) => avln_baselines::run(options).await.map_err(Failure::run)?,
        AgentCommand::PagNav(options) => avln_pag_nav::run(options).await.map_err(Failure::run)?,
        AgentCommand::Human(options) => avln_human::run(options).await.map_err(human_failure)?,
    };
    say!("{summary}");
    Ok(())
}

fn human_failure(error: HumanError) -> Failure {
    match error {
        HumanError::Run(_) => Failure::run(error),
        HumanError::Open(_) | HumanError::Page { .. } => Failure::address(error),
    }
}
