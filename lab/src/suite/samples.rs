//! Results for tests.

use super::{EpisodeKey, MissionFacts, ResultLine};
use avln_episode::{EndReason, Modality, Order};
use avln_scoring::Metrics;
use std::collections::BTreeMap;

/// Returns a result on the main track: two goals, of which `found` are found; two episodes per house.
pub(super) fn line(agent: &str, order: Order, episode: u32, found: u32) -> ResultLine {
    let share = f64::from(found) / 2.0;
    let sr = if found == 2 { 1.0 } else { 0.0 };
    let step = |goal: u32| (goal < found).then_some(10 * (goal + 1));
    let house = episode / 2;
    ResultLine {
        key: EpisodeKey {
            agent: agent.to_owned(),
            order: order.as_str().to_owned(),
            episode: format!("paper-val-{house:04}-{episode:04}"),
            seed: 0,
            program: "1".to_owned(),
            benchmark: "2".to_owned(),
            split: "digest".to_owned(),
            track: "main".to_owned(),
            rules: "lh-avln-v1".to_owned(),
            feedback: "none".to_owned(),
            side_px: 128,
        },
        scene: format!("paper-val-{house:04}"),
        mission: MissionFacts { reference_steps: 100 + episode, storeys: 1 + house % 2, area_m2: 120.0 },
        modalities: vec![Modality::Category, Modality::Image],
        end: EndReason::Stopped,
        metrics: Metrics {
            goals: 2,
            found,
            sr,
            isr: share,
            osr: share,
            osr_all: sr,
            spl: sr / 2.0,
            soft_spl: share / 2.0,
            steps: 100,
            path_m: 40.0,
            reference_m: 20.0 + f64::from(episode),
            steps_to_goal: (0..2).map(step).collect(),
            ..Metrics::default()
        },
        wrong: BTreeMap::new(),
        think_ms: 1.0,
        wall_s: 2.0,
    }
}

/// Returns the same result on another track with feedback.
pub(super) fn moved(line: ResultLine, track: &str, feedback: &str) -> ResultLine {
    let (track, feedback) = (track.to_owned(), feedback.to_owned());
    ResultLine { key: EpisodeKey { track, feedback, ..line.key }, ..line }
}
