//! `avln-pag-nav`: plays one run with the PAG-Nav agent and prints its summary. Exit code 1 when it could not.

use avln_kit::shell::{conclude, report, run_for};
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

fn main() -> ExitCode {
    let Cli { options } = Cli::parse();
    let played = run_for(options.run.slots, run_with(options, &mut report));
    played.map_or_else(|error| conclude(Err(error)), conclude)
}
