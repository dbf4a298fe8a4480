//! `avln-baselines`: plays one run with a simple agent and prints its summary. Exit code 1 when it could not.

use avln_baselines::{Options, run_with};
use avln_kit::shell::{conclude, report, run_for};
use clap::Parser;
use std::process::ExitCode;

/// Plays one run of LH-AVLN Arena with a simple agent that others are compared with
#[derive(Parser)]
#[command(name = "avln-baselines", version)]
struct Cli {
    #[command(flatten)]
    options: Options,
}

fn main() -> ExitCode {
    let Cli { options } = Cli::parse();
    let played = run_for(options.run.slots, run_with(options, &mut report));
    played.map_or_else(|error| conclude(Err(error)), conclude)
}
