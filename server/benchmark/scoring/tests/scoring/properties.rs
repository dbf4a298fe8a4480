//! Properties of every score, on random records; completeness of the metric table: every JSON field has a row, and every row
//! reaches JSON, summary and columns.

use crate::{Did, record, truth};
use avln_episode::{Action, EndReason, Order, Rules};
use avln_scoring::{
    Direction, Entry, EpisodeScore, EpisodeValue, Estimate, Key, METRICS, Metric, Metrics, Prominence,
    RankedEntry, Summary, SummaryValue, Unit, rank, score, summarise,
};
use serde_json::{Value, json};

/// A small generator for test data (Knuth's MMIX constants).
struct Draw(u64);

impl Draw {
    fn below(&mut self, count: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % count
    }
    fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }
}

fn random_did(draw: &mut Draw, goals: u64) -> Did {
    let action = Action::ALL[draw.below(5) as usize];
    let completed = draw.chance(40).then(|| draw.below(goals) as u8);
    let moved_m = if action == Action::MoveForward { draw.below(100) as f32 / 400.0 } else { 0.0 };
    let in_region = if draw.chance(5) { draw.below(16) as u8 } else { 0 };
    Did { action, moved_m, collided: draw.chance(10), in_region, completed, wrong_instance: None }
}

fn random_score(draw: &mut Draw, index: u64) -> EpisodeScore {
    let goals = 2 + draw.below(3);
    let script: Vec<Did> = (0..draw.below(60)).map(|_| random_did(draw, goals)).collect();
    let start = (0..goals).map(|_| draw.chance(5)).collect();
    let (episode, scene) = (format!("e{index}"), format!("s{}", index % 7));
    let reference_m = draw.below(40) as f64 * 0.1;
    let truth = truth(&episode, &scene, Order::Unordered, goals as usize, reference_m);
    let metrics = score(&truth, &record(&script, start, EndReason::StepLimit), &Rules::paper());
    EpisodeScore { episode, scene, order: Order::Unordered, metrics }
}

fn random_scores(seed: u64, count: u64) -> Vec<EpisodeScore> {
    let mut draw = Draw(seed);
    (0..count).map(|index| random_score(&mut draw, index)).collect()
}

#[test]
fn metrics_satisfy_their_inequalities() {
    let mut successes = 0;
    for s in random_scores(3, 2000) {
        let m = &s.metrics;
        assert!(m.isr <= m.osr && m.osr_all <= m.osr, "{m:?}");
        assert!(m.spl <= m.sr && m.sr <= m.isr && m.sna <= m.sr, "{m:?}");
        assert!(m.spl <= m.soft_spl && m.soft_spl <= m.isr, "{m:?}");
        assert!(
            [m.sr, m.isr, m.osr, m.spl, m.soft_spl, m.sna].iter().all(|v| (0.0..=1.0).contains(v)),
            "{m:?}"
        );
        successes += m.sr as u32;
    }
    assert!(successes > 100, "only {successes} successes");
}

#[test]
fn summary_is_independent_of_episode_order() {
    let scores = random_scores(5, 200);
    let mut permuted = scores.clone();
    permuted.reverse();
    permuted.rotate_left(77);
    assert_eq!(summarise(&scores, 4), summarise(&permuted, 4));
    assert_eq!(summarise(&[], 4), None);
}

#[test]
fn means_lie_in_their_intervals() {
    for seed in 0..20 {
        let summary = summarise(&random_scores(seed, 1 + seed * 3), seed).expect("some episodes");
        for estimate in [summary.sr, summary.isr, summary.osr, summary.spl, summary.soft_spl, summary.sna] {
            assert!(estimate.low <= estimate.value && estimate.value <= estimate.high, "{estimate:?}");
        }
        assert!(summary.spl.value <= summary.sr.value && summary.isr.value <= summary.osr.value);
    }
}

fn with_isr(scores: &[EpisodeScore], change: impl Fn(usize, f64) -> f64) -> Vec<EpisodeScore> {
    let mut scores = scores.to_vec();
    for (index, s) in scores.iter_mut().enumerate() {
        s.metrics.isr = change(index, s.metrics.isr);
    }
    scores
}

fn competing<'a>(summary: &'a Summary, scores: &'a [EpisodeScore]) -> Entry<'a> {
    Entry { summary, scores, is_ranked: true }
}

/// Rank and tie group of a competing entry.
fn rank_and_group(place: &RankedEntry) -> (u32, u32) {
    place.standing.map(|standing| (standing.rank, standing.tie_group)).expect("a rank")
}

#[test]
fn references_are_sorted_without_a_rank() {
    let base = random_scores(8, 140);
    let runs = [0.0, 0.5, 0.25].map(|more| with_isr(&base, |_, isr| isr + more));
    let summaries = runs.each_ref().map(|run| summarise(run, 1).expect("episodes"));
    let mut entries = [0, 1, 2].map(|index| competing(&summaries[index], &runs[index]));
    entries[1].is_ranked = false;
    let places = rank(&entries, Key::Isr, 1);
    assert_eq!(places.iter().map(|place| place.entry).collect::<Vec<_>>(), [1, 2, 0]);
    assert_eq!(
        (places[0].standing, rank_and_group(&places[1]), rank_and_group(&places[2])),
        (None, (1, 1), (2, 2))
    );
}

#[test]
fn equal_entries_share_a_rank() {
    let base = random_scores(8, 140);
    let runs =
        [with_isr(&base, |_, isr| isr), with_isr(&base, |_, isr| isr + 0.5), with_isr(&base, |_, isr| isr)];
    let summaries: Vec<Summary> = runs.iter().map(|run| summarise(run, 1).expect("episodes")).collect();
    let entries: Vec<Entry<'_>> =
        summaries.iter().zip(&runs).map(|(summary, scores)| competing(summary, scores)).collect();
    let places = rank(&entries, Key::Isr, 1);
    let standings: Vec<_> = places.iter().map(|place| (place.entry, rank_and_group(place))).collect();
    assert_eq!(standings, [(1, (1, 1)), (0, (2, 2)), (2, (2, 2))]);
}

#[test]
fn insignificant_difference_keeps_one_tie_group() {
    let base = random_scores(8, 140);
    // Up in one half of the scenes, a little less down in the other.
    let noisy = with_isr(&base, |index, isr| isr + if (index % 7) < 4 { 0.2 } else { -0.25 });
    let summaries = [summarise(&base, 1).expect("episodes"), summarise(&noisy, 1).expect("episodes")];
    let entries = [competing(&summaries[0], &base), competing(&summaries[1], &noisy)];
    let places = rank(&entries, Key::Isr, 1);
    assert_eq!((places[0].entry, places[1].entry), (1, 0));
    assert_eq!(rank_and_group(&places[1]), (2, 1));
}

/// Returns episodes in one scene with these values of ISR.
fn episodes_with(values: &[f64]) -> Vec<EpisodeScore> {
    let episode = |(index, &isr): (usize, &f64)| EpisodeScore {
        episode: format!("e{index}"),
        scene: "s".to_owned(),
        order: Order::Ordered,
        metrics: Metrics { isr, ..Metrics::default() },
    };
    values.iter().enumerate().map(episode).collect()
}

#[test]
fn clear_difference_in_two_episodes_separates_entries() {
    // The first entry leads. Resamples of two episodes have both differences as ends of the interval.
    let cases: [(&str, &[f64], &[f64], u32); 4] = [
        ("differences 1 and 1", &[1.0, 1.0], &[0.0, 0.0], 2),
        ("one difference", &[1.0], &[0.0], 1),
        ("differences 0.25 and -0.125", &[0.75, 0.5], &[0.5, 0.625], 1),
        ("differences 0.5 and 0", &[1.0, 0.5], &[0.5, 0.5], 1),
    ];
    for (case, first, second, group) in cases {
        let runs = [episodes_with(first), episodes_with(second)];
        let summaries = runs.each_ref().map(|run| summarise(run, 1).expect("episodes"));
        let entries = [competing(&summaries[0], &runs[0]), competing(&summaries[1], &runs[1])];
        let places = rank(&entries, Key::Isr, 1);
        assert_eq!((rank_and_group(&places[0]), rank_and_group(&places[1])), ((1, 1), (2, group)), "{case}");
    }
}

#[test]
fn tie_break_orders_entries_without_separating_them() {
    let plain = episodes_with(&[0.5, 0.5]);
    let mut successful = plain.clone();
    successful[0].metrics.sr = 1.0;
    let summaries = [summarise(&plain, 1).expect("episodes"), summarise(&successful, 1).expect("episodes")];
    let entries = [competing(&summaries[0], &plain), competing(&summaries[1], &successful)];
    let places = rank(&entries, Key::Isr, 1);
    assert_eq!((places[0].entry, rank_and_group(&places[0])), (1, (1, 1)));
    assert_eq!((places[1].entry, rank_and_group(&places[1])), (0, (2, 1)));
}

#[test]
fn fewer_steps_rank_higher() {
    let quick = random_scores(1, 20);
    let mut slow = quick.clone();
    slow.iter_mut().for_each(|s| s.metrics.steps += 50);
    let summaries = [summarise(&slow, 1).expect("episodes"), summarise(&quick, 1).expect("episodes")];
    let entries = [competing(&summaries[0], &slow), competing(&summaries[1], &quick)];
    let places = rank(&entries, Key::Steps, 1);
    assert_eq!(
        (places[0].entry, rank_and_group(&places[0]), rank_and_group(&places[1])),
        (1, (1, 1), (2, 2))
    );
}

/// Metrics with a different value in every field.
fn distinct_metrics() -> Metrics {
    let mut object = serde_json::to_value(Metrics::default()).expect("JSON");
    for (index, value) in object.as_object_mut().expect("an object").values_mut().enumerate() {
        *value = match value {
            Value::Array(_) => json!([index + 1, null]),
            Value::Number(number) if number.is_f64() => json!(0.5 + index as f64),
            _ => json!(index + 1),
        };
    }
    serde_json::from_value(object).expect("the same fields")
}

fn distinct_summary() -> Summary {
    let score = EpisodeScore {
        episode: "e".to_owned(),
        scene: "s".to_owned(),
        order: Order::Ordered,
        metrics: distinct_metrics(),
    };
    summarise(&[score], 1).expect("one episode")
}

/// The keys of `text`, a JSON object, in the order of the text.
fn keys(text: &str) -> Vec<String> {
    let object: serde_json::Map<String, Value> = serde_json::from_str(text).expect("an object");
    let mut keys: Vec<String> = object.into_iter().map(|(key, _)| key).collect();
    keys.sort_by_key(|key| text.find(&format!("\"{key}\":")).expect("the key"));
    keys
}

fn estimate(value: &Value) -> Estimate {
    serde_json::from_value(value.clone()).expect("an estimate")
}

#[test]
fn every_episode_field_has_a_row() {
    let metrics = distinct_metrics();
    let rows: Vec<&Metric> =
        METRICS.iter().filter(|metric| !matches!(metric.episode, EpisodeValue::None)).collect();
    let text = serde_json::to_string(&metrics).expect("JSON");
    assert_eq!(keys(&text), rows.iter().map(|metric| metric.id).collect::<Vec<_>>());
    let fields: Value = serde_json::from_str(&text).expect("JSON");
    for metric in rows {
        match metric.episode {
            EpisodeValue::Number(_) => {
                assert_eq!(metric.of(&metrics), fields[metric.id].as_f64(), "{}", metric.id)
            }
            EpisodeValue::PerGoal(list) => {
                let numbers = fields[metric.id].as_array().expect("a list").iter();
                assert_eq!(list(&metrics), numbers.map(Value::as_f64).collect::<Vec<_>>(), "{}", metric.id);
            }
            EpisodeValue::None => {}
        }
    }
}

#[test]
fn every_summary_field_has_a_row() {
    let summary = distinct_summary();
    let rows: Vec<&Metric> =
        METRICS.iter().filter(|metric| !matches!(metric.summary, SummaryValue::None)).collect();
    let text = serde_json::to_string(&summary).expect("JSON");
    let ids: Vec<&str> =
        ["episodes", "scenes"].into_iter().chain(rows.iter().map(|metric| metric.id)).collect();
    assert_eq!(keys(&text), ids);
    let fields: Value = serde_json::from_str(&text).expect("JSON");
    for metric in rows {
        let field = &fields[metric.id];
        match metric.summary {
            SummaryValue::Estimate(of) => {
                assert_eq!(of(&summary), estimate(field), "{}", metric.id);
                assert_eq!(metric.estimate_of(&summary), Some(estimate(field)));
                assert_eq!(metric.mean_of(&summary), field["value"].as_f64());
            }
            _ => assert_eq!(metric.mean_of(&summary), field.as_f64(), "{}", metric.id),
        }
    }
}

#[test]
fn summaries_average_the_episode_values() {
    let (metrics, summary) = (distinct_metrics(), distinct_summary());
    for metric in &METRICS {
        let (Some(of_one), Some(mean)) = (metric.of(&metrics), metric.mean_of(&summary)) else { continue };
        assert_eq!(of_one, mean, "{}: the mean over one episode", metric.id);
    }
}

#[test]
fn rows_are_complete_and_unique() {
    for (index, metric) in METRICS.iter().enumerate() {
        assert!(!metric.label.is_empty() && metric.meaning.len() > 9, "{}", metric.id);
        assert!(metric.id.chars().all(|c| c.is_ascii_lowercase() || c == '_'), "{}", metric.id);
        assert!(METRICS[..index].iter().all(|other| other.id != metric.id && other.label != metric.label));
        let is_shown = metric.prominence != Prominence::Optional;
        assert!(!is_shown || metric.key.is_some(), "{}: a column of tables is a ranking key", metric.id);
    }
    let headlines: Vec<&str> = Metric::headlines().map(|metric| metric.id).collect();
    assert_eq!(headlines, ["sr", "isr", "osr", "spl", "soft_spl"]);
}

#[test]
fn units_directions_and_secrets_are_as_listed() {
    let ids = |is: fn(&Metric) -> bool| -> Vec<&str> {
        METRICS.iter().filter(|metric| is(metric)).map(|metric| metric.id).collect()
    };
    let shares = ["sr", "isr", "isr_by_goal", "osr", "osr_all", "spl", "soft_spl", "sna"];
    assert_eq!(ids(|m| m.unit == Unit::Share), shares);
    assert_eq!(ids(|m| m.unit == Unit::Metres), ["path_m", "reference_m", "final_distance_m"]);
    let higher: Vec<&str> = ["found"].into_iter().chain(shares).collect();
    assert_eq!(ids(|m| m.direction == Some(Direction::Higher)), higher);
    assert_eq!(ids(|m| m.direction.is_none()), ["goals", "reference_m"]);
    assert_eq!(ids(|m| !m.hidden_until_reveal), ["goals", "steps", "path_m", "collisions"]);
    let default = ["steps", "path_m", "collisions", "wrong_submits"];
    assert_eq!(ids(|m| m.prominence == Prominence::Default), default);
}

#[test]
fn every_key_has_one_row_with_both_values() {
    let in_table: Vec<Key> = METRICS.iter().filter_map(|metric| metric.key).collect();
    assert_eq!(in_table, Key::ALL);
    for key in Key::ALL {
        let word = serde_json::to_value(key).expect("JSON");
        assert_eq!(word, json!(key.as_str()));
        assert_eq!(word, json!(key.to_string()));
        assert_eq!(key.as_str().parse(), Ok(key));
        assert!(key.metric().of(&distinct_metrics()).is_some() && key.metric().direction.is_some());
        assert!(key.metric().mean_of(&distinct_summary()).is_some());
    }
    let error = "goals".parse::<Key>().expect_err("not a key").to_string();
    assert_eq!(
        error,
        "cannot rank by the metric 'goals'; \
         use sr, isr, osr, spl, soft_spl, sna, steps, path_m, collisions or wrong_submits"
    );
}

#[test]
fn the_page_lists_the_same_directions() {
    const PAGE: &str = include_str!("../../../../../docs/scoring.md");
    let word = |metric: &Metric| match metric.direction? {
        Direction::Higher => Some("higher"),
        Direction::Lower => Some("lower"),
    };
    let mut listed = 0;
    for line in PAGE.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
        let id = cells[0].trim_matches('`');
        let metric =
            METRICS.iter().find(|metric| metric.id == id).unwrap_or_else(|| panic!("no metric {id}"));
        assert_eq!(cells.last().copied(), word(metric), "{id}");
        listed += 1;
    }
    assert!(listed >= Key::ALL.len(), "{listed} rows");
}
