use super::{Choice, tied_with, whole};
use crate::{
    board::{BoardQuery, Orders},
    pages::{Page, Part, Shell, write},
    visit::Visit,
    words,
};
use askama::Template;
use avln_scoring::{Direction, Key};
use avln_store::{LeaderboardRow, LeaderboardView, PhaseView, RunChoice};
use std::collections::BTreeMap;

/// Metrics of each order.
const COLUMNS: [Key; 5] = [Key::Sr, Key::Isr, Key::Osr, Key::Spl, Key::SoftSpl];

#[derive(Template)]
#[template(path = "leaderboards.html")]
struct BothPage {
    shell: Shell,
    caption: String,
    /// The boards with the entries that are wanted, in the phase's order.
    views: Vec<LeaderboardView>,
    lines: Vec<Line>,
    choice: Choice,
    orders: Orders,
    columns: Vec<Key>,
}

/// A method of a team, with what it reached in each order.
struct Line {
    /// Any of its runs, for what is the same in all.
    any: LeaderboardRow,
    /// In the phase's order of orders.
    sides: Vec<Option<Side>>,
}

struct Side {
    row: LeaderboardRow,
    /// Line of the board, from the top.
    place: usize,
    tied_with: Option<u32>,
}

/// All boards of a phase side by side.
pub(super) async fn page(visit: &Visit, phase: PhaseView, query: BoardQuery) -> Page {
    let mut views = Vec::new();
    for &order in &phase.orders {
        views.push(whole(visit, &phase, &query, order).await?);
    }
    let title = format!("{}: all orders of goals", phase.title);
    let shell = Shell::new(title, Part::Boards).below("Leaderboards", "/leaderboard");
    let Some(first) = views.first() else { return Err(crate::trouble::Trouble::NoPage) };
    let mut choice = Choice::new(&query, first);
    choice.teams.extend(views.iter().flat_map(|view| view.teams.iter().cloned()));
    let columns = COLUMNS.into_iter().filter(|key| query.columns.is_empty() || query.columns.contains(key));
    let columns = columns.collect();
    let (lines, caption) = (lines(&views), caption(&views, &choice));
    write(&BothPage { shell, caption, views, lines, choice, orders: Orders::Both, columns })
}

/// The methods, in the order of their best places on the boards, the first board first.
fn lines(views: &[LeaderboardView]) -> Vec<Line> {
    let mut lines: BTreeMap<(&str, &str), Line> = BTreeMap::new();
    for (order, view) in views.iter().enumerate() {
        for (place, row) in view.rows.iter().enumerate() {
            let line = lines
                .entry((&row.team, &row.method))
                .or_insert_with(|| Line { any: row.clone(), sides: views.iter().map(|_| None).collect() });
            line.sides[order] = Some(Side { row: row.clone(), place, tied_with: tied_with(&view.rows, row) });
        }
    }
    let mut lines: Vec<Line> = lines.into_values().collect();
    let ranks = |line: &Line| -> Vec<usize> {
        line.sides.iter().map(|side| side.as_ref().map_or(usize::MAX, |side| side.place)).collect()
    };
    lines.sort_by_key(ranks);
    lines
}

fn caption(views: &[LeaderboardView], choice: &Choice) -> String {
    let counts: Vec<String> = views
        .iter()
        .map(|view| {
            format!("{}: {}", words::order(&view.order), super::shown(view.rows.len() as u32, view.entries))
        })
        .collect();
    let as_of = views.first().map_or_else(String::new, super::as_of);
    format!(
        "{}. Ranked by {} ({}) in each order; the {} run stands for each method{as_of}.",
        counts.join("; "),
        words::metric(&choice.key),
        words::better(&choice.key.direction()),
        words::pick(&choice.pick),
    )
}

impl BothPage {
    fn is_key(&self, key: &Key) -> bool {
        self.choice.key == *key
    }

    /// Whether the viewer sees some teams only.
    fn is_partial(&self) -> bool {
        self.views.iter().any(|view| !view.complete)
    }

    /// The same boards for programs.
    fn twins(&self) -> [(&'static str, String); 2] {
        [("CSV", self.choice.twin("leaderboards.csv")), ("JSON", self.choice.twin("leaderboards"))]
    }
}
