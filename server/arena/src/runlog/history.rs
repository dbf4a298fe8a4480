//! Run logs as read from disk.

use crate::runlog::{DIGITS, Entry, link};
use avln_episode::{Action, EndReason, Sensors};
use avln_scoring::Metrics;
use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
    time::Duration,
};

/// A run's history.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct History {
    /// Entries in order.
    pub entries: Vec<Entry>,
    /// Complete lines, bytes.
    pub whole_bytes: u64,
    /// Last line's digits; empty without lines.
    pub head: String,
}

/// An episode's history.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeHistory {
    /// Slot.
    pub slot: u32,
    /// Index in the run, from 0.
    pub ordinal: u32,
    /// Episode id in the split.
    pub episode: String,
    /// Requested sensors.
    pub sensors: Sensors,
    /// Actions, each with the new state's hash.
    pub actions: Vec<(Action, u64)>,
    /// Remaining time bank; `None` before the first action.
    pub bank_left: Option<Duration>,
    /// Consecutive server crashes during a restoration.
    restore_crashes: u32,
    /// Consecutive server crashes in the first step after a restoration.
    step_crashes: u32,
    critical: CriticalPhase,
    /// End reason and score, if the log contains them.
    pub ended: Option<(EndReason, Box<Metrics>)>,
    /// True if the server lost the attempt.
    pub is_lost: bool,
}

/// Run log errors.
#[derive(Debug, thiserror::Error)]
pub enum LogError {
    /// Unreadable or not writable.
    #[error("run log {path}: {source}")]
    File {
        /// Path.
        path: PathBuf,
        /// System error.
        source: std::io::Error,
    },
    /// Damaged or modified.
    #[error("run log {path}, line {line}: {what}; the log is damaged or was changed")]
    Line {
        /// Path.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// Problem.
        what: String,
    },
}

impl History {
    /// Reads a log and verifies the hash chain.
    pub fn read(path: &Path) -> Result<Self, LogError> {
        let bytes = std::fs::read(path).map_err(|source| LogError::File { path: path.to_owned(), source })?;
        Self::parse(&bytes).map_err(|(line, what)| LogError::Line { path: path.to_owned(), line, what })
    }

    /// Parses a log and verifies the hash chain; an error contains the line number, from 1.
    pub fn parse(bytes: &[u8]) -> Result<Self, (usize, String)> {
        let mut history = Self::default();
        let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        for (index, line) in bytes[..whole].split_inclusive(|&byte| byte == b'\n').enumerate() {
            history.add(&line[..line.len() - 1]).map_err(|what| (index + 1, what))?;
        }
        history.whole_bytes = whole as u64;
        match history.entries.first() {
            Some(Entry::Run { format: 1..=Entry::FORMAT, .. }) | None => Ok(history),
            Some(Entry::Run { format, .. }) => {
                Err((1, format!("format {format} is not supported, only 1 to {}", Entry::FORMAT)))
            }
            Some(_) => Err((1, "the entry of the run is missing".to_owned())),
        }
    }

    fn add(&mut self, line: &[u8]) -> Result<(), String> {
        let text = std::str::from_utf8(line).map_err(|_| "it is not valid UTF-8".to_owned())?;
        let (digits, json) = text.split_once(' ').ok_or("it has no hash")?;
        if digits.len() != DIGITS || digits != link(&self.head, json) {
            return Err("its hash does not match the lines before".to_owned());
        }
        let entry = serde_json::from_str(json).map_err(|error| error.to_string())?;
        if matches!(&entry, Entry::Signed { head, .. } if *head != self.head) {
            return Err("its signature belongs to other lines".to_owned());
        }
        self.entries.push(entry);
        self.head = digits.to_owned();
        Ok(())
    }

    /// Returns the episodes by handle; an error contains the number of the contradictory line, from 1.
    pub fn episodes(&self) -> Result<BTreeMap<String, EpisodeHistory>, (usize, String)> {
        let mut episodes = BTreeMap::new();
        let mut slots: BTreeMap<u32, String> = BTreeMap::new();
        for (index, entry) in self.entries.iter().enumerate() {
            follow(entry, &mut episodes, &mut slots).map_err(|what| (index + 1, what))?;
        }
        Ok(episodes)
    }

    /// Checks that the server starts increase; an error contains the number of the contradictory line, from 1. Servers on copies
    /// of a data folder count the same starts, so a log that was moved between the copies repeats a number.
    pub fn check_epochs(&self) -> Result<(), (usize, String)> {
        let mut last = 0;
        for (index, entry) in self.entries.iter().enumerate() {
            let Entry::ServerStarted { epoch, .. } = entry else { continue };
            if *epoch <= last {
                let what = format!(
                    "server start {epoch} follows start {last}: the run was continued on a copy of the data folder"
                );
                return Err((index + 1, what));
            }
            last = *epoch;
        }
        Ok(())
    }

    /// Returns the run's total disconnection time.
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

/// A restoration's part in progress: a server stop in it counts as a crash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum CriticalPhase {
    None,
    Restore,
    FirstStep,
}

impl EpisodeHistory {
    fn begun(slot: u32, ordinal: u32, episode: &str, sensors: &Sensors) -> Self {
        Self {
            slot,
            ordinal,
            episode: episode.to_owned(),
            sensors: sensors.clone(),
            actions: Vec::new(),
            bank_left: None,
            restore_crashes: 0,
            step_crashes: 0,
            critical: CriticalPhase::None,
            ended: None,
            is_lost: false,
        }
    }

    /// Returns the consecutive crashes in the same restoration part.
    pub fn crashes(&self) -> u32 {
        let mut now = self.clone();
        now.count_crash();
        now.restore_crashes.max(now.step_crashes)
    }

    /// Counts the last server stop as a crash if it happened in a critical phase.
    fn count_crash(&mut self) {
        match self.critical {
            CriticalPhase::None => {}
            CriticalPhase::Restore => self.restore_crashes += 1,
            CriticalPhase::FirstStep => self.step_crashes += 1,
        }
        self.critical = CriticalPhase::None;
    }
}

fn follow(
    entry: &Entry,
    episodes: &mut BTreeMap<String, EpisodeHistory>,
    slots: &mut BTreeMap<u32, String>,
) -> Result<(), String> {
    match entry {
        Entry::Began { slot, handle, ordinal, episode, sensors, .. } => {
            slots.insert(*slot, handle.clone());
            let begun = EpisodeHistory::begun(*slot, *ordinal, episode, sensors);
            if episodes.insert(handle.clone(), begun).is_some() {
                return Err(format!("episode {handle} starts twice"));
            }
        }
        Entry::Acted { slot, step, action, state, bank_us, .. } => {
            let episode = slots.get(slot).and_then(|handle| episodes.get_mut(handle));
            let episode = episode.ok_or_else(|| format!("slot {slot} acts without an episode"))?;
            let state =
                u64::from_str_radix(state, 16).map_err(|_| format!("'{state}' is not a state hash"))?;
            if episode.ended.is_some() || *step as usize != episode.actions.len() + 1 {
                return Err(format!("step {step} of slot {slot} is out of order"));
            }
            episode.actions.push((*action, state));
            episode.bank_left = Some(Duration::from_micros(*bank_us));
            (episode.step_crashes, episode.critical) = (0, CriticalPhase::None);
        }
        Entry::RestoreStarted { slot, handle, .. } => {
            slots.insert(*slot, handle.clone());
            let episode =
                episodes.get_mut(handle).ok_or_else(|| format!("episode {handle} never started"))?;
            episode.count_crash();
            episode.critical = CriticalPhase::Restore;
        }
        Entry::RestoreDone { slot, .. } | Entry::StepAttempted { slot, .. } => {
            let episode = slots.get(slot).and_then(|handle| episodes.get_mut(handle));
            let episode = episode.ok_or_else(|| format!("slot {slot} has no episode"))?;
            if matches!(entry, Entry::StepAttempted { .. }) {
                episode.critical = CriticalPhase::FirstStep;
            } else {
                (episode.restore_crashes, episode.critical) = (0, CriticalPhase::None);
            }
        }
        Entry::Ended { handle, end, metrics, .. } => {
            let episode =
                episodes.get_mut(handle).ok_or_else(|| format!("episode {handle} never started"))?;
            episode.ended = Some((*end, metrics.clone()));
        }
        Entry::Lost { handle, .. } => {
            // An attempt whose start could not be logged has no history.
            if let Some(episode) = episodes.get_mut(handle) {
                episode.is_lost = true;
            }
        }
        Entry::Run { .. }
        | Entry::ServerStarted { .. }
        | Entry::ClockRestarted { .. }
        | Entry::Signed { .. } => {}
    }
    Ok(())
}
