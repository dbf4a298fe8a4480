//! The hard track: sounds of distractors, noisy sensors, no verdict by silence.

use super::contrast::{Contrast, ORDERS, PageSection, contrast_table, correct, list};
use super::selection::TrackResults;
use super::{cells_with_floor, header_of, labels_with_floor};
use avln_episode::Order;
use std::fmt::Write as _;

/// Rows that the full agent must exceed.
const BELOW: [&str; 4] = [
    "sound-follower",
    "pag-nav-plus-no-gate",
    "pag-nav-plus-no-object-memory",
    "pag-nav-plus-no-search-sound",
];
const FULL: &str = "pag-nav-plus";
/// Largest intended SR of the sound-follower.
const MOST_BY_SOUND: f64 = 0.05;

/// Returns the section; empty without results on the hard track.
pub(super) fn hard_section(track: &TrackResults<'_>) -> PageSection {
    let mut section = PageSection::default();
    if track.lines.is_empty() {
        return section;
    }
    section.text = "## Hard track\n\nThe missions of the main track with the rule set `lh-avln-hard-v1`: as many distractor sources \
         as goals, noisy sensors, and no verdict by sudden silence. No single sense suffices: following sounds leads to \
         distractor sources at least as often as to targets.\n"
        .to_owned();
    for order in ORDERS {
        let header = header_of(&labels_with_floor());
        let _ = write!(section.text, "\n### Hard track, {}\n\n{header}", order.as_str());
        for variant in track.variants() {
            let Some(summary) = track.variant(variant, order).summary() else { continue };
            let cells = cells_with_floor(track, variant, order, &summary);
            let _ = writeln!(section.text, "| {} |", cells.join(" | "));
        }
    }
    let contrasts = contrasts(track);
    if !contrasts.is_empty() {
        let _ = write!(section.text, "\n{}", contrast_table(&contrasts, "SR"));
    }
    let _ = write!(section.text, "\n{}\n", answer(track, &contrasts));
    section
}

fn contrasts(track: &TrackResults<'_>) -> Vec<Contrast> {
    let contrast = |(order, below): (Order, &str)| {
        let test = track.row(FULL, order).minus(&track.row(below, order), |line| Some(line.metrics.sr))?;
        Some(Contrast { label: format!("{FULL} - {below}"), order, test })
    };
    let pairs = ORDERS.into_iter().flat_map(|order| BELOW.map(|below| (order, below)));
    let mut contrasts: Vec<_> = pairs.filter_map(contrast).collect();
    correct(&mut contrasts);
    contrasts
}

fn answer(track: &TrackResults<'_>, contrasts: &[Contrast]) -> String {
    let rates = |name: &str| ORDERS.map(|order| track.row(name, order).sr().map(|sr| sr.value));
    let shown = |name: &str| {
        let shares = rates(name).map(|sr| sr.map_or("-".to_owned(), |sr| format!("{:.1} %", 100.0 * sr)));
        format!("{} of the ordered and {} of the unordered missions", shares[0], shares[1])
    };
    let is_low = rates("sound-follower").iter().flatten().all(|sr| *sr <= MOST_BY_SOUND);
    let aim = if is_low { "within" } else { "above" };
    let is_above = |contrast: &&Contrast| contrast.test.is_significant() && contrast.test.value > 0.0;
    let (sure, unsure): (Vec<_>, Vec<_>) = contrasts.iter().partition(is_above);
    let names = |part: &[&Contrast]| {
        let names: Vec<_> = part.iter().map(|contrast| contrast.name()).collect();
        if names.is_empty() { "none".to_owned() } else { list(&names) }
    };
    format!(
        "**Answer.** The sound-follower completes {} ({aim} the aim of 5 %), the shortest path {}; significant differences: {}; \
         not significant: {}.",
        shown("sound-follower"),
        shown("shortest-path"),
        names(&sure),
        names(&unsure)
    )
}
