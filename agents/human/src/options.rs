use crate::{door, game};
use avln_client::{Client, ConnectOptions, EpisodeEnd, Error, Order, RunOptions, RunSummary, Sensors};
use clap::Args;
use std::{io, net::SocketAddr, path::PathBuf};
use tokio::{
    net::TcpListener,
    sync::{mpsc, oneshot},
};

/// What the program is told on the command line.
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
    /// Pixels a side of the pictures, 64 to 1024
    #[arg(long, default_value_t = 256, value_name = "PIXELS")]
    pub size: u32,
    /// Where the page is, on this machine
    #[arg(long, default_value = "127.0.0.1:8090", value_name = "ADDRESS")]
    pub page: SocketAddr,
}

/// Why nobody could play.
#[derive(Debug, thiserror::Error)]
pub enum HumanError {
    /// As for every agent.
    #[error(transparent)]
    Run(#[from] Error),
    /// The page would be seen by other machines, who could play too.
    #[error(
        "{0} can be reached from other machines, and the page asks nobody who they are; use --page 127.0.0.1:8090"
    )]
    Open(SocketAddr),
    /// The page has no address.
    #[error("cannot show the page at {address}: {error}; choose another address with --page")]
    Page {
        /// Where it should have been.
        address: SocketAddr,
        /// Why it is not there.
        error: io::Error,
    },
}

/// Lets a person play one run, and tells on standard error where.
///
/// # Errors
/// When the run cannot be played, or the page cannot be shown.
pub async fn run(options: Options) -> Result<RunSummary, HumanError> {
    let tell =
        |address| eprintln!("open http://{address} in a browser on this machine and put headphones on");
    run_with(options, tell, &mut |_| {}).await
}

/// The same, telling `on_page` where the page is and `on_end` of every episode that ended.
///
/// # Errors
/// As for [`run`].
pub async fn run_with(
    options: Options,
    on_page: impl FnOnce(SocketAddr),
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, HumanError> {
    if !options.page.ip().is_loopback() {
        return Err(HumanError::Open(options.page));
    }
    let no_page = |error| HumanError::Page { address: options.page, error };
    let listener = TcpListener::bind(options.page).await.map_err(no_page)?;
    let address = listener.local_addr().map_err(no_page)?;
    let link = ConnectOptions { ca: options.ca, ..ConnectOptions::default() };
    let method = RunOptions::new(options.phase, "human").method_version(env!("CARGO_PKG_VERSION"));
    let method = method.order(options.order);
    let (arena, run) = Client::begin(&options.server, options.token, &link, method).await?;
    let play = arena.play(&run, Sensors::square(options.size)).await?;
    let (wishes, wished) = mpsc::channel(1);
    let (stop, stopped) = oneshot::channel();
    let door = tokio::spawn(door::serve(listener, address, wishes, stopped));
    on_page(address);
    let played = game::play(play, wished, on_end).await;
    // The last answer is on its way to the browser; a door that broke has nothing to finish.
    let _ = stop.send(());
    let _ = door.await;
    Ok(played?)
}
