//! The suite's results page, as Markdown with charts, and the CSV table.

mod chart;
mod contrast;
mod difficulty;
mod effects;
mod paper;
mod selection;

use super::{AgentVariant, Cause, ResultLine, host::results_path, results, table};
use avln_arena::{Failure, FailureKind};
use avln_episode::{EndReason, Modality, Order};
use avln_scoring::{Estimate, Metric, Summary};
use contrast::{Contrast, ORDERS, PageSection, average, correct, list, median, p, points};
use selection::{RowResults, TrackResults, comparable};
use std::{collections::BTreeMap, fmt::Write as _, path::Path};

const ENDS: [EndReason; 3] = [EndReason::Stopped, EndReason::FinalSubmit, EndReason::StepLimit];
/// Tracks of the page's main part: the first with results.
const MAIN_TRACKS: [&str; 4] = ["main", "quick", "main-practice", "quick-practice"];
const FLOOR: &str = "sound-follower";
const TESTS: &str = "## Tests\n\nAll tests compare the same missions or the same houses. p-values are two-sided, by the sign-flip \
    permutation test over houses, and corrected for the number of tests in a family by Holm's method. The text above a table names \
    the family: a difference in two tables has a p-value for each family. Intervals are resampled by house and not \
    corrected. With 11 houses the least p-value before the correction is 1/1024. A difference is significant if p < 0.05.\n";

/// Ablations of other parts than hearing: suffix and meaning.
const ABLATIONS: [(&str, &str); 9] = [
    (
        "no-object-memory",
        "objects out of view are forgotten, and a single look verifies; room types, and the goals seen at located sources, are kept",
    ),
    ("no-second-look", "a single look verifies"),
    (
        "no-acoustic-memory",
        "sounds before the present sounding window, and while an outcome is open, are forgotten, with the estimates of sources; \
         outcomes, views and the present frontier are kept",
    ),
    (
        "no-map",
        "free floor and obstacles of the present view only; heights, rooms, objects, sounds and visited frontiers are kept",
    ),
    ("no-priors", "neutral priors"),
    ("no-gate", "claims at a plausible candidate without visual verification"),
    ("classical", "depth and colours instead of the network"),
    ("no-network", "depth and colours instead of the network"),
    ("no-extensions", "the formulas of pag-nav with the weights of pag-nav-plus"),
];

/// The results in a folder.
pub struct SuiteReport {
    /// Markdown page, with links to `results.csv` and `images/` in the same folder.
    pub page: String,
    /// CSV table with all episodes.
    pub episodes: String,
    /// SVG charts by file name in `images/`.
    pub charts: Vec<(String, String)>,
    /// Results left out, because most results have another version, seed, split, rule set or image size.
    pub left_out: usize,
}

/// Formats the results in a folder.
///
/// # Errors
/// If there are no results, or they cannot be read.
pub fn report(folder: &Path) -> Result<SuiteReport, Failure> {
    let played = results::read(&results_path(folder))?;
    let compared = comparable(played.values());
    let left_out = played.len() - compared.len();
    let report = of_lines(&compared).map(|report| SuiteReport { left_out, ..report });
    report.ok_or_else(|| {
        let message = format!("there are no results in {}", folder.display());
        Failure::new(FailureKind::Data, message)
            .hinted("run the suite first: avln lab baselines run --out FOLDER")
    })
}

/// Formats comparable results; `None` without results of a main track.
fn of_lines(lines: &[&ResultLine]) -> Option<SuiteReport> {
    let tracks = MAIN_TRACKS.map(|label| TrackResults::of(lines, label, "none"));
    let track = tracks.into_iter().find(|track| !track.lines.is_empty())?;
    let label = track.lines.first()?.key.track.clone();
    let verdicts = TrackResults::of(lines, &label, "verdict");
    let page = ReportPage { track };
    let questions = [
        difficulty::difficulty_section(&page.track),
        effects::sound_section(&page.track, &verdicts),
        effects::factors_section(&page.track),
        difficulty::hard_section(&TrackResults::of(lines, "hard", "none")),
    ];
    let mut parts = vec![head(&page.track)?, page.main(), TESTS.to_owned()];
    let mut charts = Vec::new();
    for PageSection { text, charts: own } in questions {
        parts.extend(Some(text).filter(|text| !text.is_empty()));
        charts.extend(own);
    }
    parts.extend([page.ablations(), page.shares(), page.failures(), paper::paper_section()]);
    Some(SuiteReport { page: parts.join("\n"), episodes: table::to_csv(lines), charts, left_out: 0 })
}

struct ReportPage<'a> {
    track: TrackResults<'a>,
}

impl ReportPage<'_> {
    /// Formats a table per order, with a row per agent that played.
    fn tables(
        &self,
        heading: &str,
        header: &str,
        row: impl Fn(AgentVariant, Order, &RowResults) -> Option<String>,
    ) -> String {
        let mut text = String::new();
        for order in ORDERS {
            let order_name = match order {
                Order::Ordered => "Ordered",
                Order::Unordered => "Unordered",
            };
            let _ = write!(text, "\n### {order_name}: {heading}\n\n{header}");
            for variant in self.track.variants() {
                let played = self.track.variant(variant, order);
                let row = if played.lines.is_empty() { None } else { row(variant, order, &played) };
                text.extend(row.map(|row| row + "\n"));
            }
        }
        text
    }

    fn main(&self) -> String {
        let mut labels = labels_with_floor();
        labels.extend(["ms per action", "hours"]);
        let rows = self.tables("all agents", &header_of(&labels), |variant, order, played| {
            let summary = played.summary().filter(|_| !is_ablation(variant))?;
            let think_ms = median(played.lines.iter().map(|line| line.think_ms));
            let mut cells = cells_with_floor(&self.track, variant, order, &summary);
            cells.extend([format!("{think_ms:.1}"), format!("{:.2}", wall_h(&played.lines))]);
            Some(format!("| {} |", cells.join(" | ")))
        });
        format!(
            "## All agents\n\nIn an unordered mission every sound is an unfinished target: the sound-follower, without vision, is \
             the floor. Its column lists the difference in SR on common missions, in percentage points. The time per action is \
             the median over the episodes, and depends on the load of the machine.\n{rows}"
        )
    }

    /// Compares the ablations of both presets with the preset.
    fn ablations(&self) -> String {
        let mut text = format!(
            "## Ablations of PAG-Nav\n\np-values are corrected over the rows of each preset in a table. {}\n",
            self.legend()
        );
        let header = header_of(&[&labels()[..], &["ISR of the preset minus own"]].concat());
        for order in ORDERS {
            let _ = write!(text, "\n### Ablations, {}\n\n{header}", order.as_str());
            for base in ["pag-nav-plus", "pag-nav"] {
                self.ablations_of(base, order, &mut text);
            }
        }
        text
    }

    /// Returns the meanings of the ablations with results.
    fn legend(&self) -> String {
        let ablations = || effects::SOUND_ABLATIONS.into_iter().chain(ABLATIONS);
        let is_of = |name: &str, suffix: &str| name.ends_with(&format!("-{suffix}"));
        let names: Vec<String> = self.track.variants().into_iter().map(AgentVariant::name).collect();
        let legend = effects::legend(ablations(), |suffix| names.iter().any(|name| is_of(name, suffix)));
        let is_other =
            |name: &String| name.contains("-no-") && !ablations().any(|(suffix, _)| is_of(name, suffix));
        match names.iter().any(is_other) {
            true => format!("{legend} The other ablations remove an extension of the paper."),
            false => legend,
        }
    }

    fn ablations_of(&self, base: &str, order: Order, text: &mut String) {
        let whole = self.track.row(base, order);
        let is_own =
            |variant: &AgentVariant| variant.name() == base || preset_of(&variant.name()) == Some(base);
        let own: Vec<_> = self.track.variants().into_iter().filter(is_own).collect();
        let test = |variant: &AgentVariant| {
            let label = variant.name();
            let isr = |line: &ResultLine| Some(line.metrics.isr);
            let test = whole.minus(&self.track.row(&label, order), isr).filter(|_| label != base)?;
            Some(Contrast { label, order, test })
        };
        let mut tests: Vec<Contrast> = own.iter().filter_map(test).collect();
        correct(&mut tests);
        for variant in own {
            let Some(summary) = self.track.variant(variant, order).summary() else { continue };
            let own = tests.iter().find(|contrast| contrast.label == variant.name());
            let less = own.map_or("-".to_owned(), |own| format!("{}, {}", points(&own.test), p(&own.test)));
            let _ = writeln!(text, "| {} | {less} |", cells(variant, &summary).join(" | "));
        }
    }

    fn shares(&self) -> String {
        let header = "| agent | category | description | image | 2 goals | 3 goals | 4 goals |\n|---|---|---|---|---|---|---|\n";
        let rows = self.tables("goals found", header, |variant, _, played| {
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
        let rows = self.tables("failures", &header, |variant, _, played| {
            let lines = &played.lines;
            let ends = ENDS.map(|end| {
                let ended = lines.iter().map(|line| if line.end == end { 100.0 } else { 0.0 });
                format!("{:.0}", average(ended).0)
            });
            let causes = Cause::ALL.map(|cause| {
                let counts = lines.iter().map(|line| line.wrong.get(&cause).copied().unwrap_or(0));
                format!("{:.2}", average(counts.map(f64::from)).0)
            });
            let cells: Vec<_> = ends.into_iter().chain(causes).collect();
            Some(format!("| {} | {} |", name(variant), cells.join(" | ")))
        });
        format!(
            "## Failures\n\nEpisodes by end reason, percent; and Submits per episode that completed no goal, by cause: at another \
             instance of a wanted category; near no wanted object; within 4 m of a wanted target but outside its region; \
             at a later goal's target; at a found target. Wrong Stops, also those with which PAG-Nav claims the last goal, have \
             no column.\n{rows}"
        )
    }
}

/// Returns `true` for PAG-Nav's ablations: every variant without a part.
fn is_ablation(variant: AgentVariant) -> bool {
    variant.name().contains("-no-")
}

/// Returns the preset of an ablation or a privileged variant.
fn preset_of(name: &str) -> Option<&'static str> {
    let is_variant = name.contains("-no-") || name.contains("-true-");
    let preset = ["pag-nav-plus", "pag-nav"].into_iter().find(|preset| name.starts_with(preset));
    preset.filter(|_| is_variant || name == "pag-nav-classical")
}

/// Returns the total episode time, hours.
fn wall_h(lines: &[&ResultLine]) -> f64 {
    lines.iter().map(|line| line.wall_s).sum::<f64>() / 3600.0
}

fn name(variant: AgentVariant) -> String {
    format!("{}{}", variant.name(), if variant.is_privileged() { " †" } else { "" })
}

/// Column of SR in [`labels`].
const SR_COLUMN: usize = 4;

/// Returns the labels of an agent's first cells.
fn labels() -> Vec<&'static str> {
    let metrics = Metric::headlines().map(|metric| metric.label);
    ["agent", "type", "audio", "n"].into_iter().chain(metrics).collect()
}

fn header_of(labels: &[&str]) -> String {
    format!("| {} |\n|{}\n", labels.join(" | "), "---|".repeat(labels.len()))
}

/// Returns the labels of [`cells_with_floor`].
fn labels_with_floor() -> Vec<&'static str> {
    let mut labels = labels();
    labels.insert(SR_COLUMN + 1, "SR above the sound-follower");
    labels
}

/// Returns the cells of a row, with the difference in SR to the sound-follower on common missions.
fn cells_with_floor(
    track: &TrackResults,
    variant: AgentVariant,
    order: Order,
    summary: &Summary,
) -> Vec<String> {
    let (own, floor) = (track.variant(variant, order), track.row(FLOOR, order));
    let above = own.minus(&floor, |line| Some(line.metrics.sr)).filter(|_| variant.name() != FLOOR);
    let mut cells = cells(variant, summary);
    cells.insert(SR_COLUMN + 1, above.map_or("-".to_owned(), |above| points(&above)));
    cells
}

/// Returns an agent's first cells.
fn cells(variant: AgentVariant, summary: &Summary) -> Vec<String> {
    let method_type = match variant.is_privileged() {
        true => "-".to_owned(),
        false => variant.method_type().to_string(),
    };
    let audio = if variant.hears() { "yes" } else { "-" };
    let estimates = Metric::headlines().filter_map(|metric| metric.estimate_of(summary)).map(percent);
    [name(variant), method_type, audio.to_owned(), summary.episodes.to_string()]
        .into_iter()
        .chain(estimates)
        .collect()
}

fn percent(estimate: Estimate) -> String {
    let Estimate { value, low, high } = estimate;
    format!("{:.1} [{:.1}, {:.1}]", 100.0 * value, 100.0 * low, 100.0 * high)
}

/// Returns the head; `None` without results.
fn head(track: &TrackResults<'_>) -> Option<String> {
    let key = &track.lines.first()?.key;
    let houses: BTreeMap<&str, &ResultLine> =
        track.lines.iter().map(|line| (line.scene.as_str(), *line)).collect();
    let orders = ORDERS.map(|order| missions(track, order));
    let most = orders.iter().map(BTreeMap::len).max().unwrap_or(0);
    let seed = key.split_seed.map_or_else(String::new, |seed| format!("; split seed {seed}"));
    let count = houses.len();
    let mut rows = vec![("missions", format!("{most} in {count} houses: {}{seed}", split(&key.track)))];
    let names = ["reference, ordered", "reference, unordered"];
    rows.extend(names.into_iter().zip(orders.iter().map(reference)));
    if key.track.starts_with("main") {
        let favour = "each is recognised by the bundled network, which favours agents with this network ([DATASET](DATASET.md))";
        rows.push(("targets", favour.to_owned()));
    }
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

#[cfg(test)]
mod tests;
