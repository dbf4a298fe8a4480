//! CSV tables by RFC 4180: a header row, CRLF, and numbers in full precision.

use super::json::{find_leaderboard, find_leaderboards};
use crate::{
    error::{RequestError, Result},
    format,
    leaderboard::LeaderboardParams,
    replay::{Moment, moments},
    replay_renderer::{MaybeRenderQueue, StepLevels},
    request::{CompareQuery, PathOnly, RequestContext, RunsQuery, StrictQuery},
};
use avln_challenge::MethodType;
use avln_episode::{EndReason, Order, Sensors};
use avln_scoring::{EpisodeValue, Estimate, Key, METRICS, Metric, Standing, SummaryValue};
use avln_store::{EpisodeLine, LeaderboardRow, LeaderboardView, MissionsView, PairView, Reference, RunLine};
use axum::{
    Extension,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};
use csv::{Terminator, WriterBuilder};
use std::error::Error;

/// A row definition. A single list for names and cells prevents a header that does not match the rows.
struct Row<T>(Vec<Column<T>>);

struct Column<T> {
    name: String,
    cell: Box<dyn Fn(&T) -> String>,
}

impl<T> Row<T> {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn value(mut self, name: impl Into<String>, cell: impl Fn(&T) -> String + 'static) -> Self {
        self.0.push(Column { name: name.into(), cell: Box::new(cell) });
        self
    }

    fn text(self, name: &str, cell: impl Fn(&T) -> &str + 'static) -> Self {
        self.value(name, move |row| without_formula(cell(row)))
    }

    fn values<I>(mut self, items: impl IntoIterator<Item = I>, add: impl Fn(Self, I) -> Self) -> Self {
        for item in items {
            self = add(self, item);
        }
        self
    }

    fn respond<'a>(&self, rows: impl IntoIterator<Item = &'a T>) -> Result<Response>
    where
        T: 'a,
    {
        let write = || -> Result<Vec<u8>, Box<dyn Error>> {
            let mut writer = WriterBuilder::new().terminator(Terminator::CRLF).from_writer(Vec::new());
            writer.write_record(self.0.iter().map(|column| &column.name))?;
            for row in rows {
                writer.write_record(self.0.iter().map(|column| (column.cell)(row)))?;
            }
            Ok(writer.into_inner()?)
        };
        let table = write().map_err(|error| {
            tracing::error!(%error, "cannot write a CSV table");
            RequestError::Internal
        })?;
        Ok(([(header::CONTENT_TYPE, "text/csv; charset=utf-8; header=present")], table).into_response())
    }
}

// A spreadsheet would execute such a text as a formula; the apostrophe prevents that.
fn without_formula(text: &str) -> String {
    let guard = if text.starts_with(['=', '+', '-', '@', '\t', '\r']) { "'" } else { "" };
    format!("{guard}{text}")
}

/// A cell that is empty for `None`.
fn maybe(value: Option<impl ToString>) -> String {
    value.map(|value| value.to_string()).unwrap_or_default()
}

fn maybe_time(unix_ms: Option<i64>) -> String {
    maybe(unix_ms.map(format::rfc3339))
}

pub(super) async fn leaderboard(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> Result<Response> {
    leaderboard_table(vec![find_leaderboard(&context, &id, &params).await?])
}

pub(super) async fn leaderboards(
    context: RequestContext,
    Path(id): Path<String>,
    params: LeaderboardParams,
) -> Result<Response> {
    leaderboard_table(find_leaderboards(&context, &id, &params).await?)
}

struct OrderedRow {
    order: Order,
    row: LeaderboardRow,
}

fn leaderboard_table(views: Vec<LeaderboardView>) -> Result<Response> {
    let entries = views.into_iter().flat_map(|view| {
        let order = view.order;
        view.rows.into_iter().map(move |row| OrderedRow { order, row })
    });
    let standing =
        |value: fn(&Standing) -> u32| move |r: &OrderedRow| maybe(r.row.standing.as_ref().map(value));
    let sensor = |value: fn(&Sensors) -> bool| move |r: &OrderedRow| maybe(r.row.sensors.as_ref().map(value));
    Row::<OrderedRow>::new()
        .value("rank", standing(|s| s.rank))
        .value("rank_low", standing(|s| s.rank_low))
        .value("rank_high", standing(|s| s.rank_high))
        .value("tie_group", standing(|s| s.tie_group))
        .text("team", |r| &r.row.team)
        .value("reference", |r| maybe(r.row.reference.map(Reference::as_str)))
        .text("method", |r| &r.row.method)
        .text("version", |r| &r.row.version)
        .text("run", |r| &r.row.run)
        .value("runs_count", |r| r.row.runs_count.to_string())
        .value("median", |r| r.row.median.to_string())
        .value("finished_at", |r| maybe_time(r.row.finished_unix_ms))
        .value("episodes", |r| r.row.summary.episodes.to_string())
        .value("scenes", |r| r.row.summary.scenes.to_string())
        // Ranking keys first: the column order is part of the format.
        .values(METRICS.iter().filter(|metric| metric.key.is_some()), summary_columns)
        .values(METRICS.iter().filter(|metric| metric.key.is_none()), summary_columns)
        .values(EndReason::ALL, |row, reason| {
            row.value(format!("ended_{}", reason.as_str()), move |r| {
                r.row.health.get(reason.as_str()).copied().unwrap_or(0).to_string()
            })
        })
        .value("server_faults", |r| r.row.server_faults.to_string())
        .text("scorer", |r| &r.row.scorer)
        .value("order", |r| r.order.to_string())
        .value("rgb", sensor(|s| s.rgb))
        .value("depth", sensor(|s| s.depth))
        .value("audio", sensor(|s| s.audio))
        .value("verified", |r| r.row.verified.to_string())
        .value("type", |r| maybe(r.row.method_type.map(MethodType::as_str)))
        .respond(&entries.collect::<Vec<_>>())
}

fn summary_columns(row: Row<OrderedRow>, metric: &'static Metric) -> Row<OrderedRow> {
    let id = metric.id;
    let mean = move |r: &OrderedRow| maybe(metric.mean_of(&r.row.summary));
    let bound = |value: fn(Estimate) -> f64| {
        move |r: &OrderedRow| maybe(metric.estimate_of(&r.row.summary).map(value))
    };
    match metric.summary {
        SummaryValue::None => row,
        SummaryValue::Mean(_) | SummaryValue::GoalMean(_) => row.value(id, mean),
        SummaryValue::Estimate(_) => row
            .value(id, mean)
            .value(format!("{id}_low"), bound(|e| e.low))
            .value(format!("{id}_high"), bound(|e| e.high)),
    }
}

pub(super) async fn missions(context: RequestContext, PathOnly(id): PathOnly<String>) -> Result<Response> {
    let view = context.missions(&id).await?;
    Row::<PropertyCount>::new()
        .value("property", |r| r.property.to_owned())
        .text("value", |r| &r.value)
        .value("count", |r| r.count.to_string())
        .respond(&property_counts(&view))
}

struct PropertyCount {
    property: &'static str,
    value: String,
    count: u32,
}

fn property_counts(view: &MissionsView) -> Vec<PropertyCount> {
    let row = |property, value: String, count| PropertyCount { property, value, count };
    let mut rows = Vec::new();
    rows.extend(view.goals.iter().map(|(goals, count)| row("goals", goals.to_string(), *count)));
    rows.extend(view.modalities.iter().map(|(name, count)| row("modality", name.to_string(), *count)));
    rows.extend(view.categories.iter().map(|(name, count)| row("category", name.clone(), *count)));
    rows.extend(view.scenes.iter().map(|(name, count)| row("scene", name.clone(), *count)));
    rows.extend(view.reference_m.iter().map(|length| row("reference_m", length.to_string(), 1)));
    rows
}

pub(super) async fn compare(
    context: RequestContext,
    StrictQuery(query): StrictQuery<CompareQuery>,
) -> Result<Response> {
    let view = query.view(&context).await?;
    Row::<PairView>::new()
        .text("episode", |pair| &pair.episode)
        .text("scene", |pair| &pair.scene)
        .value("goals", |pair| pair.first.goals.to_string())
        .value("first_ordinal", |pair| pair.first_ordinal.to_string())
        .value("second_ordinal", |pair| pair.second_ordinal.to_string())
        .values(Key::ALL, |row, key| {
            row.value(format!("first_{key}"), move |pair| key.of(&pair.first).to_string())
                .value(format!("second_{key}"), move |pair| key.of(&pair.second).to_string())
        })
        .respond(&view.episodes)
}

pub(super) async fn runs(
    context: RequestContext,
    StrictQuery(query): StrictQuery<RunsQuery>,
) -> Result<Response> {
    let list = query.list(&context.reader, &context.viewer).await?;
    Row::<RunLine>::new()
        .text("run", |line| &line.run)
        .text("phase", |line| &line.phase)
        .text("team", |line| &line.team)
        .value("reference", |line| maybe(line.reference.map(Reference::as_str)))
        .text("method", |line| &line.method)
        .text("version", |line| &line.version)
        .value("order", |line| line.order.to_string())
        .value("state", |line| line.state.as_str().to_owned())
        .value("episodes", |line| line.episodes.to_string())
        .value("done", |line| line.done.to_string())
        .value("isr", |line| maybe(line.isr))
        .value("created_at", |line| format::rfc3339(line.created_unix_ms))
        .value("finished_at", |line| maybe_time(line.finished_unix_ms))
        .value("verified", |line| line.verified.to_string())
        .text("disqualified", |line| line.disqualified.as_deref().unwrap_or_default())
        .value("type", |line| maybe(line.method_type.map(MethodType::as_str)))
        .respond(&list.runs)
}

pub(super) async fn episodes(context: RequestContext, PathOnly(id): PathOnly<String>) -> Result<Response> {
    let view = context.run(&id).await?;
    Row::<EpisodeLine>::new()
        .value("ordinal", |line| line.ordinal.to_string())
        .value("state", |line| line.state.as_str().to_owned())
        .value("end", |line| maybe(line.end.map(EndReason::as_str)))
        .text("episode", |line| line.episode.as_deref().unwrap_or_default())
        .text("scene", |line| line.scene.as_deref().unwrap_or_default())
        .value("finished_at", |line| maybe_time(line.finished_unix_ms))
        .values(&METRICS, |row, metric| match metric.episode {
            EpisodeValue::Number(value) => {
                row.value(metric.id, move |line| maybe(line.metrics.as_ref().map(value)))
            }
            EpisodeValue::PerGoal(_) | EpisodeValue::None => row,
        })
        .respond(&view.episodes)
}

struct StepRow {
    position: [f32; 3],
    moment: Moment,
}

pub(super) async fn steps(
    context: RequestContext,
    PathOnly((run, ordinal)): PathOnly<(String, String)>,
) -> Result<Response> {
    let unknown = || RequestError::unknown("replay", format!("episode {ordinal} of run {run}"));
    let replay = context.episode(&run, &ordinal).await?.replay.ok_or_else(unknown)?;
    let rows = replay.path.iter().zip(moments(&replay));
    let rows: Vec<StepRow> = rows.map(|(&position, moment)| StepRow { position, moment }).collect();
    Row::<StepRow>::new()
        .value("step", |r| r.moment.step.to_string())
        .text("action", |r| r.moment.action.as_deref().unwrap_or_default())
        .value("x_m", |r| r.position[0].to_string())
        .value("y_m", |r| r.position[1].to_string())
        .value("z_m", |r| r.position[2].to_string())
        .value("heading_rad", |r| r.moment.heading_rad.to_string())
        .value("collided", |r| r.moment.collided.to_string())
        .value("sounding_goal", |r| maybe(r.moment.sounding_goal()))
        .value("bearing_rad", |r| maybe(r.moment.bearing_rad))
        .value("walked_m", |r| r.moment.walked_m.to_string())
        .value("actions_left", |r| r.moment.actions_left.to_string())
        .value("submits_left", |r| r.moment.submits_left.to_string())
        .values(0..replay.targets.len(), |row, goal| {
            row.value(format!("distance_{}_m", goal + 1), move |r| maybe(r.moment.distances_m.get(goal)))
        })
        .respond(&rows)
}

pub(super) async fn levels(
    context: RequestContext,
    PathOnly((run, ordinal)): PathOnly<(String, String)>,
    Extension(queue): Extension<MaybeRenderQueue>,
) -> Result<Response> {
    let view = context.episode(&run, &ordinal).await?;
    let unknown = || RequestError::unknown("sound", format!("of episode {ordinal} of run {run}"));
    let sound = queue.ok_or_else(unknown)?.sound(&view).await?.ok_or_else(unknown)?;
    let rows: Vec<(usize, StepLevels)> = sound.levels().iter().copied().enumerate().collect();
    Row::<(usize, StepLevels)>::new()
        .value("step", |(step, _)| step.to_string())
        .value("left_rms_pa", |(_, levels)| levels.rms[0].to_string())
        .value("right_rms_pa", |(_, levels)| levels.rms[1].to_string())
        .value("left_db", |(_, levels)| maybe(levels.ears_db()[0]))
        .value("right_db", |(_, levels)| maybe(levels.ears_db()[1]))
        .respond(&rows)
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::to_bytes;

    #[tokio::test]
    async fn text_is_quoted_and_never_a_formula() {
        for (text, line) in [
            ("plain", "plain"),
            ("a,b", "\"a,b\""),
            ("say \"hi\"", "\"say \"\"hi\"\"\""),
            ("=1", "'=1"),
            ("+1", "'+1"),
            ("-1", "'-1"),
            ("@1", "'@1"),
            ("\t1", "'\t1"),
            ("\rx", "\"'\rx\""),
            ("=1,2", "\"'=1,2\""),
            ("1-2", "1-2"),
        ] {
            let table = Row::<String>::new().text("name", |row| row).value("n", |_| "1".to_owned());
            let response = table.respond(&[text.to_owned()]).expect("a table");
            let body = to_bytes(response.into_body(), usize::MAX).await.expect("a body");
            assert_eq!(body, format!("name,n\r\n{line},1\r\n"), "{text}");
        }
    }
}
