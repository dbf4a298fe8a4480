//! Plots as SVG. They are drawn in the classes of the style sheet, so that they follow the theme, and never say anything by colour
//! alone.

pub(crate) mod curves;

use std::fmt::Write as _;

/// Text as the content of an element.
fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// Width of a bar and least width of a part that has its count written on it, pixels.
const WIDTH_PX: f64 = 600.0;
const LABEL_PX: f64 = 26.0;
/// Kinds of parts that the style sheet can tell apart.
const KINDS: usize = 6;

/// A bar of parts, one after the other, each as wide as its count; empty without any. What the parts are a list beside it has to say,
/// in the same order. Digits only, so it needs no escaping.
pub(crate) fn stacked(counts: &[u32]) -> String {
    let all: u32 = counts.iter().sum();
    if all == 0 {
        return String::new();
    }
    let mut svg = format!("<svg class=\"stacked\" viewBox=\"0 0 {WIDTH_PX} 28\" aria-hidden=\"true\">");
    let mut left = 0.0;
    for (place, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let width = WIDTH_PX * f64::from(count) / f64::from(all);
        let inner = (width - 2.0).max(1.0);
        let _ = write!(
            svg,
            "<rect class=\"part{}\" x=\"{left:.1}\" y=\"2\" width=\"{inner:.1}\" height=\"24\"/>",
            place % KINDS
        );
        if width >= LABEL_PX {
            let middle = left + inner / 2.0;
            let _ = write!(
                svg,
                "<text class=\"part{}\" x=\"{middle:.1}\" y=\"19\">{count}</text>",
                place % KINDS
            );
        }
        left += width;
    }
    svg + "</svg>"
}

/// A bar as long as a count among others of which the largest is `most`. The count must stand beside it.
pub(crate) fn bar(count: &u32, most: u32) -> String {
    let width = 100.0 * f64::from(*count) / f64::from(most.max(1));
    format!(
        "<svg class=\"count\" viewBox=\"0 0 100 10\" preserveAspectRatio=\"none\" aria-hidden=\"true\">\
         <rect width=\"{width:.1}\" height=\"10\"/></svg>"
    )
}

/// The sign of a part in the list beside a bar.
pub(crate) fn sign(place: &usize) -> String {
    let kind = place % KINDS;
    format!(
        "<svg class=\"sign\" viewBox=\"0 0 14 14\" aria-hidden=\"true\"><rect class=\"part{kind}\" width=\"14\" height=\"14\"/></svg>"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_as_wide_as_their_counts() {
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
