//! Checks: doctor before a run, protocol conformance, server calibration.

use crate::output::{print_json, say, write_file};
use avln_arena::{Failure, data::DataFolder, run_blocking, servers::RunningServers, setup::admit};
use avln_client::Sensors;
use avln_conformance::{Check, Host, Outcome, Scenario, Site, check};
use avln_lab::{
    calibration::{
        self, Calibration, CalibrationRun, CalibrationServer, PHASES, ReferenceAgent, differences,
    },
    doctor::{DoctorOptions, DoctorReport, examine},
};
use avln_store::Reference;
use std::{
    net::SocketAddr,
    path::{Path, PathBuf},
};

#[derive(Clone, Debug, clap::Args)]
pub(crate) struct DoctorArgs {
    /// gRPC server URL: http://, https:// or unix:/path
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    server: String,
    /// PEM file with trusted certificate authorities, instead of the system's
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Account token
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    token: String,
    /// Phase of the planned run; the practice phase by default
    #[arg(long, default_value_t, hide_default_value = true)]
    phase: String,
    /// Phase for the practice episodes, --phase by default; phases that count runs are not played
    #[arg(long, value_name = "PHASE")]
    practice: Option<String>,
    /// Practice episodes
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=100))]
    episodes: u32,
    /// Action limit per practice episode
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=1000))]
    steps: u32,
    /// Picture side in pixels, 64 to 1024
    #[arg(long, default_value_t = 256, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(64..=1024))]
    size: u32,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(crate) async fn diagnose(args: DoctorArgs) -> Result<(), Failure> {
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
        print_diagnosis(&report);
    }
    if report.is_well() {
        return Ok(());
    }
    let failed = report.checks.iter().filter(|check| check.verdict == avln_lab::doctor::Verdict::Failed);
    let names: Vec<_> = failed.map(|check| check.name).collect();
    Err(Failure::run(format!("a run would fail: {}", names.join(", "))))
}

fn print_diagnosis(report: &DoctorReport) {
    for check in &report.checks {
        say!("{:<8}  {:<10}  {}", check.verdict.as_str(), check.name, check.found.replace('\n', " "));
        if !check.next.is_empty() {
            say!("{:<8}  {:<10}  -> {}", "", "", check.next);
        }
    }
}

#[derive(Clone, Debug, clap::Args)]
pub(crate) struct ConformanceArgs {
    /// gRPC server URL: http:// or https://
    #[arg(long, env = "AVLN_SERVER", default_value = "http://127.0.0.1:50051", value_name = "URL")]
    server: String,
    /// PEM file with trusted certificate authorities, instead of the system's
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Account token
    #[arg(
        long,
        env = "AVLN_TOKEN",
        hide_env_values = true,
        value_name = "TOKEN",
        required_unless_present = "client"
    )]
    token: Option<String>,
    /// Phase for the test run, which plays a few steps of about ten episodes
    #[arg(long, required_unless_present = "client")]
    phase: Option<String>,
    /// Check a client instead: listen at this address, accept the first run with any token and phase, inject faults, and report
    /// the client's reactions. The client may use a stream with one or two slots, or unary calls
    #[arg(long, value_name = "ADDRESS")]
    client: Option<SocketAddr>,
    /// Faults for the client: those after which it plays on, the end of the run while it is disconnected, or a takeover of the run
    /// by another connection, after which it stops with an error
    #[arg(long, value_enum, default_value_t, value_name = "CASE", requires = "client")]
    case: ClientCase,
}

#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
enum ClientCase {
    #[default]
    Faults,
    Ended,
    Superseded,
}

impl From<ClientCase> for Scenario {
    fn from(case: ClientCase) -> Self {
        match case {
            ClientCase::Faults => Self::Faults,
            ClientCase::Ended => Self::Ended,
            ClientCase::Superseded => Self::Superseded,
        }
    }
}

pub(crate) async fn check_conformance(args: ConformanceArgs) -> Result<(), Failure> {
    let checks = match args.client {
        Some(address) => host(address, args.case.into()).await?,
        None => {
            let (token, phase) = (args.token.unwrap_or_default(), args.phase.unwrap_or_default());
            let ca = args.ca.map(read_authorities).transpose()?;
            let site = Site { server: &args.server, ca: ca.as_deref() };
            let checks = check(&site, &token, &phase).await;
            checks.map_err(Failure::run)?
        }
    };
    print_rules(&checks)
}

fn read_authorities(file: PathBuf) -> Result<String, Failure> {
    std::fs::read_to_string(&file).map_err(|error| {
        let message = format!("cannot read the authorities in {}: {error}", file.display());
        Failure::run(message).hinted("--ca takes a PEM file")
    })
}

async fn host(address: SocketAddr, scenario: Scenario) -> Result<Vec<Check>, Failure> {
    let host = Host::bind(address, scenario).await.map_err(|error| {
        Failure::address(format!("cannot listen at {address}: {error}"))
            .hinted("use an address of this machine with a free port, such as --client 127.0.0.1:50052")
    })?;
    say!("waiting for a client at http://{}", host.address);
    Ok(host.check().await)
}

fn print_rules(checks: &[Check]) -> Result<(), Failure> {
    let mut broken = 0;
    for check in checks {
        match &check.outcome {
            Outcome::Kept => say!("kept         {}", check.rule),
            Outcome::NotOffered => say!("not offered  {}", check.rule),
            Outcome::Broken(what) => {
                broken += 1;
                say!("BROKEN       {}: {what}", check.rule);
            }
        }
    }
    match broken {
        0 => {
            say!("{} rules checked, none broken", checks.len());
            Ok(())
        }
        broken => Err(Failure::run(format!("{broken} of {} rules are broken", checks.len()))
            .hinted("the rules are in proto/PROTOCOL.md")),
    }
}

#[derive(Clone, Debug, clap::Args)]
pub(crate) struct CalibrateArgs {
    /// Server that hosts the calibration phases; by default a temporary one in this process
    #[arg(long, value_name = "URL", requires = "token")]
    server: Option<String>,
    /// PEM file with trusted certificate authorities, instead of the system's
    #[arg(long, env = "AVLN_CA", value_name = "FILE")]
    ca: Option<PathBuf>,
    /// Account token on that server
    #[arg(long, env = "AVLN_TOKEN", hide_env_values = true, value_name = "TOKEN")]
    token: Option<String>,
    /// Play only this reference agent, and build no data set
    #[arg(long, value_enum, value_name = "AGENT")]
    agent: Option<ReferenceAgent>,
    /// Open the calibration phases in the data folder, for its server, and exit
    #[arg(long, conflicts_with_all = ["server", "agent", "write"])]
    open: bool,
    /// Write the results to a file instead of comparing them
    #[arg(long, value_name = "FILE")]
    write: Option<PathBuf>,
}

const CALIBRATION_TEAM: &str = "calibration";

/// Plays the reference agents, builds a data set, and compares observations, scores and digest with the published ones.
pub(crate) async fn calibrate(data: &Path, args: CalibrateArgs) -> Result<(), Failure> {
    if args.open {
        return open_phases(data).await;
    }
    let agents = args.agent.map_or(ReferenceAgent::ALL.to_vec(), |agent| vec![agent]);
    let found = match (&args.server, &args.token) {
        (Some(server), Some(token)) => {
            let server = CalibrationServer { url: server.clone(), ca: args.ca, token: token.clone() };
            play(&server, &agents).await?
        }
        _ => play_here(&agents, args.agent.is_none()).await?,
    };
    found.runs.iter().for_each(print_means);
    if let Some(path) = &args.write {
        let json = serde_json::to_string_pretty(&found).map_err(Failure::internal)?;
        write_file(path, json + "\n")?;
        say!("written to {}", path.display());
        return Ok(());
    }
    let lines = differences(&found, &calibration::published()?);
    for line in &lines {
        say!("{line}");
    }
    let episodes: usize = found.runs.iter().map(|run| run.episodes.len()).sum();
    if lines.is_empty() {
        say!("All {episodes} episodes are as published: every observation, action and metric, bit for bit.");
        if let Some(digest) = &found.dataset {
            say!("The data set mini is as published: {digest}");
        }
        return Ok(());
    }
    let message = format!("the server is not calibrated: {} differences", lines.len());
    Err(Failure::run(message).hinted(
        "its scores cannot be compared with the published ones; use the published version of the server",
    ))
}

async fn open_phases(data: &Path) -> Result<(), Failure> {
    let data = DataFolder::open(data)?;
    let store = data.store().await?;
    calibration::open(&data, &store).await?;
    store.close().await;
    let phases = PHASES.map(|phase| phase.id).join(" and ");
    say!("phases {phases} are open; once the server hosts them, any team can check it with:");
    say!("avln lab calibrate --server URL --token TOKEN");
    Ok(())
}

async fn play_here(agents: &[ReferenceAgent], with_dataset: bool) -> Result<Calibration, Failure> {
    let folder = tempfile::tempdir().map_err(Failure::data)?;
    let data = DataFolder::open(folder.path())?;
    let store = data.store().await?;
    say!("Building houses and missions");
    let place = folder.path().join("dataset");
    let build = move || with_dataset.then(|| calibration::build_dataset(&place)).transpose();
    let dataset = run_blocking(build).await?;
    calibration::open(&data, &store).await?;
    let token = admit(&store, CALIBRATION_TEAM, Some(Reference::Baseline)).await?;
    let servers = RunningServers::local(&data, &store).await?;
    let server = CalibrationServer { url: servers.grpc_url(), ca: None, token };
    let found = play(&server, agents).await;
    servers.close().await?;
    store.close().await;
    Ok(Calibration { dataset, ..found? })
}

async fn play(server: &CalibrationServer, agents: &[ReferenceAgent]) -> Result<Calibration, Failure> {
    calibration::play(server, agents, &mut |agent, phase, end| {
        let (done, total) = (end.progress.done, end.progress.total);
        eprintln!("{agent:?}, phase {phase}: episode {done} of {total}, {} steps", end.steps);
    })
    .await
}

fn print_means(run: &CalibrationRun) {
    let means: Vec<_> = run.means.iter().map(|(name, mean)| format!("{name} {mean:.6}")).collect();
    say!("{:<8} {:<9} {:<16} {}", run.agent, run.order, run.phase, means.join("  "));
}
