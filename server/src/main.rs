//! The binary `avln`.

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = avln_server::Cli::parse();
    match avln_server::run(cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            eprintln!("error: {failure}");
            failure.exit_code()
        }
    }
}
