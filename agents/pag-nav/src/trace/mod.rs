//! Episode traces as JSON Lines, specified in `docs/traces.md`; a trace never affects actions.

use crate::trace::lines::{MapLine, MissionLine, StepLine, TraceInput, TraceLine, TracedState};
use avln_client::{Action, Mission, Observation};
use serde_json::Value;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::{fmt, process};

pub(crate) mod lines;
#[cfg(test)]
mod tests;

/// Steps between map lines.
const MAP_STEPS: u32 = 25;

/// A trace writer: a JSON Lines file per episode, named by the episode's handle.
///
/// A failed write ends the episode's trace; [`PagNav::end_trace`](crate::PagNav::end_trace) returns the error.
pub struct Recorder {
    folder: PathBuf,
    file: Option<TraceFile>,
    before: TracedState,
    /// Last written step, and step at the last map line.
    last_step: Option<u32>,
    map_step: Option<u32>,
    failure: Option<TraceError>,
}

struct TraceFile {
    episode: String,
    path: PathBuf,
    out: Box<dyn Write + Send>,
}

/// Reasons for a missing or incomplete trace.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The folder cannot be created or is not writable.
    #[error("cannot write traces to {}: {problem}; give --trace a writable folder", folder.display())]
    Folder {
        /// Folder as given.
        folder: PathBuf,
        /// System error.
        problem: io::Error,
    },
    /// A file is incomplete.
    #[error("trace {} is incomplete: {problem}; the agent's actions were not affected", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// System error.
        problem: io::Error,
    },
    /// An episode's handle is not a valid file name.
    #[error(
        "no trace of episode {handle:?}: the handle is not a valid file name (1 to 128 letters, digits, '-', '_' and '.', \
         not starting with '.')"
    )]
    Handle {
        /// Handle from the server.
        handle: String,
    },
    /// A trace or a folder of traces cannot be read.
    #[error("cannot read trace {}: {problem}; give a folder written by --trace", path.display())]
    Unreadable {
        /// File or folder.
        path: PathBuf,
        /// First problem.
        problem: String,
    },
}

impl Recorder {
    /// Creates a recorder and its `folder`; fails if the folder is not writable.
    pub fn new(folder: impl Into<PathBuf>) -> Result<Self, TraceError> {
        let folder = folder.into();
        if let Err(problem) = check_writable(&folder) {
            return Err(TraceError::Folder { folder, problem });
        }
        let before = TracedState::default();
        Ok(Self { folder, file: None, before, last_step: None, map_step: None, failure: None })
    }

    /// Ends the current trace and opens the file of `episode`.
    pub(crate) fn enter(&mut self, agent: &TraceInput, episode: &str) {
        self.end(agent);
        if !is_file_name(episode) {
            return self.fail(TraceError::Handle { handle: episode.to_owned() });
        }
        let path = self.folder.join(format!("{episode}.jsonl"));
        match File::create(&path) {
            Ok(file) => self.write_to(episode, path, Box::new(BufWriter::new(file))),
            Err(problem) => self.fail(TraceError::File { path, problem }),
        }
    }

    fn write_to(&mut self, episode: &str, path: PathBuf, out: Box<dyn Write + Send>) {
        self.file = Some(TraceFile { episode: episode.to_owned(), path, out });
    }

    pub(crate) fn begin(&mut self, agent: &TraceInput, mission: &Mission) {
        self.before = TracedState::of(agent);
        (self.last_step, self.map_step) = (None, None);
        let Some(file) = &self.file else { return };
        let episode = file.episode.clone();
        self.write(&TraceLine::Mission(MissionLine::new(agent, mission, &episode)));
    }

    /// Writes a step's lines.
    pub(crate) fn step(&mut self, agent: &TraceInput, observation: &Observation, action: Action) {
        if self.file.is_none() {
            return;
        }
        let step = observation.step;
        self.write(&TraceLine::Step(StepLine::new(agent, observation, action)));
        let now = TracedState::of(agent);
        for event in self.before.until(&now) {
            self.write(&TraceLine::Event { step, event });
        }
        self.before = now;
        self.last_step = Some(step);
        if step.is_multiple_of(MAP_STEPS) {
            self.map(agent, step);
        }
    }

    /// Writes the last map line and closes the file.
    pub(crate) fn end(&mut self, agent: &TraceInput) {
        if let Some(step) = self.last_step.filter(|_| self.last_step != self.map_step) {
            self.map(agent, step);
        }
        self.flush();
        self.file = None;
    }

    /// Returns the first failure in any episode.
    pub(crate) fn conclude(self) -> Result<(), TraceError> {
        self.failure.map_or(Ok(()), Err)
    }

    fn map(&mut self, agent: &TraceInput, step: u32) {
        if self.file.is_some() {
            self.write(&TraceLine::Map(MapLine::new(agent, step)));
            // A reader may follow a running episode map by map.
            self.flush();
            self.map_step = Some(step);
        }
    }

    fn write(&mut self, line: &TraceLine) {
        self.attempt(|out| {
            serde_json::to_writer(&mut *out, line)?;
            out.write_all(b"\n")
        });
    }

    fn flush(&mut self) {
        self.attempt(|out| out.flush());
    }

    fn attempt(&mut self, work: impl FnOnce(&mut dyn Write) -> io::Result<()>) {
        let Some(file) = &mut self.file else { return };
        if let Err(problem) = work(&mut *file.out) {
            let path = file.path.clone();
            // No further attempt in this episode: a trace with a gap would be worse than a short one.
            self.file = None;
            self.fail(TraceError::File { path, problem });
        }
    }

    fn fail(&mut self, error: TraceError) {
        self.failure.get_or_insert(error);
    }
}

/// Creates the folder if necessary, and creates and deletes a file in it.
fn check_writable(folder: &Path) -> io::Result<()> {
    // A name of its own: agents of parallel episodes check the same folder.
    static CHECKS: AtomicU32 = AtomicU32::new(0);
    fs::create_dir_all(folder)?;
    let check = CHECKS.fetch_add(1, Ordering::Relaxed);
    let file = folder.join(format!(".writable-{}-{check}", process::id()));
    File::create(&file)?;
    fs::remove_file(file)
}

/// Returns true if the handle is a plain file name.
// The server chooses the handle: a hostile one must not leave the folder.
fn is_file_name(handle: &str) -> bool {
    const LONGEST: usize = 128;
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    (1..=LONGEST).contains(&handle.len()) && handle.chars().all(plain) && !handle.starts_with('.')
}

/// Claims in the traces of a folder.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TraceSummary {
    /// Trace files.
    pub episodes: u32,
    /// Submits.
    pub submits: u32,
    /// Stops.
    pub stops: u32,
    /// Submits and Stops without a look of the current frame at the candidate.
    pub unverified: u32,
    /// Submits and Stops with s_vis of the fresh look below their floor.
    pub below_floor: u32,
}

impl fmt::Display for TraceSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { episodes, submits, stops, unverified, below_floor } = self;
        writeln!(f, "episodes: {episodes}\nSubmits: {submits}\nStops: {stops}")?;
        writeln!(f, "Submits and Stops without a fresh look: {unverified}")?;
        write!(f, "Submits and Stops with s_vis below the floor: {below_floor}")
    }
}

/// Counts the claims in all traces in a folder and its subfolders; fails if a file is not a trace.
pub fn summarise(folder: &Path) -> Result<TraceSummary, TraceError> {
    let mut summary = TraceSummary::default();
    add_folder(folder, &mut summary)?;
    Ok(summary)
}

fn add_folder(folder: &Path, summary: &mut TraceSummary) -> Result<(), TraceError> {
    let failed = |problem: String| TraceError::Unreadable { path: folder.to_owned(), problem };
    for entry in fs::read_dir(folder).map_err(|error| failed(error.to_string()))? {
        let path = entry.map_err(|error| failed(error.to_string()))?.path();
        if path.is_dir() {
            add_folder(&path, summary)?;
        } else if path.extension().is_some_and(|extension| extension == "jsonl") {
            add_trace(&path, summary).map_err(|problem| TraceError::Unreadable { path, problem })?;
        }
    }
    Ok(())
}

fn add_trace(path: &Path, summary: &mut TraceSummary) -> Result<(), String> {
    let text = fs::read_to_string(path).map_err(|error| error.to_string())?;
    summary.episodes += 1;
    let mut weights = Value::Null;
    for (number, line) in (1..).zip(text.lines()) {
        let line: Value = serde_json::from_str(line).map_err(|error| format!("line {number}: {error}"))?;
        if line["weights"].is_object() {
            weights = line["weights"].clone();
        }
        match line["action"].as_str() {
            Some("Submit") => summary.submits += 1,
            Some("Stop") => summary.stops += 1,
            _ => continue,
        }
        // The look itself, not the verification, which exists above the floor only.
        match (line["gate"]["fresh_vis"].as_f64(), floor_of(&line, &weights)) {
            (Some(vis), Some(floor)) => summary.below_floor += u32::from(vis < floor),
            _ => summary.unverified += 1,
        }
    }
    Ok(())
}

/// Returns the floor of a claim: that of its verification. An ungated claim may have none: then the floor is `verify_unheard` if no
/// source supports the candidate, otherwise the least possible one.
fn floor_of(claim: &Value, weights: &Value) -> Option<f64> {
    let least = weights["verify_floor"].as_f64();
    let unheard = weights["verify_unheard"].as_f64().filter(|_| claim["candidate"]["source"].is_null());
    let ungated = least.map(|least| unheard.map_or(least, |unheard| least.max(unheard)));
    claim["gate"]["verification"]["floor"].as_f64().or(ungated)
}
