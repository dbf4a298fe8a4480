//! Lets all agents play one split, and writes down what they reach.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_episode::Order;
use avln_lab::suite::{self, Plan, Rung, Size};
use clap::{Args, Subcommand, ValueEnum};
use std::{
    num::NonZero,
    path::{Path, PathBuf},
    thread,
};

/// Commands about the ladder of agents.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Let agents play what they have not played yet; it can be stopped at any time and goes on with the next call
    Run(Run),
    /// Write the page about what was played, and beside it results.csv with each episode
    Report(Report),
}

/// Who plays what.
#[derive(Clone, Debug, Args)]
pub struct Run {
    /// Who plays; all by default
    #[arg(long, value_enum, value_delimiter = ',', value_name = "LIST")]
    pub agents: Vec<Rung>,
    /// How goals count
    #[arg(long, value_enum, default_value_t = Orders::Both)]
    pub orders: Orders,
    /// Missions that each agent plays in each order, an equal share in each house; all by default
    #[arg(long, value_name = "MISSIONS")]
    pub episodes: Option<usize>,
    /// Folder of the split, the server's data and the results
    #[arg(long, default_value = "avln-ladder", value_name = "FOLDER")]
    pub out: PathBuf,
    /// Episodes side by side; as many as there are processors by default
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16))]
    pub slots: Option<u32>,
    /// Seed of agents that draw
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Pixels a side of the pictures, 64 to 512
    #[arg(long, default_value_t = 128, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=512))]
    pub size: u32,
    /// Play again what was played, for agents that were changed
    #[arg(long)]
    pub again: bool,
    /// Houses of the split; another number makes another split, in a folder of its own
    #[arg(long, default_value_t = Size::default().houses)]
    pub houses: u32,
    /// Missions in each house
    #[arg(long, default_value_t = Size::default().missions)]
    pub missions: usize,
    /// Folder for traces of PAG-Nav and its variants that are not privileged: a folder for each and each order, a file for each mission
    #[arg(long, value_name = "FOLDER")]
    pub trace: Option<PathBuf>,
    /// Play in houses of the training pool, to tune agents there; in a folder of its own
    #[arg(long)]
    pub practice: bool,
}

/// Orders that are played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Orders {
    /// In both orders.
    Both,
    /// In the order of the goals.
    Ordered,
    /// In any order.
    Unordered,
}

/// Which page is written where.
#[derive(Clone, Debug, Args)]
pub struct Report {
    /// Folder of the ladder
    #[arg(long, default_value = "avln-ladder", value_name = "FOLDER")]
    pub out: PathBuf,
    /// The page
    #[arg(long, default_value = "docs/results.md", value_name = "FILE")]
    pub to: PathBuf,
}

/// Carries out a command about the ladder.
///
/// # Errors
/// When a folder or file cannot be used, or a run fails.
pub async fn run(command: Command) -> Result<(), Failure> {
    match command {
        Command::Run(options) => {
            let played = suite::run(&options.out, &options.plan()).await?;
            say!("{played} episodes were played; results lie in {}", options.out.display());
            say!("write the page with: avln lab baselines report --out {}", options.out.display());
            Ok(())
        }
        Command::Report(options) => {
            let report = suite::report(&options.out)?;
            write(&report.page, &options.to)?;
            write(&report.episodes, &options.to.with_file_name("results.csv"))
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

impl Run {
    fn plan(&self) -> Plan {
        let processors = || thread::available_parallelism().map_or(1, NonZero::get).min(16) as u32;
        Plan {
            agents: if self.agents.is_empty() { Rung::ALL.to_vec() } else { self.agents.clone() },
            orders: match self.orders {
                Orders::Both => vec![Order::Ordered, Order::Unordered],
                Orders::Ordered => vec![Order::Ordered],
                Orders::Unordered => vec![Order::Unordered],
            },
            episodes: self.episodes.unwrap_or(usize::MAX),
            slots: self.slots.unwrap_or_else(processors),
            seed: self.seed,
            side: self.size,
            again: self.again,
            size: Size { houses: self.houses, missions: self.missions, practice: self.practice },
            trace: self.trace.clone(),
        }
    }
}
