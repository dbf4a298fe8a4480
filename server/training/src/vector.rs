//! Many environments on worker threads.

use crate::env::Shared;
use crate::{
    AutoReset, Env, EnvOptions, EnvState, EpisodeSource, Layout, Overview, Row, StepFlags, TrainingError,
};
use avln_referee::Audio;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// Memory for one environment's next observation, filled on a worker thread.
pub trait RowSource: Send + 'static {
    /// Returns the arrays.
    fn row(&mut self) -> Row<'_>;

    /// Copies the arrays to the memory for final observations, under [`AutoReset::SameStep`].
    fn keep_final(&mut self);
}

/// A finished task of an environment.
#[derive(Debug)]
pub struct Finished<R> {
    /// Environment index.
    pub env: usize,
    /// Its memory.
    pub row: R,
    /// Flags of the step; zeros for a reset.
    pub flags: Result<StepFlags, TrainingError>,
}

enum Task {
    Reset,
    Step(i64),
    Restore(Arc<EnvState>),
}

struct Work<R> {
    env: usize,
    task: Task,
    row: R,
}

/// An environment in the vector.
struct Member {
    env: Env,
    /// True after an episode's end under [`AutoReset::NextStep`].
    needs_reset: bool,
}

/// Environments that run on a fixed number of threads. Results are equal for any number of threads.
pub struct VectorEnv<R> {
    members: Arc<Vec<Mutex<Member>>>,
    shared: Arc<Shared>,
    /// Some until the drop.
    work: Option<Sender<Work<R>>>,
    results: Arc<Results<R>>,
    threads: Vec<JoinHandle<()>>,
    /// True if the remaining tasks are to be left undone.
    is_closing: Arc<AtomicBool>,
}

impl<R: RowSource> VectorEnv<R> {
    /// Starts `threads` threads for `count` environments.
    ///
    /// # Errors
    /// If an option is out of range, or the system refuses a thread.
    pub fn new(
        count: usize,
        threads: usize,
        source: impl Into<Arc<EpisodeSource>>,
        options: EnvOptions,
        audio: Audio,
    ) -> Result<Self, TrainingError> {
        let small = |number| u32::try_from(number).unwrap_or(u32::MAX);
        crate::options::within("num_envs", small(count), 1, 4096)?;
        crate::options::within("threads", small(threads), 1, 1024)?;
        let shared = Shared::new(source.into(), options, audio)?;
        let member = |number| {
            let env = Env::with(number, Arc::clone(&shared));
            Mutex::new(Member { env, needs_reset: false })
        };
        let members: Arc<Vec<_>> = Arc::new((0..count as u64).map(member).collect());
        let (work, tasks) = channel();
        let (tasks, results) = (Arc::new(Mutex::new(tasks)), Arc::new(Results::default()));
        let is_closing = Arc::new(AtomicBool::new(false));
        let worker = |_| {
            let (members, tasks, results) = (Arc::clone(&members), Arc::clone(&tasks), Arc::clone(&results));
            let is_closing = Arc::clone(&is_closing);
            let worker = thread::Builder::new().name("avln-train".to_owned());
            worker.spawn(move || run(&members, &tasks, &results, &is_closing)).map_err(TrainingError::Thread)
        };
        let threads = (0..threads).map(worker).collect::<Result<_, _>>()?;
        Ok(Self { members, shared, work: Some(work), results, threads, is_closing })
    }

    /// Returns the arrays of a row.
    pub fn layout(&self) -> &Layout {
        &self.shared.layout
    }

    /// Returns the options.
    pub fn options(&self) -> &EnvOptions {
        &self.shared.options
    }

    /// Starts the next episode of an environment.
    ///
    /// # Errors
    /// If there is no such environment.
    pub fn send_reset(&self, env: usize, row: R) -> Result<(), TrainingError> {
        self.send(env, Task::Reset, row)
    }

    /// Starts a step.
    ///
    /// # Errors
    /// If there is no such environment.
    pub fn send_step(&self, env: usize, action: i64, row: R) -> Result<(), TrainingError> {
        self.send(env, Task::Step(action), row)
    }

    /// Starts the restoration of a state of this or another environment.
    ///
    /// # Errors
    /// If there is no such environment.
    pub fn send_restore(&self, env: usize, state: EnvState, row: R) -> Result<(), TrainingError> {
        self.send(env, Task::Restore(Arc::new(state)), row)
    }

    fn send(&self, env: usize, task: Task, row: R) -> Result<(), TrainingError> {
        self.known(env)?;
        if let Some(work) = &self.work {
            // The threads, which receive, end after this vector.
            let _ = work.send(Work { env, task, row });
        }
        Ok(())
    }

    fn known(&self, env: usize) -> Result<&Mutex<Member>, TrainingError> {
        let count = self.members.len();
        self.members.get(env).ok_or(TrainingError::UnknownEnv { env, count })
    }

    fn member(&self, env: usize) -> Result<MutexGuard<'_, Member>, TrainingError> {
        Ok(self.known(env)?.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Waits for `count` finished tasks, in the order of completion; fewer after `timeout`.
    pub fn recv(&self, count: usize, timeout: Duration) -> Vec<Finished<R>> {
        self.results.take(count, timeout)
    }

    /// Returns the exact state of an environment without a running task.
    ///
    /// # Errors
    /// If there is no such environment, or it has no episode.
    pub fn state(&self, env: usize) -> Result<EnvState, TrainingError> {
        self.member(env)?.env.state()
    }

    /// Returns the parts of a picture of an environment without a running task.
    ///
    /// # Errors
    /// If there is no such environment, it has no episode, or the side is out of range.
    pub fn overview(&self, env: usize, side: u32) -> Result<Overview, TrainingError> {
        self.member(env)?.env.overview(side)
    }
}

/// Ends all threads after their present step.
impl<R> Drop for VectorEnv<R> {
    fn drop(&mut self) {
        self.is_closing.store(true, Ordering::Relaxed);
        self.work = None;
        self.threads.drain(..).for_each(|thread| {
            // A worker catches panics, so this cannot fail.
            let _ = thread.join();
        });
    }
}

/// Performs tasks until the vector is closed.
fn run<R: RowSource>(
    members: &[Mutex<Member>],
    tasks: &Mutex<Receiver<Work<R>>>,
    results: &Results<R>,
    is_closing: &AtomicBool,
) {
    loop {
        let next = tasks.lock().unwrap_or_else(PoisonError::into_inner).recv();
        let Ok(Work { env, task, mut row }) = next else { return };
        // The channel still yields the tasks sent before.
        if is_closing.load(Ordering::Relaxed) {
            return;
        }
        let mut member = members[env].lock().unwrap_or_else(PoisonError::into_inner);
        // A panic in one environment must not stop the others.
        let flags = catch_unwind(AssertUnwindSafe(|| member.perform(&task, &mut row)));
        let flags = flags.unwrap_or_else(|_| {
            Err(TrainingError::Shared(format!("environment {env} failed; the message is on standard error")))
        });
        results.push(Finished { env, row, flags });
    }
}

impl Member {
    fn perform(&mut self, task: &Task, row: &mut impl RowSource) -> Result<StepFlags, TrainingError> {
        match task {
            Task::Reset => self.reset(row),
            Task::Restore(state) => self.restore(state, row),
            Task::Step(_) if self.needs_reset => self.reset(row),
            Task::Step(action) => self.step(*action, row),
        }
    }

    fn restore(&mut self, state: &EnvState, row: &mut impl RowSource) -> Result<StepFlags, TrainingError> {
        self.env.restore(state, &mut row.row())?;
        self.needs_reset = self.env.autoreset() == AutoReset::NextStep && self.env.is_over();
        Ok(StepFlags::default())
    }

    fn reset(&mut self, row: &mut impl RowSource) -> Result<StepFlags, TrainingError> {
        self.env.reset(&mut row.row())?;
        self.needs_reset = false;
        Ok(StepFlags::default())
    }

    fn step(&mut self, action: i64, row: &mut impl RowSource) -> Result<StepFlags, TrainingError> {
        let flags = self.env.step(action, &mut row.row())?;
        if flags.is_over() {
            match self.env.autoreset() {
                AutoReset::Disabled => {}
                AutoReset::NextStep => self.needs_reset = true,
                AutoReset::SameStep => {
                    row.keep_final();
                    self.env.reset(&mut row.row())?;
                }
            }
        }
        Ok(flags)
    }
}

/// Finished tasks in the order of completion, with one receiver. It wakes up once for all the tasks that it waits for: a wake-up
/// takes as long as a cheap step.
pub(crate) struct Results<R> {
    state: Mutex<ResultQueue<R>>,
    is_ready: Condvar,
}

struct ResultQueue<R> {
    finished: VecDeque<Finished<R>>,
    /// Tasks that the receiver waits for.
    wanted: usize,
}

impl<R> Default for Results<R> {
    fn default() -> Self {
        let state = ResultQueue { finished: VecDeque::new(), wanted: 1 };
        Self { state: Mutex::new(state), is_ready: Condvar::new() }
    }
}

impl<R> Results<R> {
    fn lock(&self) -> MutexGuard<'_, ResultQueue<R>> {
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
        let waits = |state: &mut ResultQueue<R>| state.finished.len() < count;
        let (mut state, _) =
            self.is_ready.wait_timeout_while(state, timeout, waits).unwrap_or_else(PoisonError::into_inner);
        let ready = count.min(state.finished.len());
        state.finished.drain(..ready).collect()
    }
}
