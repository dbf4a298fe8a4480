//! A person as an agent: the program plays a run like every agent, and a browser page on this machine asks the person for
//! actions. The person gets the observations and budgets of an agent; the same referee judges the episode.
//!
//! Start reading at [`run`]: `game` plays the run, `page` serves the browser page.
//!
//! *Never*: shows the person more than an agent observes; links a server crate other than `avln-simd`.

mod game;
mod page;

use avln_client::{EpisodeEnd, Error, RunSummary, Sensors};
use clap::Args;
use std::{io, net::SocketAddr};
use tokio::net::TcpListener;
use tokio::sync::{mpsc, oneshot};

pub use avln_kit::run::RunArgs;

/// Command-line arguments.
#[derive(Args, Clone, Debug)]
pub struct HumanArgs {
    /// The run.
    #[command(flatten)]
    pub run: RunArgs,
    /// Side of the images in pixels, 64 to 1024
    #[arg(long, default_value_t = 256, value_name = "PIXELS")]
    pub size: u32,
    /// Address of the page on this machine
    #[arg(long, default_value = "127.0.0.1:8090", value_name = "ADDRESS")]
    pub page: SocketAddr,
}

/// Reasons for a failed run.
#[derive(Debug, thiserror::Error)]
pub enum HumanError {
    /// An error of the run, as for every agent.
    #[error(transparent)]
    Run(#[from] Error),
    /// The page would be reachable from other machines.
    #[error("{0} is reachable from other machines, and the page has no login; use --page 127.0.0.1:8090")]
    Open(SocketAddr),
    /// The page's address is not available.
    #[error("cannot show the page at {address}: {error}; choose another address with --page")]
    Page {
        /// Requested address.
        address: SocketAddr,
        /// System error.
        error: io::Error,
    },
}

/// Lets a person play one run, and prints the page's address to standard error.
///
/// # Errors
/// If the run fails or the page cannot be shown.
pub async fn run(args: HumanArgs) -> Result<RunSummary, HumanError> {
    let print = |address| {
        eprintln!("open http://{address} in a browser on this machine and put headphones on");
    };
    run_with(args, print, &mut |_| {}).await
}

/// Lets a person play one run; calls `on_page` with the page's address and `on_end` after each episode.
///
/// # Errors
/// As for [`run`].
pub async fn run_with(
    args: HumanArgs,
    on_page: impl FnOnce(SocketAddr),
    on_end: &mut (dyn FnMut(&EpisodeEnd) + Send),
) -> Result<RunSummary, HumanError> {
    if !args.page.ip().is_loopback() {
        return Err(HumanError::Open(args.page));
    }
    let no_page = |error| HumanError::Page { address: args.page, error };
    let listener = TcpListener::bind(args.page).await.map_err(no_page)?;
    let address = listener.local_addr().map_err(no_page)?;
    let (arena, run) = args.run.begin("human", env!("CARGO_PKG_VERSION")).await?;
    let play = arena.play(&run, Sensors::square(args.size)).await?;
    let (requests, received) = mpsc::channel(1);
    let (stop, stopped) = oneshot::channel();
    let page = tokio::spawn(page::serve(listener, address, requests, stopped));
    on_page(address);
    let played = game::play(play, received, on_end).await;
    // The last answer may still be on its way to the browser: the page closes only after sending it. A failed page has
    // nothing to finish.
    let _ = stop.send(());
    let _ = page.await;
    Ok(played?)
}
