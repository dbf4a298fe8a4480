//! OpenAPI 3.1 description, generated from the routes.

use super::{Answer, BASE, Endpoint, SCHEMA_VERSION};
use crate::request::RunsQuery;
use avln_scoring::Key;
use serde_json::{Map, Value, json};

/// Describes `endpoints`.
pub(super) fn document(endpoints: &[Endpoint]) -> Value {
    let paths: Map<String, Value> =
        endpoints.iter().map(|endpoint| (format!("{BASE}{}", endpoint.path), path_item(endpoint))).collect();
    json!({
        "openapi": "3.1.0",
        "info": {
            "title": "LH-AVLN Arena",
            "version": env!("CARGO_PKG_VERSION"),
            "description": "Phases, leaderboards, runs and episodes. With a token, a team also sees its own hidden results. \
                            Shares are from 0 to 1, lengths in metres, durations in seconds, times by RFC 3339 in UTC.",
        },
        "security": [{}, { "token": [] }],
        "paths": paths,
        "components": {
            "securitySchemes": { "token": { "type": "http", "scheme": "bearer" } },
            "schemas": schemas(),
        },
    })
}

fn path_item(endpoint: &Endpoint) -> Value {
    let in_path = endpoint.path.split('/').filter_map(|part| part.strip_prefix('{')?.strip_suffix('}'));
    let parameters: Vec<Value> =
        in_path.map(path_parameter).chain(endpoint.query.iter().map(|name| query_parameter(name))).collect();
    let (kind, schema) = match endpoint.answer {
        Answer::Json(name) => ("application/json", reference(name)),
        Answer::Csv => ("text/csv", json!({ "type": "string" })),
        Answer::Text => ("text/plain", json!({ "type": "string" })),
        // OpenAPI 3.1 describes an event by its data.
        Answer::Events(name) => ("text/event-stream", reference(name)),
    };
    json!({ "get": {
        "summary": endpoint.summary,
        "operationId": operation_id(endpoint.path),
        "parameters": parameters,
        "responses": {
            "200": { "description": "The response, with an ETag.", "content": { kind: { "schema": schema } } },
            "304": { "description": "The response has not changed: If-None-Match matches its ETag." },
            "default": {
                "description": "The error.",
                "content": { "application/problem+json": { "schema": reference("Problem") } },
            },
        },
    } })
}

/// Joins the words in a path.
fn operation_id(path: &str) -> String {
    let words = path.split(|letter: char| !letter.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.collect::<Vec<_>>().join("_")
}

fn path_parameter(name: &str) -> Value {
    let schema = if name == "ordinal" { json!({ "type": "integer", "minimum": 0 }) } else { string() };
    json!({ "name": name, "in": "path", "required": true, "schema": schema })
}

fn query_parameter(name: &str) -> Value {
    let schema = match name {
        "order" => words(&["ordered", "unordered"]),
        "sort" => words(&Key::ALL.map(Key::as_str)),
        "pick" => words(&["best", "latest"]),
        "rgb" | "depth" | "audio" => words(&["with", "without"]),
        "as_of" => json!({ "type": "string", "format": "date" }),
        "limit" => json!({ "type": "integer", "minimum": 1, "maximum": RunsQuery::LIMITS.1 }),
        _ => string(),
    };
    let is_required = matches!(name, "first" | "second");
    json!({ "name": name, "in": "query", "required": is_required, "schema": schema })
}

fn reference(name: &str) -> Value {
    json!({ "$ref": format!("#/components/schemas/{name}") })
}

fn string() -> Value {
    json!({ "type": "string" })
}

fn words(words: &[&str]) -> Value {
    json!({ "type": "string", "enum": words })
}

fn list(of: &str) -> Value {
    json!({ "type": "array", "items": reference(of) })
}

/// An object schema from pairs of field name and schema. A name ending in `?` marks a nullable field.
fn object(fields: &[(&str, Value)]) -> Value {
    let mut properties = Map::new();
    let mut required = Vec::new();
    for (name, schema) in fields {
        let plain = name.trim_end_matches('?');
        let null = json!({ "anyOf": [schema, { "type": "null" }] });
        properties.insert(plain.to_owned(), if plain == *name { schema.clone() } else { null });
        required.push(plain);
    }
    json!({ "type": "object", "properties": properties, "required": required })
}

/// The schema of a complete response.
fn answer(fields: &[(&str, Value)]) -> Value {
    let version = ("schema_version", json!({ "const": SCHEMA_VERSION }));
    object(&[&[version], fields].concat())
}

/// Fields with the same schema.
fn all<'a>(names: &[&'a str], kind: &str) -> Vec<(&'a str, Value)> {
    let schema = match kind {
        "moment" => json!({ "type": "string", "format": "date-time" }),
        "list" => json!({ "type": "array" }),
        kind => json!({ "type": kind }),
    };
    names.iter().map(|&name| (name, schema.clone())).collect()
}

fn schemas() -> Value {
    json!({
        "Problem": object(&[all(&["type", "title", "detail", "instance", "reason"], "string"), all(&["status"], "integer")].concat()),
        "Status": answer(&all(&["name", "version", "state", "log_key?"], "string")),
        "Phases": answer(&[("phases", list("Phase"))]),
        "PhaseAnswer": answer(&[("phase", reference("Phase"))]),
        "Phase": phase(),
        "MissionsAnswer": answer(&[("missions", reference("Missions"))]),
        "Missions": object(&[all(&["goals", "modalities", "categories", "scenes"], "object"), all(&["reference_m"], "list")].concat()),
        "Quotas": answer(&[("quotas", list("Quota"))]),
        "Quota": quota(),
        "Leaderboard": answer(&leaderboard()),
        "Leaderboards": answer(&[("boards", list("Board"))]),
        "Board": object(&leaderboard()),
        "LeaderboardRow": row(),
        "Summary": summary(),
        "Compared": compared(),
        "Comparison": object(&[all(&["episodes", "scenes"], "integer"), vec![("differences", list("Difference"))]].concat()),
        "Difference": difference(),
        "Pair": pair(),
        "Estimate": object(&all(&["value", "low", "high"], "number")),
        "Runs": answer(&[("runs", list("RunLine")), ("next?", string())]),
        "RunLine": run_line(),
        "Run": run(),
        "LiveRuns": object(&[("runs", list("LiveRun"))]),
        "LiveRun": live_run(),
        "LiveText": object(&all(&["state", "episodes", "pace", "waits"], "string")),
        "Slot": slot(),
        "OutcomeGroup": object(&[all(&["name"], "string"), all(&["episodes"], "integer"), all(&["sr", "isr", "soft_spl", "steps"], "number")].concat()),
        "Rescore": rescore(),
        "Episodes": answer(&[all(&["run"], "string"), vec![("episodes", list("EpisodeLine"))]].concat()),
        "EpisodeLine": episode_line(),
        "Metrics": metrics(),
        "Episode": episode(),
    })
}

fn phase() -> Value {
    let visible = || words(&["public", "team", "organiser"]);
    let mut fields = all(&["id", "title", "description", "state", "state_reason?", "feedback"], "string");
    fields.extend(all(&["opens_at?", "closes_at?"], "moment"));
    fields.extend(all(&["orders"], "list"));
    fields.extend(all(&["rules", "sensors", "quotas", "time", "ranking", "promise?"], "object"));
    fields.extend(all(&["episodes", "scenes", "max_slots"], "integer"));
    fields.extend([("scores", visible()), ("replays", visible())]);
    fields.extend(all(&["sealed", "all_scores_visible"], "boolean"));
    object(&fields)
}

fn quota() -> Value {
    let mut fields = all(&["phase"], "string");
    fields.push(("window", words(&["day", "month", "total", "concurrent", "uncharged"])));
    fields.extend(all(&["limit?", "used", "remaining?"], "integer"));
    fields.extend(all(&["window_start_at", "next_increase_at?"], "moment"));
    fields.extend(all(&["charges"], "list"));
    object(&fields)
}

fn leaderboard() -> Vec<(&'static str, Value)> {
    let mut fields = vec![("phase", reference("Phase")), ("rows", list("LeaderboardRow"))];
    fields.extend(all(&["order", "key", "direction", "pick"], "string"));
    fields.extend(all(&["entries"], "integer"));
    fields.extend(all(&["as_of_at?"], "moment"));
    fields.extend(all(&["complete"], "boolean"));
    fields
}

fn row() -> Value {
    let mut fields = all(&["rank?", "rank_low?", "rank_high?", "tie_group?"], "integer");
    fields.extend(all(&["runs_count", "server_faults"], "integer"));
    fields.extend(all(&["median"], "number"));
    fields.extend(all(&["team", "reference?", "method", "version", "run", "scorer"], "string"));
    fields.extend(all(&["verified"], "boolean"));
    fields.extend(all(&["health", "sensors?"], "object"));
    fields.extend(all(&["finished_at?"], "moment"));
    fields.push(("summary", reference("Summary")));
    object(&fields)
}

fn compared() -> Value {
    let runs = ["first", "second"].map(|name| (name, reference("RunLine")));
    answer(
        &[runs.to_vec(), vec![("comparison?", reference("Comparison")), ("episodes", list("Pair"))]].concat(),
    )
}

fn difference() -> Value {
    let mut fields = vec![("key", words(&Key::ALL.map(Key::as_str))), ("estimate", reference("Estimate"))];
    fields.extend(all(&["first", "second"], "number"));
    fields.extend(all(&["is_sure"], "boolean"));
    object(&fields)
}

fn pair() -> Value {
    let mut fields = all(&["episode", "scene"], "string");
    fields.extend(all(&["first_ordinal", "second_ordinal"], "integer"));
    fields.extend(["first", "second"].map(|name| (name, reference("Metrics"))));
    object(&fields)
}

fn summary() -> Value {
    let estimates = ["sr", "isr", "osr", "spl", "soft_spl", "sna"].map(|name| (name, reference("Estimate")));
    let mut fields = estimates.to_vec();
    fields.extend(all(&["episodes", "scenes"], "integer"));
    fields.extend(all(
        &[
            "isr_by_goal",
            "osr_all",
            "steps",
            "path_m",
            "collisions",
            "wrong_submits",
            "wrong_instance_submits",
        ],
        "number",
    ));
    fields.extend(all(&["steps_to_goal?", "final_distance_m?"], "number"));
    object(&fields)
}

fn run_line() -> Value {
    let mut fields = all(&["run", "phase", "team", "method", "version", "order", "state"], "string");
    fields.extend(all(&["reference?"], "string"));
    fields.extend(all(&["disqualified?"], "string"));
    fields.extend(all(&["verified"], "boolean"));
    fields.extend(all(&["episodes", "done"], "integer"));
    fields.extend(all(&["isr?"], "number"));
    fields.extend(all(&["created_at", "finished_at?"], "moment"));
    object(&fields)
}

fn run() -> Value {
    let mut fields = vec![("line", reference("RunLine")), ("summary?", reference("Summary"))];
    fields.extend(all(&["scores_visible", "replays_visible", "eligible"], "boolean"));
    fields.extend(all(&["modalities"], "list"));
    fields.extend([("by_goals", list("OutcomeGroup")), ("by_scene", list("OutcomeGroup"))]);
    fields.extend(all(&["health", "time", "sensors?", "digests"], "object"));
    fields.extend(all(&["server_faults"], "integer"));
    fields.extend([("rescores", list("Rescore")), ("episodes", list("EpisodeLine"))]);
    answer(&fields)
}

fn live_run() -> Value {
    let mut fields = all(&["run", "state"], "string");
    fields.extend(all(&["episodes", "done", "playing"], "integer"));
    fields.extend(all(&["connected?"], "boolean"));
    fields.extend(all(&["steps_per_s?"], "number"));
    fields.extend(all(&["created_at", "finished_at?"], "moment"));
    fields.extend([("slots", list("Slot")), ("words", reference("LiveText"))]);
    object(&fields)
}

fn slot() -> Value {
    let mut fields = all(&["slot", "step"], "integer");
    fields.extend(all(&["last_step_s?", "mean_step_s?"], "number"));
    fields.extend(all(&["since_at"], "moment"));
    object(&fields)
}

fn rescore() -> Value {
    let mut fields = all(&["scorer"], "string");
    fields.extend(all(&["scored_at"], "moment"));
    fields.push(("summary?", reference("Summary")));
    object(&fields)
}

fn episode_line() -> Value {
    let mut fields = all(&["ordinal"], "integer");
    fields.extend(all(&["state", "end?", "episode?", "scene?"], "string"));
    fields.extend(all(&["finished_at?"], "moment"));
    fields.push(("metrics?", reference("Metrics")));
    object(&fields)
}

fn metrics() -> Value {
    let mut fields =
        all(&["goals", "found", "steps", "collisions", "wrong_submits", "wrong_instance_submits"], "integer");
    fields.extend(all(
        &["sr", "isr", "osr", "osr_all", "spl", "soft_spl", "sna", "path_m", "reference_m"],
        "number",
    ));
    fields.extend(all(&["steps_to_goal", "final_distance_m"], "list"));
    object(&fields)
}

fn episode() -> Value {
    let mut fields = vec![("run", reference("RunLine")), ("metrics?", reference("Metrics"))];
    fields.extend(all(&["ordinal"], "integer"));
    fields.extend(all(&["state", "end?"], "string"));
    fields.extend(all(&["finished_at?"], "moment"));
    fields.extend(all(&["mission?", "time", "replay?"], "object"));
    answer(&fields)
}
