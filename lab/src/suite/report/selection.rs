//! Selection of results: the compared edition, tracks, and an agent's results in one order.

use super::contrast::{Difference, average, between, paired};
use crate::suite::{AgentVariant, EpisodeKey, ResultLine};
use avln_episode::{Modality, Order};
use avln_scoring::{EpisodeScore, Estimate, Summary, summarise};
use clap::ValueEnum;
use std::collections::BTreeMap;

const SEED: u64 = 1;

/// Results of a track with equal split, rules, feedback and image size.
pub(super) struct TrackResults<'a> {
    pub(super) lines: Vec<&'a ResultLine>,
}

/// Returns the results with the most frequent program, benchmark and seed. Each track with equal feedback contributes its largest
/// group of equal split, rules and image size.
pub(super) fn comparable<'a>(lines: impl Iterator<Item = &'a ResultLine>) -> Vec<&'a ResultLine> {
    let edition = |key: &EpisodeKey| (key.benchmark.clone(), key.program.clone(), key.seed);
    let latest = largest(lines.collect(), edition);
    let track = |key: &EpisodeKey| (key.track.clone(), key.feedback.clone());
    let mut tracks: BTreeMap<_, Vec<&ResultLine>> = BTreeMap::new();
    latest.into_iter().for_each(|line| tracks.entry(track(&line.key)).or_default().push(line));
    let group = |key: &EpisodeKey| (key.split.clone(), key.rules.clone(), key.side_px);
    tracks.into_values().flat_map(|lines| largest(lines, group)).collect()
}

/// Returns the lines of the largest group; of the last by name among equals.
fn largest<K: Ord>(lines: Vec<&ResultLine>, group: impl Fn(&EpisodeKey) -> K) -> Vec<&ResultLine> {
    let mut counts = BTreeMap::<K, usize>::new();
    lines.iter().for_each(|line| *counts.entry(group(&line.key)).or_default() += 1);
    let Some((most, _)) = counts.into_iter().max_by_key(|(_, count)| *count) else { return Vec::new() };
    lines.into_iter().filter(|line| group(&line.key) == most).collect()
}

impl<'a> TrackResults<'a> {
    /// Returns the results of a track by label, with feedback.
    pub(super) fn of(lines: &[&'a ResultLine], track: &str, feedback: &str) -> Self {
        let own = |line: &&&ResultLine| line.key.track == track && line.key.feedback == feedback;
        Self { lines: lines.iter().filter(own).copied().collect() }
    }

    pub(super) fn row(&self, name: &str, order: Order) -> RowResults<'a> {
        let own = |line: &&&ResultLine| line.key.agent == name && line.order() == order;
        RowResults { lines: self.lines.iter().filter(own).copied().collect() }
    }

    pub(super) fn variant(&self, variant: AgentVariant, order: Order) -> RowResults<'a> {
        self.row(&variant.name(), order)
    }

    /// Returns `true` if an agent has results.
    pub(super) fn has(&self, name: &str) -> bool {
        self.lines.iter().any(|line| line.key.agent == name)
    }

    /// Returns the agents with results, in table order.
    pub(super) fn variants(&self) -> Vec<AgentVariant> {
        let all = AgentVariant::value_variants().iter().copied();
        all.filter(|variant| self.has(&variant.name())).collect()
    }

    /// Returns PAG-Nav's preset with the most abilities among those with results.
    pub(super) fn full_agent(&self) -> &'static str {
        if self.has("pag-nav-plus") { "pag-nav-plus" } else { "pag-nav" }
    }
}

/// An agent's results in one order.
pub(super) struct RowResults<'a> {
    pub(super) lines: Vec<&'a ResultLine>,
}

impl RowResults<'_> {
    /// Returns means with intervals resampled by scene; `None` without results.
    pub(super) fn summary(&self) -> Option<Summary> {
        let score = |line: &&ResultLine| EpisodeScore {
            episode: line.key.episode.clone(),
            scene: line.scene.clone(),
            order: line.order(),
            metrics: line.metrics.clone(),
        };
        summarise(&self.lines.iter().map(score).collect::<Vec<_>>(), SEED)
    }

    pub(super) fn sr(&self) -> Option<Estimate> {
        self.summary().map(|summary| summary.sr)
    }

    /// Returns the found share of a modality's goals, and the goal count.
    pub(super) fn by_modality(&self, modality: Modality) -> (f64, usize) {
        average(self.lines.iter().flat_map(|line| found(line, modality)))
    }

    /// Returns the mean ISR of missions with `goals` goals, and the mission count.
    pub(super) fn by_goals(&self, goals: u32) -> (f64, usize) {
        let lines = self.lines.iter().filter(|line| line.metrics.goals == goals);
        average(lines.map(|line| line.metrics.isr))
    }

    /// Tests this row minus another over their common missions, in percentage points of `number`; missions without a number in
    /// one of the rows do not count.
    pub(super) fn minus(
        &self,
        other: &RowResults<'_>,
        number: impl Fn(&ResultLine) -> Option<f64>,
    ) -> Option<Difference> {
        let others: BTreeMap<&str, &ResultLine> =
            other.lines.iter().map(|line| (line.key.episode.as_str(), *line)).collect();
        let pairs = self.lines.iter().filter_map(|line| {
            let other = others.get(line.key.episode.as_str())?;
            Some((line.scene.as_str(), 100.0 * (number(line)? - number(other)?)))
        });
        paired(&pairs.collect::<Vec<_>>())
    }

    /// Tests the found share of a modality's goals minus that of another, inside houses, in percentage points.
    pub(super) fn modality_gap(&self, first: Modality, second: Modality) -> Option<Difference> {
        let mut values = Vec::new();
        for line in &self.lines {
            for (modality, is_first) in [(first, true), (second, false)] {
                let own = found(line, modality);
                values.extend(own.map(|found| (line.scene.as_str(), is_first, 100.0 * found)));
            }
        }
        between(&values)
    }

    /// Tests the ISR of missions with `first` goals minus that with `second` goals, inside houses, in percentage points.
    pub(super) fn goals_gap(&self, first: u32, second: u32) -> Option<Difference> {
        let own = self.lines.iter().filter(|line| [first, second].contains(&line.metrics.goals));
        let values =
            own.map(|line| (line.scene.as_str(), line.metrics.goals == first, 100.0 * line.metrics.isr));
        between(&values.collect::<Vec<_>>())
    }
}

/// Returns 1 for each found goal of a modality and 0 for the others.
fn found(line: &ResultLine, modality: Modality) -> impl Iterator<Item = f64> + '_ {
    let goals = line.modalities.iter().zip(&line.metrics.steps_to_goal);
    let own = goals.filter(move |(of, _)| **of == modality);
    own.map(|(_, found)| if found.is_some() { 1.0 } else { 0.0 })
}

/// Returns the found share of a modality's goals in a mission; `None` without such goals.
pub(super) fn modality_share(line: &ResultLine, modality: Modality) -> Option<f64> {
    let (share, count) = average(found(line, modality));
    (count > 0).then_some(share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::suite::results::samples::{line, moved};

    fn of(lines: &[ResultLine]) -> Vec<&ResultLine> {
        comparable(lines.iter())
    }

    #[test]
    fn tracks_and_feedback_never_mix() {
        let one = line("random", Order::Ordered, 0, 1);
        let mut other_split = one.clone();
        other_split.key.split = "other".to_owned();
        other_split.key.episode = "x".to_owned();
        let lines = [
            one.clone(),
            line("random", Order::Ordered, 1, 1),
            other_split,
            moved(one.clone(), "hard", "none"),
            moved(one, "main", "verdict"),
        ];
        let kept = of(&lines);
        assert_eq!(kept.len(), 4);
        assert_eq!(TrackResults::of(&kept, "main", "none").lines.len(), 2);
        assert_eq!(TrackResults::of(&kept, "hard", "none").lines.len(), 1);
        assert_eq!(TrackResults::of(&kept, "main", "verdict").lines.len(), 1);
    }

    #[test]
    fn only_the_largest_edition_is_compared() {
        let mut old = line("random", Order::Ordered, 0, 1);
        old.key.benchmark = "1".to_owned();
        let lines = [old, line("random", Order::Ordered, 1, 1), line("random", Order::Ordered, 2, 1)];
        assert_eq!(of(&lines).len(), 2);
    }

    #[test]
    fn rows_are_compared_over_common_missions() {
        let lines: Vec<_> = (0..8)
            .map(|episode| line("pag-nav", Order::Ordered, episode, 2))
            .chain((0..6).map(|episode| line("random", Order::Ordered, episode, 1)))
            .collect();
        let track = TrackResults::of(&of(&lines), "main", "none");
        let [full, other] = ["pag-nav", "random"].map(|name| track.row(name, Order::Ordered));
        let isr = full.minus(&other, |line| Some(line.metrics.isr)).expect("pairs");
        assert_eq!((isr.count, isr.scenes, isr.value, isr.p), (6, 3, 50.0, 0.25));
        // In every mission of `random`, the category goal is found and the image goal is not.
        let gap = other.modality_gap(Modality::Category, Modality::Image).expect("goals");
        assert_eq!((gap.count, gap.value), (12, 100.0));
        assert_eq!(modality_share(other.lines[0], Modality::Image), Some(0.0));
        assert_eq!(modality_share(other.lines[0], Modality::Description), None);
        assert_eq!(other.goals_gap(2, 3), None);
    }
}
