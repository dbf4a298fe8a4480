use crate::Baseline;
use avln_client::{Arena, EpisodeEnd, Error, Link, Order, RunOptions, RunSummary, evaluate_with};
use clap::Args;
use std::path::PathBuf;

/// What the agent is told on the command line.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Which agent plays
    #[arg(value_enum, value_name = "NAME")]
    pub agent: Baseline,
    /// Address of the server's gRPC port: http://, https:// or unix:/path
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file of the authorities that an https server's certificate may come from, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Token of the account; or of one run, which is then played, whatever phase and order say
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
    /// Phase to play in
    #[arg(long, default_value = "practice")]
    pub phase: String,
    /// Order of the missions: ordered or unordered
    #[arg(long, default_value = "unordered")]
    pub order: Order,
    /// Pixels a side of the pictures, 64 to 1024
    #[arg(long, default_value_t = 128, value_name = "PIXELS")]
    pub size: u32,
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
    let link = Link { ca: options.ca, ..Link::default() };
    let method =
        RunOptions::new(options.phase, options.agent.name()).method_version(env!("CARGO_PKG_VERSION"));
    let (arena, run) =
        Arena::begin(&options.server, options.token, &link, method.order(options.order)).await?;
    let mut agent = options.agent.agent();
    evaluate_with(&arena, &run, options.agent.sensors(options.size), agent.as_mut(), on_end).await
}
