mod both;
mod choice;

use super::{Part, Shell, phase, segment, write};
use crate::{
    board::{BoardQuery, Orders},
    trouble::Trouble,
    visit::Visit,
    words,
};
use askama::Template;
use avln_episode::Order;
use avln_scoring::{Direction, Key};
use avln_store::{LeaderboardRow, LeaderboardView, PhaseView, RunChoice, Visibility};
use axum::{
    extract::Path,
    response::{IntoResponse, Redirect, Response},
};
use choice::Choice;
use std::collections::BTreeSet;

#[derive(Template)]
#[template(path = "leaderboard.html")]
pub(super) struct BoardPage {
    shell: Shell,
    caption: String,
    view: LeaderboardView,
    columns: Vec<Key>,
    choice: Choice,
    /// The orders that are shown.
    orders: Orders,
    /// Who leads the whole board.
    first: Option<String>,
}

/// The same without anything around it, for other sites to show in a frame.
#[derive(Template)]
#[template(path = "embed.html")]
struct EmbeddedPage {
    title: String,
    caption: String,
    /// Of the board with everything around it.
    address: String,
    view: LeaderboardView,
    columns: [Key; 5],
}

/// One board, or all of a phase side by side.
pub(super) async fn page(
    visit: Visit,
    Path(id): Path<String>,
    query: BoardQuery,
) -> Result<Response, Trouble> {
    let phase = phase(&visit, &id).await?;
    if query.has_blanks {
        let address = format!("/leaderboard/{}{}", segment(&id), query.address(&phase));
        return Ok(Redirect::to(&address).into_response());
    }
    if query.shown_orders(&phase) == Orders::Both {
        return Ok(both::page(&visit, phase, query).await?.into_response());
    }
    let order = query.order(&phase)?;
    let view = whole(&visit, &phase, &query, order).await?;
    Ok(write(&BoardPage::new(view, &query))?.into_response())
}

/// One board, for a frame of another site.
pub(super) async fn embedded(
    visit: Visit,
    Path(id): Path<String>,
    query: BoardQuery,
) -> Result<Response, Trouble> {
    let phase = phase(&visit, &id).await?;
    let order = query.order(&phase)?;
    let page = BoardPage::new(whole(&visit, &phase, &query, order).await?, &query);
    let address = page.choice.path() + &query.address(&phase);
    let BoardPage { shell, caption, view, .. } = page;
    let columns = [Key::Sr, Key::Isr, Key::Osr, Key::Spl, Key::SoftSpl];
    Ok(write(&EmbeddedPage { title: shell.title, caption, address, view, columns })?.into_response())
}

/// A board with all its entries.
async fn whole(
    visit: &Visit,
    phase: &PhaseView,
    query: &BoardQuery,
    order: Order,
) -> Result<LeaderboardView, Trouble> {
    let board = query.board(phase, order, visit.now_unix_ms);
    visit.reader.leaderboard(&visit.viewer, &board).await?.ok_or(Trouble::NoPage)
}

impl BoardPage {
    /// The page of a board that has all its entries yet.
    pub(super) fn new(view: LeaderboardView, query: &BoardQuery) -> Self {
        let title = format!("{}: {} goals", view.phase.title, words::order(&view.order).to_lowercase());
        let shell = Shell::new(title, Part::Boards).below("Leaderboards", "/leaderboard");
        let choice = Choice::new(query, &view);
        let first = view.leader.clone();
        let columns = query.shown_columns(view.key);
        let orders = Orders::One(view.order);
        Self { shell, caption: caption(&view), columns, choice, orders, first, view }
    }

    /// The same board for programs.
    fn twin(&self, suffix: &str) -> String {
        self.choice.twin(&format!("leaderboard{suffix}"))
    }

    /// The same board for frames of other sites, behind `/embed`.
    fn embedded(&self) -> String {
        format!("/{}{}", segment(&self.view.phase.id), self.choice.query.address(&self.view.phase))
    }

    /// Where an entry is compared with the first, where single episodes may be seen.
    fn against_first(&self, row: &LeaderboardRow) -> Option<String> {
        let first = self.first.as_ref().filter(|first| **first != row.run)?;
        let is_open = self.view.phase.replays == Visibility::Public;
        is_open.then(|| format!("/compare?first={}&second={}", segment(&row.run), segment(first)))
    }

    fn is_key(&self, key: &Key) -> bool {
        self.view.key == *key
    }

    /// The value of `aria-sort`.
    fn aria_sort(&self, key: &Key) -> &'static str {
        match key.direction() {
            _ if !self.is_key(key) => "none",
            Direction::Higher => "descending",
            Direction::Lower => "ascending",
        }
    }

    /// The rank of the entry that this one cannot be told apart from.
    fn tied_with(&self, row: &LeaderboardRow) -> Option<u32> {
        tied_with(&self.view.rows, row)
    }
}

/// The rank of the first entry of a row's group, where that is another one.
fn tied_with(rows: &[LeaderboardRow], row: &LeaderboardRow) -> Option<u32> {
    let group = |row: &LeaderboardRow| row.standing.map(|standing| standing.tie_group);
    let own = group(row)?;
    let first = rows.iter().find(|other| group(other) == Some(own))?;
    first.standing.filter(|_| first.run != row.run).map(|standing| standing.rank)
}

fn caption(view: &LeaderboardView) -> String {
    format!(
        "{} over {} in {}, ordered by {} ({}); the {} run stands for each method{}.{}",
        shown(view.rows.len() as u32, view.entries),
        words::plural(&view.phase.episodes, "episode"),
        words::plural(&view.phase.scenes, "scene"),
        words::metric(&view.key),
        words::better(&view.direction),
        words::pick(&view.pick),
        as_of(view),
        scorers(&view.rows),
    )
}

/// How many methods are shown, and among how many they are ranked.
fn shown(rows: u32, entries: u32) -> String {
    if rows == entries {
        return words::plural(&entries, "method");
    }
    format!("{rows} of {}, ranked among all of them,", words::plural(&entries, "method"))
}

/// Until when runs are on the board, where not all of them are.
fn as_of(view: &LeaderboardView) -> String {
    view.as_of_unix_ms.map_or_else(String::new, |moment| {
        format!(", as it stood at the end of {} UTC", crate::board::day(moment))
    })
}

/// By which versions of the benchmark the entries were scored.
fn scorers(rows: &[LeaderboardRow]) -> String {
    let versions: BTreeSet<&str> =
        rows.iter().map(|row| row.scorer.as_str()).filter(|v| !v.is_empty()).collect();
    let listed = versions.iter().copied().collect::<Vec<_>>().join(", ");
    match versions.len() {
        0 => String::new(),
        1 => format!(" Scored by benchmark {listed}."),
        _ => format!(" Scored by benchmarks {listed}: see each run."),
    }
}
