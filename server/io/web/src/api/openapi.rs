//! OpenAPI 3.1 description, generated from the routes.

use super::{Answer, BASE, Endpoint, SCHEMA_VERSION};
use crate::request::RunsQuery;
use avln_scoring::{EpisodeValue, Key, METRICS, SummaryValue, Unit};
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

/// Schemas without metrics, each with its fields as `name:type`. Types are in the notation of [`schema`]; a name with the suffix `~`
/// may be missing.
const SCHEMAS: &[(&str, &str)] = &[
    ("Problem", "type:string title:string detail:string instance:string reason:string status:integer"),
    ("Status", "schema_version:version name:string version:string state:string log_key:string?"),
    ("Phases", "schema_version:version phases:[Phase]"),
    ("PhaseAnswer", "schema_version:version phase:Phase"),
    (
        "Phase",
        "id:string title:string description:string state:string state_reason:string? feedback:string \
         opens_at:moment? closes_at:moment? orders:[ordered|unordered] rules:Rules sensors:Sensors \
         quotas:QuotaLimits time:TimeLimits ranking:Ranking promise:Promise? episodes:integer scenes:integer \
         max_slots:integer scores:public|team|organiser replays:public|team|organiser sealed:boolean \
         all_scores_visible:boolean",
    ),
    (
        "Rules",
        "name:string forward_m:number turn_deg:integer step_s:number max_steps:integer body_radius_m:number \
         body_height_m:number camera_height_m:number ear_height_m:number depth_max_m:number \
         depth_divisor:number audio_samples:integer pose_frame:string sounding:string \
         sounding_window_steps:integer source_lift_m:number sound_clip:string sounds:variant head~:variant \
         success_radius_m:number success_distance:string wrong_submit:string feedback:string \
         depth_noise:string rgb_noise:string",
    ),
    (
        "Sensors",
        "rgb:boolean depth:boolean audio:boolean width:integer height:integer hfov_rad:number \
         encodings:Encodings",
    ),
    ("Encodings", "rgb:string depth:string audio:string"),
    ("QuotaLimits", "day:integer? month:integer? total:integer? concurrent:integer? uncharged:integer?"),
    (
        "TimeLimits",
        "step_ms:integer bank_ms:integer run_s:integer disconnect_s:integer disconnect_total_s:integer",
    ),
    ("Ranking", "key:key entry:best|latest"),
    ("Promise", "commitment:string committed_at:moment revealed:CommitmentValues?"),
    ("CommitmentValues", "pool:string scorer:string secret:string"),
    ("MissionsAnswer", "schema_version:version missions:Missions"),
    (
        "Missions",
        "goals:{integer} modalities:{integer} categories:{integer} scenes:{integer} reference_m:[number]",
    ),
    ("Quotas", "schema_version:version quotas:[Quota]"),
    (
        "Quota",
        "phase:string window:day|month|total|concurrent|uncharged limit:integer? used:integer \
         remaining:integer? window_start_at:moment next_increase_at:moment? charges:[Charge]",
    ),
    ("Charge", "run:string charged:boolean reason:string"),
    ("Leaderboards", "schema_version:version boards:[Board]"),
    ("Board", LEADERBOARD),
    (
        "LeaderboardRow",
        "rank:integer? rank_low:integer? rank_high:integer? tie_group:integer? runs_count:integer \
         server_faults:integer median:number team:string reference:string? method:string version:string \
         run:string scorer:string verified:boolean health:{integer} sensors:Sensors? finished_at:moment? \
         summary:Summary",
    ),
    (
        "Compared",
        "schema_version:version first:RunLine second:RunLine comparison:Comparison? episodes:[Pair]",
    ),
    ("Comparison", "episodes:integer scenes:integer differences:[Difference]"),
    ("Difference", "key:key estimate:Estimate first:number second:number is_sure:boolean"),
    (
        "Pair",
        "episode:string scene:string first_ordinal:integer second_ordinal:integer first:Metrics \
         second:Metrics",
    ),
    ("Estimate", "value:number low:number high:number"),
    ("Runs", "schema_version:version runs:[RunLine] next:string?"),
    (
        "RunLine",
        "run:string phase:string team:string method:string version:string order:string state:string \
         reference:string? disqualified:string? verified:boolean episodes:integer done:integer isr:number? \
         created_at:moment finished_at:moment?",
    ),
    (
        "Run",
        "schema_version:version line:RunLine method:Method summary:Summary? scores_visible:boolean \
         replays_visible:boolean eligible:boolean modalities:[ModalityScore] by_goals:[Group] by_scene:[Group] health:{integer} \
         time:TimeAccount sensors:Sensors? digests:{string} server_faults:integer rescores:[Rescore] \
         episodes:[EpisodeLine]",
    ),
    (
        "Method",
        "name:string version:string description:string code_url:string paper_url:string \
         weights_licence:string external_data:string",
    ),
    ("ModalityScore", "modality:string goals:integer found:integer isr:number?"),
    ("TimeAccount", "simulation_s:number encoding_s:number queue_s:number thinking_s:number"),
    ("LiveRuns", "runs:[LiveRun]"),
    (
        "LiveRun",
        "run:string state:string episodes:integer done:integer playing:integer connected:boolean? \
         steps_per_s:number? created_at:moment finished_at:moment? slots:[Slot] words:LiveWords",
    ),
    ("LiveWords", "state:string episodes:string pace:string waits:string"),
    ("Slot", "slot:integer step:integer last_step_s:number? mean_step_s:number? since_at:moment"),
    ("Group", "name:string episodes:integer sr:number isr:number soft_spl:number steps:number"),
    ("Rescore", "scorer:string scored_at:moment summary:Summary?"),
    ("Episodes", "schema_version:version run:string episodes:[EpisodeLine]"),
    (
        "EpisodeLine",
        "ordinal:integer state:string end:string? episode:string? scene:string? finished_at:moment? \
         metrics:Metrics?",
    ),
    (
        "Episode",
        "schema_version:version run:RunLine metrics:Metrics? ordinal:integer state:string end:string? \
         finished_at:moment? mission:Mission? time:TimeAccount replay:Replay?",
    ),
    ("Mission", "order:string goals:[Goal]"),
    ("Goal", "modality:string text:string? found_at_step:integer? final_distance_m:number?"),
    (
        "Replay",
        "episode:string scene:string rules:Rules sensors:Sensors? hears:boolean map:SceneMap path:[[number]] \
         headings_rad:[number] actions:[string] collisions:[integer] sounding:[integer?] in_region:[integer] \
         submits:[SubmitMark] targets:[Target] reference_path:[[number]]",
    ),
    ("SceneMap", "min:[number] max:[number] polygons:[[[number]]]"),
    ("SubmitMark", "step:integer completed:integer? wrong_instance:integer?"),
    (
        "Target",
        "category:string modality:string position:[number] min:[number] max:[number] source:[number] \
         floor_y_m:number",
    ),
];
const LEADERBOARD: &str = "phase:Phase rows:[LeaderboardRow] order:string key:string direction:string pick:string \
         entries:integer as_of_at:moment? complete:boolean";

fn schemas() -> Value {
    let fields = |text: &'static str| text.split(' ').filter_map(|field| field.split_once(':'));
    let mut schemas: Map<String, Value> =
        SCHEMAS.iter().map(|&(name, text)| (name.to_owned(), object(fields(text)))).collect();
    let leaderboard = [("schema_version", "version")].into_iter().chain(fields(LEADERBOARD));
    schemas.insert("Leaderboard".to_owned(), object(leaderboard));
    let summary = METRICS.iter().filter_map(|metric| {
        let kind = match metric.summary {
            SummaryValue::Estimate(_) => "Estimate",
            SummaryValue::Mean(_) => "number",
            SummaryValue::GoalMean(_) => "number?",
            SummaryValue::None => return None,
        };
        Some((metric.id, kind))
    });
    schemas.insert(
        "Summary".to_owned(),
        object(summary.chain([("episodes", "integer"), ("scenes", "integer")])),
    );
    let metrics = METRICS.iter().filter_map(|metric| {
        let is_count = metric.unit == Unit::Count;
        let kind = match metric.episode {
            EpisodeValue::Number(_) => {
                if is_count {
                    "integer"
                } else {
                    "number"
                }
            }
            EpisodeValue::PerGoal(_) => {
                if is_count {
                    "[integer?]"
                } else {
                    "[number?]"
                }
            }
            EpisodeValue::None => return None,
        };
        Some((metric.id, kind))
    });
    schemas.insert("Metrics".to_owned(), object(metrics));
    Value::Object(schemas)
}

fn object<'a>(fields: impl Iterator<Item = (&'a str, &'a str)>) -> Value {
    let mut properties = Map::new();
    let mut required = Vec::new();
    for (name, kind) in fields {
        let plain = name.trim_end_matches('~');
        properties.insert(plain.to_owned(), schema(kind));
        if plain == name {
            required.push(plain);
        }
    }
    json!({ "type": "object", "properties": properties, "required": required })
}

/// Returns the schema for a type: `kind?` may be null, `[kind]` is an array, `{kind}` an object with free names, `a|b` an enum, a
/// capital letter starts a reference.
fn schema(kind: &str) -> Value {
    let between = |open, close| kind.strip_prefix(open).and_then(|rest: &str| rest.strip_suffix(close));
    if let Some(kind) = kind.strip_suffix('?') {
        return json!({ "anyOf": [schema(kind), { "type": "null" }] });
    }
    if let Some(kind) = between('[', ']') {
        return json!({ "type": "array", "items": schema(kind) });
    }
    if let Some(kind) = between('{', '}') {
        return json!({ "type": "object", "additionalProperties": schema(kind) });
    }
    match kind {
        "version" => json!({ "const": SCHEMA_VERSION }),
        "key" => words(&Key::ALL.map(Key::as_str)),
        "moment" => json!({ "type": "string", "format": "date-time" }),
        // An enum of Rust: a word, or an object with a word and its value.
        "variant" => json!({ "anyOf": [string(), schema("{string}")] }),
        kind if kind.contains('|') => words(&kind.split('|').collect::<Vec<_>>()),
        kind if kind.starts_with(char::is_uppercase) => reference(kind),
        kind => json!({ "type": kind }),
    }
}
