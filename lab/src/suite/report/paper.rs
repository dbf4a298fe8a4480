//! Table 1 of the paper, as percentages: SR, ISR, OSR, SPL, SoftSPL ordered, then unordered.

/// A row of the paper's table.
pub(super) struct Row {
    pub(super) method: &'static str,
    pub(super) hears: bool,
    pub(super) ordered: [f64; 5],
    pub(super) unordered: [f64; 5],
}

const fn row(method: &'static str, hears: bool, ordered: [f64; 5], unordered: [f64; 5]) -> Row {
    Row { method, hears, ordered, unordered }
}

pub(super) const ROWS: [Row; 5] = [
    row("MTU3D", false, [1.7, 15.5, 47.6, 1.5, 8.8], [2.1, 17.3, 41.3, 1.1, 9.8]),
    row("3D-Mem", false, [0.0, 11.6, 23.7, 0.0, 8.6], [1.0, 14.8, 28.0, 0.7, 9.2]),
    row("SAVi", true, [0.0, 0.1, 34.4, 0.0, 0.1], [0.0, 0.7, 35.1, 0.0, 0.5]),
    row("GOAT-Bench", false, [0.0, 7.9, 9.1, 0.2, 7.9], [0.2, 8.9, 9.2, 0.2, 8.9]),
    row("PAG-Nav", true, [2.3, 17.5, 66.5, 1.8, 12.9], [3.1, 31.5, 55.6, 1.8, 14.8]),
];
