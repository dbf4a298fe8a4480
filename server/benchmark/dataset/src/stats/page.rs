//! Page and main numbers of statistics.

use crate::stats::{Lengths, Spread, Statistics};
use std::{
    collections::BTreeMap,
    fmt::{Display, Write},
};

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}\
table{border-collapse:collapse;margin:.5rem 0 1.5rem}td,th{padding:.15rem .6rem;text-align:left;vertical-align:middle}\
td.n{text-align:right;font-variant-numeric:tabular-nums}.bar{background:#4a7ab5;height:.8rem;display:block}\
h2{margin-top:2.5rem;border-bottom:1px solid #ccc}";
/// Longest bar, em.
const LONGEST_BAR_EM: f64 = 20.0;

/// Returns the HTML statistics page with a section per split.
pub fn page(name: &str, splits: &[(String, Statistics)]) -> String {
    let name = escaped(name);
    let mut html = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{name}: statistics</title>\
         <style>{STYLE}</style><h1>{name}: statistics</h1>"
    );
    for (split, numbers) in splits {
        let _ = write!(html, "<h2>{}</h2><table>", escaped(split));
        for (label, value) in summary(numbers) {
            let _ = write!(html, "<tr><th>{label}<td>{value}");
        }
        html.push_str("</table>");
        counts(&mut html, "Goals of a mission", &numbers.goals);
        counts(&mut html, "Modalities of goals", &numbers.modalities);
        counts(&mut html, "Modalities of a mission", &numbers.mixes);
        counts(&mut html, "Categories of targets", &numbers.categories);
        counts(&mut html, "Same-category distractors of a target", &numbers.distractors);
        counts(&mut html, "Missions that ask for a target", &numbers.uses);
        histogram(&mut html, "Reference length, ordered, metres", &numbers.ordered_m);
        histogram(&mut html, "Reference length, unordered, metres", &numbers.unordered_m);
        for (goals, lengths) in &numbers.lengths {
            let title = |order: &str| format!("Reference length, {order}, {goals} goals, metres");
            histogram(&mut html, &title("ordered"), &lengths.ordered_m);
            histogram(&mut html, &title("unordered"), &lengths.unordered_m);
        }
        histogram(&mut html, "Reference steps, ordered", &numbers.ordered_steps);
        histogram(&mut html, "Reference steps, unordered", &numbers.unordered_steps);
        histogram(&mut html, "Start to success region, metres", &numbers.start_m);
        histogram(&mut html, "Words of a description", &numbers.words);
        histogram(&mut html, "Rooms of a scene", &numbers.regions);
        counts(&mut html, "Storeys of a scene", &numbers.storeys);
        histogram(&mut html, "Walkable area of a scene, square metres", &numbers.area_m2);
        histogram(&mut html, "Possible targets of a scene", &numbers.instances);
        counts(&mut html, "Instances removed by each test", &numbers.removed);
    }
    html
}

/// Returns the main numbers with labels.
pub fn summary(numbers: &Statistics) -> Vec<(String, String)> {
    let spread = |spread: &Spread, unit: &str| {
        format!("{:.1}{unit} ({:.1} to {:.1})", spread.mean(), spread.min, spread.max)
    };
    let share = |modality| format!("{:.1} %", 100.0 * numbers.share(modality));
    let shares = ["category", "description", "image"].map(share);
    let targets: u64 = numbers.uses.values().sum();
    let per_target = per(numbers.goal_count(), targets);
    let most = numbers.uses.keys().next_back().copied().unwrap_or(0);
    let mut lines = vec![
        ("scenes", numbers.scenes.to_string()),
        ("missions", numbers.missions.to_string()),
        ("goals", numbers.goal_count().to_string()),
        ("category, description, image", shares.join(", ")),
        ("targets", format!("{targets}, each requested {per_target:.1} times, at most {most}")),
        ("reference length, ordered", spread(&numbers.ordered_m, " m")),
        ("reference length, unordered", spread(&numbers.unordered_m, " m")),
        ("reference steps, ordered", spread(&numbers.ordered_steps, "")),
        ("reference steps, unordered", spread(&numbers.unordered_steps, "")),
        ("start to success region", spread(&numbers.start_m, " m")),
        ("words of a description", spread(&numbers.words, "")),
        ("rooms of a scene", spread(&numbers.regions, "")),
        ("walkable area of a scene", spread(&numbers.area_m2, " m2")),
    ]
    .into_iter()
    .map(|(label, value)| (label.to_owned(), value))
    .collect::<Vec<_>>();
    lines.extend(numbers.lengths.iter().map(by_goals));
    lines.extend(removed(numbers));
    lines
}

/// Returns the mean reference lengths for a goal count (figure 2b of the paper).
fn by_goals((goals, lengths): (&usize, &Lengths)) -> (String, String) {
    let Lengths { ordered_m, unordered_m, ordered_steps } = lengths;
    let [ordered_m, unordered_m, steps] = [ordered_m, unordered_m, ordered_steps].map(Spread::mean);
    let value = format!("{ordered_m:.1} m ordered ({steps:.1} steps), {unordered_m:.1} m unordered");
    (format!("reference length, {goals} goals"), value)
}

/// Returns the instances removed by each test; `None` if not recorded.
fn removed(numbers: &Statistics) -> Option<(String, String)> {
    let counts: Vec<_> = numbers.removed.iter().map(|(test, count)| format!("{test} {count}")).collect();
    (!counts.is_empty()).then(|| ("removed instances".to_owned(), counts.join(", ")))
}

/// Escapes text for HTML. Categories of imported data sets are arbitrary text.
fn escaped(text: &str) -> String {
    // The ampersand first: it begins the other replacements.
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn per(count: u64, of: u64) -> f64 {
    count as f64 / of.max(1) as f64
}

fn counts<K: Display>(html: &mut String, title: &str, counts: &BTreeMap<K, u64>) {
    table(html, title, counts.iter().map(|(key, &count)| (key.to_string(), count)));
}

fn histogram(html: &mut String, title: &str, spread: &Spread) {
    let label = |bin: u32| format!("{} to {}", f64::from(bin) * spread.bin, f64::from(bin + 1) * spread.bin);
    table(html, title, spread.bins.iter().map(|(&bin, &count)| (label(bin), count)));
}

fn table(html: &mut String, title: &str, rows: impl Iterator<Item = (String, u64)>) {
    let rows: Vec<_> = rows.collect();
    let most = rows.iter().map(|row| row.1).max().unwrap_or(1).max(1);
    let total: u64 = rows.iter().map(|row| row.1).sum();
    let _ = write!(html, "<h3>{title}</h3><table>");
    for (label, count) in rows {
        let label = escaped(&label);
        let width = LONGEST_BAR_EM * count as f64 / most as f64;
        let share = 100.0 * per(count, total);
        let _ = write!(
            html,
            "<tr><td>{label}<td class=n>{count}<td class=n>{share:.1} %<td><span class=bar style=\"width:{width:.2}em\"></span>"
        );
    }
    html.push_str("</table>");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_escapes_names_and_categories() {
        let mut numbers = Statistics::default();
        numbers.categories.insert("<script>\"&".to_owned(), 1);
        let html = page("<b>", &[("<i>".to_owned(), numbers)]);
        assert!(html.contains("&lt;script&gt;&quot;&amp;") && html.contains("&lt;b&gt;: statistics"));
        assert!(!html.contains("<script") && !html.contains("<b>") && !html.contains("<i>"), "{html}");
    }

    #[test]
    fn summary_has_lengths_and_removals() {
        let mut numbers = Statistics::default();
        assert!(summary(&numbers).iter().all(|(label, _)| label != "removed instances"));
        let lengths = numbers.lengths.entry(2).or_default();
        [(20.0, 10.0, 120.0), (30.0, 20.0, 140.0)].into_iter().for_each(|(ordered_m, unordered_m, steps)| {
            lengths.ordered_m.note(ordered_m);
            lengths.unordered_m.note(unordered_m);
            lengths.ordered_steps.note(steps);
        });
        numbers.removed.insert("verifier".to_owned(), 7);
        let lines = summary(&numbers);
        let value =
            |name: &str| lines.iter().find(|(label, _)| label == name).map(|(_, value)| value.as_str());
        let lengths = value("reference length, 2 goals");
        assert_eq!(lengths, Some("25.0 m ordered (130.0 steps), 15.0 m unordered"));
        assert_eq!(value("removed instances"), Some("verifier 7"));
    }
}
