//! Counts and errors of a soak.

use std::{
    collections::BTreeMap,
    fmt,
    sync::{
        Mutex, MutexGuard,
        atomic::{AtomicU64, Ordering},
    },
    time::{Duration, Instant},
};

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
