//! The numbers behind the tables.

use super::paired::{Paired, sign_flip};
use crate::suite::{AgentVariant, ResultLine, results::EpisodeKey};
use avln_episode::{Modality, Order};
use avln_scoring::{EpisodeScore, Summary, summarise};
use std::collections::BTreeMap;

/// Seed of all resampling.
pub(super) const SEED: u64 = 1;

/// All lines of one agent in one order.
pub(super) struct VariantResults<'a> {
    pub(super) lines: Vec<&'a ResultLine>,
}

impl<'a> VariantResults<'a> {
    pub(super) fn of(lines: &[&'a ResultLine], variant: AgentVariant, order: Order) -> Self {
        let own = |line: &&&ResultLine| line.key.agent == variant.name() && line.order() == order;
        Self { lines: lines.iter().filter(own).copied().collect() }
    }

    /// Means with intervals resampled by scene; `None` when nothing was played.
    pub(super) fn summary(&self) -> Option<Summary> {
        let score = |line: &&ResultLine| EpisodeScore {
            episode: line.key.episode.clone(),
            scene: line.scene.clone(),
            order: line.order(),
            metrics: line.metrics.clone(),
        };
        summarise(&self.lines.iter().map(score).collect::<Vec<_>>(), SEED)
    }

    /// Share of goals of a modality that were found, and their number.
    pub(super) fn by_modality(&self, modality: Modality) -> (f64, usize) {
        let goals =
            self.lines.iter().flat_map(|line| line.modalities.iter().zip(&line.metrics.steps_to_goal));
        mean(
            goals
                .filter(|(of, _)| **of == modality)
                .map(|(_, found)| if found.is_some() { 1.0 } else { 0.0 }),
        )
    }

    /// Mean share of goals found in missions of so many goals, and their number.
    pub(super) fn by_goals(&self, goals: u32) -> (f64, usize) {
        let lines = self.lines.iter().filter(|line| line.metrics.goals == goals);
        mean(lines.map(|line| line.metrics.isr))
    }

    /// Mean time in which an action is chosen, milliseconds.
    pub(super) fn think_ms(&self) -> f64 {
        mean(self.lines.iter().map(|line| line.think_ms)).0
    }

    /// Time of all episodes together, hours.
    pub(super) fn wall_h(&self) -> f64 {
        self.lines.iter().map(|line| line.wall_s).sum::<f64>() / 3600.0
    }
}

/// A mean and the number of values; 0 without values.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> (f64, usize) {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (if count == 0 { 0.0 } else { sum / count as f64 }, count)
}

/// Differences of one agent to another in a number, over the episodes that both played.
pub(super) fn compare(
    a: &VariantResults<'_>,
    b: &VariantResults<'_>,
    number: impl Fn(&ResultLine) -> f64,
) -> Option<Paired> {
    let others: BTreeMap<&str, &ResultLine> =
        b.lines.iter().map(|line| (line.key.episode.as_str(), *line)).collect();
    let differences: Vec<(&str, f64)> = a
        .lines
        .iter()
        .filter_map(|line| {
            let other = others.get(line.key.episode.as_str())?;
            Some((line.scene.as_str(), number(line) - number(other)))
        })
        .collect();
    sign_flip(&differences, SEED)
}

/// Steps until the first goal was found; all that an episode may take where none was.
pub(super) fn steps_to_first(line: &ResultLine) -> f64 {
    const MAX_STEPS: f64 = 1000.0;
    line.metrics.steps_to_goal.iter().flatten().min().map_or(MAX_STEPS, |&step| f64::from(step))
}

/// The lines of the build, split and seed that most lines are of: only those can be compared with each other.
pub(super) fn comparable<'a>(lines: impl Iterator<Item = &'a ResultLine>) -> Vec<&'a ResultLine> {
    let lines: Vec<&ResultLine> = lines.collect();
    let edition =
        |key: &EpisodeKey| (key.benchmark.clone(), key.program.clone(), key.split.clone(), key.seed);
    let mut counts = BTreeMap::<_, usize>::new();
    lines.iter().for_each(|line| *counts.entry(edition(&line.key)).or_default() += 1);
    let Some((most, _)) = counts.into_iter().max_by_key(|(_, count)| *count) else { return Vec::new() };
    lines.into_iter().filter(|line| edition(&line.key) == most).collect()
}
