//! Formulas: episode metrics from facts; run means from episodes, with bootstrap intervals.

use avln_episode::{Order, Point3, Rules};
use avln_geom::SplitMix64;
use avln_truth::{EpisodeTruth, Record};
use serde::{Deserialize, Serialize};

/// Episode metrics, explained by [`METRICS`](crate::METRICS). Shares and rates are in [0, 1]; `osr >= isr` and `spl <= sr` always.
#[expect(missing_docs, reason = "METRICS explains the fields")]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Metrics {
    pub goals: u32,
    pub found: u32,
    pub sr: f64,
    pub isr: f64,
    pub osr: f64,
    pub osr_all: f64,
    /// `sr × reference / max(reference, path)` (Anderson et al. 2018).
    pub spl: f64,
    /// `isr × reference / max(reference, path)`.
    pub soft_spl: f64,
    /// `sr × fewest actions / max(fewest actions, actions)` (Chen et al. 2020).
    pub sna: f64,
    pub steps: u32,
    pub path_m: f64,
    pub reference_m: f64,
    pub collisions: u32,
    pub wrong_submits: u32,
    #[serde(default)]
    pub wrong_instance_submits: u32,
    /// Per goal: step number from 1, if found.
    pub steps_to_goal: Vec<Option<u32>>,
    /// Per goal: walking distance from the last pose to the success region, metres; `None` if unreachable.
    pub final_distance_m: Vec<Option<f64>>,
}

/// Episode metrics with group keys.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeScore {
    /// Episode id inside the split.
    pub episode: String,
    /// Scene name.
    pub scene: String,
    /// Goal order.
    pub order: Order,
    /// Metrics.
    pub metrics: Metrics,
}

/// Mean over episodes with the 95 % interval, resampled by scene. `low <= value <= high`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Estimate {
    /// The mean.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Metrics for a set of episodes, explained by [`METRICS`](crate::METRICS). Plain numbers are means over episodes.
#[expect(missing_docs, reason = "METRICS explains the fields")]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct Summary {
    pub episodes: u32,
    pub scenes: u32,
    pub sr: Estimate,
    pub isr: Estimate,
    /// Goal share found, over all goals in all episodes.
    pub isr_by_goal: f64,
    pub osr: Estimate,
    pub osr_all: f64,
    pub spl: Estimate,
    pub soft_spl: Estimate,
    pub sna: Estimate,
    pub steps: f64,
    pub path_m: f64,
    pub collisions: f64,
    pub wrong_submits: f64,
    #[serde(default)]
    pub wrong_instance_submits: f64,
    /// Steps to a goal, mean over found goals; `None` without any.
    pub steps_to_goal: Option<f64>,
    /// Final distance to a goal, metres, mean over reachable goals; `None` without any.
    pub final_distance_m: Option<f64>,
}

/// Scenes below which a bootstrap by scene gives unreliable intervals.
pub const FEW_SCENES: u32 = 10;

impl Summary {
    /// Returns true if the intervals are unreliable.
    pub fn has_few_scenes(&self) -> bool {
        self.scenes < FEW_SCENES
    }
}

/// Computes episode metrics from facts; 0 without goals. Callers exclude episodes with a server fault from means.
pub fn score(truth: &EpisodeTruth, record: &Record, rules: &Rules) -> Metrics {
    let goals = truth.targets.len();
    let steps_to_goal = record.found_at(goals);
    let found = steps_to_goal.iter().flatten().count();
    // A completed goal counts as visited even without a recorded visit: isr <= osr always.
    let is_visited = |&goal: &usize| steps_to_goal[goal].is_some() || entered_region(record, goal);
    let visited = (0..goals).filter(is_visited).count();
    let wrong_submits = record.submits.iter().filter(|submit| submit.completed.is_none());
    let wrong_instances = record.submits.iter().filter(|submit| submit.wrong_instance.is_some());
    let final_distance_m = |goal: usize| record.final_distance_m.get(goal).copied().flatten();

    let sr = all(found, goals);
    let isr = share(found, goals);
    let path_m = path_length_m(record);
    let path_efficiency = efficiency(truth.reference_m, path_m);
    let fewest = fewest_actions(truth.reference_m, rules.forward_m, goals);
    Metrics {
        goals: goals as u32,
        found: found as u32,
        sr,
        isr,
        osr: share(visited, goals),
        osr_all: all(visited, goals),
        spl: sr * path_efficiency,
        soft_spl: isr * path_efficiency,
        sna: sr * efficiency(fewest, record.steps.len() as f64),
        steps: record.steps.len() as u32,
        path_m,
        reference_m: truth.reference_m,
        collisions: record.steps.iter().filter(|step| step.collided).count() as u32,
        wrong_submits: wrong_submits.count() as u32,
        wrong_instance_submits: wrong_instances.count() as u32,
        final_distance_m: (0..goals).map(final_distance_m).collect(),
        steps_to_goal,
    }
}

fn share(count: usize, goals: usize) -> f64 {
    if goals == 0 { 0.0 } else { count as f64 / goals as f64 }
}

fn all(count: usize, goals: usize) -> f64 {
    if goals > 0 && count == goals { 1.0 } else { 0.0 }
}

fn entered_region(record: &Record, goal: usize) -> bool {
    // Records have 8 region bits; further goals count as not visited instead of overflowing the shift.
    let bit = u8::try_from(1_u64.checked_shl(goal as u32).unwrap_or(0)).unwrap_or(0);
    let at_start = record.in_region_at_start.get(goal).copied().unwrap_or(false);
    at_start || record.steps.iter().any(|step| step.in_region & bit != 0)
}

/// Sums the straight lines between consecutive base positions, metres.
fn path_length_m(record: &Record) -> f64 {
    // Poses are f32. The sum over up to 1,000 steps is f64, so that rounding errors do not add up.
    let mut at = record.start.position;
    let mut length_m = 0.0;
    for step in &record.steps {
        length_m += distance_m(&at, &step.pose.position);
        at = step.pose.position;
    }
    length_m
}

/// Returns the length of the straight line from `a` to `b`, metres.
pub fn distance_m(a: &Point3<f32>, b: &Point3<f32>) -> f64 {
    let squared = |axis: usize| {
        let difference = f64::from(b[axis]) - f64::from(a[axis]);
        difference * difference
    };
    (squared(0) + squared(1) + squared(2)).sqrt()
}

/// Returns `least / max(least, spent)` in [0, 1]: 1 if both are 0, 0 if `least` is not a finite length.
pub fn efficiency(least: f64, spent: f64) -> f64 {
    if !least.is_finite() || least < 0.0 {
        return 0.0;
    }
    let most = least.max(spent);
    if most > 0.0 { least / most } else { 1.0 }
}

/// Returns a lower bound for actions in a success: forward steps on the reference tour, and a claim per goal.
fn fewest_actions(reference_m: f64, forward_m: f32, goals: usize) -> f64 {
    // Turns are excluded, so that no success needs fewer actions. The margin lets a tour with exactly n forward steps count as n,
    // although its length is a rounded sum.
    (reference_m / f64::from(forward_m) - 1e-6).ceil().max(0.0) + goals as f64
}

/// Returns means and intervals over `scores`, in any order; `None` for an empty slice.
pub fn summarise(scores: &[EpisodeScore], seed: u64) -> Option<Summary> {
    let scores = sorted(scores);
    if scores.is_empty() {
        return None;
    }
    // All columns share the bootstrap draws: a new last column leaves the other intervals unchanged.
    let columns: [fn(&Metrics) -> f64; 6] =
        [|m| m.sr, |m| m.isr, |m| m.osr, |m| m.spl, |m| m.soft_spl, |m| m.sna];
    let [sr, isr, osr, spl, soft_spl, sna] = estimates(&scores, columns, seed);
    let mean = |value: fn(&Metrics) -> f64| average(scores.iter().map(|s| value(&s.metrics))).unwrap_or(0.0);
    let found_at = scores.iter().flat_map(|s| s.metrics.steps_to_goal.iter().flatten());
    let distances_m = scores.iter().flat_map(|s| s.metrics.final_distance_m.iter().flatten());
    Some(Summary {
        episodes: scores.len() as u32,
        scenes: scores.chunk_by(|a, b| a.scene == b.scene).count() as u32,
        sr,
        isr,
        isr_by_goal: share_of_all_goals(&scores),
        osr,
        osr_all: mean(|m| m.osr_all),
        spl,
        soft_spl,
        sna,
        steps: mean(|m| f64::from(m.steps)),
        path_m: mean(|m| m.path_m),
        collisions: mean(|m| f64::from(m.collisions)),
        wrong_submits: mean(|m| f64::from(m.wrong_submits)),
        wrong_instance_submits: mean(|m| f64::from(m.wrong_instance_submits)),
        steps_to_goal: average(found_at.map(|&step| f64::from(step))),
        final_distance_m: average(distances_m.copied()),
    })
}

/// Sorts by scene, episode and order.
pub(crate) fn sorted(scores: &[EpisodeScore]) -> Vec<&EpisodeScore> {
    // Floating-point sums depend on term order, and episodes arrive in any order.
    let mut sorted: Vec<&EpisodeScore> = scores.iter().collect();
    sorted.sort_by_key(|s| (&s.scene, &s.episode, s.order.as_str()));
    sorted
}

fn estimates<const K: usize>(
    scores: &[&EpisodeScore],
    columns: [fn(&Metrics) -> f64; K],
    seed: u64,
) -> [Estimate; K] {
    let values = |metrics: &Metrics| columns.map(|column| column(metrics));
    let rows: Vec<_> = scores.iter().map(|s| (s.scene.as_str(), values(&s.metrics))).collect();
    let bounds = intervals(&clusters(&rows), seed);
    std::array::from_fn(|column| {
        let value = average(rows.iter().map(|(_, values)| values[column])).unwrap_or(0.0);
        let (low, high) = bounds[column];
        // Rounding can put the mean of equal numbers a last bit outside its resamples.
        Estimate { value, low: low.min(value), high: high.max(value) }
    })
}

fn share_of_all_goals(scores: &[&EpisodeScore]) -> f64 {
    let total = |count: fn(&Metrics) -> u32| scores.iter().map(|s| u64::from(count(&s.metrics))).sum::<u64>();
    let goals = total(|m| m.goals);
    if goals == 0 { 0.0 } else { total(|m| m.found) as f64 / goals as f64 }
}

fn average(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, count) = values.fold((0.0, 0_u32), |(sum, count), value| (sum + value, count + 1));
    (count > 0).then(|| sum / f64::from(count))
}

/// Resamples per interval of the percentile bootstrap over scenes (Efron 1979).
pub(crate) const RESAMPLES: usize = 1000;

/// A cluster, drawn as a whole: sums per column, and the episode count.
pub(crate) struct Cluster<const K: usize> {
    sums: [f64; K],
    count: usize,
}

/// Groups rows by scene; with a single scene every row is a cluster. Rows with equal scenes must be adjacent.
pub(crate) fn clusters<const K: usize>(rows: &[(&str, [f64; K])]) -> Vec<Cluster<K>> {
    // Episodes in a scene are correlated, so scenes are resampled. A single scene leaves only episodes to resample.
    let one_scene = rows.windows(2).all(|pair| pair[0].0 == pair[1].0);
    let same = |a: &(&str, [f64; K]), b: &(&str, [f64; K])| !one_scene && a.0 == b.0;
    rows.chunk_by(same).map(total).collect()
}

fn total<const K: usize>(rows: &[(&str, [f64; K])]) -> Cluster<K> {
    let mut sums = [0.0; K];
    for (_, values) in rows {
        for (sum, value) in sums.iter_mut().zip(values) {
            *sum += value;
        }
    }
    Cluster { sums, count: rows.len() }
}

/// Returns sorted means per column over clusters drawn with replacement.
fn resampled_means<const K: usize>(clusters: &[Cluster<K>], seed: u64) -> [Vec<f64>; K] {
    let mut draw = SplitMix64::new(seed);
    let mut means: [Vec<f64>; K] = std::array::from_fn(|_| Vec::with_capacity(RESAMPLES));
    for _ in 0..RESAMPLES {
        let mut sums = [0.0; K];
        let mut count = 0;
        for _ in clusters {
            let drawn = &clusters[draw.below(clusters.len())];
            count += drawn.count;
            for (sum, value) in sums.iter_mut().zip(&drawn.sums) {
                *sum += value;
            }
        }
        for (column, sum) in means.iter_mut().zip(sums) {
            column.push(sum / count as f64);
        }
    }
    for column in &mut means {
        column.sort_by(f64::total_cmp);
    }
    means
}

/// Returns the middle 95 % of resampled means per column, as (low, high). `clusters` must not be empty.
pub(crate) fn intervals<const K: usize>(clusters: &[Cluster<K>], seed: u64) -> [(f64, f64); K] {
    let means = resampled_means(clusters, seed);
    std::array::from_fn(|column| {
        (means[column][RESAMPLES / 40 - 1], means[column][RESAMPLES - RESAMPLES / 40 - 1])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opposite_scenes_give_the_full_interval() {
        let rows = [("a", [0.0]), ("a", [0.0]), ("b", [1.0]), ("b", [1.0])];
        let grouped = clusters(&rows);
        assert_eq!(grouped.len(), 2);
        assert_eq!(intervals(&grouped, 1), [(0.0, 1.0)]);
    }

    #[test]
    fn fair_coin_interval_matches_normal_approximation() {
        // 100 episodes in a scene, half with 1: 0.5 ± 1.96 × sqrt(0.25 / 100) = 0.402 to 0.598.
        let rows: Vec<_> = (0..100).map(|i| ("a", [f64::from(i % 2)])).collect();
        let [(low, high)] = intervals(&clusters(&rows), 9);
        assert!((low - 0.402).abs() < 0.02 && (high - 0.598).abs() < 0.02, "{low} to {high}");
    }

    #[test]
    fn intervals_span_25th_to_975th_mean() {
        // Ten episodes with the powers of two from 1 to 512. A second implementation of the draws gives the sorted sums
        // …, 201, 203 (25th), 209, 209, … and …, 2136, 2139 (975th), 2149, 2164, ….
        let rows: Vec<_> = (0..10).map(|power| ("a", [f64::from(1_u32 << power)])).collect();
        assert_eq!(intervals(&clusters(&rows), 1), [(203.0 / 10.0, 2139.0 / 10.0)]);
    }

    #[test]
    fn nine_scenes_are_few_and_ten_suffice() {
        let score = |scene: u32| EpisodeScore {
            episode: format!("e{scene}"),
            scene: format!("s{scene}"),
            order: Order::Ordered,
            metrics: Metrics::default(),
        };
        let of = |scenes: u32| summarise(&(0..scenes).map(score).collect::<Vec<_>>(), 1).expect("scores");
        assert!(of(9).has_few_scenes() && !of(10).has_few_scenes());
    }
}
