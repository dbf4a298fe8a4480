//! Golden pages, the API description, static copies, and documents. `AVLN_BLESS=1 cargo test -p avln-web` rewrites the golden files; review the difference.

use crate::{Arena, documents, listed, replay::FakeRenderer, repository};
use avln_episode::Sensors;
use avln_web::{Documents, FreezeError, freeze};
use axum::{
    body::Body,
    http::{Request, StatusCode, header},
};
use serde_json::{Map, Value, json};
use std::{
    collections::{BTreeMap, BTreeSet},
    env, fs, io,
    path::{Component, Path, PathBuf},
};

/// Golden files with the addresses of their pages.
const PAGES: [(&str, &str); 14] = [
    ("home.html", "/"),
    ("leaderboard-index.html", "/leaderboard"),
    ("all-orders.html", "/leaderboard/open"),
    ("leaderboard.html", "/leaderboard/open?order=unordered&sort=isr&column=sr&column=spl"),
    ("hidden-leaderboard.html", "/leaderboard/sealed?order=unordered"),
    ("embedded.html", "/embed/open?order=unordered"),
    ("runs.html", "/runs"),
    ("run.html", "/runs/run_rude"),
    ("hidden-run.html", "/runs/run_sealed"),
    ("replay.html", "/runs/run_rude/episodes/0"),
    ("compare.html", "/compare?first=run_rude&second=run_formula"),
    ("phase.html", "/phases/open"),
    ("badge.svg", "/runs/run_rude/badge.svg"),
    ("error.html", "/nowhere"),
];
/// Limit for a first page with assets, compressed, bytes.
const FIRST_LOAD_BYTES: usize = 60_000;

#[tokio::test]
async fn pages_match_their_golden_files() {
    let arena = Arena::new().await;
    for (name, address) in PAGES {
        let request = Request::get(address).header("x-request-id", "req_0123456789ab").body(Body::empty());
        assert_golden(name, &arena.ask(request.expect("a request")).await.body);
    }
}

/// Generated clients depend on this file.
#[tokio::test]
async fn the_api_description_matches_its_golden_file() {
    let document = Arena::new().await.get("/api/v1/openapi.json").await.json();
    assert_eq!(document["openapi"].as_str().map(|version| &version[..3]), Some("3.1"));
    let text = serde_json::to_string_pretty(&document).expect("JSON") + "\n";
    assert_golden("openapi.json", &text);
}

/// Compares a text with a golden file.
fn assert_golden(name: &str, text: &str) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if env::var_os("AVLN_BLESS").is_some() {
        fs::write(&path, text).expect("a golden file can be written");
    }
    let same = fs::read_to_string(&path).unwrap_or_default() == text;
    assert!(same, "{name} has changed; run this test with AVLN_BLESS=1 and review the difference");
}

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

/// Collects the properties of an object, also from parts in `allOf`.
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
async fn first_pages_are_small_with_their_assets() {
    let arena = Arena::new().await;
    for (name, address) in PAGES {
        let page = arena.get(address).await.body;
        let mut bytes = compressed_size(&arena, address).await;
        for asset in ["/assets/app.css", "/assets/icon.svg", "/assets/replay.js"] {
            if page.contains(asset) {
                bytes += compressed_size(&arena, asset).await;
            }
        }
        assert!(bytes < FIRST_LOAD_BYTES, "{name}: {bytes} bytes");
    }
}

/// Returns the compressed size of a response.
async fn compressed_size(arena: &Arena, address: &str) -> usize {
    let request = Request::get(address).header(header::ACCEPT_ENCODING, "gzip");
    arena.measure(request.body(Body::empty()).expect("a request")).await.0
}

type Files = BTreeMap<String, Vec<u8>>;

async fn frozen(arena: &Arena, phase: Option<&str>) -> Files {
    let mut files = Files::new();
    let reader = arena.store.reader();
    let write = &mut |name: &str, bytes: &[u8]| {
        files.insert(name.to_owned(), bytes.to_vec());
        Ok(())
    };
    let count = freeze(&reader, documents(), phase, 100, write).await.expect("a copy");
    assert_eq!(count, files.len());
    files
}

fn text<'a>(files: &'a Files, name: &str) -> &'a str {
    let bytes = files.get(name).unwrap_or_else(|| panic!("{name} in {:?}", files.keys()));
    std::str::from_utf8(bytes).expect("text")
}

/// Returns the addresses in a page.
fn addresses(page: &str) -> impl Iterator<Item = &str> {
    let of = |name: &'static str| page.split(name).skip(1).filter_map(|rest| rest.split('"').next());
    [" href=\"", " src=\"", " action=\""].into_iter().flat_map(of)
}

/// Returns the target of a relative address in `file`.
fn target(file: &str, address: &str) -> String {
    let path = address.split(['?', '#']).next().unwrap_or_default();
    let mut parts: Vec<String> = Vec::new();
    for part in Path::new(file).parent().expect("a folder").join(path).components() {
        match part {
            Component::ParentDir => drop(parts.pop().expect("a path inside the copy")),
            part => parts.push(part.as_os_str().to_string_lossy().into_owned()),
        }
    }
    parts.join("/")
}

#[tokio::test]
async fn copies_are_complete_and_self_contained() {
    let arena = Arena::new().await;
    for phase in [Some("open"), None] {
        let files = frozen(&arena, phase).await;
        let pages = files.keys().filter(|name| name.ends_with(".html"));
        let mut links = 0;
        for page in pages {
            let html = text(&files, page);
            assert!(html.contains("<html class=\"frozen\""), "{page}");
            let moment =
                "Frozen copy of <time datetime=\"1970-01-01T00:00:00Z\">1970-01-01 00:00 UTC</time>:";
            assert!(html.contains(moment), "{page}");
            assert!(!html.contains("--token TOKEN</code>") || page.starts_with("docs/"), "{page}");
            for address in addresses(html).filter(|address| !address.starts_with('#')) {
                let is_link_elsewhere =
                    address.starts_with("https://") && !html.contains(&format!("src=\"{address}"));
                assert!(!address.starts_with('/'), "{page} asks for {address}");
                assert!(
                    is_link_elsewhere || files.contains_key(&target(page, address)),
                    "{page} leads to {address}"
                );
                links += 1;
            }
        }
        assert!(links > 500, "{links} links");
        for name in
            ["index.html", "assets/app.css", "assets/replay.js", "runs/run_rude.html", "phases/open.html"]
        {
            assert!(files.contains_key(name), "{name}");
        }
        let episode = text(&files, "runs/run_formula/episodes/1.html");
        assert!(
            episode.contains("href=\"1.html?t=5\">5</a>") && episode.contains("data-columns=\""),
            "{episode}"
        );
        assert!(!episode.contains("/eyes/"), "{episode}");
        assert!(text(&files, "docs.html").contains("href=\"docs/glossary.html\""));
        // A search needs the server.
        let hides_forms = text(&files, "assets/app.css").contains(":root.frozen :is(.controls");
        assert!(hides_forms && text(&files, "docs.html").contains("class=\"controls\">\n<form"));
        assert!(text(&files, "data/runs/run_formula/episodes/1/steps.csv").starts_with("step,action,"));
        assert!(text(&files, "data/phases/open/leaderboards.csv").contains("good walker"));
        let json: Value = serde_json::from_slice(&files["data/phases/open/leaderboards.json"]).expect("JSON");
        assert_eq!(json["boards"][0]["rows"][0]["method"], "good walker");
    }
}

#[tokio::test]
async fn copies_hold_no_hidden_data() {
    let arena = Arena::new().await;
    for phase in [Some("open"), Some("sealed"), None] {
        for (name, bytes) in frozen(&arena, phase).await {
            let text = String::from_utf8_lossy(&bytes);
            assert!(!name.contains("run_sealed") && !text.contains("run_sealed"), "{name}");
            assert!(!text.contains("secret walker"), "{name}");
            assert!(phase != Some("sealed") || !text.contains("canary-"), "{name}");
        }
    }
}

#[tokio::test]
async fn unknown_phases_and_full_disks_fail() {
    let arena = Arena::new().await;
    let reader = arena.store.reader();
    let unknown = freeze(&reader, Documents::default(), Some("nowhere"), 100, &mut |_, _| Ok(())).await;
    assert!(matches!(unknown, Err(FreezeError::NoPhase(phase)) if phase == "nowhere"));
    let full = &mut |_: &str, _: &[u8]| Err(io::Error::from(io::ErrorKind::StorageFull));
    let failed = freeze(&reader, Documents::default(), Some("open"), 100, full).await;
    assert!(matches!(failed, Err(FreezeError::File { .. })), "{failed:?}");
}

/// Returns the Markdown files of a folder. A README is the page of a package.
fn documents_in(folder: &str) -> Vec<String> {
    let entries = fs::read_dir(repository().join(folder)).expect(folder);
    let names = entries.map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"));
    let is_document = |name: &String| name.ends_with(".md") && name != "README.md" && name != "SUMMARY.md";
    names.filter(is_document).map(|name| format!("{folder}/{name}")).collect()
}

#[test]
fn every_document_is_in_the_table_of_contents() {
    let folders = ["docs", "docs/decisions", "proto"];
    let mut present: BTreeSet<String> = folders.into_iter().flat_map(documents_in).collect();
    present.insert("CONTRIBUTING.md".to_owned());
    let summary = fs::read_to_string(repository().join("docs/SUMMARY.md")).expect("a table of contents");
    let entries = listed(&summary);
    let listed: BTreeSet<String> = entries.iter().cloned().collect();
    assert_eq!(present, listed);
    assert_eq!(listed.len(), entries.len(), "no document is listed twice");
}

#[tokio::test]
async fn documents_are_listed_by_group() {
    let arena = Arena::new().await;
    let page = arena.get("/docs").await.body;
    let places = ["<h3>Participate</h3>", "/docs/quickstart", "<h3>Organise</h3>", "/docs/organising"];
    let more = ["<h3>Contribute</h3>", "<summary>Design decisions</summary>", "/docs/decisions/0001-"];
    let found: Vec<_> = places.into_iter().chain(more).map(|words| page.find(words)).collect();
    assert!(found.iter().all(Option::is_some) && found.is_sorted(), "{found:?} in {page}");
    let empty = Arena::with_documents(Documents::default()).await.get("/docs").await;
    assert_eq!(empty.status, StatusCode::OK);
    assert!(empty.body.contains("This server has no documents."), "{}", empty.body);
}

#[tokio::test]
async fn charts_are_served_with_their_document() {
    let files = [("docs/a.md", "# First\n\n![SR](images/sr.svg)\n"), ("docs/images/sr.svg", "<svg/>")];
    let arena = Arena::with_documents(Documents::new("# Use\n\n- [A](a.md)\n", &files)).await;
    let page = arena.get("/docs/a").await.body;
    assert!(page.contains("<img src=\"/docs/images/sr.svg\" alt=\"SR\" />"), "{page}");
    let chart = arena.get("/docs/images/sr.svg").await;
    assert_eq!((chart.status, chart.body.as_str()), (StatusCode::OK, "<svg/>"));
    assert_eq!(chart.header(header::CONTENT_TYPE), "image/svg+xml; charset=utf-8");
    let absent = arena.get("/docs/images/spl.svg").await;
    assert_eq!(absent.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn searches_lead_to_sections() {
    let files = [
        ("docs/a.md", "# First\n\nA lamp.\n\n## Red <lamps>\n\nThey shine.\n"),
        ("docs/b.md", "# Second\n\nNothing.\n"),
    ];
    let documents = Documents::new("# Use\n\n- [A](a.md)\n- [B](b.md)\n", &files);
    let arena = Arena::with_documents(documents).await;
    let page = arena.get("/docs?q=SHINE++red").await;
    assert_eq!(page.status, StatusCode::OK);
    let result =
        "<li><a href=\"/docs/a\">First</a>: <a href=\"/docs/a#red-lamps\">Red &#60;lamps&#62;</a></li>";
    assert!(page.body.contains(result) && page.body.contains("1 result:"), "{}", page.body);
    assert!(!page.body.contains("/docs/b\"") && page.body.matches("<h1>").count() == 1, "{}", page.body);
    let top = arena.get("/docs?q=nothing").await.body;
    assert!(top.contains("<li><a href=\"/docs/b\">Second</a></li>"), "{top}");
    let blank = arena.get("/docs?q=+").await.body;
    assert!(blank.contains("<h3>Use</h3>"), "{blank}");
}

#[tokio::test]
async fn searches_without_results_say_so() {
    let arena = Arena::new().await;
    let page = arena.get("/docs?q=glossary+xyzzy").await;
    assert_eq!(page.status, StatusCode::OK);
    assert!(page.body.contains("No document contains all of these words."), "{}", page.body);
    let rude = arena.get("/docs?q=%22%3E%3Cscript%3E").await.body;
    assert!(!rude.contains("<script") && rude.contains("value=\"&#34;&#62;&#60;script&#62;\""), "{rude}");
}

#[tokio::test]
async fn searches_have_a_limit() {
    let arena = Arena::new().await;
    let address = |words: usize| format!("/docs?q={}", vec!["a"; words].join("+"));
    assert_eq!(arena.get(&address(32)).await.status, StatusCode::OK);
    for address in [address(33), "/docs?q=a&q=b".to_owned(), "/docs?q=a&page=2".to_owned()] {
        assert_eq!(arena.get(&address).await.status, StatusCode::BAD_REQUEST, "{address}");
    }
}

#[tokio::test]
async fn links_between_documents_resolve() {
    let arena = Arena::new().await;
    let index = arena.get("/docs").await.body;
    let addresses: BTreeSet<&str> = links(&index).filter(|link| link.starts_with("/docs/")).collect();
    assert!(addresses.len() > 25 && addresses.contains("/docs/protocol"), "{addresses:?}");
    for address in &addresses {
        let page = arena.get(address).await;
        assert_eq!(page.status, StatusCode::OK, "{address}");
        assert_eq!(page.body.matches("<h1>").count(), 1, "{address}");
        assert!(!page.body.contains("<script") && !page.body.contains("style="), "{address}");
        for link in links(&page.body).filter(|link| link.starts_with("/docs/")) {
            let (to, place) = link.split_once('#').unwrap_or((link, ""));
            assert!(addresses.contains(to), "{address} links to {link}");
            let there = arena.get(to).await.body;
            assert!(
                place.is_empty() || there.contains(&format!("id=\"{place}\"")),
                "{address} links to {link}"
            );
        }
        for place in
            links(&page.body).filter_map(|link| link.strip_prefix('#')).filter(|place| *place != "main")
        {
            assert!(page.body.contains(&format!("id=\"{place}\"")), "{address} links to #{place}");
        }
    }
}

/// Returns the targets of the links of a page.
fn links(page: &str) -> impl Iterator<Item = &str> {
    page.split("href=\"").skip(1).filter_map(|rest| rest.split('"').next())
}
