use crate::{Answer, Arena};
use avln_episode::Sensors;
use axum::{
    body::Body,
    http::{Request, StatusCode, header},
};
use serde_json::Value;

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
    assert!(lines[0].ends_with(",verified,type"), "{}", lines[0]);
    assert!(
        lines[1].ends_with(",false,learnt-perception") && lines[2].ends_with(",false,"),
        "{}",
        table.body
    );
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
        assert_eq!(packed.1[header::VARY], "authorization, cookie, accept-encoding, host", "{address}");
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
        let exposed = answer.header(header::ACCESS_CONTROL_EXPOSE_HEADERS);
        assert_eq!(exposed == "etag, x-request-id", shared, "{address}");
        assert!(
            answer.headers["permissions-policy"].to_str().is_ok_and(|policy| policy.contains("camera=()"))
        );
        assert_eq!(answer.headers["cross-origin-opener-policy"], "same-origin", "{address}");
        assert_eq!(answer.header(header::STRICT_TRANSPORT_SECURITY), "", "without TLS: {address}");
    }
    let framed = arena.get("/embed/open").await;
    assert!(!framed.headers.contains_key("cross-origin-opener-policy"));
    for (web_url, requires_tls) in [("https://arena.example", true), ("http://arena.example", false)] {
        let answer = Arena::with_addresses(web_url, None).await.get("/").await;
        let expected = if requires_tls { "max-age=31536000" } else { "" };
        assert_eq!(answer.header(header::STRICT_TRANSPORT_SECURITY), expected, "{web_url}");
    }
}

#[tokio::test]
async fn browsers_may_ask_before_api_requests() {
    let arena = Arena::new().await;
    let ask = async |address: &str| {
        let request = Request::options(address)
            .header(header::ORIGIN, "https://elsewhere.example")
            .header(header::ACCESS_CONTROL_REQUEST_METHOD, "GET")
            .header(header::ACCESS_CONTROL_REQUEST_HEADERS, "authorization");
        arena.ask(request.body(Body::empty()).expect("a request")).await
    };
    let answer = ask("/api/v1/runs").await;
    assert_eq!((answer.status, answer.body.as_str()), (StatusCode::NO_CONTENT, ""));
    for (name, value) in [
        (header::ACCESS_CONTROL_ALLOW_ORIGIN, "*"),
        (header::ACCESS_CONTROL_ALLOW_METHODS, "GET, HEAD"),
        (header::ACCESS_CONTROL_ALLOW_HEADERS, "authorization, if-none-match"),
        (header::ACCESS_CONTROL_MAX_AGE, "86400"),
    ] {
        assert_eq!(answer.header(name.clone()), value, "{name}");
    }
    let page = ask("/runs").await;
    assert_eq!(page.status, StatusCode::METHOD_NOT_ALLOWED);
    assert_eq!(page.header(header::ACCESS_CONTROL_ALLOW_ORIGIN), "");
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

/// Returns an arena with two methods, one with and one without sound.
async fn arena_with_sensors() -> Arena {
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
    let arena = arena_with_sensors().await;
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
        ("type=learnt-perception", vec!["good walker"]),
        ("type=rl", vec![]),
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
    let arena = arena_with_sensors().await;
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
    for wrong in ["as_of=yesterday", "audio=yes", "type=magic", "q=a&colour=red", "column=fame"] {
        let page = arena.get(&format!("/leaderboard/open?{wrong}")).await;
        assert_eq!(page.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    assert_eq!(arena.get("/api/v1/phases/open/leaderboard?column=sr").await.status, StatusCode::BAD_REQUEST);
}

#[tokio::test]
async fn past_leaderboards_show_their_date() {
    let arena = arena_with_sensors().await;
    let then = arena.get("/leaderboard/open?order=unordered&as_of=1970-01-01").await.body;
    assert!(then.contains(", as of the end of 1970-01-01 UTC"), "{then}");
    assert_eq!(methods(&then).len(), 2);
    let before = arena.get("/leaderboard/open?order=unordered&as_of=1969-12-31").await.body;
    assert!(before.contains("There are no completed runs") && methods(&before).is_empty(), "{before}");
}

#[tokio::test]
async fn all_orders_are_side_by_side() {
    let arena = arena_with_sensors().await;
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
