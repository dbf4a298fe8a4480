//! `avln-random`: plays one run with the random agent and prints its summary. Exit code 1 on failure.

use avln_baselines::{RandomArgs, run_random_with};
use avln_kit::run::{conclude, report, run_for};
use clap::Parser;
use std::process::ExitCode;

/// Play one run of LH-AVLN Arena with the random agent, the lower bound of every leaderboard
#[derive(Parser)]
#[command(name = "avln-random", version)]
struct RandomCli {
    #[command(flatten)]
    args: RandomArgs,
}

fn main() -> ExitCode {
    let RandomCli { args } = RandomCli::parse();
    let played = run_for(1, run_random_with(args, &mut report));
    played.map_or_else(|error| conclude(Err(error)), conclude)
}
