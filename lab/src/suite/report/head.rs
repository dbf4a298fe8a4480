//! The head of the page: missions, houses, sensors and versions.

use super::contrast::{ORDERS, list};
use super::{selection::TrackResults, statistics::average, wall_h};
use crate::suite::ResultLine;
use avln_episode::Order;
use std::collections::BTreeMap;

/// Returns the head; `None` without results.
pub(super) fn head(track: &TrackResults<'_>) -> Option<String> {
    let key = &track.lines.first()?.key;
    let houses: BTreeMap<&str, &ResultLine> =
        track.lines.iter().map(|line| (line.scene.as_str(), *line)).collect();
    let orders = ORDERS.map(|order| missions(track, order));
    let most = orders.iter().map(BTreeMap::len).max().unwrap_or(0);
    let mut rows = vec![("missions", format!("{most} in {} houses: {}", houses.len(), split(&key.track)))];
    let names = ["reference, ordered", "reference, unordered"];
    rows.extend(names.into_iter().zip(orders.iter().map(reference)));
    rows.extend([
        ("storeys", storeys(&houses)),
        ("walkable area", area(&houses)),
        ("images", format!("{0} × {0} pixels, colour and depth", key.side_px)),
        ("clips", clips(&key.track).to_owned()),
        ("rules", format!("`{}`, feedback: {}", key.rules, key.feedback)),
        ("versions", format!("program {}, benchmark {}", key.program, key.benchmark)),
        ("split digest", format!("`{}`", &key.split[..key.split.len().min(16)])),
        ("agent seed", key.seed.to_string()),
        (
            "play",
            format!("{} episodes in {:.1} hours of episode time", track.lines.len(), wall_h(&track.lines)),
        ),
    ]);
    let rows: Vec<_> = rows.iter().map(|(label, value)| format!("| {label} | {value} |\n")).collect();
    Some(format!(
        "# Results\n\nWritten by `avln lab baselines report`; do not edit. Numbers are percentages with 95 % intervals, resampled by \
         house. Rows with fewer missions have equal numbers from all houses. Agents marked † are privileged: they receive ground \
         truth and show the value of perfect perception. [results.csv](results.csv) lists all episodes.\n\n\
         | | |\n|---|---|\n{}",
        rows.concat()
    ))
}

/// Returns a result per mission of an order.
fn missions<'a>(track: &TrackResults<'a>, order: Order) -> BTreeMap<&'a str, &'a ResultLine> {
    let own = track.lines.iter().filter(|line| line.order() == order);
    own.map(|line| (line.key.episode.as_str(), *line)).collect()
}

fn reference(missions: &BTreeMap<&str, &ResultLine>) -> String {
    if missions.is_empty() {
        return "-".to_owned();
    }
    let (steps, _) = average(missions.values().map(|line| f64::from(line.mission.reference_steps)));
    let (length_m, _) = average(missions.values().map(|line| line.metrics.reference_m));
    format!("{steps:.1} steps, {length_m:.1} m on average")
}

fn storeys(houses: &BTreeMap<&str, &ResultLine>) -> String {
    let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
    houses.values().for_each(|line| *counts.entry(line.mission.storeys).or_default() += 1);
    let words = counts.into_iter().map(|(storeys, count)| {
        let houses = if count == 1 { "house" } else { "houses" };
        format!("{storeys} in {count} {houses}")
    });
    list(&words.collect::<Vec<_>>())
}

fn area(houses: &BTreeMap<&str, &ResultLine>) -> String {
    let areas_m2 = || houses.values().map(|line| line.mission.area_m2);
    let (least, most) = (areas_m2().fold(f64::INFINITY, f64::min), areas_m2().fold(0.0, f64::max));
    format!("{:.0} m² on average ({least:.0} to {most:.0})", average(areas_m2()).0)
}

/// Describes the split of a track.
fn split(track: &str) -> &'static str {
    match track {
        "main" => {
            "split `val` of the recipe `paper`, with furniture from the validation pool, unseen in training and tuning"
        }
        "quick" => {
            "split `val` of the small houses in `lab/src/suite/recipe.json`, with furniture from the validation pool, unseen in \
             training and tuning"
        }
        _ => "practice houses from the training pool",
    }
}

fn clips(track: &str) -> &'static str {
    if track.ends_with("practice") { "training share of the bank" } else { "validation share of the bank" }
}
