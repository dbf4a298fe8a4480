//! The paper's tables.

use std::fmt::Write as _;

/// SR, ISR, OSR, SPL and SoftSPL, percent; `None` for an empty row.
type PaperNumbers = Option<[f64; 5]>;

/// A row of a table in the paper.
struct PaperRow {
    method: &'static str,
    method_type: &'static str,
    hears: bool,
    ordered: PaperNumbers,
    unordered: PaperNumbers,
}

const fn row(
    method: &'static str,
    method_type: &'static str,
    hears: bool,
    [ordered, unordered]: [PaperNumbers; 2],
) -> PaperRow {
    PaperRow { method, method_type, hears, ordered, unordered }
}

const fn both(ordered: [f64; 5], unordered: [f64; 5]) -> [PaperNumbers; 2] {
    [Some(ordered), Some(unordered)]
}

const EMPTY: [PaperNumbers; 2] = [None, None];

/// Table 2, and AVLEN: the text names it among the baselines, the table omits it.
const METHODS: [PaperRow; 7] = [
    row("MTU3D", "training-free", false, both([1.7, 15.5, 47.6, 1.5, 8.8], [2.1, 17.3, 41.3, 1.1, 9.8])),
    row("3D-Mem", "training-free", false, both([0.0, 11.6, 23.7, 0.0, 8.6], [1.0, 14.8, 28.0, 0.7, 9.2])),
    row("SAVi", "pretrained", true, both([0.0, 0.1, 34.4, 0.0, 0.1], [0.0, 0.7, 35.1, 0.0, 0.5])),
    row("GOAT-Bench", "training-free", false, both([0.0, 7.9, 9.1, 0.2, 7.9], [0.2, 8.9, 9.2, 0.2, 8.9])),
    row("SCOPE", "training-free", false, EMPTY),
    row("AVLEN", "pretrained", true, EMPTY),
    row("PAG-Nav", "training-free", true, both([2.3, 17.5, 66.5, 1.8, 12.9], [3.1, 31.5, 55.6, 1.8, 14.8])),
];

/// The table of the appendix.
const APPENDIX: [PaperRow; 5] = [
    row("MAV-Nav", "DTR", true, both([2.2, 18.6, 45.9, 0.5, 11.9], [6.0, 35.2, 42.9, 3.6, 26.9])),
    row(
        "MAV-Nav without audio",
        "ablation",
        false,
        both([0.9, 8.0, 33.5, 0.4, 4.7], [1.3, 17.2, 35.2, 0.3, 9.0]),
    ),
    row(
        "MAV-Nav without image and text",
        "ablation",
        true,
        both([1.1, 17.8, 43.3, 0.6, 12.1], [4.5, 34.9, 43.4, 2.5, 27.3]),
    ),
    row("DAgger only", "imitation", true, EMPTY),
    row("Direct PPO", "RL", true, EMPTY),
];

/// Returns the section with the paper's numbers.
pub(super) fn paper_section() -> String {
    let mut text = String::from(
        "## The paper's numbers\n\nFrom another data set (Matterport3D scans, other missions): table 2 of the paper, and the \
         table of its appendix. The rows are not comparable with the tables above. Empty rows are empty in the paper; AVLEN is \
         a baseline of its text without a row. Numbers marked \\* are impossible: by the formula, SPL never exceeds SR.\n\n\
         | method | type | audio | SR | ISR | OSR | SPL | SoftSPL | SR | ISR | OSR | SPL | SoftSPL |\n\
         |---|---|---|---|---|---|---|---|---|---|---|---|---|\n\
         | | | | ordered | | | | | unordered | | | | |\n",
    );
    for PaperRow { method, method_type, hears, ordered, unordered } in METHODS.iter().chain(&APPENDIX) {
        let cells = [cells(ordered), cells(unordered)].concat().join(" | ");
        let audio = if *hears { "yes" } else { "-" };
        let _ = writeln!(text, "| {method} | {method_type} | {audio} | {cells} |");
    }
    text
}

fn cells(numbers: &PaperNumbers) -> Vec<String> {
    let Some(numbers) = numbers else { return vec!["-".to_owned(); 5] };
    let [sr, _, _, spl, _] = *numbers;
    let cell = |(column, value): (usize, &f64)| {
        let mark = if column == 3 && spl > sr { "\\*" } else { "" };
        format!("{value:.1}{mark}")
    };
    numbers.iter().enumerate().map(cell).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_and_empty_numbers_are_marked() {
        let text = paper_section();
        let row =
            |name: &str| text.lines().find(|line| line.starts_with(&format!("| {name} |"))).expect("a row");
        assert_eq!(text.matches("\\* |").count(), 1, "{text}");
        assert!(row("GOAT-Bench").contains("| 0.0 | 7.9 | 9.1 | 0.2\\* | 7.9 |"), "{text}");
        for name in ["SCOPE", "AVLEN", "DAgger only", "Direct PPO"] {
            assert!(row(name).ends_with(&format!("{}|", "| - ".repeat(10))), "{name}");
        }
        assert!(text.lines().skip(4).all(|line| line.matches('|').count() == 14), "{text}");
    }
}
