//! REST API: JSON and CSV below `/api/v1`, described by `/api/v1/openapi.json`: OpenAPI 3.1, derived from the routes and the
//! serialised types.

mod csv;
mod json;

pub use json::SignedLogs;

use crate::{error::Problem, live, request::RunsQuery};
use avln_scoring::Key;
use avln_store::{CompareView, EpisodeView, LeaderboardView, Reader, RunList, RunView};
use axum::{
    Router,
    http::header,
    response::IntoResponse,
    routing::{MethodRouter, get},
};
use serde_json::{Map, Value, json};
use utoipa::{
    ToSchema,
    openapi::{RefOr, schema::Schema},
};

const BASE: &str = "/api/v1";
/// Schema version; it changes if a field is removed or gets another meaning.
const SCHEMA_VERSION: u32 = 1;

const LEADERBOARD_QUERY: &[&str] =
    &["order", "sort", "pick", "q", "team", "type", "rgb", "depth", "audio", "as_of"];
const ALL_ORDERS_QUERY: &[&str] = &["sort", "pick", "q", "team", "type", "rgb", "depth", "audio", "as_of"];
const RUNS_QUERY: &[&str] = &["phase", "before", "limit"];
const COMPARE_QUERY: &[&str] = &["first", "second"];

struct Endpoint {
    /// Path below [`BASE`].
    path: &'static str,
    route: MethodRouter<Reader>,
    body: Body,
    summary: &'static str,
    query: &'static [&'static str],
}

impl Endpoint {
    fn new(path: &'static str, route: MethodRouter<Reader>, body: Body) -> Self {
        Self { path, route, body, summary: "", query: &[] }
    }

    fn json<T: ToSchema>(path: &'static str, route: MethodRouter<Reader>) -> Self {
        Self::new(path, route, Body::versioned::<T>())
    }

    fn csv(path: &'static str, route: MethodRouter<Reader>) -> Self {
        Self::new(path, route, Body::text("text/csv"))
    }

    /// Server-Sent Events. OpenAPI 3.1 describes the data of an event.
    fn events<T: ToSchema>(path: &'static str, route: MethodRouter<Reader>) -> Self {
        Self::new(path, route, Body::of::<T>("text/event-stream"))
    }

    fn about(self, summary: &'static str) -> Self {
        Self { summary, ..self }
    }

    fn query(self, query: &'static [&'static str]) -> Self {
        Self { query, ..self }
    }
}

fn phase_endpoints() -> Vec<Endpoint> {
    let leaderboard =
        |path| Endpoint::json::<LeaderboardView>(path, get(json::leaderboard)).query(LEADERBOARD_QUERY);
    vec![
        Endpoint::json::<json::Status>("/status", get(json::status))
            .about("Name, version and state of the server."),
        Endpoint::json::<json::Phases>("/phases", get(json::phases)).about("All phases."),
        Endpoint::json::<json::Phase>("/phases/{phase}", get(json::phase)).about("A phase with its rules."),
        Endpoint::json::<json::Missions>("/phases/{phase}/missions", get(json::missions))
            .about("Statistics of a phase's missions, if its replays are public."),
        Endpoint::csv("/phases/{phase}/missions.csv", get(csv::missions))
            .about("The same statistics as a table."),
        leaderboard("/phases/{phase}/leaderboard").about(
            "A leaderboard, best entry first. Entries of a tie_group do not differ significantly from its first entry; references have no rank.",
        ),
        leaderboard("/phases/{phase}/leaderboard.json")
            .about("The same leaderboard with a file extension in its address."),
        Endpoint::csv("/phases/{phase}/leaderboard.csv", get(csv::leaderboard))
            .query(LEADERBOARD_QUERY)
            .about("The same leaderboard as a table."),
        Endpoint::json::<json::Leaderboards>("/phases/{phase}/leaderboards", get(json::leaderboards))
            .query(ALL_ORDERS_QUERY)
            .about("The leaderboards of all orders of a phase."),
        Endpoint::csv("/phases/{phase}/leaderboards.csv", get(csv::leaderboards))
            .query(ALL_ORDERS_QUERY)
            .about("The same leaderboards as one table."),
        Endpoint::json::<json::Quotas>("/quota", get(json::quota))
            .about("Remaining quota and charges of the token's team in each phase."),
    ]
}

fn run_endpoints() -> Vec<Endpoint> {
    vec![
        Endpoint::json::<CompareView>("/compare", get(json::compare)).query(COMPARE_QUERY).about(
            "Comparison of two runs of the same phase and order over their common episodes: first minus second.",
        ),
        Endpoint::csv("/compare.csv", get(csv::compare))
            .query(COMPARE_QUERY)
            .about("The common episodes as a table."),
        Endpoint::json::<RunList>("/runs", get(json::runs))
            .query(RUNS_QUERY)
            .about(
                "Runs, newest first; cancelled runs only for their team and the organiser. Pass next as before to get the next page.",
            ),
        Endpoint::csv("/runs.csv", get(csv::runs))
            .query(RUNS_QUERY)
            .about("The same runs as a table. Pass the last run as before to get the next page."),
        Endpoint::events::<live::LiveRunsJson>("/runs/events", get(live::runs)).about(
            "Progress of all open runs: an event runs with all of them after each change, at most once per second.",
        ),
        Endpoint::events::<live::LiveRunJson>("/runs/{run}/events", get(live::run)).about(
            "Progress of a run: an event run with its state after each change, at most once per second, and a final one when it ends.",
        ),
        Endpoint::json::<RunView>("/runs/{run}", get(json::run)).about("A run with its episodes."),
        Endpoint::new("/runs/{run}/log", get(json::log), Body::text("text/plain")).about(
            "The signed log of a finished run, if the phase shows its replay. Check it with avln run verify.",
        ),
        Endpoint::json::<json::Episodes>("/runs/{run}/episodes", get(json::episodes))
            .about("The episodes of a run in playing order."),
        Endpoint::csv("/runs/{run}/episodes.csv", get(csv::episodes)).about("The same episodes as a table."),
        Endpoint::json::<EpisodeView>("/runs/{run}/episodes/{ordinal}", get(json::episode))
            .about("An episode, with its replay if the phase shows it."),
        Endpoint::csv("/runs/{run}/episodes/{ordinal}/steps.csv", get(csv::steps)).about(
            "The steps of an episode as a table, if the phase shows its replay. Row 0 is before the first action.",
        ),
        Endpoint::csv("/runs/{run}/episodes/{ordinal}/levels.csv", get(csv::levels)).about(
            "Sound levels of each step at both ears, if the phase shows the replay and the agent requested sound.",
        ),
    ]
}

pub(crate) fn router() -> Router<Reader> {
    let endpoints: Vec<Endpoint> = phase_endpoints().into_iter().chain(run_endpoints()).collect();
    let document = document(&endpoints).to_string();
    let router = Router::new().route(
        &format!("{BASE}/openapi.json"),
        get(async move || ([(header::CONTENT_TYPE, "application/json")], document).into_response()),
    );
    let add = |router: Router<Reader>, endpoint: Endpoint| {
        router.route(&format!("{BASE}{}", endpoint.path), endpoint.route)
    };
    endpoints.into_iter().fold(router, add)
}

/// Response body: media type, schema, and the schemas it refers to.
struct Body {
    media_type: &'static str,
    schema: Value,
    components: Vec<(String, RefOr<Schema>)>,
}

/// Rules that are not serialised by default.
const OMITTED_RULES: [&str; 5] = ["distractor_sources", "extra_submit", "head", "silence", "stop_claims"];

impl Body {
    /// A body without inner structure, such as a table.
    fn text(media_type: &'static str) -> Self {
        Self { media_type, schema: string(), components: Vec::new() }
    }

    fn versioned<T: ToSchema>() -> Self {
        let version = json!({
            "type": "object",
            "properties": { "schema_version": { "const": SCHEMA_VERSION } },
            "required": ["schema_version"],
        });
        let Self { schema, components, .. } = Self::of::<T>("");
        Self { media_type: "application/json", schema: json!({ "allOf": [schema, version] }), components }
    }

    fn of<T: ToSchema>(media_type: &'static str) -> Self {
        let mut components = vec![(T::name().into_owned(), T::schema())];
        T::schemas(&mut components);
        let schema = json!({ "$ref": format!("#/components/schemas/{}", T::name()) });
        Self { media_type, schema, components }
    }
}

fn document(endpoints: &[Endpoint]) -> Value {
    let problem = Body::of::<Problem>("application/problem+json");
    let mut schemas = Map::new();
    for (name, schema) in
        endpoints.iter().map(|endpoint| &endpoint.body).chain([&problem]).flat_map(|body| &body.components)
    {
        let mut schema = json!(schema);
        adapt(&mut schema);
        schemas.insert(name.clone(), schema);
    }
    let paths: Map<String, Value> = endpoints
        .iter()
        .map(|endpoint| (format!("{BASE}{}", endpoint.path), path_item(endpoint, &problem)))
        .collect();
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
            "schemas": schemas,
        },
    })
}

fn path_item(endpoint: &Endpoint, problem: &Body) -> Value {
    let in_path = endpoint.path.split('/').filter_map(|part| part.strip_prefix('{')?.strip_suffix('}'));
    let parameters: Vec<Value> =
        in_path.map(path_parameter).chain(endpoint.query.iter().map(|name| query_parameter(name))).collect();
    let content = |body: &Body| json!({ body.media_type: { "schema": body.schema } });
    json!({ "get": {
        "summary": endpoint.summary,
        "operationId": operation_id(endpoint.path),
        "parameters": parameters,
        "responses": {
            "200": { "description": "The response, with an ETag.", "content": content(&endpoint.body) },
            "304": { "description": "The response has not changed: If-None-Match matches its ETag." },
            "default": { "description": "The error.", "content": content(problem) },
        },
    } })
}

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
        "type" => json!({ "$ref": "#/components/schemas/MethodType" }),
        "rgb" | "depth" | "audio" => words(&["with", "without"]),
        "as_of" => json!({ "type": "string", "format": "date" }),
        "limit" => json!({ "type": "integer", "minimum": 1, "maximum": RunsQuery::LIMITS.1 }),
        _ => string(),
    };
    let is_required = matches!(name, "first" | "second");
    json!({ "name": name, "in": "query", "required": is_required, "schema": schema })
}

fn string() -> Value {
    json!({ "type": "string" })
}

fn words(words: &[&str]) -> Value {
    json!({ "type": "string", "enum": words })
}

fn adapt(schema: &mut Value) {
    match schema {
        Value::Array(parts) => parts.iter_mut().for_each(adapt),
        Value::Object(fields) => {
            // Doc comments address Rust users: they name units before `with_named_times`.
            if fields.get("description").is_some_and(Value::is_string) {
                fields.remove("description");
            }
            // In JSON all names are strings, but a map's numeric keys would be described as numbers.
            fields.remove("propertyNames");
            if let Some(Value::Object(properties)) = fields.get_mut("properties") {
                *properties = std::mem::take(properties).into_iter().map(named_time).collect();
                // `Option` is null, never missing; only defaults of some rules are left out.
                let required = properties
                    .keys()
                    .filter(|name| !OMITTED_RULES.contains(&name.as_str()))
                    .cloned()
                    .collect();
                fields.insert("required".to_owned(), required);
            }
            fields.values_mut().for_each(adapt);
        }
        _ => {}
    }
}

/// Describes a field as renamed by [`crate::format::with_named_times`].
fn named_time((name, schema): (String, Value)) -> (String, Value) {
    let Some(stem) = name.strip_suffix("_unix_ms") else { return (name, schema) };
    let kind = if schema["type"].is_array() { json!(["string", "null"]) } else { json!("string") };
    (format!("{stem}_at"), json!({ "type": kind, "format": "date-time" }))
}
