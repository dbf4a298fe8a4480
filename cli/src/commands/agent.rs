//! The bundled agents.

use crate::output::say;
use avln_arena::Failure;
use avln_human::HumanError;
use clap::Subcommand;

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

pub(crate) async fn run(agent: AgentCommand) -> Result<(), Failure> {
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
