use crate::{Answer, Arena, ORGANISER, RUDE_TEAM, TOKEN, phase};
use avln_challenge::Schedule;
use avln_store::{Phase, Visibility};
use axum::{
    body::Body,
    http::{Request, StatusCode, header},
};
use serde_json::json;

const PAGES: [&str; 12] = [
    "/",
    "/docs",
    "/docs/glossary",
    "/leaderboard",
    "/phases/open",
    "/leaderboard/open",
    "/leaderboard/open?order=ordered",
    "/compare?first=run_rude&second=run_formula",
    "/runs",
    "/runs/run_rude",
    "/runs/run_begun",
    "/runs/run_rude/episodes/0",
];

#[tokio::test]
async fn run_pages_link_only_https_addresses_of_methods() {
    let arena = Arena::new().await;
    let page = arena.get("/runs/run_rude").await.body;
    let code = "<a rel=\"nofollow noopener\" href=\"https://code.example/a?b=1&#38;c=2\">";
    assert!(page.contains("Follows &#60;walls&#62;") && page.contains(code), "{page}");
    assert!(page.contains("<dd>javascript:alert(1)</dd>") && !page.contains("href=\"javascript"), "{page}");
    assert!(page.contains("<dt>Licence of the weights</dt><dd>MIT</dd>"), "{page}");
    assert!(!page.contains("Other training data"), "{page}");
    let method = &arena.get("/api/v1/runs/run_rude").await.json()["method"];
    assert_eq!(
        (&method["code_url"], &method["external_data"]),
        (&json!("https://code.example/a?b=1&c=2"), &json!(""))
    );
}

#[tokio::test]
async fn boards_and_runs_show_method_types() {
    let arena = Arena::new().await;
    for board in ["/leaderboard/open?order=unordered", "/leaderboard/open?order=both", "/embed/open"] {
        let page = arena.get(board).await.body;
        assert!(page.contains("<th scope=\"col\">Type</th>"), "{board}: {page}");
        assert!(
            page.contains("<td>learnt perception</td>") && page.contains("<td>–</td>"),
            "{board}: {page}"
        );
    }
    let typed = arena.get("/runs/run_rude").await.body;
    assert!(typed.contains("<dt>Type</dt><dd>learnt perception</dd>"), "{typed}");
    assert!(!arena.get("/runs/run_formula").await.body.contains("<dt>Type</dt>"));
    let compared = arena.get("/compare?first=run_rude&second=run_formula").await.body;
    assert_eq!(compared.matches(", learnt perception</dd>").count(), 1, "{compared}");
}

#[tokio::test]
async fn pages_have_a_heading_title_and_skip_link() {
    let arena = Arena::new().await;
    for address in PAGES {
        let page = arena.get(address).await;
        assert_eq!(page.status, StatusCode::OK, "{address}: {}", page.body);
        assert_eq!(page.header(header::CONTENT_TYPE), "text/html; charset=utf-8");
        assert_eq!(page.body.matches("<h1>").count(), 1, "{address}");
        assert!(page.body.contains("<title>") && page.body.contains("href=\"#main\""), "{address}");
        assert_scripts(&page.body, address);
        assert!(!page.body.contains("style="), "{address}: the policy forbids styles in elements");
        assert!(
            page.body.matches("<table").count()
                == page.body.matches("<caption>").count() + page.body.matches("aria-label=\"Table").count(),
            "{address}"
        );
    }
}

/// Checks that only replays and open runs have scripts, from files of this server, as the content security policy requires.
fn assert_scripts(page: &str, address: &str) {
    let scripts: &[&str] = match address {
        replay if replay.contains("/episodes/") => &["sound", "replay"],
        "/runs" | "/runs/run_begun" => &["live"],
        _ => &[],
    };
    assert_eq!(page.matches("<script").count(), scripts.len(), "{address}");
    for script in scripts {
        let element = format!("<script src=\"/assets/{script}.js\" defer></script>");
        assert_eq!(page.matches(&element).count(), 1, "{script} on {address}");
    }
    let tags = page.split('<').filter_map(|rest| rest.split('>').next());
    let is_handler = |word: &str| word.starts_with("on") && word.contains('=');
    assert!(!tags.flat_map(str::split_whitespace).any(is_handler), "{address}");
}

#[tokio::test]
async fn html_in_names_is_escaped() {
    let arena = Arena::new().await;
    for address in ["/", "/leaderboard/open", "/runs", "/runs/run_rude"] {
        let page = arena.get(address).await.body;
        assert!(!page.contains(RUDE_TEAM), "{address}");
        assert!(page.contains("&#60;script&#62;alert(1)&#60;/script&#62;"), "{address}");
    }
    let episode = arena.get("/runs/run_rude/episodes/0").await.body;
    assert!(!episode.contains("<b>table") && !episode.contains("<i>table"), "{episode}");
    assert!(episode.contains("&#60;i&#62;table"), "{episode}");
}

#[tokio::test]
async fn leaderboard_links_keep_the_selection() {
    let arena = Arena::new().await;
    let page = arena.get("/leaderboard/open?order=unordered&sort=isr&pick=latest").await.body;
    let caption = "2 methods over 2 episodes in 1 scene, ranked by ISR (higher is better); each method is represented by its latest run";
    assert!(page.contains(caption), "{page}");
    assert_eq!(page.matches("aria-sort=\"descending\"").count(), 1);
    assert!(
        page.contains("href=\"/leaderboard/open?order=unordered&#38;sort=spl&#38;pick=latest\""),
        "{page}"
    );
    assert!(page.contains("href=\"/leaderboard/open?order=ordered&#38;sort=isr&#38;pick=latest\""), "{page}");
    assert!(
        page.contains(
            "href=\"/api/v1/phases/open/leaderboard.csv?order=unordered&#38;sort=isr&#38;pick=latest\""
        ),
        "{page}"
    );
    assert!(
        page.contains("href=\"/leaderboard/open?order=unordered&#38;pick=latest\""),
        "the default key is omitted"
    );
    let steps = arena.get("/leaderboard/open?order=unordered&sort=steps").await.body;
    assert!(steps.contains("aria-sort=\"ascending\"") && steps.contains("lower is better"));
    let first = page.find("good walker").expect("a row");
    assert!(first < page.find("@walker").expect("a row"), "the better method comes first");
}

#[tokio::test]
async fn phase_pages_show_the_rules() {
    let arena = Arena::new().await;
    let page = arena.get("/phases/open").await.body;
    for words in [
        "0.25 m forward",
        "30° in place",
        "up to 256 × 256 pixels from 1 m",
        "4000 samples per ear at 16 kHz",
        "within 2 m of the target",
        "25 steps each",
        "at most 1000 actions",
        "unlimited",
        "--phase open",
    ] {
        assert!(page.contains(words), "{words}: {page}");
    }
    let sealed = arena.get("/phases/sealed").await;
    assert!(sealed.status == StatusCode::OK && !sealed.body.contains("canary"), "{}", sealed.body);
    assert!(arena.get("/").await.body.contains("href=\"/phases/open\""));
    assert_eq!(arena.get("/phases/nowhere").await.status, StatusCode::NOT_FOUND);
}

/// Requests a page with a `Host` header.
async fn get_at(arena: &Arena, host: &str, address: &str) -> Answer {
    let request = Request::get(address).header(header::HOST, host);
    arena.ask(request.body(Body::empty()).expect("a request")).await
}

#[tokio::test]
async fn commands_contain_the_canonical_address() {
    let web = "https://arena.example:8443";
    let own_name = Some("https://agents.example");
    for (grpc_url, shown) in [(own_name, "https://agents.example"), (None, "http://arena.example:50051")] {
        let arena = Arena::with_addresses(web, grpc_url).await;
        for address in ["/", "/docs", "/phases/open"] {
            let page = get_at(&arena, "evil.example", address).await;
            assert!(page.body.contains(&format!("--server {shown} ")), "{address}: {}", page.body);
            assert!(!page.body.contains("evil.example"), "{address}: {}", page.body);
            assert_eq!(page.header(header::VARY), "authorization, cookie, accept-encoding", "{address}");
        }
    }
    let page = get_at(&Arena::new().await, "lab.example:8080", "/").await;
    assert!(page.body.contains("--server http://lab.example:50051 "), "{}", page.body);
}

/// Changes the phase `open`.
async fn change(arena: &Arena, changed: impl FnOnce(Phase) -> Phase) {
    let open = changed(phase("open", Visibility::Public));
    arena.store.upsert_phase(&open, 50).await.expect("the phase");
}

#[tokio::test]
async fn commands_need_an_open_phase() {
    let arena = Arena::new().await;
    let closed = Schedule { closed: true, closes_unix_ms: Some(4_000_000_000_000), ..Schedule::default() };
    change(&arena, |open| Phase { schedule: closed.clone(), ..open }).await;
    let page = arena.get("/phases/open").await.body;
    assert!(page.contains("state: closed by the organiser)") && !page.contains("--phase open"), "{page}");
    let home = arena.get("/").await.body;
    assert!(home.contains("<td>closed by the organiser</td>") && !home.contains("until"), "{home}");
    assert!(home.contains("--phase sealed"), "the other phase is open: {home}");
    let sealed = Phase { schedule: closed, ..phase("sealed", Visibility::Organiser) };
    arena.store.upsert_phase(&sealed, 60).await.expect("the phase");
    let home = arena.get("/").await.body;
    assert!(home.contains("No phase is open now.") && !home.contains("avln challenge team add"), "{home}");
}

#[tokio::test]
async fn descriptions_are_markdown_without_html() {
    let arena = Arena::new().await;
    let text = "Play **fair**.<script>alert(1)</script> [rules](https://e.org/r) https://e.org/a [x](javascript:alert(1))";
    change(&arena, |open| Phase { description: text.to_owned(), ..open }).await;
    let page = arena.get("/phases/open").await.body;
    assert!(page.contains("Play <strong>fair</strong>.alert(1) "), "{page}");
    for link in ["href=\"https://e.org/r\">rules</a>", "href=\"https://e.org/a\">https://e.org/a</a>"] {
        assert!(page.contains(&format!("<a rel=\"nofollow noopener\" {link}")), "{page}");
    }
    assert!(!page.contains("<script") && !page.contains("javascript:"), "{page}");
    let json = arena.get("/api/v1/phases/open").await.json();
    assert_eq!(json["phase"]["description"], text);
}

#[tokio::test]
async fn intervals_from_few_scenes_are_marked() {
    let arena = Arena::new().await;
    let note = "Intervals from fewer than 10 scenes are unreliable and marked.";
    let mark = "<abbr title=\"from 1 scene; reliable from about 10\">few scenes</abbr>";
    for address in [
        "/",
        "/leaderboard/open",
        "/leaderboard/open?order=unordered",
        "/embed/open",
        "/runs/run_rude",
        "/compare?first=run_rude&second=run_formula",
    ] {
        let page = arena.get(address).await.body;
        assert!(page.contains(note) && page.contains(mark), "{address}: {page}");
    }
    let empty = arena.get("/leaderboard/open?order=ordered").await.body;
    assert!(!empty.contains(note) && !empty.contains("few scenes"), "{empty}");
}

#[tokio::test]
async fn run_pages_group_episodes() {
    let arena = Arena::new().await;
    let page = arena.get("/runs/run_formula").await.body;
    assert!(page.contains("By number of goals") && page.contains("By scene"), "{page}");
    assert!(
        page.contains("class=\"name\">canary-scene</th><td class=\"num\">2</td><td class=\"num\">0.0 %</td>"),
        "{page}"
    );
    assert!(page.contains("<text class=\"part0\"") && page.contains("last submit: 2"), "{page}");
    let sealed = arena.get_as("/runs/run_sealed", TOKEN).await.body;
    assert!(!sealed.contains("By number of goals") && sealed.contains("End reasons"), "{sealed}");
}

#[tokio::test]
async fn run_pages_show_failures_and_times() {
    let arena = Arena::new().await;
    let page = arena.get("/runs/run_rude").await.body;
    assert!(!page.contains("id=\"failures\"") && page.contains("250.00 ms"), "{page}");
    arena.lose("run_begun").await;
    let page = arena.get("/runs/run_begun").await.body;
    assert!(
        page.contains("id=\"failures\"")
            && page.contains("/episodes/1\">2</a></th><td>disconnected</td><td><time"),
        "{page}"
    );
}

#[tokio::test]
async fn badges_show_the_rank() {
    let arena = Arena::new().await;
    let badge = arena.get("/runs/run_formula/badge.svg").await;
    assert_eq!((badge.status, badge.header(header::CONTENT_TYPE)), (StatusCode::OK, "image/svg+xml"));
    assert!(badge.body.contains("rank ") && badge.body.contains(" of 2</text>"), "{}", badge.body);
    assert!(badge.body.contains("aria-label") && badge.body.contains("<title>"), "{}", badge.body);
    let begun = arena.get("/runs/run_begun/badge.svg").await.body;
    assert!(begun.contains("1 of 2 episodes"), "{begun}");
    assert_eq!(arena.get("/runs/nowhere/badge.svg").await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn only_embedded_leaderboards_allow_frames() {
    let arena = Arena::new().await;
    let board = arena.get("/embed/open?order=ordered&sort=isr").await;
    assert_eq!(board.status, StatusCode::OK);
    assert!(board.header(header::CONTENT_SECURITY_POLICY).ends_with("frame-ancestors *"));
    assert!(board.headers.get(header::X_FRAME_OPTIONS).is_none());
    assert!(board.body.contains("href=\"/leaderboard/open?order=ordered&#38;sort=isr\""), "{}", board.body);
    assert!(!board.body.contains("<nav") && board.body.matches("<h1>").count() == 1);
    let whole = arena.get("/leaderboard/open?order=ordered&sort=isr").await;
    assert!(whole.body.contains("href=\"/embed/open?order=ordered&#38;sort=isr\""));
    assert_eq!(whole.header(header::X_FRAME_OPTIONS), "DENY");
}

#[tokio::test]
async fn comparisons_list_episodes() {
    let arena = Arena::new().await;
    let page = arena.get("/compare?first=run_rude&second=run_formula").await.body;
    assert!(
        page.contains("+50.0 (+50.0 to +50.0)") && page.contains("first run is better in these scenes"),
        "{page}"
    );
    assert!(page.contains("href=\"#first\">Only the first found all goals</a>: 2"), "{page}");
    assert!(page.contains("href=\"/runs/run_formula/episodes/1\">1 of 2</a>"), "{page}");
    let half = arena.get("/compare?first=run_begun&second=run_rude").await.body;
    assert!(
        half.contains("Means over the 1 episode in 1 scene") && half.contains("≈ no clear difference"),
        "{half}"
    );
    let board = arena.get("/leaderboard/open?order=unordered").await.body;
    assert!(board.contains("/compare?first=run_formula&#38;second=run_rude"), "{board}");
    for (query, status) in [
        ("?first=run_rude&second=run_sealed", StatusCode::NOT_FOUND),
        ("?first=run_rude&second=nowhere", StatusCode::NOT_FOUND),
        ("?first=run_rude", StatusCode::BAD_REQUEST),
        ("", StatusCode::BAD_REQUEST),
    ] {
        assert_eq!(arena.get(&format!("/compare{query}")).await.status, status, "{query}");
    }
}

#[tokio::test]
async fn episode_pages_have_tables_and_a_map() {
    let arena = Arena::new().await;
    let page = arena.get("/runs/run_formula/episodes/1").await.body;
    assert!(page.contains("Episode 2 of 2") && page.contains("last submit"));
    assert!(page.contains("✓ step 5") && page.contains("✕ not found"), "{page}");
    assert!(page.contains("d=\"M0.00 0.00L4.00 0.00L0.00 4.25Z\""), "the floor");
    assert!(page.contains("d=\"M0.50 2.00L0.50 1.75\" stroke=\"#0072b2\""), "the first piece of the path");
    assert!(page.contains("Step 5: Submit of goal 1, right") && page.contains("Step 6: Submit, wrong"));
    assert!(page.contains("1 m</text>"), "the scale");
    assert!(page.contains("rel=\"prev\"") && !page.contains("rel=\"next\""));
    let pending = arena.get("/runs/run_begun/episodes/1").await.body;
    assert!(pending.contains("The replay is available after the episode") && !pending.contains("<figure"));
}

#[tokio::test]
async fn errors_have_pages() {
    let arena = Arena::new().await;
    for address in [
        "/nowhere",
        "/docs/nowhere",
        "/leaderboard/nowhere",
        "/runs/nowhere",
        "/runs/run_rude/episodes/9",
        "/runs/run_rude/episodes/x",
    ] {
        let page = arena.get(address).await;
        assert_eq!(page.status, StatusCode::NOT_FOUND, "{address}");
        assert!(page.body.contains("<h1>Not found</h1>"), "{address}: {}", page.body);
    }
    let rude = arena.get("/runs/%3Cscript%3E").await;
    assert!(!rude.body.contains("<script>") && rude.body.contains("&#60;script"), "{}", rude.body);
    for address in
        ["/leaderboard/open?sort=fame", "/leaderboard/open?colour=red", "/runs?limit=0", "/docs?colour=red"]
    {
        let page = arena.get(address).await;
        assert_eq!(page.status, StatusCode::BAD_REQUEST, "{address}");
        assert!(page.body.contains("<h1>Invalid request</h1>"), "{address}");
    }
}

#[tokio::test]
async fn phase_pages_show_missions_and_scenes() {
    let arena = Arena::new().await;
    let page = arena.get("/phases/open").await.body;
    assert!(page.contains("<th scope=\"row\">2 goals</th><td class=\"num\">2</td>"), "{page}");
    assert!(page.contains("<th scope=\"row\">chair</th><td class=\"num\">2</td>"), "{page}");
    assert!(page.contains("<th scope=\"row\">0 to 10 m</th><td class=\"num\">2</td>"), "{page}");
    assert!(page.contains("src=\"/phases/open/scenes/0.svg\"") && page.contains("2 missions"), "{page}");
    let plan = arena.get("/phases/open/scenes/0.svg").await;
    assert_eq!(plan.header(header::CONTENT_TYPE), "image/svg+xml");
    assert!(plan.body.contains("<path fill=\"#8a93a3\" d=\"M0.00 0.00L4.00"), "{}", plan.body);
    for nowhere in ["/phases/open/scenes/1.svg", "/phases/open/scenes/a.svg", "/phases/nowhere/scenes/0.svg"]
    {
        assert_eq!(arena.get(nowhere).await.status, StatusCode::NOT_FOUND, "{nowhere}");
    }
    let json = arena.get("/api/v1/phases/open/missions").await.json();
    assert_eq!(json["missions"]["scenes"]["canary-scene"], 2);
}

const SEALED: [&str; 20] = [
    "/",
    "/api/v1/runs.csv",
    "/leaderboard/sealed",
    "/runs",
    "/runs/run_sealed",
    "/runs/run_sealed/episodes/0",
    "/runs/run_sealed/badge.svg",
    "/embed/sealed",
    "/api/v1/phases/sealed/leaderboard",
    "/api/v1/phases/sealed/leaderboard.csv",
    "/api/v1/runs/run_sealed/episodes.csv",
    "/leaderboard/sealed?order=both",
    "/api/v1/phases/sealed/leaderboards",
    "/api/v1/phases/sealed/leaderboards.csv",
    "/runs/run_sealed/episodes/0?t=1",
    "/runs/run_sealed/episodes/0/eyes/1.png",
    "/runs/run_sealed/episodes/0?ears=on",
    "/runs/run_sealed/episodes/0/ears/0-1.wav",
    "/api/v1/runs/run_sealed/episodes/0/levels.csv",
    "/api/v1/runs/run_sealed/episodes/0/steps.csv",
];

#[tokio::test]
async fn sealed_runs_are_hidden_without_a_token() {
    let arena = Arena::new().await;
    for address in SEALED {
        let answer = arena.get(address).await;
        assert!(!answer.body.contains("secret walker"), "{address}: {}", answer.body);
        let gone = address.contains("run_sealed");
        assert_eq!(answer.status, if gone { StatusCode::NOT_FOUND } else { StatusCode::OK }, "{address}");
    }
    for hidden in [
        "/api/v1/phases/sealed/missions",
        "/api/v1/phases/sealed/missions.csv",
        "/phases/sealed/scenes/0.svg",
    ] {
        assert_eq!(arena.get(hidden).await.status, StatusCode::NOT_FOUND, "{hidden}");
        assert_eq!(arena.get_as(hidden, TOKEN).await.status, StatusCode::NOT_FOUND, "{hidden}");
        assert_eq!(arena.get_as(hidden, ORGANISER).await.status, StatusCode::OK, "{hidden}");
    }
    let phase = arena.get_as("/phases/sealed", TOKEN).await.body;
    assert!(!phase.contains("canary") && !phase.contains("Goals per mission"), "{phase}");
    let board = arena.get("/leaderboard/sealed").await.body;
    assert!(board.contains("Scores of this phase are visible to: the organiser"), "{board}");
}

#[tokio::test]
async fn sealed_scores_are_visible_to_organisers_only() {
    let arena = Arena::new().await;
    let own = arena.get_as("/runs/run_sealed", TOKEN).await;
    assert_eq!(own.status, StatusCode::OK);
    assert!(own.body.contains("The scores of this phase are hidden") && own.body.contains("2 of 2 episodes"));
    assert!(!own.body.contains("id=\"scores\"") && !own.body.contains("canary"), "{}", own.body);
    let json = arena.get_as("/api/v1/runs/run_sealed", TOKEN).await;
    assert!(json.json()["summary"].is_null());
    let badge = arena.get_as("/runs/run_sealed/badge.svg", TOKEN).await.body;
    assert!(badge.contains("scores are hidden") && !badge.contains("canary"), "{badge}");
    for address in ["/compare", "/api/v1/compare", "/api/v1/compare.csv"] {
        let both = arena.get_as(&format!("{address}?first=run_sealed&second=run_sealed"), TOKEN).await;
        assert_eq!(both.status, StatusCode::BAD_REQUEST, "{}", both.body);
        assert!(both.body.contains("hides the scores of single episodes") && !both.body.contains("canary"));
    }
    let episode = arena.get_as("/runs/run_sealed/episodes/0", TOKEN).await.body;
    assert!(!episode.contains("<figure") && !episode.contains("canary"), "{episode}");
    let seen = arena.get_as("/runs/run_sealed", ORGANISER).await.body;
    assert!(seen.contains("id=\"scores\"") && seen.contains("canary-scene"));
    let board = arena.get_as("/leaderboard/sealed", ORGANISER).await.body;
    assert!(board.contains("secret walker"));
}

#[tokio::test]
async fn private_responses_are_not_cached() {
    let arena = Arena::new().await;
    let own = arena.get_as("/runs/run_sealed", TOKEN).await;
    assert_eq!(own.header(header::CACHE_CONTROL), "private, no-store");
    assert_eq!(own.header(header::VARY), "authorization, cookie, accept-encoding, host");
    let bad = arena.get_as("/api/v1/runs", "no such token").await;
    assert_eq!(bad.status, StatusCode::UNAUTHORIZED);
    assert_eq!(bad.header(header::WWW_AUTHENTICATE), "Bearer");
    assert_eq!(bad.json()["reason"], "UNAUTHENTICATED");
}

#[tokio::test]
async fn logs_follow_the_visibility_of_replays() {
    let arena = Arena::new().await;
    for run in ["run_rude", "run_begun", "run_sealed"] {
        let path = arena.folder.path().join(format!("{run}.log"));
        std::fs::write(path, format!("the canary log of {run}\n")).expect("a log");
    }
    let log = arena.get("/api/v1/runs/run_rude/log").await;
    assert_eq!((log.status, log.body.as_str()), (StatusCode::OK, "the canary log of run_rude\n"));
    assert_eq!(log.header(header::CACHE_CONTROL), "private, no-store");
    assert_eq!(log.header(header::CONTENT_DISPOSITION), "attachment; filename=\"run_rude.log\"");
    let open = arena.get("/api/v1/runs/run_begun/log").await;
    assert_eq!(open.status, StatusCode::BAD_REQUEST);
    assert!(open.body.contains("is still open") && !open.body.contains("canary"), "{}", open.body);
    for hidden in [
        arena.get("/api/v1/runs/run_sealed/log").await,
        arena.get_as("/api/v1/runs/run_sealed/log", TOKEN).await,
        arena.get("/api/v1/runs/..%2Frun_rude/log").await,
        arena.get("/api/v1/runs/run_formula/log").await,
    ] {
        assert_eq!(hidden.status, StatusCode::NOT_FOUND);
        assert!(!hidden.body.contains("canary"), "{}", hidden.body);
    }
    let organiser = arena.get_as("/api/v1/runs/run_sealed/log", ORGANISER).await;
    assert_eq!(organiser.body, "the canary log of run_sealed\n");
    assert_eq!(arena.get("/api/v1/status").await.json()["log_key"], crate::LOG_KEY);
}
