//! Progress messages of a suite, with the remaining time.

use super::{ResultLine, Results};
use avln_arena::Failure;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

const REPORT_INTERVAL: Duration = Duration::from_secs(5);
/// Assumed episode duration before the first measurement, seconds.
const UNMEASURED_S: f64 = 30.0;

/// An agent's name and a goal order, as in [`EpisodeKey`](super::EpisodeKey).
pub(super) type SuiteRow = (String, String);

/// The results file and the progress messages.
pub(super) struct SuiteProgress {
    results: Results,
    durations: EpisodeDurations,
    /// Missions without results by row.
    left: BTreeMap<SuiteRow, usize>,
    slots: u32,
    played: usize,
    to_play: usize,
    reported: Option<Instant>,
}

impl SuiteProgress {
    /// Begins with results of a track and the missing missions by row.
    pub(super) fn new(results: Results, track: &str, left: BTreeMap<SuiteRow, usize>, slots: u32) -> Self {
        let mut durations = EpisodeDurations::default();
        results.lines().filter(|line| line.key.track == track).for_each(|line| durations.add(line));
        let to_play = left.values().sum();
        Self { results, durations, left, slots, played: 0, to_play, reported: None }
    }

    /// Returns the count of played episodes.
    pub(super) fn played(&self) -> usize {
        self.played
    }

    /// Stores a result, and reports at intervals.
    pub(super) fn add(&mut self, line: ResultLine) -> Result<(), Failure> {
        self.played += 1;
        self.durations.add(&line);
        if let Some(left) = self.left.get_mut(&(line.key.agent.clone(), line.key.order.clone())) {
            *left = left.saturating_sub(1);
        }
        let is_last = self.played == self.to_play;
        if is_last || self.reported.is_none_or(|reported| reported.elapsed() >= REPORT_INTERVAL) {
            self.reported = Some(Instant::now());
            self.report(&line);
        }
        self.results.add(line)
    }

    fn report(&self, line: &ResultLine) {
        let (agent, order) = (&line.key.agent, &line.key.order);
        let left = self.left.get(&(agent.clone(), order.clone())).copied().unwrap_or(0);
        let time = shown(self.durations.remaining_s(&self.left) / f64::from(self.slots.max(1)));
        let (metrics, think_ms) = (&line.metrics, line.think_ms);
        eprintln!(
            "{} of {} episodes, about {time} left: {agent} {order}, {left} missions left; {} of {} goals in {} steps, {think_ms:.0} ms per action",
            self.played, self.to_play, metrics.found, metrics.goals, metrics.steps
        );
    }
}

/// Measured episode durations by row.
#[derive(Default)]
struct EpisodeDurations(BTreeMap<SuiteRow, (f64, usize)>);

impl EpisodeDurations {
    fn add(&mut self, line: &ResultLine) {
        let (sum_s, count) = self.0.entry((line.key.agent.clone(), line.key.order.clone())).or_default();
        *sum_s += line.wall_s;
        *count += 1;
    }

    fn remaining_s(&self, left: &BTreeMap<SuiteRow, usize>) -> f64 {
        left.iter().map(|(row, &count)| count as f64 * self.episode_s(row)).sum()
    }

    /// Returns a row's mean duration, or that of the agent, of its relatives or of all agents.
    fn episode_s(&self, row: &SuiteRow) -> f64 {
        let family = |name: &str| name.starts_with("pag-nav");
        let tests: [&dyn Fn(&SuiteRow) -> bool; 4] = [
            &|other| other == row,
            &|other| other.0 == row.0,
            &|other| family(&other.0) && family(&row.0),
            &|_| true,
        ];
        tests.iter().find_map(|is_alike| self.mean_s(*is_alike)).unwrap_or(UNMEASURED_S)
    }

    fn mean_s(&self, is_alike: &dyn Fn(&SuiteRow) -> bool) -> Option<f64> {
        let alike = self.0.iter().filter(|(row, _)| is_alike(row));
        let (sum_s, count) = alike.fold((0.0, 0), |(sum_s, count), (_, (s, n))| (sum_s + s, count + n));
        (count > 0).then(|| sum_s / count as f64)
    }
}

/// Formats a duration: minutes, or hours and minutes.
fn shown(seconds: f64) -> String {
    let minutes = (seconds / 60.0).ceil() as u64;
    if minutes < 60 { format!("{minutes} min") } else { format!("{} h {} min", minutes / 60, minutes % 60) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, order: &str) -> SuiteRow {
        (name.to_owned(), order.to_owned())
    }

    #[test]
    fn remaining_time_is_estimated_by_row() {
        let mut durations = EpisodeDurations::default();
        let left = BTreeMap::from([(row("pag-nav-no-map", "ordered"), 10)]);
        assert_eq!(durations.remaining_s(&left), 10.0 * UNMEASURED_S);
        durations.0.insert(row("random", "ordered"), (2.0, 2));
        assert_eq!(durations.remaining_s(&left), 10.0);
        durations.0.insert(row("pag-nav", "ordered"), (40.0, 2));
        assert_eq!(durations.remaining_s(&left), 200.0);
        durations.0.insert(row("pag-nav-no-map", "unordered"), (30.0, 1));
        assert_eq!(durations.remaining_s(&left), 300.0);
        durations.0.insert(row("pag-nav-no-map", "ordered"), (50.0, 1));
        assert_eq!(durations.remaining_s(&left), 500.0);
    }

    #[test]
    fn durations_are_shown_in_hours_and_minutes() {
        assert_eq!(
            (shown(59.0), shown(61.0), shown(7260.0)),
            ("1 min".into(), "2 min".into(), "2 h 1 min".into())
        );
    }
}
