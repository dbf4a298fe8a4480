//! The baseline suite: all bundled agents on one split.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_episode::Order;
use avln_lab::suite::{self, AgentVariant, SuiteOptions, SuiteSize};
use clap::{Args, Subcommand, ValueEnum};
use std::{
    num::NonZero,
    path::{Path, PathBuf},
    thread,
};

/// Commands on the baseline suite.
#[derive(Debug, Subcommand)]
pub enum BaselinesCommand {
    /// Play the missions that are not yet in the results; can be stopped and continued at any time
    Run(BaselinesRunArgs),
    /// Write the page of results, and next to it results.csv with all episodes
    Report(BaselinesReportArgs),
}

/// Arguments of `run`.
#[derive(Clone, Debug, Args)]
pub struct BaselinesRunArgs {
    /// Agents; all by default
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    pub agents: Vec<AgentVariant>,
    /// Order of goals
    #[arg(long, value_enum, default_value_t = OrderChoice::Both)]
    pub orders: OrderChoice,
    /// Missions per agent and order, spread evenly over the houses; all by default
    #[arg(long, value_name = "MISSIONS")]
    pub episodes: Option<usize>,
    /// Folder of the split, the server's data and the results
    #[arg(long, default_value = "avln-ladder", value_name = "FOLDER")]
    pub out: PathBuf,
    /// Parallel episodes; one per processor by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub slots: Option<u32>,
    /// Seed of the random agents
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Side of pictures in pixels, 64 to 512
    #[arg(long, default_value_t = 128, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=512))]
    pub size: u32,
    /// Play again what is in the results, for changed agents
    #[arg(long)]
    pub again: bool,
    /// Houses of the split; another number makes another split, which needs another --out
    #[arg(long, default_value_t = SuiteSize::default().houses)]
    pub houses: u32,
    /// Missions per house
    #[arg(long, default_value_t = SuiteSize::default().missions)]
    pub missions: usize,
    /// Folder for traces of PAG-Nav and its variants without privileges: a folder per variant and order, a file per mission
    #[arg(long, value_name = "FOLDER")]
    pub trace: Option<PathBuf>,
    /// Use houses of the training pool, to tune agents; needs another --out
    #[arg(long)]
    pub practice: bool,
}

/// Orders of goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum OrderChoice {
    /// Both orders.
    Both,
    /// The given order.
    Ordered,
    /// Any order.
    Unordered,
}

/// Arguments of `report`.
#[derive(Clone, Debug, Args)]
pub struct BaselinesReportArgs {
    /// Folder of the suite
    #[arg(long, default_value = "avln-ladder", value_name = "FOLDER")]
    pub out: PathBuf,
    /// File of the page
    #[arg(long, default_value = "docs/results.md", value_name = "FILE")]
    pub to: PathBuf,
}

/// Runs a command on the baseline suite.
///
/// # Errors
/// If a folder or file cannot be used, or a run fails.
pub async fn run(command: BaselinesCommand) -> Result<(), Failure> {
    match command {
        BaselinesCommand::Run(args) => {
            let played = suite::run(&args.out, &args.options()).await?;
            say!("{played} episodes were played; the results are in {}", args.out.display());
            say!("write the page with: avln lab baselines report --out {}", args.out.display());
            Ok(())
        }
        BaselinesCommand::Report(args) => {
            let report = suite::report(&args.out)?;
            write(&report.page, &args.to)?;
            write(&report.episodes, &args.to.with_file_name("results.csv"))
        }
    }
}

fn write(page: &str, to: &Path) -> Result<(), Failure> {
    std::fs::write(to, page).map_err(|error| {
        Failure::new(FailureKind::Data, format!("cannot write {}: {error}", to.display()))
            .hinted("name another file with --to FILE")
    })?;
    say!("written to {}", to.display());
    Ok(())
}

impl BaselinesRunArgs {
    fn options(&self) -> SuiteOptions {
        let processors = || thread::available_parallelism().map_or(1, NonZero::get).min(16) as u32;
        SuiteOptions {
            agents: if self.agents.is_empty() {
                AgentVariant::value_variants().to_vec()
            } else {
                self.agents.clone()
            },
            orders: match self.orders {
                OrderChoice::Both => vec![Order::Ordered, Order::Unordered],
                OrderChoice::Ordered => vec![Order::Ordered],
                OrderChoice::Unordered => vec![Order::Unordered],
            },
            episodes: self.episodes.unwrap_or(usize::MAX),
            slots: self.slots.unwrap_or_else(processors),
            seed: self.seed,
            side: self.size,
            again: self.again,
            size: SuiteSize { houses: self.houses, missions: self.missions, practice: self.practice },
            trace: self.trace.clone(),
        }
    }
}
