//! A chart of values with intervals, as SVG.

use avln_episode::Order;
use std::fmt::Write as _;

const WIDTH: f64 = 760.0;
/// Width of the labels.
const LABELS: f64 = 330.0;
const MARGIN: f64 = 24.0;
const ROW_HEIGHT: f64 = 20.0;
/// Height above the first row: title and legend.
const HEAD: f64 = 58.0;
/// Height below the last row: axis.
const FOOT: f64 = 46.0;
const MOST_TICKS: f64 = 8.0;

/// A value with its interval.
pub(super) struct ChartRow {
    pub(super) label: String,
    pub(super) order: Order,
    pub(super) value: f64,
    pub(super) low: f64,
    pub(super) high: f64,
}

/// A chart with a row per value.
pub(super) struct Chart<'a> {
    pub(super) title: &'a str,
    pub(super) axis: &'a str,
    pub(super) rows: Vec<ChartRow>,
}

impl Chart<'_> {
    /// Returns the SVG document; `None` without rows.
    pub(super) fn svg(&self) -> Option<String> {
        let scale = Scale::of(&self.rows)?;
        let height = HEAD + FOOT + ROW_HEIGHT * self.rows.len() as f64;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" role=\"img\" \
             font-family=\"sans-serif\" font-size=\"12\">\n<title>{title}</title>\n\
             <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n\
             <text x=\"{MARGIN}\" y=\"24\" font-size=\"15\" fill=\"#222\">{title}</text>\n",
            title = escaped(self.title),
        );
        self.legend(&mut svg);
        self.axis(&mut svg, &scale, height);
        for (index, row) in self.rows.iter().enumerate() {
            draw(&mut svg, &scale, row, HEAD + ROW_HEIGHT * (index as f64 + 0.5));
        }
        svg.push_str("</svg>\n");
        Some(svg)
    }

    fn legend(&self, svg: &mut String) {
        for (order, x) in [(Order::Ordered, LABELS), (Order::Unordered, LABELS + 110.0)] {
            svg.push_str(&mark(order, x, 40.0));
            let _ =
                writeln!(svg, "<text x=\"{}\" y=\"44\" fill=\"#222\">{}</text>", x + 10.0, order.as_str());
        }
    }

    fn axis(&self, svg: &mut String, scale: &Scale, height: f64) {
        let bottom = height - FOOT;
        for tick in scale.ticks() {
            let (x, colour) = (scale.x(tick), if tick == 0.0 { "#555" } else { "#ddd" });
            let _ = writeln!(
                svg,
                "<line x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{HEAD}\" y2=\"{bottom}\" stroke=\"{colour}\"/>\
                 <text x=\"{x:.1}\" y=\"{}\" text-anchor=\"middle\" fill=\"#222\">{tick}</text>",
                bottom + 16.0
            );
        }
        let middle = (LABELS + WIDTH - MARGIN) / 2.0;
        let axis = escaped(self.axis);
        let y = bottom + 36.0;
        let _ = writeln!(
            svg,
            "<text x=\"{middle}\" y=\"{y}\" text-anchor=\"middle\" fill=\"#222\">{axis}</text>"
        );
    }
}

/// Draws a row at the height `y`.
fn draw(svg: &mut String, scale: &Scale, row: &ChartRow, y: f64) {
    let label = escaped(&row.label);
    let _ = writeln!(
        svg,
        "<text x=\"{}\" y=\"{}\" text-anchor=\"end\" fill=\"#222\">{label}</text>",
        LABELS - 12.0,
        y + 4.0
    );
    let (low, high) = (scale.x(scale.clamped(row.low)), scale.x(scale.clamped(row.high)));
    let colour = colour(row.order);
    let _ = writeln!(
        svg,
        "<line x1=\"{low:.1}\" x2=\"{high:.1}\" y1=\"{y}\" y2=\"{y}\" stroke=\"{colour}\" stroke-width=\"2\"/>"
    );
    svg.push_str(&mark(row.order, scale.x(row.value), y));
}

fn colour(order: Order) -> &'static str {
    match order {
        Order::Ordered => "#1b5e9e",
        Order::Unordered => "#b3541e",
    }
}

/// Returns the mark of an order: shapes differ too, for readers without colours.
fn mark(order: Order, x: f64, y: f64) -> String {
    let colour = colour(order);
    match order {
        Order::Ordered => format!("<circle cx=\"{x:.1}\" cy=\"{y}\" r=\"4.5\" fill=\"{colour}\"/>\n"),
        Order::Unordered => {
            let (left, top) = (x - 4.0, y - 4.0);
            format!("<rect x=\"{left:.1}\" y=\"{top}\" width=\"8\" height=\"8\" fill=\"{colour}\"/>\n")
        }
    }
}

/// The axis: 0 and all finite ends, extended to whole ticks.
struct Scale {
    low: f64,
    high: f64,
    tick: f64,
}

impl Scale {
    fn of(rows: &[ChartRow]) -> Option<Self> {
        if rows.is_empty() {
            return None;
        }
        let ends = rows.iter().flat_map(|row| [row.low, row.value, row.high]).filter(|end| end.is_finite());
        let (low, high) = ends.fold((0.0_f64, 1.0_f64), |(low, high), end| (low.min(end), high.max(end)));
        let steps = [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0];
        let fits = |tick: &f64| (high - low) / tick <= MOST_TICKS;
        let tick = steps.into_iter().find(fits).unwrap_or(1000.0);
        Some(Self { low: (low / tick).floor() * tick, high: (high / tick).ceil() * tick, tick })
    }

    fn x(&self, value: f64) -> f64 {
        LABELS + (value - self.low) / (self.high - self.low) * (WIDTH - MARGIN - LABELS)
    }

    fn clamped(&self, value: f64) -> f64 {
        value.clamp(self.low, self.high)
    }

    fn ticks(&self) -> impl Iterator<Item = f64> {
        let count = ((self.high - self.low) / self.tick).round() as usize;
        (0..=count).map(|index| self.low + index as f64 * self.tick)
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(value: f64, low: f64, high: f64) -> ChartRow {
        ChartRow { label: "a < b".to_owned(), order: Order::Ordered, value, low, high }
    }

    #[test]
    fn axis_includes_zero_and_all_intervals() {
        let scale =
            Scale::of(&[row(12.0, -3.0, 31.0), row(5.0, f64::NEG_INFINITY, f64::INFINITY)]).expect("rows");
        assert_eq!((scale.low, scale.high, scale.tick), (-5.0, 35.0, 5.0));
        assert_eq!(scale.ticks().count(), 9);
        assert_eq!((scale.x(-5.0), scale.x(35.0)), (LABELS, WIDTH - MARGIN));
        assert!(Scale::of(&[]).is_none());
    }

    #[test]
    fn chart_is_a_complete_document() {
        let chart = Chart { title: "A & B", axis: "points", rows: vec![row(1.0, 0.5, f64::INFINITY)] };
        let svg = chart.svg().expect("rows");
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"), "{svg}");
        assert!(svg.contains("<title>A &amp; B</title>") && svg.contains("a &lt; b"), "{svg}");
        assert!(!svg.contains("inf") && !svg.contains("NaN"), "{svg}");
        assert_eq!(chart.svg().expect("rows"), svg);
    }
}
