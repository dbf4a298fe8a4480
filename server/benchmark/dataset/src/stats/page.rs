//! The statistics of a data set for people: one page without outside parts.

use super::{Spread, Statistics};
use std::{collections::BTreeMap, fmt::Display, fmt::Write};

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}\
table{border-collapse:collapse;margin:.5rem 0 1.5rem}td,th{padding:.15rem .6rem;text-align:left;vertical-align:middle}\
td.n{text-align:right;font-variant-numeric:tabular-nums}.bar{background:#4a7ab5;height:.8rem;display:block}\
h2{margin-top:2.5rem;border-bottom:1px solid #ccc}";
/// Length of the longest bar, em.
const LONGEST_BAR_EM: f64 = 20.0;

/// The statistics page of a data set, HTML; one part for each split.
pub fn page(name: &str, splits: &[(String, Statistics)]) -> String {
    let mut html = format!(
        "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><title>{name}: statistics</title>\
         <style>{STYLE}</style><h1>{name}: statistics</h1>"
    );
    for (split, numbers) in splits {
        let _ = write!(html, "<h2>{split}</h2><table>");
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
        histogram(&mut html, "Reference steps, ordered", &numbers.ordered_steps);
        histogram(&mut html, "Reference steps, unordered", &numbers.unordered_steps);
        histogram(&mut html, "Start to success region, metres", &numbers.start_m);
        histogram(&mut html, "Words of a description", &numbers.words);
        histogram(&mut html, "Rooms of a scene", &numbers.regions);
        counts(&mut html, "Storeys of a scene", &numbers.storeys);
        histogram(&mut html, "Walkable area of a scene, square metres", &numbers.area_m2);
        histogram(&mut html, "Possible targets of a scene", &numbers.instances);
    }
    html
}

/// The main numbers, as label and value.
pub fn summary(numbers: &Statistics) -> Vec<(&'static str, String)> {
    let spread = |spread: &Spread, unit: &str| {
        format!("{:.1}{unit} ({:.1} to {:.1})", spread.mean(), spread.min, spread.max)
    };
    let share = |modality| format!("{:.1} %", 100.0 * numbers.share(modality));
    let targets: u64 = numbers.uses.values().sum();
    let most = numbers.uses.keys().next_back().copied().unwrap_or(0);
    vec![
        ("scenes", numbers.scenes.to_string()),
        ("missions", numbers.missions.to_string()),
        ("goals", numbers.goal_count().to_string()),
        (
            "category, description, image",
            [share("category"), share("description"), share("image")].join(", "),
        ),
        (
            "targets",
            format!(
                "{targets}, each asked for {:.1} times, at most {most}",
                per(numbers.goal_count(), targets)
            ),
        ),
        ("reference length, ordered", spread(&numbers.ordered_m, " m")),
        ("reference length, unordered", spread(&numbers.unordered_m, " m")),
        ("reference steps, ordered", spread(&numbers.ordered_steps, "")),
        ("reference steps, unordered", spread(&numbers.unordered_steps, "")),
        ("start to success region", spread(&numbers.start_m, " m")),
        ("words of a description", spread(&numbers.words, "")),
        ("rooms of a scene", spread(&numbers.regions, "")),
        ("walkable area of a scene", spread(&numbers.area_m2, " m2")),
    ]
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
        let width = LONGEST_BAR_EM * count as f64 / most as f64;
        let share = 100.0 * per(count, total);
        let _ = write!(
            html,
            "<tr><td>{label}<td class=n>{count}<td class=n>{share:.1} %<td><span class=bar style=\"width:{width:.2}em\"></span>"
        );
    }
    html.push_str("</table>");
}
