//! `avln-pag-nav`: plays one run with the PAG-Nav agent and prints its summary. Exit code 1 on failure.

use avln_kit::run::{conclude, report, run_for};
use avln_pag_nav::{PagNavArgs, run_with};
use clap::Parser;
use std::process::ExitCode;

/// Play one run of LH-AVLN Arena with PAG-Nav, the reference agent
#[derive(Parser)]
#[command(name = "avln-pag-nav", version)]
struct Cli {
    #[command(flatten)]
    args: PagNavArgs,
}

fn main() -> ExitCode {
    let Cli { args } = Cli::parse();
    let played = run_for(args.run.slots, run_with(args, &mut report));
    played.map_or_else(|error| conclude(Err(error)), conclude)
}
