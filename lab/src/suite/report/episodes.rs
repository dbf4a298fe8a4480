//! The table of all episodes (CSV).

use crate::suite::ResultLine;
use avln_scoring::{EpisodeValue, METRICS, Metric, Unit};

/// Metrics left out, to keep the columns of the published docs/results.csv.
const OMITTED: [&str; 3] = ["osr_all", "sna", "wrong_instance_submits"];

/// Returns a header and a row per episode, in the order of `lines`. No cell needs quotes: names are ids.
pub(super) fn table(lines: &[&ResultLine]) -> String {
    let ids = METRICS.iter().filter(|metric| is_column(metric)).map(|metric| metric.id);
    let header: Vec<&str> = ["agent", "order", "episode", "scene"]
        .into_iter()
        .chain(ids)
        .chain(["steps_to_first_goal", "end"])
        .collect();
    let mut text = header.join(",") + "\n";
    for line in lines {
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
        // SR of an episode is 0 or 1.
        Unit::Share if metric.id == "sr" => value.to_string(),
        Unit::Share => format!("{value:.4}"),
        Unit::Metres => format!("{value:.2}"),
        Unit::Count => value.to_string(),
    }
}
