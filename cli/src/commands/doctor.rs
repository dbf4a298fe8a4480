//! Tells before a run whether it will go well.

use crate::output::say;
use avln_arena::{Failure, FailureKind};
use avln_client::Sensors;
use avln_lab::doctor::{Patient, Report, examine};
use std::path::PathBuf;

/// What to look at.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// Address of the server's gRPC port: http://, https:// or unix:/path
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file of the authorities that an https server's certificate may come from, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Token of the account
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
    /// The phase that is to be played; by default the one to practise in, where runs are not counted
    #[arg(long, default_value_t, hide_default_value = true)]
    pub phase: String,
    /// A phase to practise in, by default the phase itself; nothing is played where runs are counted
    #[arg(long, value_name = "PHASE")]
    pub practice: Option<String>,
    /// Episodes to practise
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub episodes: u32,
    /// Actions in each of them, at most
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub steps: u32,
    /// Pixels a side of the pictures, 64 to 1024
    #[arg(long, default_value_t = 256, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=1024))]
    pub size: u32,
    /// As JSON
    #[arg(long)]
    pub json: bool,
}

/// Examines the server and prints what was found.
///
/// # Errors
/// When a run would fail.
pub async fn run(options: Options) -> Result<(), Failure> {
    let patient = Patient {
        server: options.server,
        ca: options.ca,
        token: options.token,
        phase: options.phase,
        practice: options.practice,
        episodes: options.episodes,
        steps: options.steps,
        sensors: Sensors::square(options.size),
    };
    let report = examine(&patient).await;
    if options.json {
        let json = serde_json::to_string_pretty(&report);
        say!("{}", json.map_err(|error| Failure::new(FailureKind::Internal, error))?);
    } else {
        show(&report);
    }
    if report.is_well() {
        return Ok(());
    }
    let failed = report.checks.iter().filter(|check| check.verdict == avln_lab::doctor::Verdict::Failed);
    let names: Vec<_> = failed.map(|check| check.name).collect();
    Err(Failure::new(FailureKind::Run, format!("a run would fail: {}", names.join(", "))))
}

fn show(report: &Report) {
    for check in &report.checks {
        say!("{:<8}  {:<10}  {}", check.verdict.as_str(), check.name, check.found.replace('\n', " "));
        if !check.next.is_empty() {
            say!("{:<8}  {:<10}  -> {}", "", "", check.next);
        }
    }
}
