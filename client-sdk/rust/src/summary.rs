//! Progress, results and notices.

use crate::action::EndReason;
use avln_proto::v1;
use std::fmt;

/// Run progress in episodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Episodes in the run.
    pub total: u32,
    /// Stored episodes.
    pub done: u32,
    /// Open episodes.
    pub in_flight: u32,
    /// Estimated seconds to the end, once an episode has ended.
    pub eta_s: Option<u32>,
}

/// A public metric.
#[derive(Clone, Debug, PartialEq)]
pub struct Metric {
    /// Name, lower snake case: `sr`, `isr`, `osr`, `spl`, `soft_spl` …
    pub name: String,
    /// Value, in the unit at the name's end; otherwise without unit.
    pub value: f64,
    /// 95 % interval, if known.
    pub interval: Option<(f64, f64)>,
}

/// An episode's result.
#[derive(Clone, Debug, PartialEq)]
pub struct EpisodeEnd {
    /// Random episode handle, valid in this run only.
    pub episode: String,
    /// End reason.
    pub reason: EndReason,
    /// True if the task ended the episode; otherwise it was truncated.
    pub terminated: bool,
    /// Steps taken.
    pub steps: u32,
    /// Metrics; `None` if the phase hides them.
    pub metrics: Option<Vec<Metric>>,
    /// Run progress.
    pub progress: Progress,
}

/// A run's result.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RunSummary {
    /// Run id.
    pub run: String,
    /// Final progress.
    pub progress: Progress,
    /// True if every episode was played.
    pub complete: bool,
    /// Episode count by end reason.
    pub ends: Vec<(EndReason, u32)>,
    /// Metrics; `None` if the phase hides them.
    pub metrics: Option<Vec<Metric>>,
    /// Result web page; empty: none.
    pub url: String,
}

/// An announcement for people, for example of a server stop, low time or maintenance.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// Text.
    pub message: String,
    /// Effective time, milliseconds since 1970 UTC; 0: now.
    pub effective_unix_ms: i64,
}

impl RunSummary {
    /// Returns the metric `name`, if public.
    pub fn metric(&self, name: &str) -> Option<&Metric> {
        self.metrics.iter().flatten().find(|metric| metric.name == name)
    }

    pub(crate) fn from_wire(end: v1::RunEnd) -> Self {
        Self {
            run: end.run,
            progress: Progress::from_wire(end.progress),
            complete: end.complete,
            ends: ends(&end.ends),
            metrics: end.metrics.map(metrics),
            url: end.url,
        }
    }
}

impl EpisodeEnd {
    pub(crate) fn from_wire(end: v1::EpisodeEnd) -> Self {
        Self {
            reason: EndReason::from_wire(end.reason),
            episode: end.episode,
            terminated: end.terminated,
            steps: end.step,
            metrics: end.metrics.map(metrics),
            progress: Progress::from_wire(end.progress),
        }
    }
}

impl Progress {
    pub(crate) fn from_wire(progress: Option<v1::RunProgress>) -> Self {
        let v1::RunProgress { total, done, in_flight, eta_s } = progress.unwrap_or_default();
        Self { total, done, in_flight, eta_s }
    }
}

pub(crate) fn ends(counts: &[v1::EndCount]) -> Vec<(EndReason, u32)> {
    counts.iter().map(|count| (EndReason::from_wire(count.reason), count.episodes)).collect()
}

pub(crate) fn metrics(shown: v1::PublicMetrics) -> Vec<Metric> {
    let metric = |m: v1::Metric| Metric { name: m.name, value: m.value, interval: m.low.zip(m.high) };
    shown.metrics.into_iter().map(metric).collect()
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:.3}", self.name, self.value)?;
        match self.interval {
            Some((low, high)) => write!(f, " [{low:.3}, {high:.3}]"),
            None => Ok(()),
        }
    }
}

impl fmt::Display for RunSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = if self.complete { "complete" } else { "incomplete" };
        write!(f, "{}: {} of {} episodes, {state}", self.run, self.progress.done, self.progress.total)?;
        for (reason, episodes) in &self.ends {
            write!(f, "; {episodes} {reason}")?;
        }
        match &self.metrics {
            Some(metrics) => metrics.iter().try_for_each(|metric| write!(f, "\n  {metric}"))?,
            None => write!(f, "\n  this phase shows no metrics")?,
        }
        if self.url.is_empty() { Ok(()) } else { write!(f, "\n  {}", self.url) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summary_text_contains_all_values() {
        let end = v1::RunEnd {
            run: "run_1".into(),
            progress: Some(v1::RunProgress { total: 3, done: 2, in_flight: 0, eta_s: None }),
            ends: vec![v1::EndCount { reason: v1::EndReason::Stopped as i32, episodes: 2 }],
            metrics: Some(v1::PublicMetrics {
                metrics: vec![v1::Metric {
                    name: "isr".into(),
                    value: 0.25,
                    low: Some(0.1),
                    high: Some(0.5),
                    n: 2,
                }],
            }),
            complete: false,
            url: String::new(),
        };
        let summary = RunSummary::from_wire(end);
        assert_eq!(summary.metric("isr").and_then(|m| m.interval), Some((0.1, 0.5)));
        assert_eq!(
            summary.to_string(),
            "run_1: 2 of 3 episodes, incomplete; 2 stopped\n  isr 0.250 [0.100, 0.500]"
        );
    }

    #[test]
    fn hidden_metrics_are_none_and_not_empty() {
        assert_eq!(RunSummary::from_wire(v1::RunEnd::default()).metrics, None);
        assert_eq!(EpisodeEnd::from_wire(v1::EpisodeEnd::default()).metrics, None);
    }
}
