//! The worked examples of docs/scoring.md; `properties` has the metric table and the properties of every score.

mod properties;

use avln_episode::{Action, EndReason, Order, Point3, Pose, Rules};
use avln_scoring::{EpisodeScore, Key, Metrics, score, summarise};
use avln_truth::{EpisodeTruth, Record, StepFacts, SubmitFacts};
use serde_json::json;

const PAGE: &str = include_str!("../../../../../docs/scoring.md");

fn scored(
    episode: &str,
    scene: &str,
    order: Order,
    reference_m: f64,
    start: &[bool],
    script: &[Did],
) -> EpisodeScore {
    let truth = truth(episode, scene, order, start.len(), reference_m);
    let record = record(script, start.to_vec(), EndReason::TimeBudget);
    let metrics = score(&truth, &record, &Rules::paper());
    EpisodeScore { episode: episode.to_owned(), scene: scene.to_owned(), order, metrics }
}

fn forward(count: usize) -> Vec<Did> {
    vec![Did::plain(Action::MoveForward); count]
}

fn episode_a() -> EpisodeScore {
    let mut script = forward(8);
    script.push(Did::claim(Action::Submit, Some(0)));
    script.extend([Did::plain(Action::TurnLeft); 2]);
    script.extend(forward(8));
    script.extend([Did::plain(Action::TurnRight), Did::claim(Action::Stop, Some(1))]);
    scored("A", "first", Order::Unordered, 3.0, &[false, false], &script)
}

fn episode_b() -> EpisodeScore {
    let mut script = forward(12);
    script.push(Did::claim(Action::Submit, Some(0)));
    script.extend(forward(12));
    script[20].in_region = 0b100;
    script.push(Did::claim(Action::Submit, None));
    script.extend(forward(7));
    script.extend([Did { moved_m: 0.125, collided: true, ..Did::plain(Action::MoveForward) }; 2]);
    scored("B", "second", Order::Ordered, 6.0, &[false; 3], &script)
}

fn episode_c() -> EpisodeScore {
    let script = [Did::claim(Action::Submit, Some(1)), Did::claim(Action::Stop, Some(0))];
    scored("C", "first", Order::Unordered, 0.0, &[true, true], &script)
}

/// The numbers of the table row that begins with `name`.
fn row(name: &str) -> Vec<f64> {
    let start = format!("| {name} |");
    let line = PAGE.lines().find(|line| line.starts_with(&start)).unwrap_or_else(|| panic!("no row {name}"));
    line[start.len()..].split('|').filter_map(|cell| cell.trim().parse().ok()).collect()
}

fn assert_cell(name: &str, page: f64, computed: f64) {
    assert!((page - computed).abs() < 5e-4, "{name}: {page} on the page, {computed} computed");
}

#[test]
fn page_tables_match_computed_metrics() {
    let episodes = [episode_a(), episode_b(), episode_c()];
    let summary = summarise(&episodes, 1).expect("three episodes");
    for key in Key::ALL {
        let page = row(key.as_str());
        assert_eq!(page.len(), 4, "{key}");
        for (cell, episode) in page.iter().zip(&episodes) {
            assert_cell(key.as_str(), *cell, key.of(&episode.metrics));
        }
        assert_cell(key.as_str(), page[3], key.mean_of(&summary));
    }
    let strict: Vec<f64> = episodes.iter().map(|episode| episode.metrics.osr_all).collect();
    assert_eq!(row("osr_all")[..3], strict);
    assert_cell("isr_by_goal", row("isr_by_goal")[0], summary.isr_by_goal);
    assert_eq!((summary.sr.low, summary.sr.high), (0.0, 1.0));
}

#[test]
fn wrong_instance_submits_are_wrong_submits() {
    let claim = |wrong_instance| Did { wrong_instance, ..Did::claim(Action::Submit, None) };
    let script = [claim(Some(1)), claim(None), Did::claim(Action::Submit, Some(0)), claim(Some(1))];
    let episode = scored("A", "first", Order::Unordered, 3.0, &[false, false], &script);
    assert_eq!((episode.metrics.wrong_submits, episode.metrics.wrong_instance_submits), (3, 2));
    let summary = summarise(&[episode, episode_a()], 1).expect("two episodes");
    assert_eq!((summary.wrong_submits, summary.wrong_instance_submits), (1.5, 1.0));
}

#[test]
fn goals_are_found_at_the_documented_steps() {
    let found = |episode: EpisodeScore| episode.metrics.steps_to_goal;
    assert_eq!(found(episode_a()), [Some(9), Some(21)]);
    assert_eq!(found(episode_b()), [Some(13), None, None]);
    assert_eq!(found(episode_c()), [Some(2), Some(1)]);
}

#[test]
fn needless_walk_costs_all_and_short_walk_nothing() {
    let script = [Did::plain(Action::MoveForward), Did::claim(Action::Stop, Some(0))];
    let idle = scored("a", "s", Order::Ordered, 0.0, &[true], &script).metrics;
    assert_eq!((idle.sr, idle.spl, idle.soft_spl), (1.0, 0.0, 0.0));
    let short = scored("b", "s", Order::Ordered, 5.0, &[false, false], &script).metrics;
    assert_eq!((short.isr, short.soft_spl, short.spl), (0.5, 0.5, 0.0));
    let endless = scored("c", "s", Order::Ordered, f64::INFINITY, &[false], &script).metrics;
    assert_eq!((endless.sr, endless.spl, endless.sna), (1.0, 0.0, 0.0));
}

#[test]
fn path_adds_up_distances_in_all_directions() {
    let script = [Did::plain(Action::MoveForward), Did::claim(Action::Stop, Some(0))];
    let mut walk = record(&script, vec![false], EndReason::Stopped);
    // (2, 3, 6) is 7 m long, and the way on by (-1, 2, -2) 3 m.
    walk.steps[0].pose.position = Point3::new(2.0, 3.0, 6.0);
    walk.steps[1].pose.position = Point3::new(1.0, 5.0, 4.0);
    let truth = truth("a", "s", Order::Ordered, 1, 5.0);
    let metrics = score(&truth, &walk, &Rules::paper());
    assert_eq!((metrics.path_m, metrics.reference_m, metrics.spl), (10.0, 5.0, 0.5));
}

#[test]
fn summary_counts_scenes_and_averages_found_goals() {
    let episode = |episode: &str, scene: &str| {
        scored(episode, scene, Order::Ordered, 1.0, &[false, false], &forward(1))
    };
    let mut episodes = [("a", "x"), ("b", "x"), ("c", "y"), ("d", "z")].map(|(id, scene)| episode(id, scene));
    let summary = summarise(&episodes, 1).expect("four episodes");
    assert_eq!((summary.episodes, summary.scenes), (4, 3));
    assert_eq!((summary.steps_to_goal, summary.final_distance_m), (None, Some(1.0)));
    episodes[0].metrics.steps_to_goal = vec![Some(4), None];
    episodes[3].metrics.steps_to_goal = vec![Some(2), Some(9)];
    episodes[3].metrics.final_distance_m = vec![None, Some(8.0)];
    let summary = summarise(&episodes, 1).expect("four episodes");
    assert_eq!((summary.steps_to_goal, summary.final_distance_m), (Some(5.0), Some(2.0)));
}

#[test]
fn episode_without_goals_scores_zero() {
    let nothing: Metrics = scored("a", "s", Order::Ordered, 1.0, &[], &forward(3)).metrics;
    assert_eq!((nothing.sr, nothing.isr, nothing.osr, nothing.spl), (0.0, 0.0, 0.0, 0.0));
}

/// A truth with `goals` identical targets and a reference tour of `reference_m`.
fn truth(episode: &str, scene: &str, order: Order, goals: usize, reference_m: f64) -> EpisodeTruth {
    let target = json!({
        "instance": 1, "category": "chair", "modality": "category",
        "bounds": { "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 1.0] },
        "source": [0.0, 0.0, 0.0], "floor_y_m": 0.0, "region": [], "viewpoints": [], "start_distance_m": 1.0,
    });
    let mut truth: EpisodeTruth = serde_json::from_value(json!({
        "episode": episode, "scene": scene, "seed": 1, "order": order,
        "start": { "position": [0.0, 0.0, 0.0], "heading_rad": 0.0 },
        "targets": vec![target; goals], "reference_m": 0.0, "reference_path": [],
    }))
    .expect("a truth in JSON");
    truth.reference_m = reference_m;
    truth
}

/// Facts of one scripted action.
#[derive(Clone, Copy)]
struct Did {
    action: Action,
    moved_m: f32,
    collided: bool,
    in_region: u8,
    completed: Option<u8>,
    wrong_instance: Option<u8>,
}

impl Did {
    fn plain(action: Action) -> Self {
        let moved_m = if action == Action::MoveForward { 0.25 } else { 0.0 };
        Self { action, moved_m, collided: false, in_region: 0, completed: None, wrong_instance: None }
    }
    fn claim(action: Action, completed: Option<u8>) -> Self {
        Self { completed, ..Self::plain(action) }
    }
}

/// The record of a script: a walk along -Z.
fn record(script: &[Did], in_region_at_start: Vec<bool>, end: EndReason) -> Record {
    let start = Pose::new(Point3::origin(), 0.0);
    let (mut steps, mut submits, mut at) = (Vec::new(), Vec::new(), start);
    for (index, did) in script.iter().enumerate() {
        at.position.z -= did.moved_m;
        if matches!(did.action, Action::Submit | Action::Stop) {
            submits.push(SubmitFacts {
                step: index as u32 + 1,
                completed: did.completed,
                skipped: None,
                wrong_instance: did.wrong_instance,
            });
        }
        let Did { action, collided, in_region, .. } = *did;
        steps.push(StepFacts { action, pose: at, collided, in_region, sounding: None, state_hash: 0 });
    }
    let final_distance_m = vec![Some(1.0); in_region_at_start.len()];
    Record {
        rules: "lh-avln-v1".to_owned(),
        start,
        steps,
        submits,
        in_region_at_start,
        final_distance_m,
        end,
    }
}
