//! SVG plots. They use style sheet classes, which follow the theme, and never convey information only by colour.

use std::fmt::Write as _;

const SIZE_PX: [f64; 2] = [640.0, 210.0];
pub(crate) const LEFT_PX: f64 = 84.0;
pub(crate) const WIDTH_PX: f64 = 520.0;
const TOP_PX: f64 = 12.0;
const HEIGHT_PX: f64 = 158.0;
const LABEL_PX: f64 = 17.0;
const KINDS: usize = 4;

/// Curves over the steps of an episode, with a cursor that the replay moves.
pub(crate) struct Curves<'a> {
    /// Vertical axis: values and labels, lowest first.
    pub(crate) ticks: Vec<(f64, String)>,
    pub(crate) curves: Vec<Curve<'a>>,
    /// Horizontal lines with their labels.
    pub(crate) levels: Vec<(f64, &'a str)>,
    pub(crate) last: u32,
    pub(crate) step: u32,
}

pub(crate) struct Curve<'a> {
    pub(crate) kind: usize,
    pub(crate) label: &'a str,
    /// Steps and values. NaN interrupts the curve.
    pub(crate) points: Vec<(u32, f64)>,
}

pub(crate) fn round_ticks(most: f64) -> Vec<f64> {
    let most = if most.is_finite() && most > 0.0 { most } else { 1.0 };
    let power = 10_f64.powf((most / 5.0).log10().floor());
    let fits = |step: &f64| most / step <= 5.0 + 1e-9;
    let step =
        [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(fits).unwrap_or(10.0 * power);
    (0..=(most / step - 1e-9).ceil() as u32).map(|index| f64::from(index) * step).collect()
}

fn x_of(step: u32, last: u32) -> f64 {
    LEFT_PX + WIDTH_PX * f64::from(step) / f64::from(last.max(1))
}

impl Curves<'_> {
    /// Draws the plot. It is hidden from screen readers, so the page must describe it in words.
    pub(crate) fn svg(&self) -> String {
        let [width, height] = SIZE_PX;
        let mut svg = format!("<svg class=\"curves\" viewBox=\"0 0 {width} {height}\" aria-hidden=\"true\">");
        self.draw_axes(&mut svg);
        for (value, label) in &self.levels {
            let y = self.y_of(*value);
            let right = LEFT_PX + WIDTH_PX;
            let _ = write!(svg, "<path class=\"level\" d=\"M{LEFT_PX} {y:.1}H{right}\"/>");
            let _ =
                write!(svg, "<text x=\"{}\" y=\"{:.1}\">{}</text>", LEFT_PX + 6.0, y - 4.0, escape(label));
        }
        for curve in &self.curves {
            let _ = write!(svg, "<path class=\"line{}\" d=\"{}\"/>", curve.kind % KINDS, self.path(curve));
        }
        self.draw_labels(&mut svg);
        let x = x_of(self.step.min(self.last), self.last) - LEFT_PX;
        let (low, high) = (TOP_PX, TOP_PX + HEIGHT_PX);
        let _ = write!(
            svg,
            "<path class=\"cursor\" data-cursor=\"\" d=\"M{LEFT_PX} {low}V{high}\" transform=\"translate({x:.1} 0)\"/></svg>"
        );
        svg
    }

    fn y_of(&self, value: f64) -> f64 {
        let (low, high) = match (self.ticks.first(), self.ticks.last()) {
            (Some((low, _)), Some((high, _))) if high > low => (*low, *high),
            _ => (0.0, 1.0),
        };
        TOP_PX + HEIGHT_PX * (1.0 - ((value - low) / (high - low)).clamp(0.0, 1.0))
    }

    fn draw_axes(&self, svg: &mut String) {
        let (right, bottom) = (LEFT_PX + WIDTH_PX, TOP_PX + HEIGHT_PX);
        for (value, words) in &self.ticks {
            let y = self.y_of(*value);
            let _ = write!(svg, "<path class=\"grid\" d=\"M{LEFT_PX} {y:.1}H{right}\"/>");
            let (x, y) = (LEFT_PX - 8.0, y + 4.5);
            let _ = write!(svg, "<text class=\"tick\" x=\"{x}\" y=\"{y:.1}\">{}</text>", escape(words));
        }
        let is_step = |step: &f64| step.fract() == 0.0 && *step <= f64::from(self.last);
        for step in round_ticks(f64::from(self.last)).into_iter().filter(is_step) {
            let x = x_of(step as u32, self.last);
            let _ = write!(
                svg,
                "<path class=\"grid\" d=\"M{x:.1} {bottom}v5\"/><text class=\"below\" x=\"{x:.1}\" y=\"{}\">{step}</text>",
                bottom + 22.0
            );
        }
    }

    fn path(&self, curve: &Curve<'_>) -> String {
        let mut path = String::new();
        let mut pen_is_down = false;
        for &(step, value) in &curve.points {
            if value.is_finite() {
                let command = if pen_is_down { 'L' } else { 'M' };
                let _ = write!(path, "{command}{:.1} {:.1}", x_of(step, self.last), self.y_of(value));
            }
            pen_is_down = value.is_finite();
        }
        path
    }

    /// Draws labels after the last points, without overlaps.
    fn draw_labels(&self, svg: &mut String) {
        let end = |curve: &Curve<'_>| {
            curve.points.iter().rev().map(|(_, value)| *value).find(|value| value.is_finite())
        };
        let mut labels: Vec<(f64, &str)> =
            self.curves.iter().filter_map(|curve| Some((self.y_of(end(curve)?), curve.label))).collect();
        labels.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut above = f64::NEG_INFINITY;
        for (y, label) in labels {
            above = y.max(above + LABEL_PX);
            let x = LEFT_PX + WIDTH_PX + 8.0;
            let _ = write!(svg, "<text x=\"{x}\" y=\"{:.1}\">{}</text>", above + 4.5, escape(label));
        }
    }
}

pub(crate) fn curve_sign(kind: &usize) -> String {
    let kind = kind % KINDS;
    format!(
        "<svg class=\"narrow\" viewBox=\"0 0 40 16\" aria-hidden=\"true\"><path class=\"line{kind}\" d=\"M0 8H40\"/></svg>"
    )
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

const BAR_WIDTH_PX: f64 = 600.0;
const COUNT_WIDTH_PX: f64 = 26.0;
const BAR_KINDS: usize = 6;

/// Draws a stacked bar with the counts as widths; empty if all are 0. The page must list the parts in the same order.
pub(crate) fn stacked(counts: &[u32]) -> String {
    let all: u32 = counts.iter().sum();
    if all == 0 {
        return String::new();
    }
    let mut svg = format!("<svg class=\"stacked\" viewBox=\"0 0 {BAR_WIDTH_PX} 28\" aria-hidden=\"true\">");
    let mut left = 0.0;
    for (index, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let width = BAR_WIDTH_PX * f64::from(count) / f64::from(all);
        let inner = (width - 2.0).max(1.0);
        let kind = index % BAR_KINDS;
        let _ = write!(
            svg,
            "<rect class=\"part{kind}\" x=\"{left:.1}\" y=\"2\" width=\"{inner:.1}\" height=\"24\"/>"
        );
        if width >= COUNT_WIDTH_PX {
            let middle = left + inner / 2.0;
            let _ = write!(svg, "<text class=\"part{kind}\" x=\"{middle:.1}\" y=\"19\">{count}</text>");
        }
        left += width;
    }
    svg + "</svg>"
}

pub(crate) fn bar(count: &u32, most: u32) -> String {
    let width = 100.0 * f64::from(*count) / f64::from(most.max(1));
    format!(
        "<svg class=\"count\" viewBox=\"0 0 100 10\" preserveAspectRatio=\"none\" aria-hidden=\"true\">\
         <rect width=\"{width:.1}\" height=\"10\"/></svg>"
    )
}

pub(crate) fn bar_sign(index: &usize) -> String {
    let kind = index % BAR_KINDS;
    format!(
        "<svg class=\"sign\" viewBox=\"0 0 14 14\" aria-hidden=\"true\"><rect class=\"part{kind}\" width=\"14\" height=\"14\"/></svg>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_cover_the_range() {
        assert_eq!(round_ticks(10.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(round_ticks(7.3), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(round_ticks(1000.0), [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0]);
        assert_eq!(round_ticks(3.0), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(round_ticks(f64::NAN).len(), 6);
        assert_eq!(round_ticks(0.0).len(), 6);
    }

    #[test]
    fn curves_break_at_nan_and_escape_labels() {
        let points = vec![(0, 0.0), (1, 1.0), (2, f64::NAN), (3, 0.5), (4, 9.0)];
        let curves = vec![Curve { kind: 5, label: "<b>", points }];
        let ticks = vec![(0.0, "0".to_owned()), (1.0, "1".to_owned())];
        let svg = Curves { ticks, curves, levels: vec![], last: 4, step: 9 }.svg();
        assert!(svg.contains("class=\"line1\" d=\"M84.0 170.0L214.0 12.0M474.0 91.0L604.0 12.0\""), "{svg}");
        assert!(svg.contains("&lt;b&gt;") && !svg.contains("<b>"), "{svg}");
        assert!(svg.contains("translate(520.0 0)"), "the cursor stays on the plot: {svg}");
    }

    #[test]
    fn widths_follow_counts() {
        let bar = stacked(&[30, 0, 10, 1]);
        assert_eq!(bar.matches("<rect").count(), 3);
        assert!(bar.contains("class=\"part0\" x=\"0.0\" y=\"2\" width=\"437.0\""), "{bar}");
        assert!(bar.contains("class=\"part2\" x=\"439.0\" y=\"2\" width=\"144.3\""), "{bar}");
        assert!(
            bar.contains(">30</text>") && bar.contains(">10</text>") && !bar.contains(">1</text>"),
            "{bar}"
        );
        assert_eq!(stacked(&[0, 0]), "");
    }
}
