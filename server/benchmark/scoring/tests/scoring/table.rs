//! Completeness of the metric table: every field of the JSON has a row, and every row reaches JSON, summary and columns.

use avln_episode::Order;
use avln_scoring::{
    Direction, EpisodeScore, EpisodeValue, Estimate, Key, METRICS, Metric, Metrics, Prominence, Summary,
    SummaryValue, summarise,
};
use serde_json::{Value, json};

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
fn every_key_has_one_row_with_both_values() {
    let in_table: Vec<Key> = METRICS.iter().filter_map(|metric| metric.key).collect();
    assert_eq!(in_table, Key::ALL);
    for key in Key::ALL {
        let word = serde_json::to_value(key).expect("JSON");
        assert_eq!(word, json!(key.as_str()));
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
