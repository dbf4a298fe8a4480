use crate::fixture::Arena;
use avln_web::{FreezeError, freeze};
use std::{
    collections::BTreeMap,
    io,
    path::{Component, Path},
};

type Files = BTreeMap<String, Vec<u8>>;

async fn frozen(arena: &Arena, phase: Option<&str>) -> Files {
    let mut files = Files::new();
    let reader = arena.store.reader();
    let keep = &mut |name: &str, bytes: &[u8]| {
        files.insert(name.to_owned(), bytes.to_vec());
        Ok(())
    };
    let count = freeze(&reader, phase, 100, keep).await.expect("a copy");
    assert_eq!(count, files.len());
    files
}

fn text<'a>(files: &'a Files, name: &str) -> &'a str {
    let bytes = files.get(name).unwrap_or_else(|| panic!("{name} in {:?}", files.keys()));
    std::str::from_utf8(bytes).expect("text")
}

/// Addresses in a page.
fn addresses(page: &str) -> impl Iterator<Item = &str> {
    let of = |name: &'static str| page.split(name).skip(1).filter_map(|rest| rest.split('"').next());
    [" href=\"", " src=\"", " action=\""].into_iter().flat_map(of)
}

/// The file that a relative address in `file` leads to.
fn target(file: &str, address: &str) -> String {
    let path = address.split(['?', '#']).next().unwrap_or_default();
    let mut parts: Vec<String> = Vec::new();
    for part in Path::new(file).parent().expect("a folder").join(path).components() {
        match part {
            Component::ParentDir => drop(parts.pop().expect("it stays inside the copy")),
            part => parts.push(part.as_os_str().to_string_lossy().into_owned()),
        }
    }
    parts.join("/")
}

#[tokio::test]
async fn a_copy_holds_what_its_links_lead_to_and_asks_no_other_origin() {
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
async fn what_is_hidden_is_in_no_copy() {
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
async fn a_phase_that_nobody_knows_and_a_file_that_cannot_be_kept_are_failures() {
    let arena = Arena::new().await;
    let reader = arena.store.reader();
    let unknown = freeze(&reader, Some("nowhere"), 100, &mut |_, _| Ok(())).await;
    assert!(matches!(unknown, Err(FreezeError::NoPhase(phase)) if phase == "nowhere"));
    let full = &mut |_: &str, _: &[u8]| Err(io::Error::from(io::ErrorKind::StorageFull));
    let failed = freeze(&reader, Some("open"), 100, full).await;
    assert!(matches!(failed, Err(FreezeError::File { .. })), "{failed:?}");
}
