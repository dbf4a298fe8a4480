//! `avln-pag-nav`: plays one run with the PAG-Nav agent and prints its summary. Exit code 1 when it could not.

use avln_kit::shell::{conclude, report};
use avln_pag_nav::{Options, run_with};
use clap::Parser;
use std::process::ExitCode;

/// Plays one run of LH-AVLN Arena with PAG-Nav, the reference agent
#[derive(Parser)]
#[command(name = "avln-pag-nav", version)]
struct Cli {
    #[command(flatten)]
    options: Options,
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    conclude(run_with(Cli::parse().options, &mut report).await)
}
