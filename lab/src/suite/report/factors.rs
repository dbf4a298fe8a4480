//! The paper's third question: effect of order, modality, number of goals and memory.

use super::chart::Chart;
use super::contrast::{Contrast, ORDERS, PageSection, chart_rows, contrast_table, correct, list};
use super::selection::TrackResults;
use crate::suite::ResultLine;
use avln_episode::{Modality, Order};
use std::fmt::Write as _;

/// Ablations of memory.
const MEMORIES: [&str; 3] = ["no-object-memory", "no-acoustic-memory", "no-map"];
const MODALITY_PAIRS: [(Modality, Modality); 3] = [
    (Modality::Description, Modality::Category),
    (Modality::Image, Modality::Category),
    (Modality::Image, Modality::Description),
];
const GOAL_PAIRS: [(u32, u32); 3] = [(3, 2), (4, 2), (4, 3)];

/// A factor's tested differences in ISR.
struct Factor {
    name: &'static str,
    contrasts: Vec<Contrast>,
}

/// Returns the section; empty without results of the full agent in both orders.
pub(super) fn factors_section(track: &TrackResults<'_>) -> PageSection {
    let mut section = PageSection::default();
    let full = track.full_agent();
    let factors = [
        Factor { name: "order", contrasts: orders(track, full) },
        Factor { name: "modality", contrasts: modalities(track, full) },
        Factor { name: "number of goals", contrasts: goals(track, full) },
        Factor { name: "memory", contrasts: memories(track, full) },
    ];
    if factors[0].contrasts.is_empty() {
        return section;
    }
    section.text = format!(
        "## Question 3: effect of order, modality, number of goals and memory\n\nDifferences in ISR, in percentage points; for \
         modalities, in the found share of goals. Orders and ablations of memory are paired by mission; modalities and goal counts \
         are compared inside houses. All rows are for {full} unless they name another agent.\n"
    );
    for Factor { name, contrasts } in factors.iter().filter(|factor| !factor.contrasts.is_empty()) {
        let _ = write!(section.text, "\n### Effect of {name}\n\n{}", contrast_table(contrasts, "ISR"));
    }
    let rows = factors.iter().flat_map(|factor| chart_rows(&factor.contrasts)).collect();
    let title = format!("Differences in ISR of {full}");
    let chart = Chart { title: &title, axis: "percentage points, with 95 % intervals", rows };
    section.add_chart(
        "results-factors.svg",
        "Effects of order, modality, number of goals and memory with 95 % intervals",
        chart.svg(),
    );
    let _ = write!(section.text, "\n{}\n", answer(full, &factors));
    section
}

fn isr(line: &ResultLine) -> Option<f64> {
    Some(line.metrics.isr)
}

fn corrected(contrasts: impl Iterator<Item = Contrast>) -> Vec<Contrast> {
    let mut contrasts: Vec<_> = contrasts.collect();
    correct(&mut contrasts);
    contrasts
}

fn orders(track: &TrackResults<'_>, full: &str) -> Vec<Contrast> {
    let mut agents = vec![full, "pag-nav", "sound-follower"];
    agents.dedup();
    let contrast = |agent: &str| {
        let [ordered, unordered] = ORDERS.map(|order| track.row(agent, order));
        let label = format!("{agent}: unordered - ordered");
        let test = unordered.minus(&ordered, isr)?;
        Some(Contrast { label, order: Order::Unordered, test })
    };
    corrected(agents.into_iter().filter_map(contrast))
}

fn modalities(track: &TrackResults<'_>, full: &str) -> Vec<Contrast> {
    let contrast = |(order, (first, second)): (Order, (Modality, Modality))| {
        let test = track.row(full, order).modality_gap(first, second)?;
        Some(Contrast { label: format!("{} - {}", first.as_str(), second.as_str()), order, test })
    };
    let pairs = ORDERS.into_iter().flat_map(|order| MODALITY_PAIRS.map(|pair| (order, pair)));
    corrected(pairs.filter_map(contrast))
}

fn goals(track: &TrackResults<'_>, full: &str) -> Vec<Contrast> {
    let contrast = |(order, (first, second)): (Order, (u32, u32))| {
        let test = track.row(full, order).goals_gap(first, second)?;
        Some(Contrast { label: format!("{first} goals - {second} goals"), order, test })
    };
    let pairs = ORDERS.into_iter().flat_map(|order| GOAL_PAIRS.map(|pair| (order, pair)));
    corrected(pairs.filter_map(contrast))
}

fn memories(track: &TrackResults<'_>, full: &str) -> Vec<Contrast> {
    let contrast = |(order, suffix): (Order, &str)| {
        let ablation = track.row(&format!("{full}-{suffix}"), order);
        let test = track.row(full, order).minus(&ablation, isr)?;
        Some(Contrast { label: format!("{full} - {suffix}"), order, test })
    };
    let pairs = ORDERS.into_iter().flat_map(|order| MEMORIES.map(|suffix| (order, suffix)));
    corrected(pairs.filter_map(contrast))
}

fn answer(full: &str, factors: &[Factor]) -> String {
    let (mut found, mut unsure, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    for Factor { name, contrasts } in factors {
        let sure = contrasts.iter().filter(|contrast| contrast.test.is_significant());
        let largest = sure.max_by(|a, b| a.test.value.abs().total_cmp(&b.test.value.abs()));
        match largest {
            Some(largest) => found.push(format!("{name} (largest: {}, {})", largest.name(), largest.words())),
            None if contrasts.is_empty() => missing.push((*name).to_owned()),
            None => unsure.push((*name).to_owned()),
        }
    }
    let mut clauses = vec![match found.is_empty() {
        true => "no factor has a significant effect".to_owned(),
        false => format!("significant effects: {}", list(&found)),
    }];
    if !found.is_empty() && !unsure.is_empty() {
        clauses.push(format!("no significant effect: {}", list(&unsure)));
    }
    if !missing.is_empty() {
        clauses.push(format!("without results: {}", list(&missing)));
    }
    format!("**Answer.** On the ISR of {full}, {}.", clauses.join("; "))
}
