use super::SCHEMA_VERSION;
use crate::{
    SignedLogs,
    board::BoardQuery,
    trouble::Trouble,
    visit::{self, Asked, CompareQuery, Nothing, RunsQuery, Visit},
    words,
};
use avln_episode::Order;
use avln_store::{EpisodeView, LeaderboardView, MissionsView, PhaseView, RunView};
use axum::{Extension, Json, extract::Path};
use serde::Serialize;
use serde_json::{Value, json};

type Answer = Result<Json<Value>, Trouble>;

pub(super) async fn status(
    visit: Visit,
    Extension(logs): Extension<Option<SignedLogs>>,
    _: Asked<Nothing>,
) -> Answer {
    visit.reader.ping().await?;
    let (version, log_key) = (env!("CARGO_PKG_VERSION"), logs.map(|logs| logs.key));
    answer(&json!({ "name": "LH-AVLN Arena", "version": version, "state": "up", "log_key": log_key }))
}

pub(super) async fn phases(visit: Visit, _: Asked<Nothing>) -> Answer {
    answer(&json!({ "phases": visit.reader.phases(&visit.viewer, visit.now_unix_ms).await? }))
}

pub(super) async fn phase(visit: Visit, Path(id): Path<String>, _: Asked<Nothing>) -> Answer {
    answer(&json!({ "phase": find_phase(&visit, &id).await? }))
}

pub(super) async fn missions(visit: Visit, Path(id): Path<String>, _: Asked<Nothing>) -> Answer {
    answer(&json!({ "missions": find_missions(&visit, &id).await? }))
}

pub(super) async fn quota(visit: Visit, _: Asked<Nothing>) -> Answer {
    answer(&json!({ "quotas": visit.reader.quotas(&visit.viewer, visit.now_unix_ms).await? }))
}

pub(super) async fn leaderboard(visit: Visit, Path(id): Path<String>, query: BoardQuery) -> Answer {
    let phase = find_phase(&visit, &id).await?;
    let order = query.order(&phase)?;
    answer(&find_board(&visit, &phase, &query, order).await?)
}

pub(super) async fn leaderboards(visit: Visit, Path(id): Path<String>, query: BoardQuery) -> Answer {
    answer(&json!({ "boards": find_boards(&visit, &id, &query).await? }))
}

pub(super) async fn compare(visit: Visit, Asked(query): Asked<CompareQuery>) -> Answer {
    answer(&query.view(&visit).await?)
}

pub(super) async fn runs(visit: Visit, Asked(query): Asked<RunsQuery>) -> Answer {
    answer(&query.list(&visit.reader, &visit.viewer).await?)
}

pub(super) async fn run(visit: Visit, Path(id): Path<String>, _: Asked<Nothing>) -> Answer {
    answer(&find_run(&visit, &id).await?)
}

pub(super) async fn episodes(visit: Visit, Path(id): Path<String>, _: Asked<Nothing>) -> Answer {
    let RunView { line, episodes, .. } = find_run(&visit, &id).await?;
    answer(&json!({ "run": line.run, "episodes": episodes }))
}

pub(super) async fn episode(
    visit: Visit,
    Path((run, place)): Path<(String, String)>,
    _: Asked<Nothing>,
) -> Answer {
    answer(&find_episode(&visit, &run, &place).await?)
}

pub(super) async fn find_episode(visit: &Visit, run: &str, place: &str) -> Result<EpisodeView, Trouble> {
    let view = visit.reader.episode(&visit.viewer, run, visit::ordinal(place)?).await?;
    view.ok_or_else(|| Trouble::Unknown { what: "episode", name: format!("{place} of run {run}") })
}

pub(super) async fn find_run(visit: &Visit, id: &str) -> Result<RunView, Trouble> {
    let view = visit.reader.run(&visit.viewer, id).await?;
    view.ok_or_else(|| Trouble::Unknown { what: "run", name: id.to_owned() })
}

pub(super) async fn find_phase(visit: &Visit, id: &str) -> Result<PhaseView, Trouble> {
    let view = visit.reader.phase(&visit.viewer, id, visit.now_unix_ms).await?;
    view.ok_or_else(|| Trouble::Unknown { what: "phase", name: id.to_owned() })
}

pub(super) async fn find_missions(visit: &Visit, phase: &str) -> Result<MissionsView, Trouble> {
    let view = visit.reader.missions(&visit.viewer, phase).await?;
    view.ok_or_else(|| Trouble::Unknown { what: "open list of missions of phase", name: phase.to_owned() })
}

/// The board that `query` asks for, for goals in one order.
pub(super) async fn find_board(
    visit: &Visit,
    phase: &PhaseView,
    query: &BoardQuery,
    order: Order,
) -> Result<LeaderboardView, Trouble> {
    if !query.columns.is_empty() {
        return Err(Trouble::Invalid("columns are chosen on pages; here are all of them".to_owned()));
    }
    let board = query.board(phase, order, visit.now_unix_ms);
    let view = visit.reader.leaderboard(&visit.viewer, &board).await?;
    view.ok_or_else(|| Trouble::Unknown { what: "phase", name: phase.id.clone() })
}

/// The boards of a phase in all its orders.
pub(super) async fn find_boards(
    visit: &Visit,
    id: &str,
    query: &BoardQuery,
) -> Result<Vec<LeaderboardView>, Trouble> {
    if query.orders.is_some() {
        return Err(Trouble::Invalid("all orders are here; leave order out".to_owned()));
    }
    let phase = find_phase(visit, id).await?;
    let mut boards = Vec::new();
    for &order in &phase.orders {
        boards.push(find_board(visit, &phase, query, order).await?);
    }
    Ok(boards)
}

/// The object `body` with the version of its schema, and with moments by RFC 3339.
fn answer(body: &impl Serialize) -> Answer {
    let mut value = serde_json::to_value(body)?;
    name_moments(&mut value);
    if let Value::Object(fields) = &mut value {
        fields.insert("schema_version".to_owned(), SCHEMA_VERSION.into());
    }
    Ok(Json(value))
}

/// Turns every `x_unix_ms` into `x_at`.
pub(crate) fn name_moments(value: &mut Value) {
    match value {
        Value::Array(items) => items.iter_mut().for_each(name_moments),
        Value::Object(fields) => {
            for (mut name, mut value) in std::mem::take(fields) {
                name_moments(&mut value);
                if let Some(stem) = name.strip_suffix("_unix_ms") {
                    value = value.as_i64().map_or(Value::Null, |ms| words::rfc3339(ms).into());
                    name = format!("{stem}_at");
                }
                fields.insert(name, value);
            }
        }
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_told_by_rfc_3339_at_every_depth() {
        let mut value = json!({ "finished_unix_ms": null, "runs": [{ "created_unix_ms": 1000, "n": 2 }] });
        name_moments(&mut value);
        let expected =
            json!({ "finished_at": null, "runs": [{ "created_at": "1970-01-01T00:00:01Z", "n": 2 }] });
        assert_eq!(value, expected);
    }
}
