//! Pages and plots as they were looked at last. `AVLN_BLESS=1 cargo test -p avln-web` writes them anew; look at what changed.

use crate::fixture::Arena;
use axum::{
    body::Body,
    http::{Request, header},
};
use std::{env, fs, path::PathBuf};

/// Each kind of page, by the name of its file.
const PAGES: [(&str, &str); 14] = [
    ("home.html", "/"),
    ("boards.html", "/leaderboard"),
    ("both-orders.html", "/leaderboard/open"),
    ("board.html", "/leaderboard/open?order=unordered&sort=isr&column=sr&column=spl"),
    ("hidden-board.html", "/leaderboard/sealed?order=unordered"),
    ("embedded.html", "/embed/open?order=unordered"),
    ("runs.html", "/runs"),
    ("run.html", "/runs/run_rude"),
    ("hidden-run.html", "/runs/run_sealed"),
    ("replay.html", "/runs/run_rude/episodes/0"),
    ("compare.html", "/compare?first=run_rude&second=run_formula"),
    ("phase.html", "/phases/open"),
    ("badge.svg", "/runs/run_rude/badge.svg"),
    ("trouble.html", "/nowhere"),
];
/// Most bytes that a browser loads for a first page, compressed.
const FIRST_LOAD_BYTES: usize = 60_000;

#[tokio::test]
async fn pages_look_as_they_did() {
    let arena = Arena::new().await;
    for (name, address) in PAGES {
        assert_golden(name, &arena.get(address).await.body);
    }
}

/// Programs are made after it: whoever changes it sees how.
#[tokio::test]
async fn the_description_of_the_api_is_as_it_was() {
    let document = Arena::new().await.get("/api/v1/openapi.json").await.json();
    assert_eq!(document["openapi"].as_str().map(|version| &version[..3]), Some("3.1"));
    let text = serde_json::to_string_pretty(&document).expect("JSON") + "\n";
    assert_golden("openapi.json", &text);
}

/// Holds a text against the file of this name.
fn assert_golden(name: &str, text: &str) {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if env::var_os("AVLN_BLESS").is_some() {
        fs::write(&path, text).expect("a golden file can be written");
    }
    let same = fs::read_to_string(&path).unwrap_or_default() == text;
    assert!(same, "{name} changed; look at what this test writes with AVLN_BLESS=1");
}

#[tokio::test]
async fn a_first_page_is_small_with_all_that_belongs_to_it() {
    let arena = Arena::new().await;
    for (name, address) in PAGES {
        let page = arena.get(address).await.body;
        let mut bytes = packed(&arena, address).await;
        for asset in ["/assets/app.css", "/assets/icon.svg", "/assets/replay.js"] {
            if page.contains(asset) {
                bytes += packed(&arena, asset).await;
            }
        }
        assert!(bytes < FIRST_LOAD_BYTES, "{name}: {bytes} bytes");
    }
}

/// Bytes of an answer as browsers ask for it.
async fn packed(arena: &Arena, address: &str) -> usize {
    let request = Request::get(address).header(header::ACCEPT_ENCODING, "gzip");
    arena.measure(request.body(Body::empty()).expect("a request")).await.0
}
