//! Counts, errors, samples and checks of a soak.

use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{Connection, SqliteConnection};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};
use std::{fmt, fs};

/// Printed errors of each kind; further ones are counted only.
const SHOWN_ERRORS: u64 = 100;
/// Time after a restart in which clients may still report its effects.
const AFTERMATH: Duration = Duration::from_secs(20);

/// A counter.
#[derive(Debug, Default)]
pub(crate) struct Count(AtomicU64);

impl Count {
    pub(crate) fn add(&self, number: u64) {
        self.0.fetch_add(number, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// A run with its id and token.
pub(crate) type RunAccess = [String; 2];

/// Counts of a soak.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    pub(crate) steps: Count,
    pub(crate) started: Count,
    pub(crate) views: Count,
    pub(crate) connections: Count,
    pub(crate) agent_kills: Count,
    pub(crate) server_kills: Count,
    runs: Mutex<Runs>,
    errors: Mutex<Errors>,
}

#[derive(Debug, Default)]
struct Runs {
    /// Latest run by process.
    current: BTreeMap<usize, RunAccess>,
    completed: Vec<String>,
    /// Steps of ended episodes by handle.
    ended: BTreeMap<String, u32>,
}

#[derive(Debug, Default)]
struct Errors {
    unexpected: u64,
    explained: u64,
    /// End of the time in which a kill of the server explains errors.
    fault_until: Option<Instant>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().expect("no panic under the lock")
}

impl Tally {
    /// Records a line of an agent process.
    pub(crate) fn note(&self, process: usize, line: &str) {
        match line.split(' ').collect::<Vec<_>>().as_slice() {
            ["steps", steps] => self.steps.add(steps.parse().expect("a number of steps")),
            ["run", id, token] => {
                self.started.add(1);
                lock(&self.runs).current.insert(process, [id, token].map(|word| (*word).to_owned()));
            }
            ["end", handle, steps] => self.end(handle, steps.parse().expect("a number of steps")),
            ["complete", id] => lock(&self.runs).completed.push((*id).to_owned()),
            _ => self.error(&format!("agent {process}: {line}")),
        }
    }

    fn end(&self, handle: &str, steps: u32) {
        if lock(&self.runs).ended.insert(handle.to_owned(), steps).is_some() {
            self.finding(&format!("episode {handle} ended twice"));
        }
    }

    /// Records an error of a client, which a kill of the server may explain.
    pub(crate) fn error(&self, text: &str) {
        let mut errors = lock(&self.errors);
        if errors.fault_until.is_none_or(|until| until < Instant::now()) {
            errors.unexpected(text);
            return;
        }
        errors.explained += 1;
        if errors.explained <= SHOWN_ERRORS {
            println!("around a kill of the server: {text}");
        }
    }

    /// Records an error that no kill explains.
    pub(crate) fn finding(&self, text: &str) {
        lock(&self.errors).unexpected(text);
    }

    pub(crate) fn fault_begins(&self) {
        self.server_kills.add(1);
        lock(&self.errors).fault_until = Some(Instant::now() + Duration::from_secs(3600));
    }

    pub(crate) fn fault_ends(&self) {
        lock(&self.errors).fault_until = Some(Instant::now() + AFTERMATH);
    }

    pub(crate) fn unexpected(&self) -> u64 {
        lock(&self.errors).unexpected
    }

    /// Returns the latest run of a process.
    pub(crate) fn current(&self, process: usize) -> Option<RunAccess> {
        lock(&self.runs).current.get(&process).cloned()
    }

    /// Returns the completed runs, oldest first.
    pub(crate) fn completed(&self) -> Vec<String> {
        lock(&self.runs).completed.clone()
    }

    /// Returns the steps of ended episodes by handle.
    pub(crate) fn ended(&self) -> BTreeMap<String, u32> {
        lock(&self.runs).ended.clone()
    }
}

impl Errors {
    fn unexpected(&mut self, text: &str) {
        self.unexpected += 1;
        if self.unexpected <= SHOWN_ERRORS {
            println!("error: {text}");
        }
    }
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (completed, episodes) = {
            let runs = lock(&self.runs);
            (runs.completed.len(), runs.ended.len())
        };
        let errors = lock(&self.errors);
        write!(f, "{} steps, {episodes} episodes, ", self.steps.get())?;
        write!(f, "{completed} of {} runs complete, ", self.started.get())?;
        write!(f, "{} agents and {} servers killed, ", self.agent_kills.get(), self.server_kills.get())?;
        write!(f, "{} page views, {} short connections, ", self.views.get(), self.connections.get())?;
        write!(f, "{} errors, {} around kills of the server", errors.unexpected, errors.explained)
    }
}

/// Shortest warm-up, seconds.
const MIN_WARM_UP_S: u64 = 120;
/// Largest median of the last third in relation to the first.
const MAX_GROWTH: f64 = 1.05;
/// Fewest samples for a comparison.
const MIN_SAMPLES: usize = 9;

/// State of the server process.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Sample {
    /// Seconds since the start of the soak.
    second: u64,
    /// Resident memory, MiB.
    pub(crate) rss_mib: f64,
    pub(crate) descriptors: usize,
    pub(crate) threads: usize,
}

impl Sample {
    /// Returns the state of a process; `None` without `/proc`.
    pub(crate) fn take(process: u32, second: u64) -> Option<Self> {
        let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
        let number = |name: &str| {
            let line = status.lines().find_map(|line| line.strip_prefix(name))?;
            line.split_whitespace().next()?.parse::<usize>().ok()
        };
        let descriptors = fs::read_dir(format!("/proc/{process}/fd")).ok()?.count();
        let rss_mib = number("VmRSS:")? as f64 / 1024.0;
        Some(Self { second, rss_mib, descriptors, threads: number("Threads:")? })
    }
}

/// Samples in order of time.
#[derive(Debug, Default)]
pub(crate) struct Samples(Vec<Sample>);

impl Samples {
    pub(crate) fn push(&mut self, sample: Sample) {
        self.0.push(sample);
    }

    pub(crate) fn last(&self) -> Sample {
        self.0.last().copied().unwrap_or_default()
    }

    /// Prints and compares the first and the last third after the warm-up, a tenth of the time.
    pub(crate) fn are_flat(&self, length_s: u64) -> bool {
        let warm_up_s = (length_s / 10).max(MIN_WARM_UP_S);
        let warm: Vec<_> = self.0.iter().filter(|sample| sample.second > warm_up_s).copied().collect();
        if warm.len() < MIN_SAMPLES {
            println!("flatness: {} samples after {warm_up_s} s of warm-up are too few", warm.len());
            return true;
        }
        println!("after {warm_up_s} s of warm-up: {:+.1} MiB per hour", slope_mib_per_h(&warm));
        let of = |what: fn(&Sample) -> f64| warm.iter().map(what).collect::<Vec<_>>();
        [
            is_flat("memory, MiB", &of(|sample| sample.rss_mib)),
            is_flat("descriptors", &of(|sample| sample.descriptors as f64)),
            is_flat("threads", &of(|sample| sample.threads as f64)),
        ]
        .iter()
        .all(|flat| *flat)
    }
}

fn is_flat(name: &str, values: &[f64]) -> bool {
    let third = values.len() / 3;
    let [first, last] = [&values[..third], &values[values.len() - third..]].map(median);
    let most = values.iter().copied().fold(0.0, f64::max);
    let flat = last <= MAX_GROWTH * first;
    let verdict = if flat { "flat" } else { "NOT FLAT" };
    println!(
        "{name}: median {first:.0} in the first third, {last:.0} in the last, {most:.0} at most: {verdict}"
    );
    flat
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

/// Slope of the least-squares line through the memory.
fn slope_mib_per_h(samples: &[Sample]) -> f64 {
    let count = samples.len() as f64;
    let hours = |sample: &Sample| sample.second as f64 / 3600.0;
    let mean_h = samples.iter().map(hours).sum::<f64>() / count;
    let mean_mib = samples.iter().map(|sample| sample.rss_mib).sum::<f64>() / count;
    let product = |sample: &Sample| (hours(sample) - mean_h) * (sample.rss_mib - mean_mib);
    let square = |sample: &Sample| (hours(sample) - mean_h).powi(2);
    samples.iter().map(product).sum::<f64>() / samples.iter().map(square).sum::<f64>()
}

/// Most run logs to verify, because each is played again.
const MAX_VERIFIED: usize = 100;

/// The server's log, as far as it has been read.
#[derive(Debug)]
pub(crate) struct ServerLog {
    path: PathBuf,
    lines: usize,
}

impl ServerLog {
    pub(crate) fn new(folder: &Path) -> Self {
        Self { path: folder.join("server.log"), lines: 0 }
    }

    /// Records every new line: by default the log contains only warnings and errors.
    pub(crate) fn read(&mut self, tally: &Tally) {
        let text = fs::read_to_string(&self.path).unwrap_or_default();
        for line in text.lines().skip(self.lines) {
            tally.finding(&format!("server log: {line}"));
        }
        self.lines = text.lines().count();
    }
}

/// Rows with a run or an episode that is lost or counted twice.
const CONTRADICTIONS: &[(&str, &str)] = &[
    (
        "completed run with missing episodes",
        "SELECT id FROM runs WHERE state = 'completed' AND episodes != (SELECT COUNT(*) FROM episodes e \
         WHERE e.run = runs.id AND e.metrics IS NOT NULL)",
    ),
    (
        "run with a wrong number of scored episodes",
        "SELECT run FROM run_summaries s WHERE scored != (SELECT COUNT(*) FROM episodes e \
         WHERE e.run = s.run AND e.metrics IS NOT NULL)",
    ),
    (
        "scored episode without a record",
        "SELECT handle FROM episodes e WHERE metrics IS NOT NULL AND NOT EXISTS \
         (SELECT 1 FROM records r WHERE r.run = e.run AND r.ordinal = e.ordinal)",
    ),
];

/// Compares the database with the episodes that the agents saw end.
pub(crate) async fn check_database(folder: &Path, tally: &Tally) {
    let options = SqliteConnectOptions::new().filename(folder.join("avln.db"));
    let mut database = SqliteConnection::connect_with(&options).await.expect("the database");
    for (what, query) in CONTRADICTIONS.iter().copied() {
        let rows: Vec<String> = sqlx::query_scalar(query).fetch_all(&mut database).await.expect("rows");
        rows.iter().for_each(|row| tally.finding(&format!("{what}: {row}")));
    }
    let query = "SELECT handle, json_extract(metrics, '$.steps') FROM episodes WHERE metrics IS NOT NULL";
    let rows: Vec<(String, i64)> = sqlx::query_as(query).fetch_all(&mut database).await.expect("rows");
    let stored: BTreeMap<_, _> = rows.into_iter().collect();
    let ended = tally.ended();
    for (handle, steps) in &ended {
        match stored.get(handle) {
            Some(scored) if *scored == i64::from(*steps) => {}
            other => tally.finding(&format!("episode {handle} ended after {steps} steps; stored: {other:?}")),
        }
    }
    let unseen = stored.keys().filter(|handle| !ended.contains_key(*handle)).count();
    println!("{} episodes stored, {} of them seen by agents to the end", stored.len(), stored.len() - unseen);
}

/// Verifies run logs with the program, evenly chosen if there are many.
pub(crate) fn verify_logs(program: &str, folder: &Path, tally: &Tally) {
    let completed = tally.completed();
    let chosen: Vec<_> = completed.iter().step_by(completed.len().div_ceil(MAX_VERIFIED).max(1)).collect();
    let begun = Instant::now();
    for run in &chosen {
        let log = folder.join("runs").join(format!("{run}.log"));
        let mut verify = Command::new(program);
        verify.arg("--data").arg(folder).args(["run", "verify"]).arg(log);
        let output = verify.output().expect("the program runs");
        if !output.status.success() {
            tally.finding(&format!("log of {run}: {}", String::from_utf8_lossy(&output.stderr)));
        }
    }
    println!("{} of {} logs verified in {:.0?}", chosen.len(), completed.len(), begun.elapsed());
}
