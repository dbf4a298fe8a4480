use crate::fixture::{Arena, listed, repository};
use avln_web::Documents;
use axum::http::{StatusCode, header};
use std::{collections::BTreeSet, fs};

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
    let present: BTreeSet<String> = folders.into_iter().flat_map(documents_in).collect();
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
