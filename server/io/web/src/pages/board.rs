use super::{Page, Part, Shell, phase, segment, write};
use crate::{
    trouble::Trouble,
    visit::{Asked, BoardQuery, Visit},
    words,
};
use askama::Template;
use avln_episode::Order;
use avln_scoring::{Direction, Key};
use avln_store::{LeaderboardRow, LeaderboardView, Pick, Visibility};
use axum::extract::Path;
use std::collections::BTreeSet;

/// Metrics of the table.
const COLUMNS: [Key; 9] = [
    Key::Sr,
    Key::Isr,
    Key::Osr,
    Key::Spl,
    Key::SoftSpl,
    Key::Steps,
    Key::PathM,
    Key::Collisions,
    Key::WrongSubmits,
];

#[derive(Template)]
#[template(path = "leaderboard.html")]
pub(super) struct BoardPage {
    shell: Shell,
    caption: String,
    view: LeaderboardView,
    columns: [Key; 9],
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

/// One board.
pub(super) async fn page(visit: Visit, Path(id): Path<String>, Asked(query): Asked<BoardQuery>) -> Page {
    write(&BoardPage::new(view(&visit, &id, query).await?))
}

/// One board, for a frame of another site.
pub(super) async fn embedded(visit: Visit, Path(id): Path<String>, Asked(query): Asked<BoardQuery>) -> Page {
    let whole = BoardPage::new(view(&visit, &id, query).await?);
    let address = whole.sorted_by(&whole.view.key);
    let BoardPage { shell, caption, view, .. } = whole;
    let columns = [Key::Sr, Key::Isr, Key::Osr, Key::Spl, Key::SoftSpl];
    write(&EmbeddedPage { title: shell.title, caption, address, view, columns })
}

async fn view(visit: &Visit, id: &str, query: BoardQuery) -> Result<LeaderboardView, Trouble> {
    let phase = phase(visit, id).await?;
    let board = query.board(&phase, visit.now_unix_ms);
    visit.reader.leaderboard(&visit.viewer, &board).await?.ok_or(Trouble::NoPage)
}

impl BoardPage {
    pub(super) fn new(view: LeaderboardView) -> Self {
        let title = format!("{}: {} goals", view.phase.title, words::order(&view.order).to_lowercase());
        let shell = Shell::new(title, Part::Boards).below("Leaderboards", "/leaderboard");
        Self { shell, caption: caption(&view), view, columns: COLUMNS }
    }

    /// What stands behind `?` for the same board with something changed; what is usual is left out.
    fn query(&self, order: Order, key: Key, pick: Pick) -> String {
        let mut parts = Vec::new();
        if self.view.phase.orders.first() != Some(&order) {
            parts.push(format!("order={order}"));
        }
        if key != self.view.phase.ranking.key {
            parts.push(format!("sort={key}"));
        }
        if pick != self.view.phase.ranking.entry {
            parts.push(format!("pick={}", words::pick(&pick)));
        }
        if parts.is_empty() { String::new() } else { format!("?{}", parts.join("&")) }
    }

    fn path(&self) -> String {
        format!("/leaderboard/{}", segment(&self.view.phase.id))
    }

    fn sorted_by(&self, key: &Key) -> String {
        self.path() + &self.query(self.view.order, *key, self.view.pick)
    }

    fn ordered_by(&self, order: &Order) -> String {
        self.path() + &self.query(*order, self.view.key, self.view.pick)
    }

    fn picked_by(&self, pick: Pick) -> String {
        self.path() + &self.query(self.view.order, self.view.key, pick)
    }

    /// The same board for programs.
    fn twin(&self, suffix: &str) -> String {
        let query = self.query(self.view.order, self.view.key, self.view.pick);
        format!("/api/v1/phases/{}/leaderboard{suffix}{query}", segment(&self.view.phase.id))
    }

    /// The same board for frames of other sites, behind `/embed`.
    fn embedded(&self) -> String {
        let query = self.query(self.view.order, self.view.key, self.view.pick);
        format!("/{}{query}", segment(&self.view.phase.id))
    }

    /// Where an entry is compared with the first, where single episodes may be seen.
    fn against_first(&self, row: &LeaderboardRow) -> Option<String> {
        let first = self.view.rows.first().filter(|first| first.run != row.run)?;
        let is_open = self.view.phase.replays == Visibility::Public;
        is_open.then(|| format!("/compare?first={}&second={}", segment(&row.run), segment(&first.run)))
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
        let first = self.view.rows.iter().find(|other| other.tie_group == row.tie_group)?;
        (first.run != row.run).then_some(first.rank)
    }
}

fn caption(view: &LeaderboardView) -> String {
    format!(
        "{} over {} in {}, ordered by {} ({}); the {} run stands for each method.{}",
        words::plural(&(view.rows.len() as u32), "method"),
        words::plural(&view.phase.episodes, "episode"),
        words::plural(&view.phase.scenes, "scene"),
        words::metric(&view.key),
        words::better(&view.direction),
        words::pick(&view.pick),
        scorers(&view.rows),
    )
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
