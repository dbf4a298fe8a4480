//! The results as a page.

mod episodes;
mod facts;
mod paired;
mod paper;

use super::{AgentVariant, Cause, ResultLine, host::results_path, results};
use avln_arena::{Failure, FailureKind};
use avln_episode::{EndReason, Modality, Order};
use avln_scoring::{Estimate, Metric, Summary};
use facts::{VariantResults, comparable, compare, mean, steps_to_first};
use paired::Paired;
use std::{fmt::Write as _, path::Path};

const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];

/// Runs in a folder.
pub struct SuiteReport {
    /// A page of tables, Markdown. It links to `results.csv` beside it.
    pub page: String,
    /// A table of all episodes, CSV.
    pub episodes: String,
}

/// Tells what was played in a folder.
///
/// # Errors
/// When nothing was played there, or the results cannot be read.
pub fn report(folder: &Path) -> Result<SuiteReport, Failure> {
    let path = results_path(folder);
    let nothing = || {
        Failure::new(FailureKind::Data, format!("nothing was played in {}", folder.display()))
            .hinted("play first: avln lab baselines run --out FOLDER")
    };
    let played = results::read(&path)?;
    let lines = comparable(played.values());
    let Some(first) = lines.first() else { return Err(nothing()) };
    let page = ReportPage { lines: &lines, first };
    let sections = [
        page.head(),
        page.main(),
        page.paper(),
        page.variants(),
        page.tests(),
        page.shares(),
        page.failures(),
    ];
    Ok(SuiteReport { page: sections.join("\n"), episodes: episodes::table(&lines) })
}

struct ReportPage<'a> {
    lines: &'a [&'a ResultLine],
    first: &'a ResultLine,
}

impl ReportPage<'_> {
    fn of(&self, variant: AgentVariant, order: Order) -> VariantResults<'_> {
        VariantResults::of(self.lines, variant, order)
    }

    /// The agents that played, in the order of tables.
    fn rungs(&self) -> impl Iterator<Item = AgentVariant> {
        AgentVariant::ALL
            .into_iter()
            .filter(|variant| self.lines.iter().any(|line| line.key.agent == variant.name()))
    }

    fn head(&self) -> String {
        let key = &self.first.key;
        let mut scenes: Vec<&str> = self.lines.iter().map(|line| line.scene.as_str()).collect();
        scenes.sort_unstable();
        scenes.dedup();
        let mut missions: Vec<&str> = self.lines.iter().map(|line| line.key.episode.as_str()).collect();
        missions.sort_unstable();
        missions.dedup();
        let hours: f64 = self.lines.iter().map(|line| line.wall_s).sum::<f64>() / 3600.0;
        format!(
            "# Results\n\nWritten by `avln lab baselines report`; do not edit. {} missions in {} houses of the public split `val` of \
             `lab/src/suite/recipe.json`, furnished from the pool for validation, which no agent was made with. Numbers are \
             percentages with 95 % intervals, resampled by house. Agents marked † are privileged: they are told what no agent may \
             know, and show what a perfect sense would be worth.\n\n\
             Program {}, benchmark {}, split `{}`, seed of agents {}, {} episodes in {hours:.1} hours of episode time. \
             [results.csv](results.csv) has each of them.\n",
            missions.len(),
            scenes.len(),
            key.program,
            key.benchmark,
            &key.split[..key.split.len().min(16)],
            key.seed,
            self.lines.len(),
        )
    }

    /// The paper's table in its form.
    fn main(&self) -> String {
        let mut text = String::from("## All agents\n");
        for order in ORDERS {
            let _ = write!(text, "\n### {}\n\n{}", heading(order), header(&["ms a step", "hours"]));
            for variant in self.rungs().filter(|variant| !variant.is_variant() || variant.is_privileged()) {
                let played = self.of(variant, order);
                let Some(summary) = played.summary() else { continue };
                let _ = writeln!(
                    text,
                    "{} {:.1} | {:.2} |",
                    row(variant, &summary),
                    played.think_ms(),
                    played.wall_h()
                );
            }
        }
        text
    }

    fn paper(&self) -> String {
        let mut text = String::from(
            "## The paper's numbers\n\nOf another data set (Matterport3D scans, other missions), as published in its table 1; \
             they cannot be compared row by row.\n\n\
             | method | audio | SR | ISR | OSR | SPL | SoftSPL | SR | ISR | OSR | SPL | SoftSPL |\n\
             |---|---|---|---|---|---|---|---|---|---|---|---|\n\
             | | | ordered | | | | | unordered | | | | |\n",
        );
        for paper::Row { method, hears, ordered, unordered } in paper::ROWS {
            let cells: Vec<_> = ordered.iter().chain(&unordered).map(|value| format!("{value:.1}")).collect();
            let _ = writeln!(text, "| {method} | {} | {} |", yes(hears), cells.join(" | "));
        }
        text
    }

    /// Ablation of PAG-Nav.
    fn variants(&self) -> String {
        let mut text = String::from("## What parts of PAG-Nav are worth\n");
        for order in ORDERS {
            let _ = write!(text, "\n### {}\n\n{}", heading(order), header(&["ISR less than PAG-Nav's"]));
            let whole = self.of(AgentVariant::PagNav, order);
            for variant in
                self.rungs().filter(|&variant| variant == AgentVariant::PagNav || variant.is_variant())
            {
                let played = self.of(variant, order);
                let Some(summary) = played.summary() else { continue };
                let test = compare(&whole, &played, |line| line.metrics.isr)
                    .filter(|_| variant != AgentVariant::PagNav);
                let less = test
                    .map_or("-".to_owned(), |test| format!("{:.1}, {}", 100.0 * test.difference, p(test)));
                let _ = writeln!(text, "{} {less} |", row(variant, &summary));
            }
        }
        text
    }

    /// PAG-Nav with and without audio on the same episodes.
    fn tests(&self) -> String {
        let mut text = String::from(
            "## What audio is worth\n\nPAG-Nav less PAG-Nav without audio on the same missions: mean differences, and by the \
             sign-flip permutation test over houses (two-sided) how likely they would be by chance. An episode without a goal \
             counts as 1000 steps to the first.\n\n| order | pairs | OSR | | steps to the first goal | |\n|---|---|---|---|---|---|\n",
        );
        for order in ORDERS {
            let (with, without) =
                (self.of(AgentVariant::PagNav, order), self.of(AgentVariant::PagNavNoAudio, order));
            let osr = compare(&with, &without, |line| 100.0 * line.metrics.osr);
            let (Some(osr), Some(steps)) = (osr, compare(&with, &without, steps_to_first)) else { continue };
            let (by, slower) = (osr.difference, steps.difference);
            let _ = writeln!(
                text,
                "| {order} | {} | {by:+.1} | {} | {slower:+.0} | {} |",
                osr.pairs,
                p(osr),
                p(steps),
                order = order.as_str()
            );
        }
        text
    }

    /// Shares of goals found, by how goals were described and by how many there were.
    fn shares(&self) -> String {
        let mut text = String::from("## Goals found, by modality and number of goals\n");
        for order in ORDERS {
            let _ = write!(
                text,
                "\n### {}\n\n| agent | category | description | image | 2 goals | 3 goals | 4 goals |\n|---|---|---|---|---|---|---|\n",
                heading(order)
            );
            for variant in self.rungs() {
                let played = self.of(variant, order);
                if played.lines.is_empty() {
                    continue;
                }
                let modalities = [Modality::Category, Modality::Description, Modality::Image];
                let shares = modalities.map(|modality| played.by_modality(modality));
                let shares = shares.into_iter().chain([2, 3, 4].map(|goals| played.by_goals(goals)));
                let cells: Vec<_> =
                    shares.map(|(share, count)| format!("{:.1} ({count})", 100.0 * share)).collect();
                let _ = writeln!(text, "| {} | {} |", name(variant), cells.join(" | "));
            }
        }
        text
    }

    /// End reasons of episodes, and reasons of Submits without completion.
    fn failures(&self) -> String {
        let mut text = String::from(
            "## What fails\n\nShares of episodes by how they ended, and Submits of an episode that completed nothing, by cause: \
             at another instance of a wanted category; near nothing that is wanted; within 4 m of a wanted target but not in its \
             region; at the target of a later goal; at a target that had been found.\n",
        );
        const ENDS: [EndReason; 4] =
            [EndReason::Stopped, EndReason::FinalSubmit, EndReason::StepLimit, EndReason::TimeBudget];
        let head: Vec<_> = ENDS.iter().map(|end| end.as_str().replace('_', " ")).collect();
        let causes: Vec<_> = Cause::ALL.iter().map(|cause| cause.words()).collect();
        for order in ORDERS {
            let rule = "---|".repeat(1 + head.len() + causes.len());
            let _ = write!(
                text,
                "\n### {}\n\n| agent | {} | {} |\n|{rule}\n",
                heading(order),
                head.join(" | "),
                causes.join(" | ")
            );
            for variant in self.rungs() {
                let lines = self.of(variant, order).lines;
                if lines.is_empty() {
                    continue;
                }
                let share = |end: EndReason| {
                    mean(lines.iter().map(|line| if line.end == end { 100.0 } else { 0.0 })).0
                };
                let count = |cause: &Cause| {
                    mean(
                        lines.iter().map(|line| line.wrong.get(cause).map_or(0.0, |&count| f64::from(count))),
                    )
                    .0
                };
                let ends = ENDS.map(|end| format!("{:.0}", share(end)));
                let causes = Cause::ALL.iter().map(|cause| format!("{:.2}", count(cause)));
                let cells: Vec<_> = ends.into_iter().chain(causes).collect();
                let _ = writeln!(text, "| {} | {} |", name(variant), cells.join(" | "));
            }
        }
        text
    }
}

fn heading(order: Order) -> &'static str {
    match order {
        Order::Ordered => "Ordered",
        Order::Unordered => "Unordered",
    }
}

fn name(variant: AgentVariant) -> String {
    format!("{}{}", variant.name(), if variant.is_privileged() { " †" } else { "" })
}

fn yes(is: bool) -> &'static str {
    if is { "yes" } else { "-" }
}

/// Header of a table of agents: the cells of [`row`], then `more`.
fn header(more: &[&str]) -> String {
    let labels = Metric::headlines().map(|metric| metric.label);
    let cells: Vec<&str> =
        ["agent", "audio", "n"].into_iter().chain(labels).chain(more.iter().copied()).collect();
    format!("| {} |\n|{}\n", cells.join(" | "), "---|".repeat(cells.len()))
}

/// First cells of a row in every table of agents.
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
