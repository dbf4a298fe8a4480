//! Numbers behind the tables: means, paired tests, and the CSV table.

use crate::suite::{AgentVariant, EpisodeKey, ResultLine};
use avln_episode::{Modality, Order};
use avln_geom::Rng;
use avln_scoring::{EpisodeScore, EpisodeValue, METRICS, Metric, Summary, Unit, summarise};
use std::collections::BTreeMap;

const SEED: u64 = 1;
const DRAWS: u32 = 20_000;
/// Metrics without a column: docs/results.csv was published before they existed.
const OMITTED: [&str; 3] = ["osr_all", "sna", "wrong_instance_submits"];

/// An agent's results in one order.
pub(super) struct VariantResults<'a> {
    pub(super) lines: Vec<&'a ResultLine>,
}

impl<'a> VariantResults<'a> {
    pub(super) fn of(lines: &[&'a ResultLine], variant: AgentVariant, order: Order) -> Self {
        let name = variant.name();
        let own = |line: &&&ResultLine| line.key.agent == name && line.order() == order;
        Self { lines: lines.iter().filter(own).copied().collect() }
    }

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

    /// Returns the found share of a modality's goals, and the goal count.
    pub(super) fn by_modality(&self, modality: Modality) -> (f64, usize) {
        let goals =
            self.lines.iter().flat_map(|line| line.modalities.iter().zip(&line.metrics.steps_to_goal));
        let own = goals.filter(|(of, _)| **of == modality);
        mean(own.map(|(_, found)| if found.is_some() { 1.0 } else { 0.0 }))
    }

    /// Returns the mean ISR of missions with `goals` goals, and the mission count.
    pub(super) fn by_goals(&self, goals: u32) -> (f64, usize) {
        let lines = self.lines.iter().filter(|line| line.metrics.goals == goals);
        mean(lines.map(|line| line.metrics.isr))
    }
}

/// Returns mean and count; 0 without values.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> (f64, usize) {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), value| (sum + value, count + 1));
    (if count == 0 { 0.0 } else { sum / count as f64 }, count)
}

/// Compares a number between two agents over their common episodes.
pub(super) fn compare(
    a: &VariantResults<'_>,
    b: &VariantResults<'_>,
    number: impl Fn(&ResultLine) -> f64,
) -> Option<Paired> {
    let others: BTreeMap<&str, &ResultLine> =
        b.lines.iter().map(|line| (line.key.episode.as_str(), *line)).collect();
    let difference = |line: &&'_ ResultLine| {
        let other = others.get(line.key.episode.as_str())?;
        Some((line.scene.clone(), number(line) - number(other)))
    };
    let differences: Vec<(String, f64)> = a.lines.iter().filter_map(difference).collect();
    sign_flip(&differences, SEED)
}

/// Returns the steps to the first found goal, or the step limit.
pub(super) fn steps_to_first(line: &ResultLine) -> f64 {
    const MAX_STEPS: f64 = 1000.0;
    line.metrics.steps_to_goal.iter().flatten().min().map_or(MAX_STEPS, |&step| f64::from(step))
}

/// Returns the largest group of lines with equal build, split and seed.
pub(super) fn comparable<'a>(lines: impl Iterator<Item = &'a ResultLine>) -> Vec<&'a ResultLine> {
    let lines: Vec<&ResultLine> = lines.collect();
    let edition =
        |key: &EpisodeKey| (key.benchmark.clone(), key.program.clone(), key.split.clone(), key.seed);
    let mut counts = BTreeMap::<_, usize>::new();
    lines.iter().for_each(|line| *counts.entry(edition(&line.key)).or_default() += 1);
    let Some((most, _)) = counts.into_iter().max_by_key(|(_, count)| *count) else { return Vec::new() };
    lines.into_iter().filter(|line| edition(&line.key) == most).collect()
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Paired {
    pub(super) pairs: usize,
    pub(super) difference: f64,
    /// Two-sided probability of an equal or greater mean if signs were random.
    pub(super) p: f64,
}

/// Runs the sign-flip permutation test (Fisher 1935) on paired differences by scene; `None` without pairs.
fn sign_flip(differences: &[(String, f64)], seed: u64) -> Option<Paired> {
    if differences.is_empty() {
        return None;
    }
    let mut sorted = differences.to_vec();
    sorted.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    // A scene's episodes are alike: their signs flip together.
    let sums: Vec<f64> =
        sorted.chunk_by(|a, b| a.0 == b.0).map(|scene| scene.iter().map(|(_, value)| value).sum()).collect();
    let total: f64 = sums.iter().sum();
    let mut rng = Rng::new(seed);
    let mut flipped =
        || sums.iter().map(|sum| if rng.next_u64() >> 63 == 0 { *sum } else { -sum }).sum::<f64>();
    let extreme = (0..DRAWS).filter(|_| flipped().abs() >= total.abs() - 1e-9).count();
    let p = (extreme as f64 + 1.0) / (f64::from(DRAWS) + 1.0);
    Some(Paired { pairs: sorted.len(), difference: total / sorted.len() as f64, p })
}

/// Returns the CSV table: a header, and a row per line.
pub(super) fn table(lines: &[&ResultLine]) -> String {
    let ids = METRICS.iter().filter(|metric| is_column(metric)).map(|metric| metric.id);
    let before = ["agent", "order", "episode", "scene"].into_iter();
    let header: Vec<&str> = before.chain(ids).chain(["steps_to_first_goal", "end"]).collect();
    let mut text = header.join(",") + "\n";
    for line in lines {
        // Names are ids: no cell needs quotes.
        text += &(cells(line).join(",") + "\n");
    }
    text
}

fn is_column(metric: &Metric) -> bool {
    matches!(metric.episode, EpisodeValue::Number(_)) && !OMITTED.contains(&metric.id)
}

fn cells(line: &ResultLine) -> Vec<String> {
    let ResultLine { key, scene, metrics, end, .. } = line;
    let mut cells = vec![key.agent.clone(), key.order.clone(), key.episode.clone(), scene.clone()];
    for metric in METRICS.iter().filter(|metric| is_column(metric)) {
        cells.extend(metric.of(metrics).map(|value| number(metric, value)));
    }
    let first = metrics.steps_to_goal.iter().flatten().min();
    cells.push(first.map(u32::to_string).unwrap_or_default());
    cells.push(end.as_str().to_owned());
    cells
}

fn number(metric: &Metric, value: f64) -> String {
    match metric.unit {
        // An episode's SR is 0 or 1.
        Unit::Share if metric.id == "sr" => value.to_string(),
        Unit::Share => format!("{value:.4}"),
        Unit::Metres => format!("{value:.2}"),
        Unit::Count => value.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn test_of(differences: &[(&str, f64)]) -> Option<Paired> {
        let named: Vec<_> = differences.iter().map(|&(scene, value)| (scene.to_owned(), value)).collect();
        sign_flip(&named, 1)
    }

    #[test]
    fn eight_agreeing_scenes_have_probability_1_in_128() {
        let paired = test_of(&["a", "b", "c", "d", "e", "f", "g", "h"].map(|name| (name, 0.5))).unwrap();
        // Both signs count: 2 of 2^8.
        assert!((paired.p - 2.0 / 256.0).abs() < 2e-3 && paired.difference == 0.5, "{paired:?}");
    }

    #[test]
    fn cancelling_differences_are_not_significant() {
        let paired = test_of(&[("a", 1.0), ("b", -1.0)]).unwrap();
        assert_eq!((paired.pairs, paired.p), (2, 1.0));
        assert_eq!(test_of(&[]), None);
    }
}
