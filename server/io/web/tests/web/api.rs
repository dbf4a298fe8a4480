use crate::{
    fixture::{Answer, Arena},
    replay::FakeRenderer,
};
use avln_episode::Sensors;
use axum::{
    body::Body,
    http::{Request, StatusCode, header},
};
use serde_json::Value;

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
    if let Some(reference) = schema["$ref"].as_str() {
        let schema = document.pointer(reference.trim_start_matches('#')).expect("a schema");
        return check(document, schema, value, &format!("{place} {reference}"));
    }
    if let Some(choices) = schema["anyOf"].as_array() {
        if !value.is_null() {
            check(document, &choices[0], value, place);
        }
        return;
    }
    match schema["type"].as_str() {
        Some("integer") => assert!(value.is_u64() || value.is_i64(), "{place}: {value}"),
        Some("number") => assert!(value.is_number(), "{place}: {value}"),
        Some("string") => assert!(value.is_string(), "{place}: {value}"),
        Some("boolean") => assert!(value.is_boolean(), "{place}: {value}"),
        Some("array") => {
            let items = value.as_array().unwrap_or_else(|| panic!("{place}: {value}"));
            assert!(schema["items"].is_object(), "{place}: an array without item type");
            items.iter().for_each(|item| check(document, &schema["items"], item, place));
        }
        Some("object") => {
            let fields = value.as_object().unwrap_or_else(|| panic!("{place}: {value}"));
            let Some(properties) = schema["properties"].as_object() else {
                let values = &schema["additionalProperties"];
                assert!(values.is_object(), "{place}: an object without types");
                return fields.values().for_each(|field| check(document, values, field, place));
            };
            let described: Vec<&String> = properties.keys().collect();
            let required = schema["required"].as_array().expect("required fields");
            assert!(fields.keys().all(|name| described.contains(&name)), "{place}: {fields:?}");
            assert!(
                required.iter().all(|name| fields.contains_key(name.as_str().expect("a name"))),
                "{place}"
            );
            fields.iter().for_each(|(name, field)| {
                check(document, &properties[name], field, &format!("{place}.{name}"));
            });
        }
        _ => assert_eq!(&schema["const"], value, "{place}"),
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
