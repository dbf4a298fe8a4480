use super::{RunView, run::Sight};
use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, PoisonError},
};

/// Completed runs that somebody looked at, by id and by what the viewer may see. Their episodes never change.
#[derive(Clone, Debug, Default)]
pub(super) struct KeptRuns(Arc<Mutex<BTreeMap<Question, RunView>>>);

/// The run, and whether scores and replays are seen.
type Question = (String, bool, bool);

impl KeptRuns {
    /// Runs kept at a time: some megabytes when each has 550 episodes.
    const KEPT: usize = 32;

    pub(super) fn find(&self, run: &str, sight: Sight) -> Option<RunView> {
        let runs = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        runs.get(&(run.to_owned(), sight.scores, sight.replays)).cloned()
    }

    pub(super) fn keep(&self, run: &str, sight: Sight, view: RunView) {
        let mut runs = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if runs.len() >= Self::KEPT {
            runs.clear();
        }
        runs.insert((run.to_owned(), sight.scores, sight.replays), view);
    }
}
