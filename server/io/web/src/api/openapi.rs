//! OpenAPI 3.1 description, derived from the routes and the serialised types.

use super::{BASE, Endpoint, SCHEMA_VERSION};
use crate::{error::Problem, request::RunsQuery};
use avln_scoring::Key;
use serde_json::{Map, Value, json};
use utoipa::{
    ToSchema,
    openapi::{RefOr, schema::Schema},
};

/// Response body: media type, schema, and the schemas it refers to.
pub(super) struct Body {
    media_type: &'static str,
    schema: Value,
    components: Vec<(String, RefOr<Schema>)>,
}

/// Rules that are not serialised by default.
const OMITTED_RULES: [&str; 5] = ["distractor_sources", "extra_submit", "head", "silence", "stop_claims"];

impl Body {
    /// A body without inner structure, such as a table.
    pub(super) fn text(media_type: &'static str) -> Self {
        Self { media_type, schema: string(), components: Vec::new() }
    }

    pub(super) fn versioned<T: ToSchema>() -> Self {
        let version = json!({
            "type": "object",
            "properties": { "schema_version": { "const": SCHEMA_VERSION } },
            "required": ["schema_version"],
        });
        let Self { schema, components, .. } = Self::of::<T>("");
        Self { media_type: "application/json", schema: json!({ "allOf": [schema, version] }), components }
    }

    pub(super) fn of<T: ToSchema>(media_type: &'static str) -> Self {
        let mut components = vec![(T::name().into_owned(), T::schema())];
        T::schemas(&mut components);
        let schema = json!({ "$ref": format!("#/components/schemas/{}", T::name()) });
        Self { media_type, schema, components }
    }
}

pub(super) fn document(endpoints: &[Endpoint]) -> Value {
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
