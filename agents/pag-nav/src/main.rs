//! `avln-pag-nav`: plays one run with the PAG-Nav agent and prints its summary. Exit code 1 when it could not.

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

#[tokio::main(flavor = "current_thread")]
async fn main() -> ExitCode {
    let options = Cli::parse().options;
    let mut report = |end: &avln_client::EpisodeEnd| {
        let progress = end.progress;
        eprintln!(
            "episode {} of {}: {} after {} steps",
            progress.done, progress.total, end.reason, end.steps
        );
    };
    match run_with(options, &mut report).await {
        Ok(summary) => {
            println!("{summary}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}
