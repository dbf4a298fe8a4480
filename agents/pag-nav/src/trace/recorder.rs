use super::events::Moment;
use super::lines::{Line, Opening, Step};
use super::map::MapLine;
use crate::PagNav;
use avln_client::{Action, Mission, Observation};
use std::{
    fs::{self, File},
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

/// Steps from one map to the next.
const MAP_STEPS: u32 = 25;

/// Writes traces: a file of JSON Lines for each episode, named by the episode's handle.
///
/// What cannot be written is left out, and told in the end: nothing here keeps an episode from being played.
pub struct Recorder {
    folder: PathBuf,
    file: Option<TraceFile>,
    before: Moment,
    /// The last step that was written, and the one of the last map.
    last_step: Option<u32>,
    map_step: Option<u32>,
    failure: Option<TraceError>,
}

struct TraceFile {
    episode: String,
    path: PathBuf,
    out: Box<dyn Write + Send>,
}

/// Why a trace could not be written.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// The folder cannot be made, or nothing can be written in it.
    #[error("traces in {}: {problem}; give --trace a folder that can be written to", folder.display())]
    Folder {
        /// As given.
        folder: PathBuf,
        /// What the system said.
        problem: io::Error,
    },
    /// A file could not be written to its end.
    #[error("trace {}: {problem}; it ends early, and what the agent did is the same", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system said.
        problem: io::Error,
    },
    /// An episode's handle cannot name a file.
    #[error(
        "trace of episode {handle:?}: this is no name of a file; handles of 1 to 128 letters, digits, '-', '_' and '.', \
         which does not come first, are"
    )]
    Handle {
        /// As the server gave it.
        handle: String,
    },
}

impl Recorder {
    /// Writes in `folder`, which is made where it is not there.
    ///
    /// # Errors
    /// When it cannot be made, or nothing can be written in it.
    pub fn new(folder: impl Into<PathBuf>) -> Result<Self, TraceError> {
        let folder = folder.into();
        if let Err(problem) = probe(&folder) {
            return Err(TraceError::Folder { folder, problem });
        }
        let before = Moment::default();
        Ok(Self { folder, file: None, before, last_step: None, map_step: None, failure: None })
    }

    /// Ends the trace before and opens that of `episode`.
    pub(crate) fn enter(&mut self, agent: &PagNav, episode: &str) {
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

    pub(super) fn write_to(&mut self, episode: &str, path: PathBuf, out: Box<dyn Write + Send>) {
        self.file = Some(TraceFile { episode: episode.to_owned(), path, out });
    }

    /// Writes the first line.
    pub(crate) fn begin(&mut self, agent: &PagNav, mission: &Mission) {
        (self.before, self.last_step, self.map_step) = (Moment::of(agent), None, None);
        let Some(file) = &self.file else { return };
        let episode = file.episode.clone();
        self.write(&Line::Mission(Opening::new(agent, mission, &episode)));
    }

    /// Writes what belongs to one step.
    pub(crate) fn step(&mut self, agent: &PagNav, observation: &Observation, action: Action) {
        if self.file.is_none() {
            return;
        }
        let step = observation.step;
        self.write(&Line::Step(Step::new(agent, observation, action)));
        let now = Moment::of(agent);
        for event in self.before.until(&now) {
            self.write(&Line::Event { step, event });
        }
        (self.before, self.last_step) = (now, Some(step));
        if step.is_multiple_of(MAP_STEPS) {
            self.map(agent, step);
        }
    }

    /// Writes the last map and closes the file.
    pub(super) fn end(&mut self, agent: &PagNav) {
        if let Some(step) = self.last_step.filter(|_| self.last_step != self.map_step) {
            self.map(agent, step);
        }
        self.flush();
        self.file = None;
    }

    /// The first failure of all episodes.
    pub(super) fn conclude(self) -> Result<(), TraceError> {
        self.failure.map_or(Ok(()), Err)
    }

    fn map(&mut self, agent: &PagNav, step: u32) {
        if self.file.is_some() {
            self.write(&Line::Map(MapLine::new(agent, step)));
            self.flush();
            self.map_step = Some(step);
        }
    }

    fn write(&mut self, line: &Line) {
        self.attempt(|out| {
            serde_json::to_writer(&mut *out, line)?;
            out.write_all(b"\n")
        });
    }

    fn flush(&mut self) {
        self.attempt(|out| out.flush());
    }

    /// What fails once is not tried again in this episode.
    fn attempt(&mut self, work: impl FnOnce(&mut dyn Write) -> io::Result<()>) {
        let Some(file) = &mut self.file else { return };
        if let Err(problem) = work(&mut *file.out) {
            let path = file.path.clone();
            self.file = None;
            self.fail(TraceError::File { path, problem });
        }
    }

    fn fail(&mut self, error: TraceError) {
        self.failure.get_or_insert(error);
    }
}

/// Tries to write in a folder, which is made where it is not there.
fn probe(folder: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let file = folder.join(".writable");
    File::create(&file)?;
    fs::remove_file(file)
}

/// Whether a handle can name a file, and one in its folder.
fn is_file_name(handle: &str) -> bool {
    const LONGEST: usize = 128;
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    (1..=LONGEST).contains(&handle.len()) && handle.chars().all(plain) && !handle.starts_with('.')
}
