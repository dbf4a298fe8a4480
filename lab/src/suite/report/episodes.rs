//! The CSV table of all episodes.

use crate::suite::ResultLine;
use avln_scoring::{EpisodeValue, METRICS, Metric, Unit};

/// Returns the CSV table: a header, and a row per line.
pub(super) fn table(lines: &[&ResultLine]) -> String {
    let ids = METRICS.iter().filter(|metric| is_column(metric)).map(|metric| metric.id);
    let before = ["track", "feedback", "agent", "order", "episode", "scene"].into_iter();
    let after = ["modalities", "steps_to_goals", "reference_steps", "storeys", "area_m2", "end"];
    let header: Vec<&str> = before.chain(ids).chain(after).collect();
    let mut text = header.join(",") + "\n";
    for line in lines {
        // Names are ids: no cell needs quotes.
        text += &(cells(line).join(",") + "\n");
    }
    text
}

fn is_column(metric: &Metric) -> bool {
    matches!(metric.episode, EpisodeValue::Number(_))
}

fn cells(line: &ResultLine) -> Vec<String> {
    let ResultLine { key, scene, metrics, mission, .. } = line;
    let names = [&key.track, &key.feedback, &key.agent, &key.order, &key.episode, scene];
    let mut cells = names.map(String::clone).to_vec();
    for metric in METRICS.iter().filter(|metric| is_column(metric)) {
        cells.extend(metric.of(metrics).map(|value| number(metric, value)));
    }
    let modalities = line.modalities.iter().map(|modality| modality.as_str().to_owned());
    let steps = metrics.steps_to_goal.iter().map(|step| step.map_or("-".to_owned(), |step| step.to_string()));
    cells.extend([joined(modalities), joined(steps)]);
    cells.extend([mission.reference_steps, mission.storeys].map(|count| count.to_string()));
    cells.extend([format!("{:.1}", mission.area_m2), line.end.as_str().to_owned()]);
    cells
}

fn joined(values: impl Iterator<Item = String>) -> String {
    values.collect::<Vec<_>>().join("+")
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
    use crate::suite::samples::line;
    use avln_episode::Order;

    #[test]
    fn rows_have_a_cell_per_column() {
        let line = line("random", Order::Ordered, 3, 1);
        let text = table(&[&line]);
        let rows: Vec<Vec<&str>> = text.lines().map(|row| row.split(',').collect()).collect();
        assert_eq!((rows.len(), rows[0].len()), (2, rows[1].len()));
        let cell = |name: &str| rows[1][rows[0].iter().position(|column| *column == name).expect("a column")];
        assert_eq!((cell("track"), cell("agent"), cell("found")), ("main", "random", "1"));
        assert_eq!((cell("modalities"), cell("steps_to_goals")), ("category+image", "10+-"));
        assert_eq!((cell("reference_steps"), cell("storeys"), cell("end")), ("103", "2", "stopped"));
    }
}
