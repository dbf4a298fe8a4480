//! `avln-baselines`: plays one run with a simple agent and prints its summary. Exit code 1 on failure.

use avln_baselines::{BaselineArgs, run_with};
use avln_kit::run::{conclude, report, run_for};
use clap::Parser;
use std::process::ExitCode;

/// Play one run of LH-AVLN Arena with a simple agent for comparison
#[derive(Parser)]
#[command(name = "avln-baselines", version)]
struct Cli {
    #[command(flatten)]
    args: BaselineArgs,
}

fn main() -> ExitCode {
    let Cli { args } = Cli::parse();
    let played = run_for(args.run.slots, run_with(args, &mut report));
    played.map_or_else(|error| conclude(Err(error)), conclude)
}
