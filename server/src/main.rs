//! The binary `avln`.

use std::process::ExitCode;

fn main() -> ExitCode {
    avln_server::main()
}
