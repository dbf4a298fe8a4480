use avln_scoring::{EpisodeScore, Metrics};
use serde::Serialize;
use std::collections::BTreeMap;

/// A group of a run's episodes, with means.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
pub struct GroupView {
    /// Common scene or goal count.
    pub name: String,
    /// Episode count.
    pub episodes: u32,
    /// Success rate.
    pub sr: f64,
    /// Found share.
    pub isr: f64,
    /// Found share weighted by path length.
    pub soft_spl: f64,
    /// Action count.
    pub steps: f64,
}

/// Groups episodes by goal count, ascending.
pub(crate) fn by_goals(scores: &[EpisodeScore]) -> Vec<GroupView> {
    grouped(scores, |score| score.metrics.goals, u32::to_string)
}

/// Groups episodes by scene name.
pub(crate) fn by_scene(scores: &[EpisodeScore]) -> Vec<GroupView> {
    grouped(scores, |score| score.scene.as_str(), |scene| (*scene).to_owned())
}

fn grouped<'a, K: Ord>(
    scores: &'a [EpisodeScore],
    key: impl Fn(&'a EpisodeScore) -> K,
    name: impl Fn(&K) -> String,
) -> Vec<GroupView> {
    let mut groups = BTreeMap::<K, Vec<&EpisodeScore>>::new();
    scores.iter().for_each(|score| groups.entry(key(score)).or_default().push(score));
    groups.into_iter().map(|(key, scores)| GroupView::new(name(&key), scores)).collect()
}

impl GroupView {
    fn new(name: String, mut scores: Vec<&EpisodeScore>) -> Self {
        // Float addition is not associative: sorted sums are equal for every playing order.
        scores.sort_by(|a, b| a.episode.cmp(&b.episode));
        let mean = |value: fn(&Metrics) -> f64| {
            scores.iter().map(|score| value(&score.metrics)).sum::<f64>() / scores.len() as f64
        };
        Self {
            episodes: scores.len() as u32,
            sr: mean(|m| m.sr),
            isr: mean(|m| m.isr),
            soft_spl: mean(|m| m.soft_spl),
            steps: mean(|m| f64::from(m.steps)),
            name,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_episode::Order;

    #[test]
    fn episodes_are_grouped_by_goals_and_scene() {
        let score = |episode: &str, scene: &str, goals, isr| EpisodeScore {
            episode: episode.to_owned(),
            scene: scene.to_owned(),
            order: Order::Ordered,
            metrics: Metrics { goals, isr, steps: 10, ..Metrics::default() },
        };
        let scores = [score("c", "x", 4, 0.5), score("a", "y", 2, 1.0), score("b", "x", 2, 0.0)];
        let values = |groups: Vec<GroupView>| {
            groups.into_iter().map(|group| (group.name, group.episodes, group.isr)).collect::<Vec<_>>()
        };
        assert_eq!(values(by_goals(&scores)), [("2".to_owned(), 2, 0.5), ("4".to_owned(), 1, 0.5)]);
        assert_eq!(values(by_scene(&scores)), [("x".to_owned(), 2, 0.25), ("y".to_owned(), 1, 1.0)]);
    }
}
