//! Runs the agents that come with the arena.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_human::HumanError;
use clap::Subcommand;

/// The agents that come with the arena; each connects as a client like everyone else.
#[derive(Debug, Subcommand)]
pub enum Agent {
    /// Walk at random: the floor of every leaderboard
    Random(avln_baselines::RandomArgs),
    /// Simple agents that others are compared with
    Baseline(avln_baselines::BaselineArgs),
    /// PAG-Nav, the reference agent
    PagNav(avln_pag_nav::PagNavArgs),
    /// A person in a browser on this machine, who senses and may do what agents do
    Human(avln_human::HumanArgs),
}

impl Agent {
    /// How many episodes it plays side by side.
    pub fn slots(&self) -> u32 {
        match self {
            Self::Random(_) | Self::Human(_) => 1,
            Self::Baseline(options) => options.run.slots,
            Self::PagNav(options) => options.run.slots,
        }
    }
}

/// Runs an agent to the end of its run.
///
/// # Errors
/// When the run fails.
pub async fn run(agent: Agent) -> Result<(), Failure> {
    let summary = match agent {
        Agent::Random(options) => avln_baselines::run_random(options).await.map_err(Failure::run)?,
        Agent::Baseline(options) => avln_baselines::run(options).await.map_err(Failure::run)?,
        Agent::PagNav(options) => avln_pag_nav::run(options).await.map_err(Failure::run)?,
        Agent::Human(options) => avln_human::run(options).await.map_err(human_failure)?,
    };
    say!("{summary}");
    Ok(())
}

fn human_failure(error: HumanError) -> Failure {
    let kind = match error {
        HumanError::Run(_) => FailureKind::Run,
        HumanError::Open(_) | HumanError::Page { .. } => FailureKind::Address,
    };
    Failure::new(kind, error)
}
