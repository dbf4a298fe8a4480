//! The check before a run.

use crate::output::{print_json, say};
use avln_arena::{Failure, FailureKind};
use avln_client::Sensors;
use avln_lab::doctor::{DoctorOptions, DoctorReport, examine};
use std::path::PathBuf;

/// Arguments of `avln lab doctor`.
#[derive(Clone, Debug, clap::Args)]
pub struct DoctorArgs {
    /// URL of the gRPC server: http://, https:// or unix:/path
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    pub server: String,
    /// PEM file of trusted certificate authorities, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Account token
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: String,
    /// Phase of the planned run; the practice phase by default
    #[arg(long, default_value_t, hide_default_value = true)]
    pub phase: String,
    /// Phase for the practice episodes, --phase by default; phases that count runs are not played
    #[arg(long, value_name = "PHASE")]
    pub practice: Option<String>,
    /// Number of practice episodes
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    pub episodes: u32,
    /// Largest number of actions per practice episode
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub steps: u32,
    /// Side of pictures in pixels, 64 to 1024
    #[arg(long, default_value_t = 256, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=1024))]
    pub size: u32,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Runs all checks and prints the findings.
///
/// # Errors
/// If a run would fail.
pub async fn run(args: DoctorArgs) -> Result<(), Failure> {
    let options = DoctorOptions {
        server: args.server,
        ca: args.ca,
        token: args.token,
        phase: args.phase,
        practice: args.practice,
        episodes: args.episodes,
        steps: args.steps,
        sensors: Sensors::square(args.size),
    };
    let report = examine(&options).await;
    if args.json {
        print_json(&report)?;
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

fn show(report: &DoctorReport) {
    for check in &report.checks {
        say!("{:<8}  {:<10}  {}", check.verdict.as_str(), check.name, check.found.replace('\n', " "));
        if !check.next.is_empty() {
            say!("{:<8}  {:<10}  -> {}", "", "", check.next);
        }
    }
}
