use crate::{
    Metrics,
    bootstrap::{clusters, intervals},
};
use avln_episode::Order;
use serde::{Deserialize, Serialize};

/// The metrics of one episode, and what they are grouped by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EpisodeScore {
    /// Id of the episode inside its split.
    pub episode: String,
    /// Name of the scene.
    pub scene: String,
    /// Whether goals had to be found in order.
    pub order: Order,
    /// What the episode was worth.
    pub metrics: Metrics,
}

/// A mean over episodes with its 95 % interval, resampled by scene. `low <= value <= high`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The mean.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// What a set of episodes was worth. Plain numbers are means over episodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Episodes counted.
    pub episodes: u32,
    /// Scenes that they took place in.
    pub scenes: u32,
    /// Success rate.
    pub sr: Estimate,
    /// Share of goals found, mean over episodes.
    pub isr: Estimate,
    /// Share of goals found, over all goals of all episodes.
    pub isr_by_goal: f64,
    /// Share of goals whose region was entered, mean over episodes.
    pub osr: Estimate,
    /// Share of episodes in which every region was entered.
    pub osr_all: f64,
    /// Success weighted by path length.
    pub spl: Estimate,
    /// Share of goals found weighted by path length.
    pub soft_spl: Estimate,
    /// Success weighted by number of actions.
    pub sna: Estimate,
    /// Actions.
    pub steps: f64,
    /// Length of the walk, metres.
    pub path_m: f64,
    /// Collisions.
    pub collisions: f64,
    /// Claims that completed nothing.
    pub wrong_submits: f64,
    /// Those of them at an instance of the right category that is not the target.
    #[serde(default)]
    pub wrong_instance_submits: f64,
    /// Steps to a goal, over the goals found; `None` when none was.
    pub steps_to_goal: Option<f64>,
    /// Final distance to a goal, metres, over the goals that can be reached; `None` when none can.
    pub final_distance_m: Option<f64>,
}

/// The means and intervals over `scores`; `None` when there are none.
///
/// The result depends on the scores and the seed, not on the order in which they come.
pub fn summarise(scores: &[EpisodeScore], seed: u64) -> Option<Summary> {
    let scores = sorted(scores);
    if scores.is_empty() {
        return None;
    }
    let [sr, isr, osr, spl, soft_spl, sna] = estimates(&scores, seed);
    let mean = |value: fn(&Metrics) -> f64| average(scores.iter().map(|s| value(&s.metrics))).unwrap_or(0.0);
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
        steps_to_goal: average(
            scores.iter().flat_map(|s| s.metrics.steps_to_goal.iter().flatten()).map(|&step| f64::from(step)),
        ),
        final_distance_m: average(
            scores.iter().flat_map(|s| s.metrics.final_distance_m.iter().flatten()).copied(),
        ),
    })
}

/// By scene, then episode, then order: sums then do not depend on the order of arrival.
pub(crate) fn sorted(scores: &[EpisodeScore]) -> Vec<&EpisodeScore> {
    let mut sorted: Vec<&EpisodeScore> = scores.iter().collect();
    sorted.sort_by_key(|s| (&s.scene, &s.episode, s.order.as_str()));
    sorted
}

fn estimates(scores: &[&EpisodeScore], seed: u64) -> [Estimate; 6] {
    let columns = |m: &Metrics| [m.sr, m.isr, m.osr, m.spl, m.soft_spl, m.sna];
    let rows: Vec<_> = scores.iter().map(|s| (s.scene.as_str(), columns(&s.metrics))).collect();
    let bounds = intervals(&clusters(&rows), seed);
    std::array::from_fn(|column| {
        let value = average(rows.iter().map(|(_, values)| values[column])).unwrap_or(0.0);
        let (low, high) = bounds[column];
        // Rounding may put the mean of equal numbers a last bit outside of its resamples.
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
