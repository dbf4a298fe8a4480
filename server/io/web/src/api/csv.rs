//! Tables by RFC 4180: a header, CRLF, quotes where they are needed, numbers in full.

use super::answers::{find_board, find_boards, find_episode, find_missions, find_phase, find_run};
use crate::{
    board::BoardQuery,
    onlooker::{Levels, MaybeDesk},
    replay::{Moment, moments},
    trouble::Trouble,
    visit::{Asked, CompareQuery, Nothing, RunsQuery, Visit},
    words::{self, estimate},
};
use avln_episode::{EndReason, Order, Sensors};
use avln_scoring::{Key, Metrics, Standing};
use avln_store::{EpisodeLine, LeaderboardRow, LeaderboardView, MissionsView, PairView, Reference, RunLine};
use axum::{
    Extension,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};

pub(super) async fn leaderboard(
    visit: Visit,
    Path(id): Path<String>,
    query: BoardQuery,
) -> Result<Response, Trouble> {
    let phase = find_phase(&visit, &id).await?;
    let order = query.order(&phase)?;
    Ok(boards(&[find_board(&visit, &phase, &query, order).await?]))
}

pub(super) async fn leaderboards(
    visit: Visit,
    Path(id): Path<String>,
    query: BoardQuery,
) -> Result<Response, Trouble> {
    Ok(boards(&find_boards(&visit, &id, &query).await?))
}

fn boards(views: &[LeaderboardView]) -> Response {
    let rows = views.iter().flat_map(|view| view.rows.iter().map(|row| board_row(view.order, row)));
    file(board_header(), rows)
}

/// How often missions of a phase have each property.
pub(super) async fn missions(
    visit: Visit,
    Path(id): Path<String>,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let view = find_missions(&visit, &id).await?;
    Ok(file(names(&["property", "value", "count"]), mission_rows(&view).into_iter()))
}

/// The episodes that two runs both played, with what each was worth in both.
pub(super) async fn compare(visit: Visit, Asked(query): Asked<CompareQuery>) -> Result<Response, Trouble> {
    let view = query.view(&visit).await?;
    Ok(file(pairs_header(), view.episodes.iter().map(pair_row)))
}

pub(super) async fn runs(visit: Visit, Asked(query): Asked<RunsQuery>) -> Result<Response, Trouble> {
    let list = query.list(&visit.reader, &visit.viewer).await?;
    Ok(file(runs_header(), list.runs.iter().map(run_row)))
}

pub(super) async fn episodes(
    visit: Visit,
    Path(id): Path<String>,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let view = find_run(&visit, &id).await?;
    Ok(file(episodes_header(), view.episodes.iter().map(episode_row)))
}

/// The moments of a replay; there is no table where the phase does not show it.
pub(super) async fn steps(
    visit: Visit,
    Path((run, place)): Path<(String, String)>,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let replay = find_episode(&visit, &run, &place).await?.replay;
    let name = || format!("episode {place} of run {run}");
    let replay = replay.ok_or_else(|| Trouble::Unknown { what: "replay", name: name() })?;
    let rows = moments(&replay);
    let places = replay.path.iter().zip(&rows);
    Ok(file(steps_header(replay.targets.len()), places.map(|(place, moment)| step_row(place, moment))))
}

/// How loud each step was at both ears, where the phase shows the replay and the agent asked for sound.
pub(super) async fn levels(
    visit: Visit,
    Path((run, place)): Path<(String, String)>,
    Extension(desk): Extension<MaybeDesk>,
    _: Asked<Nothing>,
) -> Result<Response, Trouble> {
    let view = find_episode(&visit, &run, &place).await?;
    let none = || Trouble::Unknown { what: "sound", name: format!("of episode {place} of run {run}") };
    let sound = desk.ok_or_else(none)?.sound(&view).await?.ok_or_else(none)?;
    let header = names(&["step", "left_rms_pa", "right_rms_pa", "left_db", "right_db"]);
    Ok(file(header, (0..).zip(sound.levels()).map(level_row)))
}

fn level_row((step, levels): (u32, &Levels)) -> Vec<String> {
    let mut cells = vec![step.to_string()];
    cells.extend(levels.rms.map(|rms| rms.to_string()));
    cells.extend(levels.ears_db().map(maybe));
    cells
}

fn file(header: Vec<String>, rows: impl Iterator<Item = Vec<String>>) -> Response {
    let mut table = line(&header);
    rows.for_each(|row| table += &line(&row));
    ([(header::CONTENT_TYPE, "text/csv; charset=utf-8; header=present")], table).into_response()
}

fn line(cells: &[String]) -> String {
    cells.join(",") + "\r\n"
}

/// A cell of text. What a spreadsheet would take for a formula begins with an apostrophe.
fn text(text: &str) -> String {
    let guard = if text.starts_with(['=', '+', '-', '@', '\t', '\r']) { "'" } else { "" };
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{guard}{}\"", text.replace('"', "\"\""))
    } else {
        format!("{guard}{text}")
    }
}

/// A cell that is empty where there is nothing.
fn maybe(value: Option<impl ToString>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

fn moment(unix_ms: Option<i64>) -> String {
    maybe(unix_ms.map(words::rfc3339))
}

fn names(names: &[&str]) -> Vec<String> {
    names.iter().map(|&name| name.to_owned()).collect()
}

fn board_header() -> Vec<String> {
    let mut header = names(&[
        "rank",
        "rank_low",
        "rank_high",
        "tie_group",
        "team",
        "reference",
        "method",
        "version",
        "run",
    ]);
    header.extend(names(&["runs_count", "median", "finished_at", "episodes", "scenes"]));
    for key in Key::ALL {
        header.push(key.to_string());
        if has_interval(key) {
            header.extend([format!("{key}_low"), format!("{key}_high")]);
        }
    }
    header.extend(names(&["isr_by_goal", "osr_all", "wrong_instance_submits"]));
    header.extend(names(&["steps_to_goal", "final_distance_m"]));
    header.extend(EndReason::ALL.map(|reason| format!("ended_{}", reason.as_str())));
    header.extend(names(&["server_faults", "scorer", "order", "rgb", "depth", "audio", "verified"]));
    header
}

fn has_interval(key: Key) -> bool {
    !matches!(key, Key::Steps | Key::PathM | Key::Collisions | Key::WrongSubmits)
}

fn board_row(order: Order, row: &LeaderboardRow) -> Vec<String> {
    let summary = &row.summary;
    let mut cells = standing_cells(row.standing);
    cells.extend([text(&row.team), maybe(row.reference.map(Reference::as_str))]);
    cells.extend([text(&row.method), text(&row.version), text(&row.run)]);
    cells.extend([row.runs_count.to_string(), row.median.to_string(), moment(row.finished_unix_ms)]);
    cells.extend([summary.episodes.to_string(), summary.scenes.to_string()]);
    for key in Key::ALL {
        cells.push(key.mean_of(summary).to_string());
        if let Some(estimate) = estimate(key, summary) {
            cells.extend([estimate.low.to_string(), estimate.high.to_string()]);
        }
    }
    cells.extend([summary.isr_by_goal.to_string(), summary.osr_all.to_string()]);
    cells.push(summary.wrong_instance_submits.to_string());
    cells.extend([maybe(summary.steps_to_goal), maybe(summary.final_distance_m)]);
    cells.extend(EndReason::ALL.map(|reason| maybe(row.health.get(reason.as_str()).or(Some(&0)))));
    cells.extend([row.server_faults.to_string(), text(&row.scorer), order.to_string()]);
    let senses = row.sensors.as_ref().map(|Sensors { rgb, depth, audio, .. }| [*rgb, *depth, *audio]);
    cells.extend([0, 1, 2].map(|sense| maybe(senses.map(|senses| senses[sense]))));
    cells.push(row.verified.to_string());
    cells
}

/// Rank, its interval and its tie group, all empty for a reference.
fn standing_cells(standing: Option<Standing>) -> Vec<String> {
    let numbers = standing.map(|s| [s.rank, s.rank_low, s.rank_high, s.tie_group]);
    (0..4).map(|index| maybe(numbers.map(|numbers| numbers[index]))).collect()
}

fn mission_rows(view: &MissionsView) -> Vec<Vec<String>> {
    let row = |property: &str, value: String, count: u32| vec![property.to_owned(), value, count.to_string()];
    let goals = view.goals.iter().map(|(goals, count)| row("goals", goals.to_string(), *count));
    let modalities = view.modalities.iter().map(|(name, count)| row("modality", text(name), *count));
    let categories = view.categories.iter().map(|(name, count)| row("category", text(name), *count));
    let scenes = view.scenes.iter().map(|(name, count)| row("scene", text(name), *count));
    let tours = view.reference_m.iter().map(|length| row("reference_m", length.to_string(), 1));
    goals.chain(modalities).chain(categories).chain(scenes).chain(tours).collect()
}

fn pairs_header() -> Vec<String> {
    let mut header = names(&["episode", "scene", "goals", "first_ordinal", "second_ordinal"]);
    header.extend(Key::ALL.into_iter().flat_map(|key| [format!("first_{key}"), format!("second_{key}")]));
    header
}

fn pair_row(pair: &PairView) -> Vec<String> {
    let mut cells = vec![text(&pair.episode), text(&pair.scene), pair.first.goals.to_string()];
    cells.extend([pair.first_ordinal, pair.second_ordinal].map(|ordinal| ordinal.to_string()));
    let both = |key: Key| [&pair.first, &pair.second].map(|metrics| key.of(metrics).to_string());
    cells.extend(Key::ALL.into_iter().flat_map(both));
    cells
}

fn runs_header() -> Vec<String> {
    let mut header = names(&["run", "phase", "team", "reference", "method", "version", "order", "state"]);
    header.extend(names(&[
        "episodes",
        "done",
        "isr",
        "created_at",
        "finished_at",
        "verified",
        "disqualified",
    ]));
    header
}

fn run_row(line: &RunLine) -> Vec<String> {
    let mut cells = [&line.run, &line.phase, &line.team].map(|name| text(name)).to_vec();
    cells.push(maybe(line.reference.map(Reference::as_str)));
    cells.extend([text(&line.method), text(&line.version), line.order.to_string()]);
    cells.extend([line.state.as_str().to_owned(), line.episodes.to_string(), line.done.to_string()]);
    cells.extend([maybe(line.isr), moment(Some(line.created_unix_ms)), moment(line.finished_unix_ms)]);
    cells.extend([line.verified.to_string(), text(line.disqualified.as_deref().unwrap_or_default())]);
    cells
}

fn episodes_header() -> Vec<String> {
    let mut header = names(&["ordinal", "state", "end", "episode", "scene", "finished_at", "goals", "found"]);
    header.extend(names(&["sr", "isr", "osr", "osr_all", "spl", "soft_spl", "sna", "steps", "path_m"]));
    header.extend(names(&["reference_m", "collisions", "wrong_submits", "wrong_instance_submits"]));
    header
}

fn episode_row(line: &EpisodeLine) -> Vec<String> {
    let mut cells = vec![line.ordinal.to_string(), text(line.state.as_str())];
    cells.push(maybe(line.end.map(EndReason::as_str)));
    cells.push(text(line.episode.as_deref().unwrap_or_default()));
    cells.push(text(line.scene.as_deref().unwrap_or_default()));
    cells.push(moment(line.finished_unix_ms));
    match &line.metrics {
        Some(metrics) => cells.extend(metric_cells(metrics)),
        None => cells.extend(std::iter::repeat_n(String::new(), 15)),
    }
    cells
}

fn steps_header(goals: usize) -> Vec<String> {
    let mut header = names(&["step", "action", "x_m", "y_m", "z_m", "heading_rad", "collided"]);
    header.extend(names(&["sounding_goal", "bearing_rad", "walked_m", "actions_left", "submits_left"]));
    header.extend((1..=goals).map(|goal| format!("distance_{goal}_m")));
    header
}

fn step_row(place: &[f32; 3], moment: &Moment) -> Vec<String> {
    let mut cells = vec![moment.step.to_string(), text(moment.action.as_deref().unwrap_or_default())];
    cells.extend(place.map(|metres| metres.to_string()));
    cells.extend([moment.heading_rad.to_string(), moment.collided.to_string()]);
    cells.push(maybe(moment.sounding.map(|goal| u32::from(goal) + 1)));
    cells.extend([maybe(moment.bearing_rad), moment.walked_m.to_string()]);
    cells.extend([moment.actions_left.to_string(), moment.submits_left.to_string()]);
    cells.extend(moment.distances_m.iter().map(ToString::to_string));
    cells
}

fn metric_cells(m: &Metrics) -> [String; 15] {
    [
        m.goals.to_string(),
        m.found.to_string(),
        m.sr.to_string(),
        m.isr.to_string(),
        m.osr.to_string(),
        m.osr_all.to_string(),
        m.spl.to_string(),
        m.soft_spl.to_string(),
        m.sna.to_string(),
        m.steps.to_string(),
        m.path_m.to_string(),
        m.reference_m.to_string(),
        m.collisions.to_string(),
        m.wrong_submits.to_string(),
        m.wrong_instance_submits.to_string(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_quoted_and_never_a_formula() {
        assert_eq!(text("plain"), "plain");
        assert_eq!(text("a,b"), "\"a,b\"");
        assert_eq!(text("say \"hi\""), "\"say \"\"hi\"\"\"");
        for start in ['=', '+', '-', '@', '\t'] {
            assert_eq!(text(&format!("{start}1")), format!("'{start}1"));
        }
        assert_eq!(text("\rx"), "\"'\rx\"");
        assert_eq!(text("=1,2"), "\"'=1,2\"");
        assert_eq!(text("1-2"), "1-2");
    }
}
