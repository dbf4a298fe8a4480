//! Sign-in, permissions of teams and organisers, and protection against requests from other sites.

use crate::{
    Arena, FORMULA_TEAM, ORGANISER, RUDE_TEAM, TOKEN,
    site::{NEW_SECRET, READ_ONLY, Site},
};
use avln_store::{AuditNote, TokenScope};
use axum::body::Body;
use axum::http::{StatusCode, header};
use std::net::SocketAddr;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::{TcpListener, TcpStream},
};

#[tokio::test]
async fn visitors_sign_in_and_out() {
    let site = Site::new().await;
    let mut browser = site.stranger();
    let page = browser.get("/runs").await;
    assert!(page.body.contains("<a href=\"/sign-in\" aria-current=\"false\">Sign in</a>"), "{}", page.body);
    assert_eq!(browser.get("/sign-in?next=/me").await.status, StatusCode::OK);
    let answer = browser.sign_in(TOKEN, "").await;
    assert_eq!((answer.status, answer.header(header::LOCATION)), (StatusCode::SEE_OTHER, "/me"));
    let cookie = answer.header(header::SET_COOKIE);
    assert!(cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict") && !cookie.contains(TOKEN), "{cookie}");
    let me = browser.get("/me").await;
    assert_eq!(me.header(header::CACHE_CONTROL), "private, no-store");
    assert_eq!(me.header(header::VARY), "authorization, cookie, accept-encoding, host");
    for words in ["secret walker", "good walker", "this one", "Quota", "/runs/run_sealed"] {
        assert!(me.body.contains(words), "{words}: {}", me.body);
    }
    assert!(!me.body.contains(TOKEN) && !me.body.contains("@walker"), "{}", me.body);
    assert!(!me.body.contains("<script>"), "names are escaped");
    let own = browser.get("/runs/run_sealed").await;
    assert_eq!((own.status, own.header(header::CACHE_CONTROL)), (StatusCode::OK, "private, no-store"));
    assert!(own.body.contains("<a href=\"/me\" aria-current=\"false\">My page</a>"), "{}", own.body);
    assert_eq!(browser.get("/api/v1/runs/run_sealed").await.status, StatusCode::OK, "the API as well");
    let lost = browser.get("/nowhere").await;
    assert!(lost.body.contains("My page"), "error pages have the same menu");
    let out = browser.act("/sign-out", "").await;
    assert!(out.header(header::SET_COOKIE).contains("Max-Age=0"), "{:?}", out.headers);
    let gone = browser.get("/me").await;
    assert_eq!((gone.status, gone.header(header::LOCATION)), (StatusCode::SEE_OTHER, "/sign-in?next=/me"));
    assert_eq!(browser.get("/runs/run_sealed").await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn without_management_there_is_no_sign_in() {
    let arena = Arena::new().await;
    for address in ["/sign-in", "/me", "/organise", "/organise/audit"] {
        assert_eq!(arena.get(address).await.status, StatusCode::NOT_FOUND, "{address}");
    }
    assert!(!arena.get("/").await.body.contains("/sign-in"));
}

#[tokio::test]
async fn invalid_tokens_are_refused_alike_and_limited() {
    let site = Site::new().await;
    site.arena.store.revoke_tokens(FORMULA_TEAM, 5).await.expect("a team");
    let mut browser = site.stranger();
    let mut pages = Vec::new();
    for token in ["no-such-token", "run_rude", "run_formula"] {
        let answer = browser.sign_in(token, "").await;
        assert_eq!(answer.status, StatusCode::FORBIDDEN, "{token}");
        assert_eq!(answer.header(header::SET_COOKIE), "");
        assert!(!answer.body.contains(token) && answer.body.contains("href=\"/sign-in\""), "{}", answer.body);
        pages.push(answer.body);
    }
    assert!(pages.windows(2).all(|two| two[0] == two[1]), "they differ");
    for _ in 0..7 {
        browser.sign_in("no-such-token", "").await;
    }
    let waits = browser.sign_in(TOKEN, "").await;
    assert_eq!(waits.status, StatusCode::TOO_MANY_REQUESTS, "{}", waits.body);
    assert_eq!(waits.header(header::RETRY_AFTER), "60");
}

#[tokio::test]
async fn sign_in_redirects_to_management_pages_only() {
    let site = Site::new().await;
    let wanted = site.stranger().get("/organise/audit").await;
    assert_eq!(wanted.header(header::LOCATION), "/sign-in?next=/organise/audit");
    let form = site.stranger().get("/sign-in?next=/organise/audit").await.body;
    assert!(form.contains("name=\"next\" value=\"/organise/audit\""), "{form}");
    let foreign = site.stranger().get("/sign-in?next=//evil.example").await.body;
    assert!(!foreign.contains("evil"), "{foreign}");
    for (next, to) in
        [("/organise/audit", "/organise/audit"), ("%2F%2Fevil.example", "/organise"), ("", "/organise")]
    {
        let answer = site.stranger().sign_in(ORGANISER, next).await;
        assert_eq!(answer.header(header::LOCATION), to, "{next}");
    }
}

#[tokio::test]
async fn forms_need_the_origin_and_the_key() {
    let site = Site::new().await;
    let browser = site.signed_in(TOKEN).await;
    let other = site.signed_in(TOKEN).await;
    let (key, foreign_key) = (browser.key().await, other.key().await);
    assert_ne!(key, foreign_key, "each session has its own");
    let fields = |key: &str| format!("action=revoke&id=abc&key={key}");
    for keyless in ["action=revoke&id=abc".to_owned(), fields(""), fields("0"), fields(&foreign_key)] {
        let answer = browser.post("/me", &keyless).await;
        assert_eq!(answer.status, StatusCode::FORBIDDEN, "{keyless}: {}", answer.body);
    }
    let origins = [
        ("origin", "https://evil.example"),
        ("origin", "null"),
        ("sec-fetch-site", "cross-site"),
        ("sec-fetch-site", "same-site"),
        ("x-nothing", ""),
    ];
    for (name, value) in origins {
        for (address, fields) in [("/me", fields(&key)), ("/sign-in", format!("token={TOKEN}&next="))] {
            let request = browser.request("POST", address).header(name, value);
            let answer = site.arena.ask(request.body(Body::from(fields)).expect("a request")).await;
            assert_eq!(answer.status, StatusCode::FORBIDDEN, "{address} {name}: {value}");
        }
    }
    let unsigned = site.stranger().post("/me", &fields(&key)).await;
    assert_eq!(unsigned.status, StatusCode::SEE_OTHER, "the key requires the cookie");
    let large = browser.post("/me", &format!("{}&x={}", fields(&key), "x".repeat(20_000))).await;
    assert_eq!(large.status, StatusCode::PAYLOAD_TOO_LARGE);
    assert_eq!(site.asked(), Vec::<String>::new());
    let same = browser.request("POST", "/me").header(header::ORIGIN, "http://arena.example");
    let answer = site.arena.ask(same.body(Body::from(fields(&key))).expect("a request")).await;
    assert_eq!(answer.status, StatusCode::SEE_OTHER, "{}", answer.body);
    assert_eq!(site.asked().len(), 1);
}

#[tokio::test]
async fn new_tokens_and_confirmations_are_shown_once() {
    let site = Site::new().await;
    let browser = site.signed_in(TOKEN).await;
    let shown = browser.act("/me", "action=issue&name=laptop&kind=read_only&days=30").await;
    assert_eq!((shown.status, shown.header(header::CACHE_CONTROL)), (StatusCode::OK, "no-store"));
    assert_eq!(shown.body.matches(NEW_SECRET).count(), 1, "{}", shown.body);
    assert!(!browser.get("/me").await.body.contains(NEW_SECRET), "once");
    let cancelled = browser.act("/me", "action=cancel&run=run_begun").await;
    assert_eq!((cancelled.status, cancelled.header(header::LOCATION)), (StatusCode::SEE_OTHER, "/me"));
    let page = browser.get("/me").await.body;
    assert!(page.contains("It is &#60;done&#62;."), "{page}");
    assert!(!browser.get("/me").await.body.contains("It is"), "once");
    for wrong in ["action=fly", "action=issue&name=x&kind=account&days=0", "action=revoke", ""] {
        assert_eq!(browser.act("/me", wrong).await.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    let issue = "IssueToken { name: \"laptop\", looks_only: true, days: Some(30) }";
    let expected = [issue, "CancelRun { run: \"run_begun\" }"];
    assert_eq!(site.asked(), expected.map(|action| format!("{RUDE_TEAM}: {action}")));
}

#[tokio::test]
async fn read_only_tokens_change_nothing() {
    let site = Site::new().await;
    let browser = site.signed_in(READ_ONLY).await;
    let page = browser.get("/me").await.body;
    assert!(page.contains("which is read-only") && page.contains("secret walker"), "{page}");
    assert!(!page.contains("name=\"action\""), "{page}");
    assert_eq!(browser.act("/me", "action=revoke&id=abc").await.status, StatusCode::CONFLICT);
    assert_eq!(site.asked(), Vec::<String>::new());
}

const ORGANISERS: [&str; 8] = [
    "/organise",
    "/organise/phases/open",
    "/organise/phases/nowhere",
    "/organise/teams",
    "/organise/runs",
    "/organise/runs/run_sealed",
    "/organise/audit",
    "/organise/health",
];

#[tokio::test]
async fn teams_have_no_organiser_pages() {
    let site = Site::new().await;
    let browser = site.signed_in(TOKEN).await;
    let nothing = browser.get("/nowhere").await;
    for address in ORGANISERS {
        let answer = browser.get(address).await;
        assert_eq!((answer.status, &answer.body), (StatusCode::NOT_FOUND, &nothing.body), "{address}");
        let stranger = site.stranger().get(address).await;
        let to = format!("/sign-in?next={address}");
        assert_eq!(stranger.header(header::LOCATION), to);
    }
    let key = browser.key().await;
    for (address, action) in [
        ("/organise/phases/open", "action=pause&reason=x"),
        ("/organise/teams", "action=admit&team=x&reason="),
        ("/organise/runs/run_formula", "action=disqualify&reason=x"),
    ] {
        let answer = browser.post(address, &format!("{action}&key={key}")).await;
        assert_eq!((answer.status, &answer.body), (StatusCode::NOT_FOUND, &nothing.body), "{address}");
    }
    assert_eq!(site.asked(), Vec::<String>::new());
}

#[tokio::test]
async fn organiser_pages_show_the_state() {
    let site = Site::new().await;
    let browser = site.signed_in(ORGANISER).await;
    assert_eq!(browser.get("/me").await.header(header::LOCATION), "/organise");
    for address in ORGANISERS.iter().filter(|address| !address.ends_with("nowhere")) {
        let page = browser.get(address).await;
        assert_eq!(page.status, StatusCode::OK, "{address}: {}", page.body);
        assert_eq!(page.body.matches("<h1>").count(), 1, "{address}");
        assert_eq!(page.body.matches("<table").count(), page.body.matches("<caption>").count(), "{address}");
        assert!(!page.body.contains("<script") && !page.body.contains("style="), "{address}");
        assert!(!page.body.contains(ORGANISER), "{address}");
        assert_eq!(page.header(header::CACHE_CONTROL), "private, no-store", "{address}");
    }
    assert_eq!(browser.get("/organise/phases/nowhere").await.status, StatusCode::NOT_FOUND);
    let health = browser.get("/organise/health").await.body;
    assert!(health.contains("4321") && health.contains(">77</td>"), "{health}");
    let teams = browser.get("/organise/teams").await.body;
    assert!(teams.contains("&#60;script&#62;alert(1)") && teams.contains("=1+1"), "{teams}");
    assert!(browser.get("/runs/run_sealed").await.body.contains("href=\"/organise/runs/run_sealed\""));
}

#[tokio::test]
async fn the_audit_log_has_pages() {
    let site = Site::new().await;
    for index in 0..150 {
        let note = AuditNote { what: format!("change {index}."), ..AuditNote::default() };
        site.arena.store.add_audit_note(note, 100).await.expect("a line");
    }
    let browser = site.signed_in(ORGANISER).await;
    let newest = browser.get("/organise/audit").await.body;
    assert!(
        newest.contains("change 149.") && newest.contains("change 50.") && !newest.contains("change 49."),
        "{newest}"
    );
    assert!(newest.contains("href=\"/organise/audit?before=51\""), "{newest}");
    let older = browser.get("/organise/audit?before=51").await.body;
    assert!(
        older.contains("change 49.") && older.contains("change 0.") && !older.contains("Older lines"),
        "{older}"
    );
}

#[tokio::test]
async fn irreversible_actions_need_confirmation_and_reasons() {
    let site = Site::new().await;
    let browser = site.signed_in(ORGANISER).await;
    for wrong in [
        "action=close&reason=over&typed=",
        "action=close&reason=over&typed=sealed",
        "action=close&reason=+&typed=open",
        "action=pause&reason=",
        "action=pause&reason=a%0Ab",
        "action=reveal&reason=&typed=opem",
    ] {
        let answer = browser.act("/organise/phases/open", wrong).await;
        assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    let long = format!("action=pause&reason={}", "x".repeat(501));
    assert_eq!(browser.act("/organise/phases/open", &long).await.status, StatusCode::BAD_REQUEST);
    assert_eq!(site.asked(), Vec::<String>::new());
    let closed = browser.act("/organise/phases/open", "action=close&reason=it+is+over&typed=open").await;
    assert_eq!(closed.header(header::LOCATION), "/organise/phases/open");
    let admitted = browser.act("/organise/teams", "action=admit&team=blue&reason=").await;
    assert_eq!(admitted.body.matches(NEW_SECRET).count(), 1, "{}", admitted.body);
    let grant = "action=grant&team=nobody&phase=open&runs=2&reason=a+full+disk";
    let refused = browser.act("/organise/teams", grant).await;
    assert_eq!(refused.status, StatusCode::CONFLICT);
    assert!(refused.body.contains("Sorry, no such team; nothing was changed."), "{}", refused.body);
    let expected = [
        "organiser: Close(\"open\") because it is over",
        "organiser: Admit { team: \"blue\" } because ",
        "organiser: Grant { team: \"nobody\", phase: \"open\", runs: 2 } because a full disk",
    ];
    assert_eq!(site.asked(), expected);
}

#[tokio::test]
async fn disqualified_runs_leave_the_leaderboard() {
    let site = Site::new().await;
    let organiser = site.signed_in(ORGANISER).await;
    let rule = "/organise/runs/run_rude";
    organiser.act(rule, "action=verify&reason=we+ran+it").await;
    let stranger = site.stranger();
    let board = stranger.get("/leaderboard/open").await.body;
    assert!(
        board.contains("good walker") && board.contains("<span class=\"badge\">verified</span>"),
        "{board}"
    );
    assert_eq!(board.matches("verified</span>").count(), 1, "only one run is verified");
    let json = stranger.get("/api/v1/phases/open/leaderboard").await.json();
    assert_eq!([&json["rows"][0]["verified"], &json["rows"][1]["verified"]], [true, false]);
    assert!(stranger.get("/runs/run_rude").await.body.contains("verified by the organiser"));
    organiser.act(rule, "action=disqualify&reason=it+read+the+%3Cmap%3E").await;
    let board = stranger.get("/leaderboard/open?order=unordered").await.body;
    assert!(!board.contains("good walker") && board.contains("1 method over"), "{board}");
    assert_eq!(stranger.get("/api/v1/phases/open/leaderboard").await.json()["entries"], 1);
    assert!(!stranger.get("/leaderboard/open?order=both").await.body.contains("good walker"));
    let page = stranger.get("/runs/run_rude").await;
    assert!(
        page.body.contains("it read the &#60;map&#62;") && page.body.contains("It is not ranked"),
        "{}",
        page.body
    );
    assert!(page.body.contains("id=\"scores\""), "the scores remain");
    assert!(stranger.get("/runs").await.body.contains(">disqualified</span>"));
    assert!(stranger.get("/runs/run_rude/badge.svg").await.body.contains("disqualified"));
    let run = stranger.get("/api/v1/runs/run_rude").await.json();
    assert_eq!(
        (&run["line"]["disqualified"], &run["eligible"]),
        (&"it read the <map>".into(), &false.into())
    );
    organiser.act(rule, "action=reinstate&reason=it+did+not").await;
    assert!(stranger.get("/leaderboard/open").await.body.contains("good walker"));
    organiser.act(rule, "action=unverify&reason=the+machine+was+lost").await;
    assert!(!stranger.get("/leaderboard/open").await.body.contains("verified</span>"));
    let audit = organiser.get("/organise/audit").await.body;
    assert!(audit.contains("it read the &#60;map&#62;") && audit.contains("it did not"), "{audit}");
}

#[tokio::test]
async fn hidden_phases_stay_hidden_after_sign_in() {
    let site = Site::new().await;
    site.arena.issue("the-other-team", TokenScope::Participant, Some(FORMULA_TEAM)).await;
    let organiser = site.signed_in(ORGANISER).await;
    organiser.act("/organise/runs/run_sealed", "action=disqualify&reason=a+canary+reason").await;
    let browser = site.signed_in("the-other-team").await;
    for address in ["/", "/me", "/runs", "/runs/run_sealed", "/leaderboard/sealed", "/api/v1/runs"] {
        let answer = browser.get(address).await;
        for hidden in ["secret walker", "canary reason"] {
            assert!(!answer.body.contains(hidden), "{address}: {}", answer.body);
        }
    }
    let own = site.signed_in(TOKEN).await;
    assert!(own.get("/runs/run_sealed").await.body.contains("a canary reason"));
    let board = own.get("/leaderboard/sealed").await.body;
    assert!(!board.contains("secret walker"), "{board}");
}

#[tokio::test]
async fn sessions_end_with_their_token() {
    let site = Site::new().await;
    let browser = site.signed_in(TOKEN).await;
    assert_eq!(browser.get("/me").await.status, StatusCode::OK);
    site.arena.store.revoke_tokens(RUDE_TEAM, 5).await.expect("a team");
    assert_eq!(browser.get("/me").await.status, StatusCode::SEE_OTHER);
    assert_eq!(browser.get("/runs/run_sealed").await.status, StatusCode::NOT_FOUND);
}

/// Sends a sign-in with a wrong token through a proxy on this machine, and returns the status line.
async fn forwarded_sign_in(server: SocketAddr, client: &str) -> String {
    let body = "token=no-such-token&next=";
    let request = format!(
        "POST /sign-in HTTP/1.1\r\nHost: x\r\nSec-Fetch-Site: same-origin\r\nX-Forwarded-For: {client}\r\n\
         Content-Length: {}\r\nConnection: close\r\n\r\n{body}",
        body.len()
    );
    let mut stream = TcpStream::connect(server).await.expect("a connection");
    stream.write_all(request.as_bytes()).await.expect("a request");
    let mut response = String::new();
    stream.read_to_string(&mut response).await.expect("a response");
    response.lines().next().unwrap_or_default().to_owned()
}

#[tokio::test]
async fn sign_in_limit_counts_clients_behind_proxy() {
    let behind = Site::new().await;
    let management = behind.management();
    let proxy = "127.0.0.1".parse().expect("an address");
    for (trusted_proxies, other_may_try) in [(vec![proxy], true), (vec![], false)] {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let server = listener.local_addr().expect("an address");
        let site = avln_web::Site {
            management: Some(management.clone()),
            trusted_proxies,
            ..avln_web::Site::default()
        };
        tokio::spawn(avln_web::serve(listener, behind.arena.store.reader(), site, std::future::pending()));
        for _ in 0..10 {
            assert!(forwarded_sign_in(server, "198.51.100.7").await.contains(" 403 "));
        }
        assert!(forwarded_sign_in(server, "198.51.100.7").await.contains(" 429 "));
        let other = forwarded_sign_in(server, "198.51.100.8").await;
        assert_eq!(other.contains(" 403 "), other_may_try, "{other}");
    }
}
