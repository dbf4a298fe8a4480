//! Queue of finished tasks.

use crate::Finished;
use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Finished tasks in the order of completion, with one receiver. It wakes up once for all the tasks that it waits for: a wake-up
/// takes as long as a cheap step.
pub(crate) struct Results<R> {
    state: Mutex<State<R>>,
    is_ready: Condvar,
}

struct State<R> {
    finished: VecDeque<Finished<R>>,
    /// Tasks that the receiver waits for.
    wanted: usize,
}

impl<R> Default for Results<R> {
    fn default() -> Self {
        let state = State { finished: VecDeque::new(), wanted: 1 };
        Self { state: Mutex::new(state), is_ready: Condvar::new() }
    }
}

impl<R> Results<R> {
    fn lock(&self) -> MutexGuard<'_, State<R>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn push(&self, finished: Finished<R>) {
        let mut state = self.lock();
        state.finished.push_back(finished);
        let is_ready = state.finished.len() >= state.wanted;
        drop(state);
        if is_ready {
            self.is_ready.notify_one();
        }
    }

    /// Returns the next `count` tasks, or fewer after `timeout`.
    pub(crate) fn take(&self, count: usize, timeout: Duration) -> Vec<Finished<R>> {
        let mut state = self.lock();
        state.wanted = count;
        let waits = |state: &mut State<R>| state.finished.len() < count;
        let (mut state, _) =
            self.is_ready.wait_timeout_while(state, timeout, waits).unwrap_or_else(PoisonError::into_inner);
        let ready = count.min(state.finished.len());
        state.finished.drain(..ready).collect()
    }
}
