//! Faults of the simulator, the run logs and the whole server, injected at the next opportunity.

use avln_grpc::{Acted, EpisodeLog, Watchdog};
use std::{
    io,
    panic::resume_unwind,
    sync::atomic::{AtomicBool, AtomicU32, Ordering},
    time::Duration,
};

/// Faults to come. The simulation is single-threaded: atomics only satisfy `Sync`.
#[derive(Debug, Default)]
pub(crate) struct Faults {
    /// Calls and log lines before the server crashes; 0 for no crash.
    fuse: AtomicU32,
    crashed: AtomicBool,
    /// Lines of run logs that fail.
    pub(crate) failing_lines: AtomicU32,
    /// Steps whose simulation panics.
    pub(crate) panicking_steps: AtomicU32,
    /// Steps whose simulation hangs.
    pub(crate) hanging_steps: AtomicU32,
    /// First observations that panic.
    pub(crate) panicking_starts: AtomicU32,
    /// First observations that hang.
    pub(crate) hanging_starts: AtomicU32,
}

impl Faults {
    /// Crashes the server at the `points`-th call or log line from now on.
    pub(crate) fn crash_after(&self, points: u32) {
        self.fuse.store(points, Ordering::Relaxed);
    }

    pub(crate) fn has_crashed(&self) -> bool {
        self.crashed.load(Ordering::Relaxed)
    }

    /// Passes a point at which the server may crash. Returns whether it has crashed, here or before.
    pub(crate) fn passes_crash(&self) -> bool {
        if self.fuse.load(Ordering::Relaxed) > 0 && self.fuse.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.crashed.store(true, Ordering::Relaxed);
        }
        self.has_crashed()
    }

    /// Forgets all faults to come.
    pub(crate) fn clear(&self) {
        self.fuse.store(0, Ordering::Relaxed);
        let counts =
            [&self.failing_lines, &self.panicking_steps, &self.hanging_steps, &self.panicking_starts];
        counts.into_iter().chain([&self.hanging_starts]).for_each(|count| count.store(0, Ordering::Relaxed));
    }

    /// Disturbs a step before it is taken.
    pub(crate) fn disturb_step(&self, watchdog: &Watchdog) {
        disturb(&self.panicking_steps, &self.hanging_steps, watchdog);
    }

    /// Disturbs a first observation.
    pub(crate) fn disturb_start(&self, watchdog: &Watchdog) {
        disturb(&self.panicking_starts, &self.hanging_starts, watchdog);
    }
}

fn disturb(panics: &AtomicU32, hangs: &AtomicU32, watchdog: &Watchdog) {
    if take(hangs) {
        watchdog.expire();
    } else if take(panics) {
        // Without the panic hook, which would print a message.
        resume_unwind(Box::new("an injected panic"));
    }
}

/// Uses up one of the faults, if any.
fn take(count: &AtomicU32) -> bool {
    count.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_ok()
}

/// A run log with faults.
pub(crate) struct FaultyLog {
    pub(crate) log: Box<dyn EpisodeLog>,
    pub(crate) faults: std::sync::Arc<Faults>,
}

impl FaultyLog {
    /// Writes a line, unless the disk is full or the server crashes before it.
    fn write(&mut self, line: impl FnOnce(&mut dyn EpisodeLog) -> io::Result<()>) -> io::Result<()> {
        if self.faults.passes_crash() {
            return Err(io::Error::other("the server has crashed"));
        }
        if take(&self.faults.failing_lines) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        line(&mut *self.log)?;
        // A crash here leaves a line whose answer the agent never receives.
        self.faults.passes_crash();
        Ok(())
    }
}

impl EpisodeLog for FaultyLog {
    fn acting(&mut self, step: u32) -> io::Result<()> {
        self.write(|log| log.acting(step))
    }

    fn acted(&mut self, acted: &Acted) -> io::Result<()> {
        self.write(|log| log.acted(acted))
    }

    fn clock_restarted(&mut self, step: u32, away: Duration) -> io::Result<()> {
        self.write(|log| log.clock_restarted(step, away))
    }
}
