use crate::RandomAgent;
use avln_client::{
    Client, ConnectOptions, EpisodeEnd, Error, Order, RunOptions, RunSummary, Sensors, evaluate_with,
};
use clap::Args;
use std::path::PathBuf;

/// What the agent is told on the command line.
#[derive(Args, Clone, Debug)]
pub struct Options {
    /// Address of the server's gRPC port: http://, https:// or unix:/path
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file of the authorities that an https server's certificate may come from, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Token of the account; or of one run, which is then played, whatever phase and order say
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
    /// Phase to play in; by default the one to practise in, where runs are not counted
    #[arg(long, default_value_t, hide_default_value = true)]
    pub phase: String,
    /// Order of the missions: ordered or unordered
    #[arg(long, default_value = "unordered")]
    pub order: Order,
    /// Seed of the agent's choices
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Pixels a side of the pictures, 64 to 1024
    #[arg(long, default_value_t = 128, value_name = "PIXELS")]
    pub size: u32,
}

/// Plays one run with [`RandomAgent`].
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
    let link = ConnectOptions { ca: options.ca, ..ConnectOptions::default() };
    let method = RunOptions::new(options.phase, "random").method_version(env!("CARGO_PKG_VERSION"));
    let method = method.order(options.order);
    let (arena, run) = Client::begin(&options.server, options.token, &link, method).await?;
    let mut agent = RandomAgent::new(options.seed);
    evaluate_with(&arena, &run, Sensors::square(options.size), &mut agent, on_end).await
}
