//! Curves over the steps of an episode, with a cursor that the clock moves.

use super::escape;
use std::fmt::Write as _;

/// Size of a plot and where its axes are, pixels.
const SIZE_PX: [f64; 2] = [640.0, 210.0];
pub(crate) const LEFT_PX: f64 = 84.0;
pub(crate) const WIDTH_PX: f64 = 520.0;
const TOP_PX: f64 = 12.0;
const HEIGHT_PX: f64 = 158.0;
/// Least distance between labels at the ends of lines, pixels.
const LABEL_PX: f64 = 17.0;
/// Kinds of lines that the style sheet can tell apart.
pub(crate) const KINDS: usize = 4;

/// What is drawn.
pub(crate) struct Curves<'a> {
    /// Values of the vertical axis, the lowest first, and what stands beside them.
    pub(crate) ticks: Vec<(f64, String)>,
    pub(crate) lines: Vec<Line<'a>>,
    /// Values that are drawn across.
    pub(crate) levels: Vec<(f64, &'a str)>,
    /// The last step.
    pub(crate) last: u32,
    /// The step that the cursor stands at.
    pub(crate) step: u32,
}

/// Values that belong together.
pub(crate) struct Line<'a> {
    /// Which look it has.
    pub(crate) kind: usize,
    /// What stands at its last point.
    pub(crate) label: &'a str,
    /// Steps and values; a line is broken where there is no number.
    pub(crate) points: Vec<(u32, f64)>,
}

/// Round values from 0 to `most` at least, six at most.
pub(crate) fn round_ticks(most: f64) -> Vec<f64> {
    let most = if most.is_finite() && most > 0.0 { most } else { 1.0 };
    let power = 10_f64.powf((most / 5.0).log10().floor());
    let fits = |step: &f64| most / step <= 5.0 + 1e-9;
    let step =
        [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(fits).unwrap_or(10.0 * power);
    (0..=(most / step - 1e-9).ceil() as u32).map(|index| f64::from(index) * step).collect()
}

/// Where a step is on the horizontal axis.
pub(crate) fn x_of(step: u32, last: u32) -> f64 {
    LEFT_PX + WIDTH_PX * f64::from(step) / f64::from(last.max(1))
}

impl Curves<'_> {
    /// The plot. What it says must stand beside it in words.
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
        for line in &self.lines {
            let _ = write!(svg, "<path class=\"line{}\" d=\"{}\"/>", line.kind % KINDS, self.path(line));
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
            let _ = write!(
                svg,
                "<text class=\"tick\" x=\"{}\" y=\"{:.1}\">{}</text>",
                LEFT_PX - 8.0,
                y + 4.5,
                escape(words)
            );
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

    fn path(&self, line: &Line<'_>) -> String {
        let mut path = String::new();
        let mut pen_is_down = false;
        for &(step, value) in &line.points {
            if value.is_finite() {
                let command = if pen_is_down { 'L' } else { 'M' };
                let _ = write!(path, "{command}{:.1} {:.1}", x_of(step, self.last), self.y_of(value));
            }
            pen_is_down = value.is_finite();
        }
        path
    }

    /// Labels right of the last points, moved apart.
    fn draw_labels(&self, svg: &mut String) {
        let end = |line: &Line<'_>| {
            line.points.iter().rev().map(|(_, value)| *value).find(|value| value.is_finite())
        };
        let mut labels: Vec<(f64, &str)> =
            self.lines.iter().filter_map(|line| Some((self.y_of(end(line)?), line.label))).collect();
        labels.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut above = f64::NEG_INFINITY;
        for (y, label) in labels {
            above = y.max(above + LABEL_PX);
            let x = LEFT_PX + WIDTH_PX + 8.0;
            let _ = write!(svg, "<text x=\"{x}\" y=\"{:.1}\">{}</text>", above + 4.5, escape(label));
        }
    }
}

/// The sign of a line in the list beside a plot.
pub(crate) fn line_sign(kind: &usize) -> String {
    let kind = kind % KINDS;
    format!(
        "<svg class=\"narrow\" viewBox=\"0 0 40 16\" aria-hidden=\"true\"><path class=\"line{kind}\" d=\"M0 8H40\"/></svg>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_reach_the_top() {
        assert_eq!(round_ticks(10.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(round_ticks(7.3), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(round_ticks(1000.0), [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0]);
        assert_eq!(round_ticks(3.0), [0.0, 1.0, 2.0, 3.0]);
        assert_eq!(round_ticks(f64::NAN).len(), 6);
        assert_eq!(round_ticks(0.0).len(), 6);
    }

    #[test]
    fn lines_are_broken_where_there_is_no_number_and_labels_are_escaped() {
        let points = vec![(0, 0.0), (1, 1.0), (2, f64::NAN), (3, 0.5), (4, 9.0)];
        let lines = vec![Line { kind: 5, label: "<b>", points }];
        let ticks = vec![(0.0, "0".to_owned()), (1.0, "1".to_owned())];
        let svg = Curves { ticks, lines, levels: vec![], last: 4, step: 9 }.svg();
        assert!(svg.contains("class=\"line1\" d=\"M84.0 170.0L214.0 12.0M474.0 91.0L604.0 12.0\""), "{svg}");
        assert!(svg.contains("&lt;b&gt;") && !svg.contains("<b>"), "{svg}");
        assert!(svg.contains("translate(520.0 0)"), "the cursor stays on the plot: {svg}");
    }
}
