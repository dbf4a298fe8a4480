use super::lines::{Solid, xz};
use crate::PagNav;
use avln_kit::map::{CELL_M, Cell, Object, Occupancy};
use serde::Serialize;
use std::fmt::Write;

/// Most words for one object.
const WORDS: usize = 3;

/// What is remembered of the surroundings.
#[derive(Serialize)]
pub(super) struct MapLine {
    step: u32,
    #[serde(flatten)]
    plan: Plan,
    objects: Vec<ObjectNote>,
}

/// The floor plan: rows of cells, in runs.
#[derive(Serialize)]
pub(super) struct Plan {
    cell_m: f32,
    /// The corner of the first cell with the lowest coordinates.
    min_m: [f32; 2],
    pub(super) columns: u32,
    pub(super) rows: u32,
    pub(super) cells: String,
}

#[derive(Serialize)]
struct ObjectNote {
    object: usize,
    #[serde(flatten)]
    solid: Solid,
    /// The likeliest categories, with their likelihoods.
    words: Vec<(String, f32)>,
    /// Visual compatibility with each goal.
    vis: Vec<f32>,
    looks: u32,
    views: u32,
    wrong_submits: i32,
}

impl MapLine {
    pub(super) fn new(agent: &PagNav, step: u32) -> Self {
        let objects = agent.objects.all().iter().enumerate();
        let note = |(index, object)| ObjectNote::new(index, object, agent.queries.len());
        Self { step, plan: Plan::of(&agent.map), objects: objects.map(note).collect() }
    }
}

impl Plan {
    pub(super) fn of(map: &Occupancy) -> Self {
        // The map is a square around the start.
        let last = 2 * Cell::at(Default::default()).column - 1;
        let inside = |cell: Cell| Cell { column: cell.column.clamp(0, last), row: cell.row.clamp(0, last) };
        let [low, high] = map.area(0.0).map(|corner| inside(Cell::at(corner)));
        let rows = low.row..=high.row;
        let cells = rows.flat_map(|row| (low.column..=high.column).map(move |column| Cell { column, row }));
        let [x, z] = xz(low.center());
        Self {
            cell_m: CELL_M,
            min_m: [x - 0.5 * CELL_M, z - 0.5 * CELL_M],
            columns: low.column.abs_diff(high.column) + 1,
            rows: low.row.abs_diff(high.row) + 1,
            cells: runs(cells.map(|cell| state(map, cell))),
        }
    }
}

impl ObjectNote {
    fn new(index: usize, object: &Object, goals: usize) -> Self {
        let thing = &object.thing;
        let mut words = thing.kinds.clone();
        words.sort_by(|a, b| b.1.total_cmp(&a.1));
        words.truncate(WORDS);
        Self {
            object: index,
            solid: Solid::of(thing),
            words,
            vis: (0..goals).map(|goal| object.vis(goal)).collect(),
            looks: object.looks,
            views: thing.views,
            wrong_submits: object.wrong_submits,
        }
    }
}

/// The letter of a cell: wall, lower obstacle, free floor or unknown.
fn state(map: &Occupancy, cell: Cell) -> char {
    match cell {
        cell if map.is_wall(cell) => 'w',
        cell if map.is_obstacle(cell) => 'o',
        cell if map.is_free(cell) => 'f',
        _ => 'u',
    }
}

/// Letters as runs of length and letter: `uuuf` as `3u1f`.
pub(super) fn runs(letters: impl Iterator<Item = char>) -> String {
    let mut text = String::new();
    let mut letters = letters.peekable();
    while let Some(letter) = letters.next() {
        let mut count = 1;
        while letters.next_if_eq(&letter).is_some() {
            count += 1;
        }
        let _ = write!(text, "{count}{letter}");
    }
    text
}
