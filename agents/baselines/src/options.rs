use crate::Baseline;
use avln_client::{EpisodeEnd, Error, RunSummary};
use avln_kit::shell::{Method, RunArgs, play};
use clap::Args;

/// What the agent is told on the command line.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Which agent plays
    #[arg(value_enum, value_name = "NAME")]
    pub agent: Baseline,
    /// The run that it plays
    #[command(flatten)]
    pub run: RunArgs,
}

/// Plays one run.
///
/// # Errors
/// As for [`avln_client::evaluate`] and for beginning a run.
pub async fn run(options: Options) -> Result<RunSummary, Error> {
    run_with(options, &mut |_| {}).await
}

/// As [`run`], telling `on_end` about every episode that ended.
///
/// # Errors
/// As for [`run`].
pub async fn run_with(
    options: Options,
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, Error> {
    let Options { agent, run } = options;
    let sensors = agent.sensors(run.size);
    let method = Method { name: agent.name().to_owned(), version: env!("CARGO_PKG_VERSION"), sensors };
    let mut agents = run.agents(|| Ok::<_, Error>(agent.agent()))?;
    play(run, method, &mut agents, on_end).await
}
