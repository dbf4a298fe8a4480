//! What the agent writes down of each episode; `docs/traces.md` has the format.

mod events;
mod lines;
mod map;
mod recorder;
#[cfg(test)]
mod tests;

use crate::PagNav;
use crate::planner::{Candidate, Gate, Stage};
use avln_kit::perception::{Heard, Place};

pub use recorder::{Recorder, TraceError};

/// What the last action was decided by.
#[derive(Clone, Copy, Default)]
pub(crate) struct Thought {
    /// What was heard, and which source it was taken for.
    pub(crate) heard: Option<(usize, Heard)>,
    pub(crate) stage: Option<Stage>,
    pub(crate) candidate: Option<Candidate>,
    pub(crate) gate: Option<Gate>,
    /// The frontier that search chose, and its S_search.
    pub(crate) frontier: Option<(Place, f32)>,
}

impl PagNav {
    /// The same, writing down each episode; what it does stays the same, even where that fails.
    pub fn traced(mut self, trace: Recorder) -> Self {
        self.trace = Some(trace);
        self
    }

    /// Ends the trace of the last episode: there will be no other.
    ///
    /// # Errors
    /// The first thing that could not be written down, in all episodes.
    pub fn end_trace(&mut self) -> Result<(), TraceError> {
        self.trace(Recorder::end);
        self.trace.take().map_or(Ok(()), Recorder::conclude)
    }

    pub(crate) fn trace(&mut self, write: impl FnOnce(&mut Recorder, &Self)) {
        if let Some(mut trace) = self.trace.take() {
            write(&mut trace, self);
            self.trace = Some(trace);
        }
    }
}
