//! The suite's results page, as Markdown and CSV.

mod statistics;

use super::{AgentVariant, Cause, ResultLine, host::results_path, results};
use avln_arena::{Failure, FailureKind};
use avln_episode::{EndReason, Modality, Order};
use avln_scoring::{Estimate, Metric, Summary};
use clap::ValueEnum;
use statistics::{Paired, VariantResults, comparable, compare, mean, steps_to_first};
use std::{collections::BTreeSet, fmt::Write as _, path::Path};

const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];
const ENDS: [EndReason; 4] =
    [EndReason::Stopped, EndReason::FinalSubmit, EndReason::StepLimit, EndReason::TimeBudget];

/// A row of the paper's table 1, percent: SR, ISR, OSR, SPL and SoftSPL by order.
struct PaperRow {
    method: &'static str,
    hears: bool,
    ordered: [f64; 5],
    unordered: [f64; 5],
}

const fn paper(method: &'static str, hears: bool, ordered: [f64; 5], unordered: [f64; 5]) -> PaperRow {
    PaperRow { method, hears, ordered, unordered }
}

const PAPER: [PaperRow; 5] = [
    paper("MTU3D", false, [1.7, 15.5, 47.6, 1.5, 8.8], [2.1, 17.3, 41.3, 1.1, 9.8]),
    paper("3D-Mem", false, [0.0, 11.6, 23.7, 0.0, 8.6], [1.0, 14.8, 28.0, 0.7, 9.2]),
    paper("SAVi", true, [0.0, 0.1, 34.4, 0.0, 0.1], [0.0, 0.7, 35.1, 0.0, 0.5]),
    paper("GOAT-Bench", false, [0.0, 7.9, 9.1, 0.2, 7.9], [0.2, 8.9, 9.2, 0.2, 8.9]),
    paper("PAG-Nav", true, [2.3, 17.5, 66.5, 1.8, 12.9], [3.1, 31.5, 55.6, 1.8, 14.8]),
];

/// The results in a folder.
pub struct SuiteReport {
    /// Markdown page, with a link to `results.csv` in the same folder.
    pub page: String,
    /// CSV table with all episodes.
    pub episodes: String,
}

/// Formats the results in a folder.
///
/// # Errors
/// If there are no results, or they cannot be read.
pub fn report(folder: &Path) -> Result<SuiteReport, Failure> {
    let played = results::read(&results_path(folder))?;
    let lines = comparable(played.values());
    let Some(first) = lines.first() else {
        let message = format!("there are no results in {}", folder.display());
        return Err(Failure::new(FailureKind::Data, message)
            .hinted("run the suite first: avln lab baselines run --out FOLDER"));
    };
    let page = ReportPage { lines: &lines, first };
    let sections = [
        page.head(),
        page.main(),
        paper_table(),
        page.variants(),
        page.tests(),
        page.shares(),
        page.failures(),
    ];
    Ok(SuiteReport { page: sections.join("\n"), episodes: statistics::table(&lines) })
}

struct ReportPage<'a> {
    lines: &'a [&'a ResultLine],
    first: &'a ResultLine,
}

impl ReportPage<'_> {
    fn of(&self, variant: AgentVariant, order: Order) -> VariantResults<'_> {
        VariantResults::of(self.lines, variant, order)
    }

    /// Formats a table per order, with a row per agent that played.
    fn tables(
        &self,
        header: &str,
        row: impl Fn(AgentVariant, Order, &VariantResults) -> Option<String>,
    ) -> String {
        let mut text = String::new();
        for order in ORDERS {
            let heading = match order {
                Order::Ordered => "Ordered",
                Order::Unordered => "Unordered",
            };
            let _ = write!(text, "\n### {heading}\n\n{header}");
            for &variant in AgentVariant::value_variants() {
                let played = self.of(variant, order);
                let row = if played.lines.is_empty() { None } else { row(variant, order, &played) };
                text.extend(row.map(|row| row + "\n"));
            }
        }
        text
    }

    fn head(&self) -> String {
        let key = &self.first.key;
        let scenes: BTreeSet<&str> = self.lines.iter().map(|line| line.scene.as_str()).collect();
        let missions: BTreeSet<&str> = self.lines.iter().map(|line| line.key.episode.as_str()).collect();
        let hours = wall_h(self.lines);
        format!(
            "# Results\n\nWritten by `avln lab baselines report`; do not edit. {} missions in {} houses of the public split `val` of \
             `lab/src/suite/recipe.json`, with furniture from the validation pool, which no agent was trained or tuned on. Numbers are \
             percentages with 95 % intervals, resampled by house. Agents marked † are privileged: they receive ground truth and \
             show the value of perfect perception.\n\n\
             Program {}, benchmark {}, split `{}`, agent seed {}, {} episodes in {hours:.1} hours of episode time. \
             [results.csv](results.csv) lists all episodes.\n",
            missions.len(),
            scenes.len(),
            key.program,
            key.benchmark,
            &key.split[..key.split.len().min(16)],
            key.seed,
            self.lines.len(),
        )
    }

    fn main(&self) -> String {
        let rows = self.tables(&header(&["ms per action", "hours"]), |variant, _, played| {
            let summary = played.summary().filter(|_| !variant.is_variant() || variant.is_privileged())?;
            let (think_ms, _) = mean(played.lines.iter().map(|line| line.think_ms));
            let hours = wall_h(&played.lines);
            Some(format!("{} {think_ms:.1} | {hours:.2} |", row(variant, &summary)))
        });
        format!("## All agents\n{rows}")
    }

    fn variants(&self) -> String {
        let rows = self.tables(&header(&["ISR less than PAG-Nav's"]), |variant, order, played| {
            let is_whole = variant == AgentVariant::PagNav;
            let summary = played.summary().filter(|_| is_whole || variant.is_variant())?;
            let whole = self.of(AgentVariant::PagNav, order);
            let test = compare(&whole, played, |line| line.metrics.isr).filter(|_| !is_whole);
            let less =
                test.map_or("-".to_owned(), |test| format!("{:.1}, {}", 100.0 * test.difference, p(test)));
            Some(format!("{} {less} |", row(variant, &summary)))
        });
        format!("## Ablation of PAG-Nav\n{rows}")
    }

    /// Compares PAG-Nav with and without audio.
    fn tests(&self) -> String {
        let mut text = String::from(
            "## The value of audio\n\nPAG-Nav minus PAG-Nav without audio on the same missions: mean differences, with two-sided \
             p-values by the sign-flip permutation test over houses. An episode without a found goal counts as 1000 steps to \
             the first.\n\n| order | pairs | OSR | | steps to the first goal | |\n|---|---|---|---|---|---|\n",
        );
        for order in ORDERS {
            let with = self.of(AgentVariant::PagNav, order);
            let without = self.of(AgentVariant::PagNavNoAudio, order);
            let osr = compare(&with, &without, |line| 100.0 * line.metrics.osr);
            let (Some(osr), Some(steps)) = (osr, compare(&with, &without, steps_to_first)) else { continue };
            let (pairs, gain, later) = (osr.pairs, osr.difference, steps.difference);
            let (order, p_osr, p_steps) = (order.as_str(), p(osr), p(steps));
            let _ = writeln!(text, "| {order} | {pairs} | {gain:+.1} | {p_osr} | {later:+.0} | {p_steps} |");
        }
        text
    }

    fn shares(&self) -> String {
        let header = "| agent | category | description | image | 2 goals | 3 goals | 4 goals |\n|---|---|---|---|---|---|---|\n";
        let rows = self.tables(header, |variant, _, played| {
            let modalities = [Modality::Category, Modality::Description, Modality::Image];
            let shares = modalities.map(|modality| played.by_modality(modality)).into_iter();
            let shares = shares.chain([2, 3, 4].map(|goals| played.by_goals(goals)));
            let cells: Vec<_> =
                shares.map(|(share, count)| format!("{:.1} ({count})", 100.0 * share)).collect();
            Some(format!("| {} | {} |", name(variant), cells.join(" | ")))
        });
        format!("## Goals found, by modality and number of goals\n{rows}")
    }

    fn failures(&self) -> String {
        let ends = ENDS.iter().map(|end| end.as_str().replace('_', " "));
        let causes = Cause::ALL.iter().map(|cause| cause.words().to_owned());
        let labels: Vec<_> = ends.chain(causes).collect();
        let header = format!("| agent | {} |\n|{}\n", labels.join(" | "), "---|".repeat(1 + labels.len()));
        let rows = self.tables(&header, |variant, _, played| {
            let lines = &played.lines;
            let ends = ENDS.map(|end| {
                let ended = lines.iter().map(|line| if line.end == end { 100.0 } else { 0.0 });
                format!("{:.0}", mean(ended).0)
            });
            let causes = Cause::ALL.map(|cause| {
                let counts = lines.iter().map(|line| line.wrong.get(&cause).copied().unwrap_or(0));
                format!("{:.2}", mean(counts.map(f64::from)).0)
            });
            let cells: Vec<_> = ends.into_iter().chain(causes).collect();
            Some(format!("| {} | {} |", name(variant), cells.join(" | ")))
        });
        format!(
            "## Failures\n\nEpisodes by end reason, percent; and Submits per episode that completed no goal, by cause: at another \
             instance of a wanted category; near no wanted object; within 4 m of a wanted target but outside its region; \
             at a later goal's target; at a found target.\n{rows}"
        )
    }
}

/// Returns the total episode time, hours.
fn wall_h(lines: &[&ResultLine]) -> f64 {
    lines.iter().map(|line| line.wall_s).sum::<f64>() / 3600.0
}

fn paper_table() -> String {
    let mut text = String::from(
        "## The paper's numbers\n\nFrom another data set (Matterport3D scans, other missions), as published in its table 1; \
         the rows are not comparable with the tables above.\n\n\
         | method | audio | SR | ISR | OSR | SPL | SoftSPL | SR | ISR | OSR | SPL | SoftSPL |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|\n\
         | | | ordered | | | | | unordered | | | | |\n",
    );
    for PaperRow { method, hears, ordered, unordered } in PAPER {
        let cells: Vec<_> = ordered.iter().chain(&unordered).map(|value| format!("{value:.1}")).collect();
        let _ = writeln!(text, "| {method} | {} | {} |", yes(hears), cells.join(" | "));
    }
    text
}

fn name(variant: AgentVariant) -> String {
    format!("{}{}", variant.name(), if variant.is_privileged() { " †" } else { "" })
}

fn yes(is: bool) -> &'static str {
    if is { "yes" } else { "-" }
}

/// Returns the header for rows by [`row`] with `more` columns.
fn header(more: &[&str]) -> String {
    let labels = Metric::headlines().map(|metric| metric.label);
    let cells: Vec<&str> =
        ["agent", "audio", "n"].into_iter().chain(labels).chain(more.iter().copied()).collect();
    format!("| {} |\n|{}\n", cells.join(" | "), "---|".repeat(cells.len()))
}

/// Returns an agent's first cells.
fn row(variant: AgentVariant, summary: &Summary) -> String {
    let percent =
        |e: Estimate| format!("{:.1} [{:.1}, {:.1}]", 100.0 * e.value, 100.0 * e.low, 100.0 * e.high);
    let estimates = Metric::headlines().filter_map(|metric| metric.estimate_of(summary));
    let cells = estimates.map(percent).collect::<Vec<_>>().join(" | ");
    format!("| {} | {} | {} | {cells} |", name(variant), yes(variant.hears()), summary.episodes)
}

fn p(test: Paired) -> String {
    if test.p < 1e-4 { "p < 0.0001".to_owned() } else { format!("p = {:.4}", test.p) }
}
