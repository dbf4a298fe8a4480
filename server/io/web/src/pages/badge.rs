use super::phase;
use crate::{
    board::BoardQuery,
    trouble::Trouble,
    visit::{Asked, Nothing, Visit},
    words,
};
use askama::Template;
use avln_scoring::{Key, Summary};
use avln_store::{PhaseView, RunView};
use axum::{
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};

/// Width that a letter is given, and room on both sides of a text, pixels.
const LETTER_PX: u32 = 7;
const MARGIN_PX: u32 = 8;

/// A picture of one line: where a run stands.
#[derive(Template)]
#[template(path = "badge.svg")]
struct Badge {
    subject: Label,
    standing: Label,
}

/// A text and the room that it takes.
struct Label {
    text: String,
    text_px: u32,
    width_px: u32,
}

/// The badge of a run.
pub(super) async fn badge(
    visit: Visit,
    Path(id): Path<String>,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let view = visit.reader.run(&visit.viewer, &id).await?;
    let view = view.ok_or(Trouble::Unknown { what: "run", name: id })?;
    let phase = phase(&visit, &view.line.phase).await?;
    let subject = format!("{}, {}", phase.title, words::order(&view.line.order).to_lowercase());
    let standing = standing(&visit, &phase, &view).await?;
    let badge = Badge { subject: Label::new(subject), standing: Label::new(standing) };
    Ok(([(header::CONTENT_TYPE, "image/svg+xml")], badge.render()?).into_response())
}

/// What a badge says of a run: its score and rank by what the phase ranks by, or why it has none.
async fn standing(visit: &Visit, phase: &PhaseView, view: &RunView) -> Result<String, Trouble> {
    let line = &view.line;
    let summary = match &view.summary {
        _ if line.disqualified.is_some() => return Ok("disqualified".to_owned()),
        _ if !view.scores_visible => return Ok("scores are hidden".to_owned()),
        Some(summary) if view.eligible => summary,
        _ if line.state.is_open() => return Ok(format!("{} of {} episodes", line.done, line.episodes)),
        _ => return Ok("not ranked".to_owned()),
    };
    let board = BoardQuery::default().board(phase, line.order, visit.now_unix_ms);
    let board = visit.reader.leaderboard(&visit.viewer, &board).await?;
    let rows = board.map(|board| board.rows).unwrap_or_default();
    let standing = rows.iter().find(|row| row.run == line.run).and_then(|row| row.standing);
    let ranked = rows.iter().filter(|row| row.standing.is_some()).count();
    let rank = standing.map_or(String::new(), |standing| format!(", rank {} of {ranked}", standing.rank));
    Ok(score(phase.ranking.key, summary) + &rank)
}

/// A metric with its interval, in one line.
fn score(key: Key, summary: &Summary) -> String {
    let name = words::metric(&key);
    match words::estimate(key, summary) {
        Some(estimate) => {
            let [low, high] = [estimate.low, estimate.high].map(|share| words::number(&(100.0 * share)));
            format!("{name} {} ({low} to {high})", words::share(&estimate.value))
        }
        None => format!("{name} {}", words::number(&key.mean_of(summary))),
    }
}

impl Label {
    fn new(text: String) -> Self {
        let text_px =
            LETTER_PX * u32::try_from(text.chars().count()).unwrap_or(u32::MAX / LETTER_PX / 4).min(400);
        Self { text, text_px, width_px: text_px + 2 * MARGIN_PX }
    }
}

impl Badge {
    fn width_px(&self) -> u32 {
        self.subject.width_px + self.standing.width_px
    }
}
