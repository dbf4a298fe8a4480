//! Spans of runs, sessions, episodes and steps, with duration and outcome; listed in `docs/OPERATING.md`.
//!
//! Spans above the step have the level error, so that they are part of every log line at any filter. The end of a span is an event in
//! it. Fields contain only facts known to the agent, and durations.

use crate::control::TimeSpent;
use avln_episode::Action;
use parking_lot::Mutex;
use std::{collections::BTreeMap, time::Duration};
use tokio::time::Instant;
use tracing::{Span, field::Empty};

/// Simulation and encoding of a step beyond this time cause a warning.
pub(crate) const SLOW_STEP: Duration = Duration::from_secs(1);

/// A span with its start.
#[derive(Clone, Debug)]
pub(crate) struct TimedSpan {
    span: Span,
    begun: Instant,
}

impl TimedSpan {
    fn new(span: Span) -> Self {
        Self { span, begun: Instant::now() }
    }

    /// Returns the span, to enter it.
    pub(crate) fn span(&self) -> Span {
        self.span.clone()
    }

    fn record_end(&self, outcome: &str) {
        self.span.record("outcome", outcome).record("duration_ms", millis(self.begun.elapsed()));
    }
}

/// Spans of the runs on this server, from the first session to the end of the run. A run may have several sessions.
#[derive(Debug, Default)]
pub(crate) struct RunSpans(Mutex<BTreeMap<String, TimedSpan>>);

impl RunSpans {
    /// Returns a run's span, new if the run has none.
    pub(crate) fn enter(&self, run: &str) -> Span {
        let mut open = self.0.lock();
        if let Some(known) = open.get(run) {
            return known.span();
        }
        let span = tracing::error_span!(parent: None, "run", run, outcome = Empty, duration_ms = Empty);
        open.insert(run.to_owned(), TimedSpan::new(span.clone()));
        span
    }

    /// Ends a run's span, unless it has none.
    pub(crate) fn end(&self, run: &str, outcome: &str) {
        let Some(ended) = self.0.lock().remove(run) else { return };
        ended.record_end(outcome);
        tracing::info!(parent: &ended.span, "run ended");
    }
}

/// Span of a session.
#[derive(Debug)]
pub(crate) struct SessionSpan(TimedSpan);

impl SessionSpan {
    pub(crate) fn begin(run: &Span) -> Self {
        let span = tracing::error_span!(parent: run, "session", outcome = Empty, duration_ms = Empty);
        Self(TimedSpan::new(span))
    }

    pub(crate) fn span(&self) -> Span {
        self.0.span()
    }

    pub(crate) fn end(&self, outcome: &str) {
        self.0.record_end(outcome);
        tracing::info!(parent: &self.0.span, "session ended");
    }
}

/// Span of an episode, from the request to the stored result.
#[derive(Debug)]
pub(crate) struct EpisodeSpan {
    timed: TimedSpan,
    steps: u32,
}

impl EpisodeSpan {
    pub(crate) fn begin(session: &Span, slot: u32) -> Self {
        let span = tracing::error_span!(
            parent: session,
            "episode",
            slot,
            episode = Empty,
            ordinal = Empty,
            steps = Empty,
            outcome = Empty,
            duration_ms = Empty
        );
        Self { timed: TimedSpan::new(span), steps: 0 }
    }

    pub(crate) fn span(&self) -> Span {
        self.timed.span()
    }

    /// Records the name of the issued episode, and its number in the run.
    pub(crate) fn issued(&self, handle: &str, ordinal: u32) {
        self.timed.span.record("episode", handle).record("ordinal", ordinal);
    }

    pub(crate) fn stepped(&mut self, step: u32) {
        self.steps = step;
    }

    pub(crate) fn end(&self, outcome: &str) {
        self.timed.span.record("steps", self.steps);
        self.timed.record_end(outcome);
        tracing::info!(parent: &self.timed.span, "episode ended");
    }
}

/// Span of a step, from the action's arrival to the encoded observation.
#[derive(Debug)]
pub(crate) struct StepSpan {
    timed: TimedSpan,
    step: u32,
    /// The episode's time accounts when the action arrived.
    before: TimeSpent,
}

impl StepSpan {
    /// Begins a step with the episode's time accounts, after the thinking time `thought`.
    pub(crate) fn begin(step: u32, action: Action, before: TimeSpent, thought: Duration) -> Self {
        let span = tracing::debug_span!(
            "step",
            step,
            %action,
            thinking_ms = millis(thought),
            queue_ms = Empty,
            simulation_ms = Empty,
            encoding_ms = Empty,
            outcome = Empty,
            duration_ms = Empty
        );
        Self { timed: TimedSpan::new(span), step, before }
    }

    pub(crate) fn span(&self) -> Span {
        self.timed.span()
    }

    /// Ends a step that was carried out. `after` are the episode's time accounts.
    pub(crate) fn end(&self, outcome: &str, after: TimeSpent) {
        let queue = after.queue.saturating_sub(self.before.queue);
        let simulation = after.simulation.saturating_sub(self.before.simulation);
        let encoding = after.encoding.saturating_sub(self.before.encoding);
        let parts = [("queue_ms", queue), ("simulation_ms", simulation), ("encoding_ms", encoding)];
        for (name, part) in parts {
            self.timed.span.record(name, millis(part));
        }
        self.fail(outcome);
        // Without the queue: on a busy server every step waits, and the metrics show that.
        if simulation + encoding > SLOW_STEP {
            let (simulation_ms, encoding_ms) = (millis(simulation), millis(encoding));
            tracing::warn!(
                step = self.step,
                simulation_ms,
                encoding_ms,
                queue_ms = millis(queue),
                "slow step"
            );
        }
    }

    /// Ends a step without a result.
    pub(crate) fn fail(&self, outcome: &str) {
        self.timed.record_end(outcome);
        tracing::debug!(parent: &self.timed.span, "step ended");
    }
}

/// Returns milliseconds, rounded to microseconds.
fn millis(time: Duration) -> f64 {
    time.as_micros() as f64 / 1000.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::{
        Arc,
        atomic::{AtomicUsize, Ordering},
    };
    use tracing::{Event, Level, Subscriber, subscriber::with_default};
    use tracing_subscriber::{
        layer::{Context, Layer, SubscriberExt},
        registry,
    };

    /// Counts warnings.
    #[derive(Clone, Default)]
    struct Warnings(Arc<AtomicUsize>);

    impl<S: Subscriber> Layer<S> for Warnings {
        fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
            self.0.fetch_add(usize::from(*event.metadata().level() == Level::WARN), Ordering::Relaxed);
        }
    }

    /// Counts the warnings of a step with these times, seconds.
    fn warnings(queue_s: u64, simulation_s: u64) -> usize {
        let counted = Warnings::default();
        let seconds = Duration::from_secs;
        let (before, passed) = (seconds(100), |time_s| seconds(100 + time_s));
        with_default(registry().with(counted.clone()), || {
            let before = TimeSpent { queue: before, simulation: before, ..TimeSpent::default() };
            let after = TimeSpent {
                queue: passed(queue_s),
                simulation: passed(simulation_s),
                ..TimeSpent::default()
            };
            StepSpan::begin(1, Action::Stop, before, Duration::ZERO).end("stopped", after);
        });
        counted.0.load(Ordering::Relaxed)
    }

    #[test]
    fn only_slow_simulation_causes_a_warning() {
        assert_eq!(warnings(0, 2), 1);
        assert_eq!(warnings(0, 1), 0);
        assert_eq!(warnings(60, 0), 0);
    }

    #[test]
    fn sessions_of_a_run_share_its_span() {
        with_default(registry(), || {
            let spans = RunSpans::default();
            let first = spans.enter("run_a");
            assert_eq!(spans.enter("run_a").id(), first.id());
            assert_ne!(spans.enter("run_b").id(), first.id());
            spans.end("run_a", "completed");
            assert_ne!(spans.enter("run_a").id(), first.id());
        });
    }
}
