//! Golden pages, and static copies. `AVLN_BLESS=1 cargo test -p avln-web` rewrites the golden files; review the difference.

use crate::fixture::Arena;
use avln_web::{FreezeError, freeze};
use axum::{
    body::Body,
    http::{Request, header},
};
use std::{
    collections::BTreeMap,
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
/// Limit of the compressed size of a first page with its assets, bytes.
const FIRST_LOAD_BYTES: usize = 60_000;

#[tokio::test]
async fn pages_match_their_golden_files() {
    let arena = Arena::new().await;
    for (name, address) in PAGES {
        assert_golden(name, &arena.get(address).await.body);
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
    let count = freeze(&reader, phase, 100, write).await.expect("a copy");
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
        assert!(text(&files, "data/runs/run_formula/episodes/1/steps.csv").starts_with("step,action,"));
        assert!(text(&files, "data/phases/open/leaderboards.csv").contains("good walker"));
        let json: serde_json::Value =
            serde_json::from_slice(&files["data/phases/open/leaderboards.json"]).expect("JSON");
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
    let unknown = freeze(&reader, Some("nowhere"), 100, &mut |_, _| Ok(())).await;
    assert!(matches!(unknown, Err(FreezeError::NoPhase(phase)) if phase == "nowhere"));
    let full = &mut |_: &str, _: &[u8]| Err(io::Error::from(io::ErrorKind::StorageFull));
    let failed = freeze(&reader, Some("open"), 100, full).await;
    assert!(matches!(failed, Err(FreezeError::File { .. })), "{failed:?}");
}
