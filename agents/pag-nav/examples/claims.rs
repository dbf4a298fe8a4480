//! Counts the Submits and Stops in a folder of traces, and those without sufficient visual support.
//!
//! ```sh
//! cargo run -p avln-pag-nav --example claims -- FOLDER
//! ```

use avln_pag_nav::summarise;
use std::path::PathBuf;
use std::process::ExitCode;

fn main() -> ExitCode {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        eprintln!("usage: claims FOLDER, a folder written by --trace");
        return ExitCode::FAILURE;
    };
    match summarise(&folder) {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}
