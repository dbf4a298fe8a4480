//! The program `avln`, built with the tests, so that it matches them.

use std::process::ExitCode;

fn main() -> ExitCode {
    avln_cli::main()
}
