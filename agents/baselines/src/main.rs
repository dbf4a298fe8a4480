//! `avln-baselines`: plays one run with a simple agent and prints its summary. Exit code 1 when it could not.

use avln_baselines::{Options, run_with};
use avln_kit::shell::{conclude, report};
use clap::Parser;
use std::process::ExitCode;

/// Plays one run of LH-AVLN Arena with a simple agent that others are compared with
#[derive(Parser)]
#[command(name = "avln-baselines", version)]
struct Cli {
    #[command(flatten)]
    options: Options,
}

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    conclude(run_with(Cli::parse().options, &mut report).await)
}
