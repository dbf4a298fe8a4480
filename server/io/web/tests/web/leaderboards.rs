use crate::fixture::Arena;
use avln_episode::Sensors;
use axum::http::{StatusCode, header};

/// Returns an arena with two methods, one with and one without sound.
async fn arena() -> Arena {
    let arena = Arena::new().await;
    let hears = Sensors::all(64, 64);
    let deaf = Sensors { audio: false, ..hears.clone() };
    for (run, sensors) in [("run_rude", &hears), ("run_formula", &deaf)] {
        arena.store.set_sensors(run, sensors).await.expect("a run");
    }
    arena
}

/// Returns the methods in a table in order of their rows.
fn methods(page: &str) -> Vec<&'static str> {
    let body = page.split("<tbody>").nth(1).unwrap_or_default();
    let mut found: Vec<_> = ["good walker", "@walker", "slow walker", "secret walker"]
        .into_iter()
        .filter_map(|name| Some((body.find(&format!(">{name}<"))?, name)))
        .collect();
    found.sort_unstable();
    found.into_iter().map(|(_, name)| name).collect()
}

#[tokio::test]
async fn filtered_entries_keep_their_ranks() {
    let arena = arena().await;
    let board =
        async |query: &str| arena.get(&format!("/leaderboard/open?order=unordered&{query}")).await.body;
    assert_eq!(methods(&board("").await), ["good walker", "@walker"]);
    for (query, wanted) in [
        ("q=GOOD", vec!["good walker"]),
        ("q=%3D1", vec!["@walker"]),
        ("q=nobody", vec![]),
        ("team=%3D1%2B1", vec!["@walker"]),
        ("audio=with", vec!["good walker"]),
        ("audio=without", vec!["@walker"]),
        ("rgb=without", vec![]),
        ("rgb=with&depth=with&sort=spl", vec!["good walker", "@walker"]),
    ] {
        assert_eq!(methods(&board(query).await), wanted, "{query}");
        let csv = arena.get(&format!("/api/v1/phases/open/leaderboard.csv?{query}")).await.body;
        assert_eq!(csv.lines().count(), 1 + wanted.len(), "{query}: {csv}");
        let json = arena.get(&format!("/api/v1/phases/open/leaderboard.json?{query}")).await.json();
        assert_eq!(json["rows"].as_array().map(Vec::len), Some(wanted.len()), "{query}");
        assert_eq!(json["entries"], 2);
    }
    let second = board("audio=without").await;
    assert!(second.contains("1 of 2 methods, ranked among all of them,"), "{second}");
    assert!(second.contains("<td class=\"num rank\">2"), "{second}");
    assert!(second.contains("colour, depth, no sound"), "{second}");
    assert!(
        second.contains("/compare?first=run_formula&#38;second=run_rude"),
        "the leader is filtered out: {second}"
    );
}

#[tokio::test]
async fn forms_redirect_to_canonical_addresses() {
    let arena = arena().await;
    let form = "order=&sort=sr&pick=best&q=&team=&rgb=&depth=&audio=with&as_of=";
    let all = "sr isr osr spl soft_spl steps path_m collisions wrong_submits".split(' ');
    let columns: String = all.map(|column| format!("&column={column}")).collect();
    let sent = arena.get(&format!("/leaderboard/open?{form}{columns}")).await;
    assert_eq!(sent.status, StatusCode::SEE_OTHER);
    assert_eq!(sent.header(header::LOCATION), "/leaderboard/open?audio=with");
    let fewer = arena.get("/leaderboard/open?order=ordered&q=&column=spl&column=sr").await;
    assert_eq!(fewer.header(header::LOCATION), "/leaderboard/open?order=ordered&column=sr&column=spl");
    let page = arena.get("/leaderboard/open?order=unordered&column=sr&column=spl&sort=isr").await.body;
    let heads = page.split("<thead>").nth(1).and_then(|rest| rest.split("</thead>").next()).expect("a head");
    assert!(heads.contains(">SR <") && heads.contains(">SPL <") && heads.contains(">ISR <"), "{heads}");
    assert!(!heads.contains("Collisions"), "{heads}");
    assert!(
        page.contains("href=\"/leaderboard/open?order=unordered&#38;sort=spl&#38;column=sr&#38;column=spl\""),
        "{page}"
    );
    assert!(page.contains("leaderboard.csv?order=unordered&#38;sort=isr\""), "CSV has all columns: {page}");
    for wrong in ["as_of=yesterday", "audio=yes", "q=a&colour=red", "column=fame"] {
        let page = arena.get(&format!("/leaderboard/open?{wrong}")).await;
        assert_eq!(page.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    assert_eq!(arena.get("/api/v1/phases/open/leaderboard?column=sr").await.status, StatusCode::BAD_REQUEST);
}

#[tokio::test]
async fn past_leaderboards_show_their_date() {
    let arena = arena().await;
    let then = arena.get("/leaderboard/open?order=unordered&as_of=1970-01-01").await.body;
    assert!(then.contains(", as of the end of 1970-01-01 UTC"), "{then}");
    assert_eq!(methods(&then).len(), 2);
    let before = arena.get("/leaderboard/open?order=unordered&as_of=1969-12-31").await.body;
    assert!(before.contains("There are no completed runs") && methods(&before).is_empty(), "{before}");
}

#[tokio::test]
async fn all_orders_are_side_by_side() {
    let arena = arena().await;
    let page = arena.get("/leaderboard/open?order=both").await;
    assert_eq!(page.status, StatusCode::OK);
    assert_eq!(page.body, arena.get("/leaderboard/open").await.body, "the default of a phase");
    assert_eq!(methods(&page.body), ["good walker", "@walker"]);
    assert_eq!(page.body.matches("scope=\"colgroup\" colspan=\"6\"").count(), 2);
    assert!(page.body.contains("Unordered: 2 methods; Ordered: 0 methods."), "{}", page.body);
    assert!(page.body.contains("href=\"/api/v1/phases/open/leaderboards.csv\""), "{}", page.body);
    let csv = arena.get("/api/v1/phases/open/leaderboards.csv").await.body;
    assert_eq!(csv.lines().filter(|line| line.contains(",unordered,")).count(), 2, "{csv}");
    let json = arena.get("/api/v1/phases/open/leaderboards?audio=with").await.json();
    assert_eq!(json["boards"][0]["rows"].as_array().map(Vec::len), Some(1));
    for wrong in [
        "/api/v1/phases/open/leaderboard?order=both",
        "/api/v1/phases/open/leaderboards?order=ordered",
        "/embed/open?order=both",
    ] {
        assert_eq!(arena.get(wrong).await.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    let sealed = arena.get("/leaderboard/sealed?order=both").await;
    assert!(sealed.status == StatusCode::OK && !sealed.body.contains("secret walker"), "{}", sealed.body);
    assert!(sealed.body.contains("These ranks include only the runs that you may see"), "{}", sealed.body);
}
