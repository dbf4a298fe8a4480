//! Tested differences as table rows, chart rows and text.

use super::chart::ChartRow;
use super::statistics::{Difference, holm};
use avln_episode::Order;
use std::fmt::Write as _;

pub(super) const ORDERS: [Order; 2] = [Order::Ordered, Order::Unordered];

/// A part of the page, with the charts in `images/` by file name.
#[derive(Default)]
pub(super) struct PageSection {
    pub(super) text: String,
    pub(super) charts: Vec<(String, String)>,
}

impl PageSection {
    /// Appends a chart with a description for readers without images; nothing without a chart.
    pub(super) fn add_chart(&mut self, name: &str, description: &str, svg: Option<String>) {
        let Some(svg) = svg else { return };
        let _ = write!(self.text, "\n![{description}](images/{name})\n");
        self.charts.push((name.to_owned(), svg));
    }
}

/// A tested difference, in percentage points.
pub(super) struct Contrast {
    pub(super) label: String,
    pub(super) order: Order,
    pub(super) test: Difference,
}

impl Contrast {
    /// Returns the difference with its p-value: `+12.3 points, p = 0.0010`.
    pub(super) fn words(&self) -> String {
        format!("{:+.1} points, {}", self.test.value, p(&self.test))
    }

    /// Returns the label with the order.
    pub(super) fn name(&self) -> String {
        format!("{}, {}", self.label, self.order.as_str())
    }
}

/// Corrects the p-values of a family.
pub(super) fn correct(family: &mut [Contrast]) {
    holm(family.iter_mut().map(|contrast| &mut contrast.test));
}

/// Returns a table with a row per difference in `number`.
pub(super) fn contrast_table(contrasts: &[Contrast], number: &str) -> String {
    let mut text = format!("| comparison | order | n | {number} difference | p |\n|---|---|---|---|---|\n");
    for Contrast { label, order, test } in contrasts {
        let cells = [label.clone(), order.as_str().to_owned(), test.count.to_string(), points(test), p(test)];
        let _ = writeln!(text, "| {} |", cells.join(" | "));
    }
    text
}

/// Returns the differences as chart rows.
pub(super) fn chart_rows(contrasts: &[Contrast]) -> Vec<ChartRow> {
    let row = |Contrast { label, order, test }: &Contrast| ChartRow {
        label: label.clone(),
        order: *order,
        value: test.value,
        low: test.low,
        high: test.high,
    };
    contrasts.iter().map(row).collect()
}

/// Returns a difference with its interval; `-` for the interval of a single house.
pub(super) fn points(test: &Difference) -> String {
    if test.low.is_finite() {
        format!("{:+.1} [{:+.1}, {:+.1}]", test.value, test.low, test.high)
    } else {
        format!("{:+.1} [-]", test.value)
    }
}

pub(super) fn p(test: &Difference) -> String {
    if test.p < 1e-4 { "p < 0.0001".to_owned() } else { format!("p = {:.4}", test.p) }
}

/// Joins words: `a`, `a and b`, `a, b and c`.
pub(super) fn list(words: &[String]) -> String {
    match words {
        [] => String::new(),
        [one] => one.clone(),
        [first @ .., last] => format!("{} and {last}", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_shown_with_interval_and_p() {
        let test = Difference { count: 9, scenes: 3, value: 1.5, low: -0.5, high: 3.0, p: 0.25 };
        let contrast = Contrast { label: "a - b".to_owned(), order: Order::Ordered, test };
        let table = contrast_table(&[contrast], "ISR");
        assert!(table.ends_with("| a - b | ordered | 9 | +1.5 [-0.5, +3.0] | p = 0.2500 |\n"), "{table}");
        let single = Difference { low: f64::NEG_INFINITY, high: f64::INFINITY, p: 1e-5, ..test };
        assert_eq!((points(&single), p(&single)), ("+1.5 [-]".to_owned(), "p < 0.0001".to_owned()));
    }

    #[test]
    fn lists_end_with_and() {
        let words = ["a", "b", "c"].map(str::to_owned);
        assert_eq!(
            (list(&words), list(&words[..1]), list(&[])),
            ("a, b and c".into(), "a".into(), String::new())
        );
    }
}
