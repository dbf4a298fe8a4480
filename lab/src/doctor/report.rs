use serde::Serialize;

/// Result of an examination.
#[derive(Clone, Debug, Default, Serialize)]
pub struct DoctorReport {
    /// The checks, in the order in which they were made.
    pub checks: Vec<Check>,
    /// Measurements of the finished checks.
    pub measured: Measured,
}

/// A check.
#[derive(Clone, Debug, Serialize)]
pub struct Check {
    /// Subject of the check.
    pub name: &'static str,
    /// Status of the check.
    pub verdict: Verdict,
    /// Finding, as text.
    pub found: String,
    /// Advice; empty without any.
    pub next: String,
}

/// Outcome of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// As it should be.
    Ok,
    /// A run can be played, but look at this.
    Warning,
    /// A run would fail.
    Failed,
    /// It was not looked at.
    Skipped,
}

impl Verdict {
    /// Its word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Failed => "FAILED",
            Self::Skipped => "skipped",
        }
    }
}

/// Measurements. Times are seconds.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Measured {
    /// Between sending a question and its answer.
    pub round_trip_s: Option<Spread>,
    /// By how much the server's clock is ahead of this machine's.
    pub clock_ahead_s: Option<f64>,
    /// Between asking for an episode and its first observation.
    pub begin_s: Option<Spread>,
    /// Between sending an action and its observation.
    pub step_s: Option<Spread>,
    /// Steps a second with one episode at a time, without the agent's own thinking.
    pub steps_per_s: Option<f64>,
    /// Bytes of sensors that an observation brings, unpacked.
    pub observation_bytes: Option<usize>,
    /// Longest that a run of the phase takes with one slot, without the agent's own thinking.
    pub longest_run_s: Option<f64>,
}

/// Distribution of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Half are below.
    pub median: f64,
    /// One in twenty is above.
    pub p95: f64,
    /// The largest.
    pub max: f64,
    /// Number of measurements.
    pub count: usize,
}

impl Spread {
    /// Of these; `None` of nothing.
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let at = |share: f64| values.get((share * (values.len().saturating_sub(1)) as f64).round() as usize);
        let (&median, &p95, &max) = (at(0.5)?, at(0.95)?, values.last()?);
        Some(Self { median, p95, max, count: values.len() })
    }
}

impl DoctorReport {
    /// True if no check failed.
    pub fn is_well(&self) -> bool {
        self.checks.iter().all(|check| check.verdict != Verdict::Failed)
    }

    pub(super) fn add(&mut self, name: &'static str, verdict: Verdict, found: impl ToString, next: &str) {
        self.checks.push(Check { name, verdict, found: found.to_string(), next: next.to_owned() });
    }

    pub(super) fn ok(&mut self, name: &'static str, found: impl ToString) {
        self.add(name, Verdict::Ok, found, "");
    }

    pub(super) fn failed(&mut self, name: &'static str, found: impl ToString, next: &str) {
        self.add(name, Verdict::Failed, found, next);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spread_is_read_off_sorted_values() {
        let spread = Spread::of((1..=101).rev().map(f64::from).collect()).unwrap();
        assert_eq!(spread, Spread { median: 51.0, p95: 96.0, max: 101.0, count: 101 });
        assert_eq!(Spread::of(vec![]), None);
        assert_eq!(Spread::of(vec![2.0]).unwrap().p95, 2.0);
    }

    #[test]
    fn what_fails_is_not_well_and_warnings_are() {
        let mut report = DoctorReport::default();
        report.add("clock", Verdict::Warning, "2 s ahead", "set it");
        assert!(report.is_well());
        report.failed("token", "refused", "ask for another");
        assert!(!report.is_well());
    }
}
