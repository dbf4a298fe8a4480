//! Soak: hours of 64 slots, killed agents, short connections and page views. Memory, descriptors and threads must stay flat.
//!
//! `cargo bench -p avln-tests --bench soak -- 120` takes two hours; the default is five minutes. `--pause-ms` sets the agents'
//! thinking time per step. `--kill-server` also kills the server every minute. Exit code 1: not flat, or errors. Linux only.

mod agents;
mod fleet;
mod tally;
mod visitors;

use agents::Agent;
use avln_arena::{data::DataFolder, setup::admit};
use avln_tests::{Server, TestSetup, set_up};
use fleet::{Fleet, PROCESSES};
use std::{
    net::{SocketAddr, TcpListener},
    path::Path,
    process::ExitCode,
    sync::Arc,
    thread::sleep,
    time::{Duration, Instant},
};
use tally::{Sample, Samples, ServerLog, Tally, check_database, verify_logs};
use tempfile::TempDir;
use tokio::runtime::{Builder, Runtime};
use visitors::Places;

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
const USAGE: &str = "usage: soak [MINUTES] [--pause-ms MS] [--kill-server]";
const SAMPLE_INTERVAL_S: u64 = 5;
/// Second of a minute in which an agent is killed.
const AGENT_KILL_S: u64 = 30;
/// Second of a minute in which the server is killed.
const SERVER_KILL_S: u64 = 50;

#[derive(Debug)]
struct Settings {
    minutes: u64,
    pause_ms: u64,
    kills_server: bool,
}

impl Settings {
    /// Returns the settings; `None` for an unknown word.
    fn parse(words: &[String]) -> Option<Self> {
        let mut settings = Self { minutes: 5, pause_ms: 150, kills_server: false };
        let mut words = words.iter();
        while let Some(word) = words.next() {
            match word.as_str() {
                "--kill-server" => settings.kills_server = true,
                "--pause-ms" => settings.pause_ms = words.next()?.parse().ok()?,
                minutes => settings.minutes = minutes.parse().ok()?,
            }
        }
        Some(settings)
    }
}

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| word != "--bench").collect();
    if let Some(agent) = Agent::parse(&words) {
        let runtime = Builder::new_current_thread().enable_all().build().expect("a runtime");
        runtime.block_on(agents::play(agent));
        return ExitCode::SUCCESS;
    }
    match Settings::parse(&words) {
        Some(settings) => soak(&Runtime::new().expect("a runtime"), settings),
        None => {
            eprintln!("{USAGE}");
            ExitCode::from(2)
        }
    }
}

/// Addresses that survive a restart of the server.
#[derive(Clone, Copy, Debug)]
struct Addresses {
    grpc: SocketAddr,
    web: SocketAddr,
    admin: SocketAddr,
}

impl Addresses {
    /// Ports below those of outgoing connections, one of which could take a port while the server is down.
    fn free() -> Self {
        let first = 20_000 + (std::process::id() % 9_000) as u16;
        let is_free = |address: &SocketAddr| TcpListener::bind(address).is_ok();
        let mut free = (first..32_000).map(|port| SocketAddr::from(([127, 0, 0, 1], port))).filter(is_free);
        let mut next = || free.next().expect("a free port");
        Self { grpc: next(), web: next(), admin: next() }
    }

    fn start(self, folder: &Path) -> Server {
        let [grpc, web, admin] = [self.grpc, self.web, self.admin].map(|address| address.to_string());
        Server::serve(PROGRAM, folder, &["--grpc", &grpc, "--web", &web, "--admin", &admin])
    }
}

/// A phase with 24 episodes, and a team per process and one for short connections.
async fn tokens(folder: &Path) -> Vec<String> {
    set_up(folder, &TestSetup { houses: 2, missions: 12, ..TestSetup::default() }).await;
    let data = DataFolder::open(folder).expect("the folder is writable");
    let store = data.store().await.expect("its database");
    let mut tokens = Vec::new();
    for number in 0..=PROCESSES {
        tokens.push(admit(&store, &format!("team {number}"), None).await.expect("a team"));
    }
    store.close().await;
    tokens
}

struct Soak {
    settings: Settings,
    folder: TempDir,
    addresses: Addresses,
    server: Option<Server>,
    fleet: Fleet,
    tally: Arc<Tally>,
    samples: Samples,
    log: ServerLog,
}

fn soak(runtime: &Runtime, settings: Settings) -> ExitCode {
    let folder = tempfile::tempdir().expect("a folder");
    println!("data folder {}", folder.path().display());
    let mut tokens = runtime.block_on(tokens(folder.path()));
    let addresses = Addresses::free();
    let server = Some(addresses.start(folder.path()));
    let tally = Arc::new(Tally::default());
    let begun = Instant::now();
    let until = begun + Duration::from_secs(60 * settings.minutes);
    let guest = tokens.pop().expect("the team for short connections");
    let places = Places { grpc: addresses.grpc, web: addresses.web, admin: addresses.admin };
    let visits = runtime.spawn(visitors::view_pages(places, tally.clone(), until));
    let teams = [tokens.clone(), vec![guest]].concat();
    let churn = runtime.spawn(visitors::churn(places, teams, tally.clone(), until));
    let fleet = Fleet::start(addresses.grpc, tokens, settings.pause_ms, until, tally.clone());
    let log = ServerLog::new(folder.path());
    let mut soak =
        Soak { settings, folder, addresses, server, fleet, tally, samples: Samples::default(), log };
    soak.run(begun);
    let (visits, churn) = runtime.block_on(async { tokio::join!(visits, churn) });
    visits.and(churn).expect("no panic");
    soak.finish(runtime)
}

impl Soak {
    fn run(&mut self, begun: Instant) {
        for second in 1..=60 * self.settings.minutes {
            sleep((begun + Duration::from_secs(second)).saturating_duration_since(Instant::now()));
            if second.is_multiple_of(SAMPLE_INTERVAL_S) {
                self.look(second);
            }
            self.inject_faults(second);
            if second.is_multiple_of(60) {
                self.print_minute(second / 60);
            }
        }
    }

    fn look(&mut self, second: u64) {
        self.log.read(&self.tally);
        let server = self.server.as_mut().expect("a server");
        if !server.is_running() {
            self.tally.finding("the server has ended");
            self.server = Some(self.addresses.start(self.folder.path()));
        } else if let Some(sample) = Sample::take(server.id(), second) {
            self.samples.push(sample);
        }
    }

    fn inject_faults(&mut self, second: u64) {
        self.fleet.revive();
        if second % 60 == AGENT_KILL_S {
            self.fleet.replace(second / 60);
        }
        if self.settings.kills_server && second % 60 == SERVER_KILL_S {
            self.tally.fault_begins();
            self.server.take().expect("a server").kill();
            self.server = Some(self.addresses.start(self.folder.path()));
            self.tally.fault_ends();
        }
    }

    fn print_minute(&self, minute: u64) {
        let sample = self.samples.last();
        println!(
            "{minute:>4} min: {:.0} MiB, {} fds, {} threads; {}",
            sample.rss_mib, sample.descriptors, sample.threads, self.tally
        );
    }

    fn finish(mut self, runtime: &Runtime) -> ExitCode {
        self.fleet.finish();
        self.log.read(&self.tally);
        self.server.take().expect("a server").kill();
        runtime.block_on(check_database(self.folder.path(), &self.tally));
        verify_logs(PROGRAM, self.folder.path(), &self.tally);
        println!("{}", self.tally);
        // A restart makes memory and descriptors small again.
        let is_flat = self.settings.kills_server || self.samples.are_flat(60 * self.settings.minutes);
        if is_flat && self.tally.unexpected() == 0 {
            return ExitCode::SUCCESS;
        }
        println!("data folder kept: {}", self.folder.keep().display());
        ExitCode::FAILURE
    }
}
