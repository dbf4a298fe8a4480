//! The paper's second and third question: benefit of sound beyond vision and language; effect of order, modality, number of
//! goals and memory.

use super::chart::Chart;
use super::contrast::{
    Contrast, Difference, ORDERS, PageSection, chart_rows, contrast_table, correct, family, family_note,
    holm, list, p, points,
};
use super::percent;
use super::selection::{RowResults, TrackResults, modality_share};
use crate::suite::ResultLine;
use avln_episode::{Modality, Order};
use std::fmt::Write as _;

/// Ablations of hearing: suffix and meaning.
pub(super) const SOUND_ABLATIONS: [(&str, &str); 3] = [
    ("no-audio", "no hearing, hence no search, located sources, grounding or outcomes of Submits by sound"),
    (
        "no-search-sound",
        "outcomes of Submits by sound, but no search by sound, hence no located sources, no grounding by sound, no association \
         of sources and goals, and no lower floor of visual verification at located sources (in pag-nav-plus 0.25 instead of \
         0.5)",
    ),
    (
        "no-outcomes",
        "search by sound, but no outcomes of Submits by sound, hence no wait at the gate for the target's sound",
    ),
];
const MODALITIES: [Modality; 3] = [Modality::Category, Modality::Description, Modality::Image];

/// Returns the section; empty without an ablation of hearing.
pub(super) fn sound_section(track: &TrackResults<'_>, with_verdicts: &TrackResults<'_>) -> PageSection {
    let mut section = PageSection::default();
    let full = track.full_agent();
    let Some(search) = searched(track, full) else { return section };
    let rows = SOUND_ABLATIONS.into_iter().flat_map(|(suffix, _)| compared(track, full, suffix, ""));
    let rows = corrected(rows.collect());
    section.text = format!(
        "## Question 2: benefit of sound beyond vision and language\n\nDifferences between {full} and its ablations on common \
         missions, in percentage points. Hearing has three uses: search, grounding with verification, and the outcomes of \
         Submits, since a found target falls silent. {}\n\n{}{}",
        legend(SOUND_ABLATIONS, |suffix| track.has(&format!("{full}-{suffix}"))),
        table(&rows),
        verdicts(with_verdicts)
    );
    let situations = situations(track, full, search);
    let _ = write!(
        section.text,
        "\nISR of {full} minus {full}-{search}, by situation; for a modality, the found share of its goals in a mission. Short, \
         middle and long are the thirds of the missions by reference length.\n\n{}",
        contrast_table(&situations, "ISR")
    );
    let title = format!("ISR of {full} minus {full}-{search}");
    let chart = Chart {
        title: &title,
        axis: "percentage points, with 95 % intervals",
        rows: chart_rows(&situations),
    };
    section.add_chart("results-sound.svg", "Benefit of sound by situation with 95 % intervals", chart.svg());
    let _ = write!(section.text, "\n{}\n", sound_answer(full, search, &rows, &situations));
    section
}

/// Returns the meanings of the ablations with results.
pub(super) fn legend(
    ablations: impl IntoIterator<Item = (&'static str, &'static str)>,
    has: impl Fn(&str) -> bool,
) -> String {
    let present = ablations.into_iter().filter(|(suffix, _)| has(suffix));
    present.map(|(suffix, meaning)| format!("*{suffix}*: {meaning}.")).collect::<Vec<_>>().join(" ")
}

/// Returns levels, and the value of hearing for both presets, with verdicts; empty without results.
fn verdicts(track: &TrackResults<'_>) -> String {
    if track.lines.is_empty() {
        return String::new();
    }
    let mut text = String::from(
        "\nWith verdicts, the server sends the outcome of every Submit to both variants.\n\n\
         | agent, with verdicts | order | n | SR | ISR |\n|---|---|---|---|---|\n",
    );
    for order in ORDERS {
        for variant in track.variants() {
            let Some(summary) = track.variant(variant, order).summary() else { continue };
            let (name, order) = (variant.name(), order.as_str());
            let [sr, isr] = [summary.sr, summary.isr].map(percent);
            let _ = writeln!(text, "| {name} | {order} | {} | {sr} | {isr} |", summary.episodes);
        }
    }
    let presets = presets(track).into_iter();
    let rows = presets.flat_map(|preset| compared(track, preset, "no-audio", ", verdicts sent to both"));
    let rows = corrected(rows.collect());
    if !rows.is_empty() {
        let _ = write!(text, "\n{}", table(&rows));
    }
    text
}

/// Returns the least confounded ablation of search by sound with results.
fn searched(track: &TrackResults<'_>, full: &str) -> Option<&'static str> {
    ["no-search-sound", "no-audio"].into_iter().find(|suffix| track.has(&format!("{full}-{suffix}")))
}

/// Differences in SR, ISR and OSR.
struct SoundRow {
    label: String,
    suffix: &'static str,
    metrics: Vec<Contrast>,
}

fn compared(track: &TrackResults<'_>, full: &str, suffix: &'static str, note: &str) -> Vec<SoundRow> {
    let numbers: [fn(&ResultLine) -> f64; 3] =
        [|line| line.metrics.sr, |line| line.metrics.isr, |line| line.metrics.osr];
    let other = format!("{full}-{suffix}");
    let row = |order| {
        let [with, without] = [full, other.as_str()].map(|name| track.row(name, order));
        let label = format!("{full} - {suffix}{note}");
        let contrast = |number: fn(&ResultLine) -> f64| {
            let test = with.minus(&without, |line| Some(number(line)))?;
            Some(Contrast { label: label.clone(), order, test })
        };
        let metrics: Vec<_> = numbers.into_iter().filter_map(contrast).collect();
        (!metrics.is_empty()).then_some(SoundRow { label, suffix, metrics })
    };
    ORDERS.into_iter().filter_map(row).collect()
}

/// Corrects the p-values of a table's rows as a family.
fn corrected(mut rows: Vec<SoundRow>) -> Vec<SoundRow> {
    holm(rows.iter_mut().flat_map(|row| &mut row.metrics).map(|contrast| &mut contrast.test));
    rows
}

fn table(rows: &[SoundRow]) -> String {
    let family = family_note(rows.iter().flat_map(|row| &row.metrics).map(|contrast| &contrast.test));
    let mut text = format!(
        "{family}\n\n| comparison | order | n | SR difference | ISR difference | OSR difference |\n|---|---|---|---|---|---|\n"
    );
    for SoundRow { label, metrics, .. } in rows {
        let Some(first) = metrics.first() else { continue };
        let cells: Vec<_> =
            metrics.iter().map(|Contrast { test, .. }| format!("{}, {}", points(test), p(test))).collect();
        let (order, count) = (first.order.as_str(), first.test.count);
        let _ = writeln!(text, "| {label} | {order} | {count} | {} |", cells.join(" | "));
    }
    text
}

/// A condition with a number per mission; `None` for missions outside it.
type Situation = (String, Box<dyn Fn(&ResultLine) -> Option<f64>>);

fn situations(track: &TrackResults<'_>, full: &str, suffix: &str) -> Vec<Contrast> {
    let mut contrasts = Vec::new();
    for order in ORDERS {
        let [with, without] =
            [full.to_owned(), format!("{full}-{suffix}")].map(|name| track.row(&name, order));
        for (label, number) in conditions(&without) {
            let test = with.minus(&without, number);
            contrasts.extend(test.map(|test| Contrast { label, order, test }));
        }
    }
    correct(&mut contrasts);
    contrasts
}

/// Returns the situations: goal counts, modalities, and thirds of the missions by reference length.
fn conditions(row: &RowResults<'_>) -> Vec<Situation> {
    let mut conditions: Vec<Situation> = Vec::new();
    for goals in [2, 3, 4] {
        let own = move |line: &ResultLine| (line.metrics.goals == goals).then_some(line.metrics.isr);
        conditions.push((format!("{goals} goals"), Box::new(own)));
    }
    for modality in MODALITIES {
        let own = move |line: &ResultLine| modality_share(line, modality);
        conditions.push((format!("{} goals", modality.as_str()), Box::new(own)));
    }
    let [short_m, long_m] = thirds_m(row);
    let bounds = [(0.0, short_m, "short"), (short_m, long_m, "middle"), (long_m, f64::INFINITY, "long")];
    for (from_m, to_m, name) in bounds {
        let range = if to_m.is_finite() { format!("to {to_m:.0} m") } else { format!("from {from_m:.0} m") };
        let own = move |line: &ResultLine| {
            (from_m..to_m).contains(&line.metrics.reference_m).then_some(line.metrics.isr)
        };
        conditions.push((format!("{name} reference, {range}"), Box::new(own)));
    }
    conditions
}

/// Returns the ends of the first two thirds by reference length, metres.
fn thirds_m(row: &RowResults<'_>) -> [f64; 2] {
    let mut lengths_m: Vec<f64> = row.lines.iter().map(|line| line.metrics.reference_m).collect();
    lengths_m.sort_by(f64::total_cmp);
    [1, 2].map(|third| lengths_m.get(third * lengths_m.len() / 3).copied().unwrap_or(0.0))
}

fn sound_answer(full: &str, search: &str, rows: &[SoundRow], situations: &[Contrast]) -> String {
    let isr = rows.iter().filter(|row| row.suffix == search).filter_map(|row| row.metrics.get(1));
    let clauses: Vec<String> = isr.map(clause).collect();
    let is_sure = |contrast: &&Contrast| contrast.test.is_significant() && contrast.test.value > 0.0;
    let sure: Vec<&Contrast> = situations.iter().filter(is_sure).collect();
    let most =
        sure.iter().copied().reduce(|most, next| if next.test.value > most.test.value { next } else { most });
    let most = match (most, sure.len()) {
        (Some(only), 1) => format!("the only significant situation is {} ({})", only.name(), only.words()),
        (Some(most), _) => {
            format!("the largest significant benefit is that for {} ({})", most.name(), most.words())
        }
        (None, _) => "no situation has a significant benefit".to_owned(),
    };
    let sound = if search == "no-audio" { "hearing" } else { "sound in search and grounding" };
    format!("**Answer.** For {full}, {sound} {}; {most}.", clauses.join(" and "))
}

fn clause(contrast: &Contrast) -> String {
    let order = contrast.order.as_str();
    match (contrast.test.is_significant(), contrast.test.value > 0.0) {
        (true, true) => format!("significantly raises the ISR of {order} missions ({})", contrast.words()),
        (true, false) => format!("significantly lowers the ISR of {order} missions ({})", contrast.words()),
        (false, _) => {
            format!("does not significantly change the ISR of {order} missions ({})", contrast.words())
        }
    }
}

/// Compared agents: the suffix of the first after the full agent's name, and the ablation of the second. Without object memory a single
/// look verifies, so only the second pair differs in the memory alone.
const MEMORIES: [[&str; 2]; 4] = [
    ["", "no-object-memory"],
    ["-no-second-look", "no-object-memory"],
    ["", "no-acoustic-memory"],
    ["", "no-map"],
];
const MEMORY_NOTE: &str = "\nThe paper's memory consists of rooms, objects and sounds; *no-map* removes the occupancy map instead.\n";
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
        Factor { name: "modality", contrasts: modalities(track) },
        Factor { name: "number of goals", contrasts: goals(track) },
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
        if *name == "memory" {
            section.text += MEMORY_NOTE;
        }
    }
    let rows = factors.iter().flat_map(|factor| chart_rows(&factor.contrasts)).collect();
    let title = format!("Differences in ISR, of {full} unless another agent is named");
    let chart = Chart { title: &title, axis: "percentage points, with 95 % intervals", rows };
    section.add_chart(
        "results-factors.svg",
        "Effects of order, modality, number of goals and memory with 95 % intervals",
        chart.svg(),
    );
    let _ = write!(section.text, "\n{}\n", factors_answer(full, &factors));
    section
}

fn isr(line: &ResultLine) -> Option<f64> {
    Some(line.metrics.isr)
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
    let mut contrasts: Vec<_> = agents.into_iter().filter_map(contrast).collect();
    correct(&mut contrasts);
    contrasts
}

/// Returns both presets, or the only one if it is the full agent.
fn presets(track: &TrackResults<'_>) -> Vec<&'static str> {
    let mut presets = vec![track.full_agent(), "pag-nav"];
    presets.dedup();
    presets
}

/// Tests cases for both presets, each preset as a family; labels name the preset with fewer abilities.
fn per_preset<T>(
    track: &TrackResults<'_>,
    cases: &[T],
    test: impl Fn(&RowResults<'_>, &T) -> Option<(String, Difference)>,
) -> Vec<Contrast> {
    let full = track.full_agent();
    let tested = |preset: &str| {
        family(cases, |order, case| {
            let (label, test) = test(&track.row(preset, order), case)?;
            Some((if preset == full { label } else { format!("{preset}: {label}") }, test))
        })
    };
    presets(track).into_iter().flat_map(tested).collect()
}

fn modalities(track: &TrackResults<'_>) -> Vec<Contrast> {
    per_preset(track, &MODALITY_PAIRS, |row, (first, second)| {
        let test = row.modality_gap(*first, *second)?;
        Some((format!("{} - {}", first.as_str(), second.as_str()), test))
    })
}

fn goals(track: &TrackResults<'_>) -> Vec<Contrast> {
    per_preset(track, &GOAL_PAIRS, |row, (first, second)| {
        let test = row.goals_gap(*first, *second)?;
        Some((format!("{first} goals - {second} goals"), test))
    })
}

fn memories(track: &TrackResults<'_>, full: &str) -> Vec<Contrast> {
    family(&MEMORIES, |order, [more, less]| {
        let more = format!("{full}{more}");
        let test = track.row(&more, order).minus(&track.row(&format!("{full}-{less}"), order), isr)?;
        Some((format!("{more} - {less}"), test))
    })
}

fn factors_answer(full: &str, factors: &[Factor]) -> String {
    let (mut found, mut unsure, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    for Factor { name, contrasts } in factors {
        let sure = contrasts.iter().filter(|contrast| contrast.test.is_significant());
        let largest = sure.max_by(|a, b| a.test.value.abs().total_cmp(&b.test.value.abs()));
        match largest {
            Some(largest) => {
                let significant = contrasts.iter().filter(|contrast| contrast.test.is_significant()).count();
                let (name_of, words) = (largest.name(), largest.words());
                found.push(format!(
                    "{name} ({significant} of {} differences; largest: {name_of}, {words})",
                    contrasts.len()
                ));
            }
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
    format!("**Answer.** On the ISR, of {full} unless another agent is named, {}.", clauses.join("; "))
}
