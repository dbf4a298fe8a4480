use crate::{
    fixture::{Answer, Arena},
    replay::FakeRenderer,
};
use avln_episode::Sensors;
use axum::{
    body::Body,
    http::{Request, StatusCode, header},
};
use serde_json::{Map, Value, json};

#[tokio::test]
async fn responses_match_their_description() {
    let arena = Arena::with_renderer(Some(FakeRenderer::new(100))).await;
    arena.store.set_sensors("run_rude", &Sensors::all(64, 64)).await.expect("a run");
    std::fs::write(arena.folder.path().join("run_rude.log"), "a log\n").expect("a log");
    let document = arena.get("/api/v1/openapi.json").await.json();
    let paths = document["paths"].as_object().expect("paths");
    assert_eq!(paths.len(), 24);
    for (path, item) in paths {
        let address = path.replace("{phase}", "open").replace("{run}", "run_rude").replace("{ordinal}", "0");
        let both =
            if path.starts_with("/api/v1/compare") { "?first=run_rude&second=run_formula" } else { "" };
        let address = address + both;
        let events = &item["get"]["responses"]["200"]["content"]["text/event-stream"];
        if events.is_object() {
            let mut follower = arena.follow(&address, &[]).await;
            assert_eq!(follower.headers[header::CONTENT_TYPE], "text/event-stream", "{address}");
            let event = follower.next().await.expect("the current state");
            check(&document, &events["schema"], &event.data, &address);
            continue;
        }
        let answer = arena.get(&address).await;
        assert_eq!(answer.status, StatusCode::OK, "{address}: {}", answer.body);
        let content = item["get"]["responses"]["200"]["content"].as_object().expect("content");
        let (kind, described) = content.iter().next().expect("one kind");
        assert!(answer.header(header::CONTENT_TYPE).starts_with(kind), "{address}");
        if kind == "application/json" {
            check(&document, &described["schema"], &answer.json(), &address);
        }
    }
}

/// Checks that `value` has the fields of `schema` and no others, at every depth.
fn check(document: &Value, schema: &Value, value: &Value, place: &str) {
    if let Err(fault) = fits(document, schema, value) {
        panic!("{place}{fault}");
    }
}

fn fits(document: &Value, schema: &Value, value: &Value) -> Result<(), String> {
    let schema = resolved(document, schema);
    if let Some(choices) = schema["oneOf"].as_array() {
        let faults = choices.iter().map(|choice| fits(document, choice, value).err());
        return faults.collect::<Option<Vec<_>>>().map_or(Ok(()), |faults| Err(faults.join(" or ")));
    }
    if let Some(expected) = schema.get("const") {
        return if expected == value { Ok(()) } else { Err(format!(": {value} is not {expected}")) };
    }
    if schema["enum"].as_array().is_some_and(|words| !words.contains(value)) {
        return Err(format!(": {value} is not one of {}", schema["enum"]));
    }
    let kind = match value {
        Value::Null => "null",
        Value::Bool(_) => "boolean",
        Value::Number(number) if number.is_f64() => "number",
        Value::Number(_) => "integer",
        Value::String(_) => "string",
        Value::Array(_) => "array",
        Value::Object(_) => "object",
    };
    let mut kinds = schema["type"].as_array().cloned().unwrap_or_else(|| vec![schema["type"].clone()]);
    if kinds.contains(&json!("number")) {
        kinds.push(json!("integer"));
    }
    if schema.get("allOf").is_none() && !kinds.contains(&json!(kind)) {
        return Err(format!(": {value} is not {}", schema["type"]));
    }
    match value {
        Value::Array(items) => items.iter().try_for_each(|item| {
            fits(document, &schema["items"], item).map_err(|fault| format!("[]{fault}"))
        }),
        Value::Object(fields) => object_fits(document, schema, fields),
        _ => Ok(()),
    }
}

fn object_fits(document: &Value, schema: &Value, fields: &Map<String, Value>) -> Result<(), String> {
    let (mut properties, mut required) = (Map::new(), Vec::new());
    collect_properties(document, schema, &mut properties, &mut required);
    if let Some(missing) = required.iter().find(|name| !fields.contains_key(name.as_str())) {
        return Err(format!(": {missing} is missing"));
    }
    fields.iter().try_for_each(|(name, field)| {
        let described = properties.get(name).unwrap_or(&schema["additionalProperties"]);
        fits(document, described, field).map_err(|fault| format!(".{name}{fault}"))
    })
}

/// Collects the properties of an object, whose parts may be in `allOf`.
fn collect_properties(
    document: &Value,
    schema: &Value,
    properties: &mut Map<String, Value>,
    required: &mut Vec<String>,
) {
    let schema = resolved(document, schema);
    for part in schema["allOf"].as_array().into_iter().flatten() {
        collect_properties(document, part, properties, required);
    }
    properties.extend(schema["properties"].as_object().cloned().unwrap_or_default());
    let names = schema["required"].as_array().into_iter().flatten();
    required.extend(names.map(|name| name.as_str().expect("a name").to_owned()));
}

fn resolved<'a>(document: &'a Value, schema: &'a Value) -> &'a Value {
    match schema["$ref"].as_str() {
        Some(reference) => document.pointer(reference.trim_start_matches('#')).expect("a schema"),
        None => schema,
    }
}

#[tokio::test]
async fn every_property_has_a_type() {
    let document = Arena::new().await.get("/api/v1/openapi.json").await.json();
    let schemas = document["components"]["schemas"].as_object().expect("schemas");
    assert!(schemas.len() > 50, "{:?}", schemas.keys());
    for (name, schema) in schemas {
        assert_typed(schema, name);
    }
}

fn assert_typed(schema: &Value, place: &str) {
    let parts = ["allOf", "oneOf"].into_iter().filter_map(|key| schema[key].as_array());
    let parts: Vec<&Value> = parts.flatten().collect();
    parts.iter().for_each(|part| assert_typed(part, place));
    let properties = schema["properties"].as_object();
    for (name, property) in properties.into_iter().flatten() {
        assert_typed(property, &format!("{place}.{name}"));
    }
    match (schema["type"].as_str(), schema["additionalProperties"].as_object()) {
        (Some("object"), Some(_)) => assert_typed(&schema["additionalProperties"], place),
        (Some("object"), None) => assert!(properties.is_some(), "{place} is an object without properties"),
        (Some("array"), _) => assert_typed(&schema["items"], &format!("{place}[]")),
        (Some(_), _) => {}
        (None, _) => {
            let is_typed = schema["type"].is_array() || schema["$ref"].is_string() || !parts.is_empty();
            assert!(is_typed, "{place} has no type: {schema}");
        }
    }
}

#[tokio::test]
async fn leaderboards_are_available_as_json() {
    let arena = Arena::new().await;
    let board = arena.get("/api/v1/phases/open/leaderboard?sort=isr").await.json();
    assert_eq!(board["schema_version"], 1);
    assert_eq!(board["key"], "isr");
    assert_eq!(board["rows"][0]["team"], "<script>alert(1)</script>");
    assert_eq!(board["rows"][0]["summary"]["isr"]["value"], 1.0);
    assert_eq!(board["rows"][1]["summary"]["isr"]["value"], 0.5);
    assert_eq!(board["rows"][1]["finished_at"], "1970-01-01T00:00:00Z");
}

#[tokio::test]
async fn csv_cells_are_no_formulas() {
    let arena = Arena::new().await;
    let table = arena.get("/api/v1/phases/open/leaderboard.csv").await;
    assert_eq!(table.header(header::CONTENT_TYPE), "text/csv; charset=utf-8; header=present");
    let lines: Vec<&str> = table.body.split_terminator("\r\n").collect();
    assert_eq!(lines.len(), 3, "{}", table.body);
    assert!(lines[0].starts_with("rank,rank_low,rank_high,tie_group,team,reference,method,version,run,"));
    let worse = ",'=1+1,,'@walker,1.0,run_formula,1,0,1970-01-01T00:00:00Z,2,1,0,0,0,0.5,0.5,0.5,";
    assert!(lines[2].starts_with('2') && lines[2].contains(worse), "{}", lines[2]);
}

#[tokio::test]
async fn csv_rows_match_their_header() {
    let arena = Arena::new().await;
    for (address, rows) in [
        ("/api/v1/phases/open/leaderboard.csv", 2),
        ("/api/v1/phases/open/missions.csv", 7),
        ("/api/v1/runs.csv", 3),
        ("/api/v1/compare.csv?first=run_rude&second=run_formula", 2),
        ("/api/v1/runs/run_begun/episodes.csv", 2),
    ] {
        let table = arena.get(address).await;
        assert_eq!(table.header(header::CONTENT_TYPE), "text/csv; charset=utf-8; header=present");
        let lines: Vec<usize> =
            table.body.split_terminator("\r\n").map(|line| line.split(',').count()).collect();
        assert_eq!(lines.len(), rows + 1, "{address}: {}", table.body);
        assert!(lines.iter().all(|columns| *columns == lines[0]), "{address}: {}", table.body);
    }
}

#[tokio::test]
async fn comparisons_and_missions_are_available_as_csv() {
    let arena = Arena::new().await;
    let pairs = arena.get("/api/v1/compare.csv?first=run_rude&second=run_formula").await.body;
    assert!(
        pairs.starts_with("episode,scene,goals,first_ordinal,second_ordinal,first_sr,second_sr,"),
        "{pairs}"
    );
    let missions = arena.get("/api/v1/phases/open/missions.csv").await.body;
    assert!(missions.starts_with("property,value,count\r\ngoals,"), "{missions}");
}

#[tokio::test]
async fn known_etags_get_304() {
    let arena = Arena::new().await;
    for address in
        ["/api/v1/phases", "/leaderboard/open", "/api/v1/phases/open/leaderboard.csv", "/assets/app.css"]
    {
        let first = arena.get(address).await;
        let tag = first.header(header::ETAG).to_owned();
        assert!(tag.len() > 10, "{address}");
        let again = known(&arena, address, &format!("\"other\", {}", tag.trim_start_matches("W/"))).await;
        assert_eq!((again.status, again.body.as_str()), (StatusCode::NOT_MODIFIED, ""), "{address}");
        assert_eq!(again.header(header::ETAG), tag);
        assert_eq!(known(&arena, address, "\"other\"").await.status, StatusCode::OK, "{address}");
    }
}

#[tokio::test]
async fn responses_are_compressed_on_request() {
    let arena = Arena::new().await;
    for address in ["/leaderboard/open", "/api/v1/openapi.json", "/assets/app.css"] {
        let plain = arena.get(address).await;
        let request = Request::get(address).header(header::ACCEPT_ENCODING, "gzip");
        let packed = arena.measure(request.body(Body::empty()).expect("a request")).await;
        assert_eq!(packed.1.get(header::CONTENT_ENCODING).expect(address), "gzip");
        assert!(packed.0 * 3 < plain.body.len() * 2, "{address}: {} of {} bytes", packed.0, plain.body.len());
        assert_eq!(packed.1[header::VARY], "authorization, cookie, accept-encoding", "{address}");
        assert_eq!(packed.1[header::ETAG], plain.headers[header::ETAG], "{address}");
    }
}

async fn known(arena: &Arena, address: &str, tag: &str) -> Answer {
    let request = Request::get(address).header(header::IF_NONE_MATCH, tag);
    arena.ask(request.body(Body::empty()).expect("a request")).await
}

#[tokio::test]
async fn lists_of_runs_have_pages() {
    let arena = Arena::new().await;
    let all = arena.get("/api/v1/runs").await.json();
    let names = |list: &Value| -> Vec<String> {
        list["runs"].as_array().unwrap().iter().map(|run| run["run"].as_str().unwrap().to_owned()).collect()
    };
    let (mut seen, mut before) = (Vec::new(), String::new());
    loop {
        let part = arena.get(&format!("/api/v1/runs?limit=1{before}")).await.json();
        seen.extend(names(&part));
        let Some(next) = part["next"].as_str() else { break };
        before = format!("&before={next}");
    }
    assert!(seen.len() > 2 && all["next"].is_null(), "{all}");
    assert_eq!(seen, names(&all));
    let table = arena.get(&format!("/api/v1/runs.csv?before={}", seen[0])).await.body;
    assert_eq!(table.lines().count(), seen.len(), "{table}");
    for hidden in ["run_sealed", "nowhere"] {
        let refused = arena.get(&format!("/api/v1/runs?before={hidden}")).await;
        assert_eq!(refused.status, StatusCode::NOT_FOUND, "{}", refused.body);
    }
    let page = arena.get("/runs?limit=1").await.body;
    assert!(page.contains(&format!("href=\"/runs?before={}&#38;limit=1\"", seen[0])), "{page}");
}

#[tokio::test]
async fn errors_are_problem_details() {
    let arena = Arena::new().await;
    for (address, status, reason) in [
        ("/api/v1/nowhere", 404, "NOT_FOUND"),
        ("/api/v1/phases/nowhere", 404, "NOT_FOUND"),
        ("/api/v1/phases/nowhere/leaderboard.csv", 404, "NOT_FOUND"),
        ("/api/v1/runs/run_rude/episodes/-1", 404, "NOT_FOUND"),
        ("/api/v1/runs?limit=201", 400, "INVALID_ARGUMENT"),
        ("/api/v1/phases?limit=1", 400, "INVALID_ARGUMENT"),
        ("/api/v1/phases/open/leaderboard?order=sideways", 400, "INVALID_ARGUMENT"),
    ] {
        let answer = arena.get(address).await;
        assert_eq!(answer.header(header::CONTENT_TYPE), "application/problem+json", "{address}");
        let problem = answer.json();
        assert_eq!(problem["status"], status, "{address}");
        assert_eq!(answer.status.as_u16(), status, "{address}");
        assert_eq!(problem["reason"], reason, "{address}");
    }
    let long = format!("/api/v1/runs?phase={}", "x".repeat(3000));
    assert_eq!(arena.get(&long).await.status, StatusCode::URI_TOO_LONG);
    let post = Request::post("/api/v1/runs").body(Body::empty()).expect("a request");
    let post = arena.ask(post).await;
    assert_eq!(
        (post.status, post.json()["reason"].as_str()),
        (StatusCode::METHOD_NOT_ALLOWED, Some("METHOD_NOT_ALLOWED"))
    );
}

#[tokio::test]
async fn all_responses_have_security_headers() {
    let arena = Arena::new().await;
    for address in ["/", "/api/v1/phases", "/nowhere", "/healthz", "/readyz"] {
        let answer = arena.get(address).await;
        assert!(
            answer.header(header::CONTENT_SECURITY_POLICY).contains("frame-ancestors 'none'"),
            "{address}"
        );
        assert_eq!(answer.header(header::X_CONTENT_TYPE_OPTIONS), "nosniff", "{address}");
        let shared = answer.header(header::ACCESS_CONTROL_ALLOW_ORIGIN) == "*";
        assert_eq!(shared, address.starts_with("/api/") || address == "/readyz", "{address}");
    }
}

#[tokio::test]
async fn readiness_follows_the_database() {
    let arena = Arena::new().await;
    assert_eq!(arena.get("/readyz").await.status, StatusCode::OK);
    arena.store.clone().close().await;
    assert_eq!(arena.get("/readyz").await.status, StatusCode::SERVICE_UNAVAILABLE);
    assert_eq!(arena.get("/healthz").await.status, StatusCode::OK);
    let broken = arena.get("/runs").await;
    assert_eq!(broken.status, StatusCode::INTERNAL_SERVER_ERROR);
    assert!(
        broken.body.contains("<h1>Internal error</h1>") && !broken.body.contains("pool"),
        "{}",
        broken.body
    );
}
