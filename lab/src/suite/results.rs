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

/// What tells one played episode from all others.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct EpisodeKey {
    /// The agent, by [`AgentVariant::name`](super::AgentVariant::name).
    pub agent: String,
    /// `ordered` or `unordered`.
    pub order: String,
    /// Id of the episode inside its split.
    pub episode: String,
    /// Seed of agents that draw.
    pub seed: u64,
    /// Version of the program, and of the agents in it.
    pub program: String,
    /// Version of the benchmark.
    pub benchmark: String,
    /// Digest of the split.
    pub split: String,
}

/// A played episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultLine {
    /// Which.
    pub key: EpisodeKey,
    /// Name of its scene.
    pub scene: String,
    /// How each goal was described.
    pub modalities: Vec<Modality>,
    /// Why it ended.
    pub end: EndReason,
    /// What it was worth.
    pub metrics: Metrics,
    /// Submits that completed nothing, by cause.
    pub wrong: BTreeMap<Cause, u32>,
    /// Mean time in which the agent chose an action, milliseconds.
    pub think_ms: f64,
    /// Time that the episode took, seconds.
    pub wall_s: f64,
}

impl ResultLine {
    /// How goals counted.
    pub fn order(&self) -> Order {
        self.key.order.parse().unwrap_or(Order::Ordered)
    }
}

/// The file of played episodes: a line of JSON each, written when the episode is over.
pub struct Results {
    path: PathBuf,
    file: File,
    /// By key; an episode that was played again counts as it was played last.
    lines: BTreeMap<EpisodeKey, ResultLine>,
}

impl Results {
    /// Opens the file, and makes it when it is not there. A last line that was cut off is dropped.
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

    /// Whether an episode was played.
    pub fn has(&self, key: &EpisodeKey) -> bool {
        self.lines.contains_key(key)
    }

    /// All episodes, by agent, order and id.
    pub fn lines(&self) -> impl Iterator<Item = &ResultLine> {
        self.lines.values()
    }
}

/// The played episodes of a file, by key, while somebody else may add to it; none when there is no such file.
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

/// All lines that have their end.
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
