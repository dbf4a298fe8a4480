use crate::{Error, PagNav, Weights};
use avln_client::{EpisodeEnd, RunSummary, Sensors};
use avln_kit::shell::{Method, RunArgs, play};
use clap::Args;
use std::path::PathBuf;

/// What the agent is told on the command line.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// The run that it plays
    #[command(flatten)]
    pub run: RunArgs,
    /// Name of the method on the board
    #[arg(long, default_value = "PAG-Nav", value_name = "NAME")]
    pub method: String,
    /// TOML file with numbers to use instead of the defaults, which agents/pag-nav/pag-nav.toml explains
    #[arg(long, value_name = "FILE")]
    pub weights: Option<PathBuf>,
}

/// Plays one run with [`PagNav`].
///
/// # Errors
/// When the weights cannot be used, as for [`avln_client::evaluate`], and for beginning a run.
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
    let weights = options.weights.as_deref().map_or_else(|| Ok(Weights::default()), Weights::read)?;
    let sensors = Sensors::square(options.run.size);
    let method = Method { name: options.method, version: env!("CARGO_PKG_VERSION"), sensors };
    Ok(play(options.run, method, &mut PagNav::new(weights), on_end).await?)
}
