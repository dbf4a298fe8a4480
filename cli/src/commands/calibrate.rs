//! Proves that a server scores as the published one does.

use crate::output::say;
use avln_arena::setup::admit;
use avln_arena::{
    Arena, Failure, FailureKind, SCENE_MEMORY_MIB,
    data::DataFolder,
    servers::{Addresses, Servers},
};
use avln_lab::calibration::{self, Calibration, PHASE, Place, Reference, differences};
use std::{
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

/// What to calibrate.
#[derive(Clone, Debug, clap::Args)]
pub struct Options {
    /// A server that hosts the calibration phase; by default this program hosts it for itself, and leaves nothing behind
    #[arg(long, value_name = "URL", requires = "token")]
    pub server: Option<String>,
    /// PEM file of the authorities that an https server's certificate may come from, instead of those of the system
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    pub ca: Option<PathBuf>,
    /// Token of an account on that server
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    pub token: Option<String>,
    /// Play with one reference agent alone
    #[arg(long, value_enum, value_name = "AGENT")]
    pub agent: Option<Reference>,
    /// Make the calibration phase in the data folder, for its server to host, and play nothing
    #[arg(long, conflicts_with_all = ["server", "agent", "write"])]
    pub open: bool,
    /// Write what was found into a file instead of comparing it
    #[arg(long, value_name = "FILE")]
    pub write: Option<PathBuf>,
}

/// The team of reference agents on a server of this program's own.
const TEAM: &str = "calibration";

/// Lets the reference agents play, and compares what they sensed and reached with what is published.
///
/// # Errors
/// When the server cannot be played on, or a bit differs.
pub async fn run(data: &Path, options: Options) -> Result<(), Failure> {
    if options.open {
        return open(data).await;
    }
    let agents = options.agent.map_or(Reference::ALL.to_vec(), |agent| vec![agent]);
    let found = match (&options.server, &options.token) {
        (Some(server), Some(token)) => {
            let place = Place { server: server.clone(), ca: options.ca, token: token.clone() };
            play(&place, &agents).await?
        }
        _ => play_here(&agents).await?,
    };
    found.runs.iter().for_each(show);
    if let Some(path) = &options.write {
        return write(path, &found);
    }
    let lines = differences(&found, &calibration::published()?);
    for line in &lines {
        say!("{line}");
    }
    let episodes: usize = found.runs.iter().map(|run| run.episodes.len()).sum();
    if lines.is_empty() {
        say!("All {episodes} episodes are as published: every sense, action and metric, bit for bit.");
        return Ok(());
    }
    Err(Failure::new(FailureKind::Run, format!("the server is not calibrated: {} differences", lines.len()))
        .hinted(
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

/// Hosts the phase in a folder for the moment, and plays there.
async fn play_here(agents: &[Reference]) -> Result<Calibration, Failure> {
    let folder = tempfile::tempdir().map_err(|error| Failure::new(FailureKind::Data, error))?;
    let data = DataFolder::open(folder.path())?;
    let store = data.store().await?;
    say!("Building houses and missions");
    calibration::open(&data, &store).await?;
    let token = admit(&store, TEAM, Some(avln_store::Reference::Baseline)).await?;
    let arena = Arena::open(&data, store.clone(), SCENE_MEMORY_MIB).await?;
    let doors = Servers::bind(&Addresses::LOCAL).await?;
    let doors = doors.open(Arc::new(arena), store.reader())?;
    let place = Place { server: format!("http://{}", doors.grpc), ca: None, token };
    let found = play(&place, agents).await;
    doors.close().await?;
    store.close().await;
    found
}

async fn play(place: &Place, agents: &[Reference]) -> Result<Calibration, Failure> {
    calibration::play(place, agents, &mut |agent, end| {
        eprintln!("{agent:?}: episode {} of {}, {} steps", end.progress.done, end.progress.total, end.steps);
    })
    .await
}

fn show(run: &calibration::Played) {
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
