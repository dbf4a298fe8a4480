//! The paper's first question, difficulty for methods of different types, and the hard track.

use super::chart::{Chart, ChartRow};
use super::contrast::{Contrast, ORDERS, PageSection, contrast_table, correct, family, list};
use super::selection::TrackResults;
use super::{cells_with_floor, header_of, labels_with_floor, name, percent};
use crate::suite::{AgentVariant, ResultLine};
use avln_episode::Order;
use std::fmt::Write as _;

/// Returns the section; empty without methods in both orders.
pub(super) fn difficulty_section(track: &TrackResults<'_>) -> PageSection {
    let mut section = PageSection::default();
    let best_of_types = best_of_types(track);
    let Some(best) = best_by(track, best_of_types.iter().map(|(_, variant)| *variant)) else {
        return section;
    };
    section.text = "## Question 1: difficulty for methods of different types\n\nThe best method of each type by mean SR over both \
         orders, without ablations and privileged agents; and the differences in SR to the best of all methods on common \
         missions. The selection of the best favours it. A type is represented by its agents on this page; for the models of \
         `pag-nav-models` see [models.md](models.md).\n\n\
         | type | best method | SR ordered | SR unordered |\n|---|---|---|---|\n"
        .to_owned();
    for (method_type, variant) in &best_of_types {
        let [ordered, unordered] = ORDERS.map(|order| sr(track, *variant, order));
        let _ = writeln!(section.text, "| {method_type} | {} | {ordered} | {unordered} |", name(*variant));
    }
    let contrasts = contrasts(track, best, &best_of_types);
    if !contrasts.is_empty() {
        let _ = write!(section.text, "\n{}", contrast_table(&contrasts, "SR"));
    }
    section.add_chart("results-difficulty.svg", "SR of all methods with 95 % intervals", chart(track));
    let _ = write!(section.text, "\n{}\n", answer(track, best, &best_of_types, &contrasts));
    section
}

/// Returns `true` for methods: neither ablations nor privileged agents.
fn is_method(variant: AgentVariant) -> bool {
    let name = variant.name();
    // Any other ablation lacks a part of PAG-Nav.
    !variant.is_privileged() && !name.contains("-no-")
}

fn mean_sr(track: &TrackResults<'_>, variant: AgentVariant) -> Option<f64> {
    let [ordered, unordered] = ORDERS.map(|order| track.variant(variant, order).sr());
    Some(ordered?.value + unordered?.value)
}

/// Returns the method with the best mean SR; the first among equals.
fn best_by(track: &TrackResults<'_>, variants: impl Iterator<Item = AgentVariant>) -> Option<AgentVariant> {
    let rated = variants.filter_map(|variant| Some((mean_sr(track, variant)?, variant)));
    let better =
        |best: (f64, AgentVariant), next: (f64, AgentVariant)| if next.0 > best.0 { next } else { best };
    rated.reduce(better).map(|(_, variant)| variant)
}

fn best_of_types(track: &TrackResults<'_>) -> Vec<(String, AgentVariant)> {
    let methods: Vec<_> = track.variants().into_iter().filter(|variant| is_method(*variant)).collect();
    let mut types: Vec<String> = methods.iter().map(|variant| variant.method_type().to_string()).collect();
    types.sort();
    types.dedup();
    let best = |method_type: String| {
        let own = methods.iter().copied().filter(|variant| variant.method_type().to_string() == method_type);
        best_by(track, own).map(|variant| (method_type, variant))
    };
    types.into_iter().filter_map(best).collect()
}

fn contrasts(
    track: &TrackResults<'_>,
    best: AgentVariant,
    others: &[(String, AgentVariant)],
) -> Vec<Contrast> {
    let mut contrasts = Vec::new();
    for &(_, other) in others.iter().filter(|(_, other)| *other != best) {
        for order in ORDERS {
            let [first, second] = [best, other].map(|variant| track.variant(variant, order));
            let test = first.minus(&second, |line| Some(line.metrics.sr));
            let label = format!("{} - {}", best.name(), other.name());
            contrasts.extend(test.map(|test| Contrast { label, order, test }));
        }
    }
    correct(&mut contrasts);
    contrasts
}

fn chart(track: &TrackResults<'_>) -> Option<String> {
    let mut rows = Vec::new();
    for variant in track.variants().into_iter().filter(|variant| is_method(*variant)) {
        for order in ORDERS {
            let sr = track.variant(variant, order).sr();
            let percent = sr.map(|sr| [sr.value, sr.low, sr.high].map(|share| 100.0 * share));
            let label = variant.name();
            rows.extend(percent.map(|[value, low, high]| ChartRow { label, order, value, low, high }));
        }
    }
    Chart { title: "SR by method", axis: "SR, percent, with 95 % intervals", rows }.svg()
}

fn sr(track: &TrackResults<'_>, variant: AgentVariant, order: Order) -> String {
    track.variant(variant, order).sr().map_or("-".to_owned(), percent)
}

/// Returns an agent's SR in both orders, in words.
fn rates(track: &TrackResults<'_>, name: &str) -> String {
    let [ordered, unordered] = ORDERS.map(|order| {
        track.row(name, order).sr().map_or("-".to_owned(), |sr| format!("{:.1} %", 100.0 * sr.value))
    });
    format!("{ordered} of the ordered and {unordered} of the unordered missions")
}

fn answer(
    track: &TrackResults<'_>,
    best: AgentVariant,
    best_of_types: &[(String, AgentVariant)],
    contrasts: &[Contrast],
) -> String {
    let others = best_of_types.iter().filter(|(_, variant)| *variant != best);
    let others: Vec<String> = others.map(|(_, variant)| variant.name()).collect();
    let unsure: Vec<String> =
        contrasts.iter().filter(|contrast| !contrast.test.is_significant()).map(Contrast::name).collect();
    let verdict = match (contrasts.is_empty(), unsure.is_empty()) {
        (true, _) => "no other type has results".to_owned(),
        (false, true) => {
            format!("the differences to {} (the best of other types) are significant", list(&others))
        }
        (false, false) => format!("these differences are not significant: {}", list(&unsure)),
    };
    let bound = match track.has("shortest-path") {
        true => format!(", the shortest path {}", rates(track, "shortest-path")),
        false => String::new(),
    };
    let name = best.name();
    format!(
        "**Answer.** The best method without ground truth, {name} ({}), completes {}{bound}; {verdict}.",
        best.method_type(),
        rates(track, &name)
    )
}

/// Rows that the full agent must exceed.
const BELOW: [&str; 4] = [
    "sound-follower",
    "pag-nav-plus-no-gate",
    "pag-nav-plus-no-object-memory",
    "pag-nav-plus-no-search-sound",
];
const FULL: &str = "pag-nav-plus";
/// The agent with perfect recognition, and its ablations: they show whether the track requires memory and hearing.
const SIGHTED: &str = "pag-nav-plus-true-sight";
const BELOW_SIGHTED: [&str; 2] =
    ["pag-nav-plus-true-sight-no-object-memory", "pag-nav-plus-true-sight-no-search-sound"];
/// Largest intended SR of the sound-follower.
const MOST_BY_SOUND: f64 = 0.05;

/// Returns the section; empty without results on the hard track.
pub(super) fn hard_section(track: &TrackResults<'_>) -> PageSection {
    let mut section = PageSection::default();
    if track.lines.is_empty() {
        return section;
    }
    section.text = "## Hard track\n\nThe missions of the main track with the rule set `lh-avln-hard-v1`: as many distractor sources \
         as goals, noisy sensors, and no verdict by sudden silence. The track is designed to require vision, hearing and \
         memory: following sounds leads to distractor sources at least as often as to targets. The tests below show whether it \
         does; [Recognition](perception.md#sensor-noise) explains them.\n"
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
    let contrasts = [hard_contrasts(track, FULL, &BELOW), hard_contrasts(track, SIGHTED, &BELOW_SIGHTED)];
    for table in contrasts.iter().filter(|table| !table.is_empty()) {
        let _ = write!(section.text, "\n{}", contrast_table(table, "SR or ISR"));
    }
    let _ = write!(section.text, "\n{}\n", hard_answer(track, &contrasts));
    section
}

/// A number of an episode.
type Number = fn(&ResultLine) -> f64;

fn hard_contrasts(track: &TrackResults<'_>, full: &str, below: &[&str]) -> Vec<Contrast> {
    // Complete missions are rare on this track: ISR, their found share, shows smaller differences.
    let numbers: [(&str, Number); 2] = [("SR", |line| line.metrics.sr), ("ISR", |line| line.metrics.isr)];
    let cases: Vec<_> = below.iter().flat_map(|below| numbers.map(|number| (*below, number))).collect();
    family(&cases, |order, (below, (name, number))| {
        let test = track.row(full, order).minus(&track.row(below, order), |line| Some(number(line)))?;
        Some((format!("{name}: {full} - {below}"), test))
    })
}

fn hard_answer(track: &TrackResults<'_>, [contrasts, sighted]: &[Vec<Contrast>; 2]) -> String {
    let by_sound = ORDERS.map(|order| track.row("sound-follower", order).sr());
    let is_low = by_sound.iter().flatten().all(|sr| sr.value <= MOST_BY_SOUND);
    let aim = if is_low { "within" } else { "above" };
    let differences = match contrasts.is_empty() {
        true => format!("{FULL} has no results to compare"),
        false => format!("differences of {FULL} in the table above: {}", verdicts_of(contrasts)),
    };
    let differences_by_sight = match sighted.is_empty() {
        true => String::new(),
        false => format!("; differences of {SIGHTED}: {}", verdicts_of(sighted)),
    };
    format!(
        "**Answer.** The sound-follower completes {} ({aim} the aim of 5 %), the shortest path \
         {}; {differences}{differences_by_sight}.",
        rates(track, "sound-follower"),
        rates(track, "shortest-path")
    )
}

/// Returns the numbers of significant and other differences.
fn verdicts_of(contrasts: &[Contrast]) -> String {
    let sure = || contrasts.iter().filter(|contrast| contrast.test.is_significant());
    let above = sure().filter(|contrast| contrast.test.value > 0.0).count();
    let (below, unsure) = (sure().count() - above, contrasts.len() - sure().count());
    format!("{above} significantly positive, {below} significantly negative, {unsure} not significant")
}
