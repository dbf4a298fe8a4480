//! Calibration: proof that a server scores like the published one.

use crate::output::say;
use avln_arena::{Failure, FailureKind, data::DataFolder, servers::RunningServers, setup::admit};
use avln_lab::calibration::{
    self, Calibration, CalibrationRun, CalibrationServer, PHASE, ReferenceAgent, differences,
};
use avln_store::Reference;
use std::{
    fs,
    path::{Path, PathBuf},
};

/// Arguments of `avln lab calibrate`.
#[derive(Clone, Debug, clap::Args)]
pub struct CalibrateArgs {
    /// Server that hosts the calibration phase; by default a temporary one in this process
    #[arg(long, value_name = "URL", requires = "token")]
    pub server: Option<String>,
    /// PEM file of trusted certificate authorities, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Account token on that server
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: Option<String>,
    /// Play only this reference agent
    #[arg(long, value_enum, value_name = "AGENT")]
    pub agent: Option<ReferenceAgent>,
    /// Open the calibration phase in the data folder, for its server, and exit
    #[arg(long, conflicts_with_all = ["server", "agent", "write"])]
    pub open: bool,
    /// Write the results to a file instead of comparing them
    #[arg(long, value_name = "FILE")]
    pub write: Option<PathBuf>,
}

/// Team of the reference agents on the temporary server.
const TEAM: &str = "calibration";

/// Plays the reference agents and compares their observations and scores with the published ones.
///
/// # Errors
/// If a run fails or a bit differs.
pub async fn run(data: &Path, args: CalibrateArgs) -> Result<(), Failure> {
    if args.open {
        return open(data).await;
    }
    let agents = args.agent.map_or(ReferenceAgent::ALL.to_vec(), |agent| vec![agent]);
    let found = match (&args.server, &args.token) {
        (Some(server), Some(token)) => {
            let server = CalibrationServer { url: server.clone(), ca: args.ca, token: token.clone() };
            play(&server, &agents).await?
        }
        _ => play_here(&agents).await?,
    };
    found.runs.iter().for_each(show);
    if let Some(path) = &args.write {
        return write(path, &found);
    }
    let lines = differences(&found, &calibration::published()?);
    for line in &lines {
        say!("{line}");
    }
    let episodes: usize = found.runs.iter().map(|run| run.episodes.len()).sum();
    if lines.is_empty() {
        say!("All {episodes} episodes are as published: every observation, action and metric, bit for bit.");
        return Ok(());
    }
    let message = format!("the server is not calibrated: {} differences", lines.len());
    Err(Failure::run(message).hinted(
        "its scores cannot be compared with the published ones; use the published version of the server",
    ))
}

async fn open(data: &Path) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    calibration::open(&data, &store).await?;
    store.close().await;
    say!("phase {PHASE} is open; once the server hosts it, agents prove it with:");
    say!("avln lab calibrate --server URL --token TOKEN");
    Ok(())
}

/// Hosts the phase in a temporary folder and plays it.
async fn play_here(agents: &[ReferenceAgent]) -> Result<Calibration, Failure> {
    let folder = tempfile::tempdir().map_err(|error| Failure::new(FailureKind::Data, error))?;
    let data = DataFolder::open(folder.path())?;
    let store = data.store().await?;
    say!("Building houses and missions");
    calibration::open(&data, &store).await?;
    let token = admit(&store, TEAM, Some(Reference::Baseline)).await?;
    let servers = RunningServers::local(&data, &store).await?;
    let server = CalibrationServer { url: servers.grpc_url(), ca: None, token };
    let found = play(&server, agents).await;
    servers.close().await?;
    store.close().await;
    found
}

async fn play(server: &CalibrationServer, agents: &[ReferenceAgent]) -> Result<Calibration, Failure> {
    calibration::play(server, agents, &mut |agent, end| {
        eprintln!("{agent:?}: episode {} of {}, {} steps", end.progress.done, end.progress.total, end.steps);
    })
    .await
}

fn show(run: &CalibrationRun) {
    let means: Vec<_> = run.means.iter().map(|(name, mean)| format!("{name} {mean:.6}")).collect();
    say!("{:<8} {:<10} {}", run.agent, run.order, means.join("  "));
}

fn write(path: &Path, found: &Calibration) -> Result<(), Failure> {
    let json =
        serde_json::to_string_pretty(found).map_err(|error| Failure::new(FailureKind::Internal, error))?;
    fs::write(path, json + "\n").map_err(|error| {
        Failure::new(FailureKind::Data, format!("cannot write {}: {error}", path.display()))
    })?;
    say!("written to {}", path.display());
    Ok(())
}
