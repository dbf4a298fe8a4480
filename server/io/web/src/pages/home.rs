use super::{Page, Part, Shell, write};
use crate::{
    board::BoardQuery,
    visit::{Asked, Host, Nothing, Visit},
    words,
};
use askama::Template;
use avln_scoring::Key;
use avln_store::{LeaderboardView, PhaseState, PhaseView};

/// Entries of a board that the first page shows.
const TOP: usize = 3;

#[derive(Template)]
#[template(path = "home.html")]
struct HomePage {
    shell: Shell,
    phases: Vec<PhaseView>,
    host: Host,
    example: String,
    boards: Vec<LeaderboardView>,
    columns: [Key; 4],
}

#[derive(Template)]
#[template(path = "boards.html")]
struct BoardsPage {
    shell: Shell,
    phases: Vec<PhaseView>,
}

/// Phases, how to take part, and who leads.
pub(super) async fn home(visit: Visit, host: Host, _: Asked<Nothing>) -> Page {
    let phases = visit.reader.phases(&visit.viewer, visit.now_unix_ms).await?;
    let mut boards = Vec::new();
    for phase in &phases {
        for &order in &phase.orders {
            let board = BoardQuery::default().board(phase, order, visit.now_unix_ms);
            boards.extend(visit.reader.leaderboard(&visit.viewer, &board).await?);
        }
    }
    boards.retain(|board| !board.rows.is_empty());
    boards.iter_mut().for_each(|board| board.rows.truncate(TOP));
    let example = phases.iter().find(|phase| phase.state == PhaseState::Open);
    let example = example.map_or_else(|| "PHASE".to_owned(), |phase| phase.id.clone());
    let columns = [Key::Sr, Key::Isr, Key::Spl, Key::SoftSpl];
    write(&HomePage {
        shell: Shell::new("LH-AVLN Arena", Part::Home),
        phases,
        host,
        example,
        boards,
        columns,
    })
}

/// A list of all boards.
pub(super) async fn boards(visit: Visit, _: Asked<Nothing>) -> Page {
    let phases = visit.reader.phases(&visit.viewer, visit.now_unix_ms).await?;
    write(&BoardsPage { shell: Shell::new("Leaderboards", Part::Boards), phases })
}
