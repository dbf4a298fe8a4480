//! Run logs as read from disk.

use crate::runlog::{DIGITS, Entry, link};
use avln_episode::{Action, EndReason, Sensors};
use avln_scoring::Metrics;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};

/// Content of a run log.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// The entries, in order.
    pub entries: Vec<Entry>,
    /// Bytes of the lines that are whole.
    pub whole_bytes: u64,
    /// The digits in front of the last line; empty where there is none.
    pub head: String,
}

/// Content of a run log about one episode.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeHistory {
    /// The slot that played it.
    pub slot: u32,
    /// Place in the run's list, from 0.
    pub ordinal: u32,
    /// Id of the episode inside the split.
    pub episode: String,
    /// Sensors of the agent.
    pub sensors: Sensors,
    /// Its actions, each with the hash of the state that it led to.
    pub actions: Vec<(Action, u64)>,
    /// Remaining time bank; `None` before the first action.
    pub bank_left: Option<Duration>,
    /// Number of consecutive server crashes during the restore of the episode.
    restore_crashes: u32,
    /// Number of consecutive server crashes in the first step after a restore.
    step_crashes: u32,
    critical: CriticalPhase,
    /// Why it ended and what it was worth, where that is written.
    pub ended: Option<(EndReason, Box<Metrics>)>,
}

/// Why a run log cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// It cannot be read or written.
    #[error("run log {path}: {source}")]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// A line is not what was written.
    #[error("run log {path}, line {line}: {what}; this is not the log as the server wrote it")]
    Line {
        /// Path of the file.
        path: PathBuf,
        /// Number of the line, counted from 1.
        line: usize,
        /// Defect of the log.
        what: String,
    },
}

impl History {
    /// Reads the log at `path` and checks its chain.
    ///
    /// # Errors
    /// When it cannot be read, or a line that is whole is not what was written.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let bytes = std::fs::read(path).map_err(|source| LogError::File { path: path.to_owned(), source })?;
        Self::parse(&bytes).map_err(|(line, what)| LogError::Line { path: path.to_owned(), line, what })
    }

    /// The same for a log in memory; an error names the line, counted from 1.
    ///
    /// # Errors
    /// When a line that is whole is not what was written.
    pub fn parse(bytes: &[u8]) -> Result<Self, (usize, String)> {
        let mut history = Self::default();
        let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        for (index, line) in bytes[..whole].split_inclusive(|&byte| byte == b'\n').enumerate() {
            history.add(&line[..line.len() - 1]).map_err(|what| (index + 1, what))?;
        }
        history.whole_bytes = whole as u64;
        match history.entries.first() {
            Some(Entry::Run { format: Entry::FORMAT, .. }) | None => Ok(history),
            Some(Entry::Run { format, .. }) => {
                Err((1, format!("format {format} is not known, {} is", Entry::FORMAT)))
            }
            Some(_) => Err((1, "it does not say whose log it is".to_owned())),
        }
    }

    fn add(&mut self, line: &[u8]) -> Result<(), String> {
        let text = std::str::from_utf8(line).map_err(|_| "it is not text".to_owned())?;
        let (digits, json) = text.split_once(' ').ok_or("it has no hash")?;
        if digits.len() != DIGITS || digits != link(&self.head, json) {
            return Err("its hash does not fit".to_owned());
        }
        let entry = serde_json::from_str(json).map_err(|error| error.to_string())?;
        if matches!(&entry, Entry::Signed { head, .. } if *head != self.head) {
            return Err("it signs other lines".to_owned());
        }
        self.entries.push(entry);
        self.head = digits.to_owned();
        Ok(())
    }

    /// The episodes by handle.
    ///
    /// # Errors
    /// When entries do not fit together; names the line, counted from 1.
    pub fn episodes(&self) -> Result<BTreeMap<String, EpisodeHistory>, (usize, String)> {
        let mut episodes = BTreeMap::new();
        let mut slots: BTreeMap<u32, String> = BTreeMap::new();
        for (index, entry) in self.entries.iter().enumerate() {
            follow(entry, &mut episodes, &mut slots).map_err(|what| (index + 1, what))?;
        }
        Ok(episodes)
    }

    /// Total disconnection time charged to the run.
    pub fn away(&self) -> Duration {
        let away = |entry: &Entry| match entry {
            Entry::ClockRestarted { away_us, at_ms, .. } => Some((*at_ms, *away_us)),
            _ => None,
        };
        // Slots with a simultaneous clock restart were disconnected together.
        let mut each: Vec<_> = self.entries.iter().filter_map(away).collect();
        each.dedup_by(|b, a| b.0.abs_diff(a.0) <= 1000 && b.1.abs_diff(a.1) <= 1_000_000);
        Duration::from_micros(each.iter().fold(0, |sum, (_, away_us)| sum.saturating_add(*away_us)))
    }
}

/// Activity of the server with a restored episode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CriticalPhase {
    None,
    Restore,
    FirstStep,
}

impl EpisodeHistory {
    /// Consecutive server crashes in the same phase of a restoration, as far as known.
    pub fn crashes(&self) -> u32 {
        let mut now = self.clone();
        now.count_crash();
        now.restore_crashes.max(now.step_crashes)
    }

    /// A new server has started after a crash.
    fn count_crash(&mut self) {
        match self.critical {
            CriticalPhase::None => {}
            CriticalPhase::Restore => self.restore_crashes += 1,
            CriticalPhase::FirstStep => self.step_crashes += 1,
        }
        self.critical = CriticalPhase::None;
    }
}

/// Adds an entry to the episode that it is about.
fn follow(
    entry: &Entry,
    episodes: &mut BTreeMap<String, EpisodeHistory>,
    slots: &mut BTreeMap<u32, String>,
) -> Result<(), String> {
    match entry {
        Entry::Began { slot, handle, ordinal, episode, sensors, .. } => {
            slots.insert(*slot, handle.clone());
            let begun = EpisodeHistory {
                slot: *slot,
                ordinal: *ordinal,
                episode: episode.clone(),
                sensors: sensors.clone(),
                actions: Vec::new(),
                bank_left: None,
                restore_crashes: 0,
                step_crashes: 0,
                critical: CriticalPhase::None,
                ended: None,
            };
            match episodes.insert(handle.clone(), begun) {
                None => Ok(()),
                Some(_) => Err(format!("episode {handle} begins twice")),
            }
        }
        Entry::Acted { slot, step, action, state, bank_us, .. } => {
            let episode = slots.get(slot).and_then(|handle| episodes.get_mut(handle));
            let episode = episode.ok_or_else(|| format!("slot {slot} acts and holds no episode"))?;
            let state = u64::from_str_radix(state, 16).map_err(|_| format!("'{state}' is no state"))?;
            if episode.ended.is_some() || *step as usize != episode.actions.len() + 1 {
                return Err(format!("step {step} of slot {slot} is out of turn"));
            }
            episode.actions.push((*action, state));
            episode.bank_left = Some(Duration::from_micros(*bank_us));
            (episode.step_crashes, episode.critical) = (0, CriticalPhase::None);
            Ok(())
        }
        Entry::RestoreStarted { slot, handle, .. } => {
            slots.insert(*slot, handle.clone());
            let episode = episodes.get_mut(handle).ok_or_else(|| format!("episode {handle} never began"))?;
            episode.count_crash();
            episode.critical = CriticalPhase::Restore;
            Ok(())
        }
        Entry::RestoreDone { slot, .. } | Entry::StepAttempted { slot, .. } => {
            let episode = slots.get(slot).and_then(|handle| episodes.get_mut(handle));
            let episode = episode.ok_or_else(|| format!("slot {slot} holds no episode"))?;
            if matches!(entry, Entry::StepAttempted { .. }) {
                episode.critical = CriticalPhase::FirstStep;
            } else {
                (episode.restore_crashes, episode.critical) = (0, CriticalPhase::None);
            }
            Ok(())
        }
        Entry::Ended { handle, end, metrics, .. } => {
            let episode = episodes.get_mut(handle).ok_or_else(|| format!("episode {handle} never began"))?;
            episode.ended = Some((*end, metrics.clone()));
            Ok(())
        }
        Entry::Run { .. } | Entry::ClockRestarted { .. } | Entry::Signed { .. } => Ok(()),
    }
}
