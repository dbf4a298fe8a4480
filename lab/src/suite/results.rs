use super::Cause;
use avln_arena::{Failure, FailureKind};
use avln_episode::{EndReason, Modality, Order};
use avln_scoring::Metrics;
use serde::{Deserialize, Serialize};
use std::{
    collections::BTreeMap,
    fs::{self, File, OpenOptions},
    io::{ErrorKind, Read, Write},
    path::{Path, PathBuf},
};

/// The key of a result.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct EpisodeKey {
    /// The agent, by [`AgentVariant::name`](super::AgentVariant::name).
    pub agent: String,
    /// `ordered` or `unordered`.
    pub order: String,
    /// Id of the episode in its split.
    pub episode: String,
    /// Seed of random agents.
    pub seed: u64,
    /// Version of the program and its agents.
    pub program: String,
    /// Version of the benchmark.
    pub benchmark: String,
    /// Digest of the split.
    pub split: String,
}

/// The result of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultLine {
    /// Key.
    pub key: EpisodeKey,
    /// Name of the scene.
    pub scene: String,
    /// Modality of every goal.
    pub modalities: Vec<Modality>,
    /// End reason.
    pub end: EndReason,
    /// Metrics.
    pub metrics: Metrics,
    /// Failed Submits, by cause.
    pub wrong: BTreeMap<Cause, u32>,
    /// Mean time to choose an action, milliseconds.
    pub think_ms: f64,
    /// Duration of the episode, seconds.
    pub wall_s: f64,
}

impl ResultLine {
    /// Order of goals.
    pub fn order(&self) -> Order {
        self.key.order.parse().unwrap_or(Order::Ordered)
    }
}

/// The results file: one line of JSON per finished episode.
pub struct Results {
    path: PathBuf,
    file: File,
    /// Results by key; the last one of a repeated episode counts.
    lines: BTreeMap<EpisodeKey, ResultLine>,
}

impl Results {
    /// Opens or creates the file. An incomplete last line is removed.
    ///
    /// # Errors
    /// When it cannot be read or written, or holds something else.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let cannot = |error: std::io::Error| {
            Failure::new(FailureKind::Data, format!("cannot open results {}: {error}", path.display()))
        };
        let mut file = OpenOptions::new().create(true).read(true).append(true).open(path).map_err(cannot)?;
        let mut text = String::new();
        file.read_to_string(&mut text).map_err(cannot)?;
        let whole = whole(&text);
        file.set_len(whole.len() as u64).map_err(cannot)?;
        let lines = parse(path, whole)?;
        Ok(Self { path: path.to_owned(), file, lines })
    }

    /// Adds an episode.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn add(&mut self, line: ResultLine) -> Result<(), Failure> {
        let json =
            serde_json::to_string(&line).map_err(|error| Failure::new(FailureKind::Internal, error))?;
        self.file.write_all((json + "\n").as_bytes()).map_err(|error| {
            Failure::new(FailureKind::Data, format!("cannot write {}: {error}", self.path.display()))
        })?;
        self.lines.insert(line.key.clone(), line);
        Ok(())
    }

    /// Returns `true` if there is a result for the key.
    pub fn has(&self, key: &EpisodeKey) -> bool {
        self.lines.contains_key(key)
    }

    /// Returns all results, by agent, order and id.
    pub fn lines(&self) -> impl Iterator<Item = &ResultLine> {
        self.lines.values()
    }
}

/// Reads all results of a file, which another process may be extending; empty if there is no file.
///
/// # Errors
/// When it cannot be read, or holds something else.
pub(super) fn read(path: &Path) -> Result<BTreeMap<EpisodeKey, ResultLine>, Failure> {
    match fs::read_to_string(path) {
        Ok(text) => parse(path, whole(&text)),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(BTreeMap::new()),
        Err(error) => {
            Err(Failure::new(FailureKind::Data, format!("cannot read results {}: {error}", path.display())))
        }
    }
}

/// Returns all complete lines.
fn whole(text: &str) -> &str {
    &text[..text.rfind('\n').map_or(0, |end| end + 1)]
}

fn parse(path: &Path, text: &str) -> Result<BTreeMap<EpisodeKey, ResultLine>, Failure> {
    let line = |(number, json): (usize, &str)| {
        let line: ResultLine = serde_json::from_str(json).map_err(|error| {
            let message = format!("{}, line {number}: {error}", path.display());
            Failure::new(FailureKind::Data, message)
                .hinted("remove the line, and its episode is played again")
        })?;
        Ok((line.key.clone(), line))
    };
    (1..).zip(text.lines()).map(line).collect()
}
