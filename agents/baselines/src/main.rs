//! `avln-baselines`: plays one run with a simple agent and prints its summary. Exit code 1 when it could not.

use avln_baselines::{Options, run_with};
use clap::Parser;
use std::process::ExitCode;

/// Plays one run of LH-AVLN Arena with a simple agent that others are compared with
#[derive(Parser)]
#[command(name = "avln-baselines", version)]
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
