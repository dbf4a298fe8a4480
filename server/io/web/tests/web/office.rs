//! Those who sign in: what they may see and ask for, and what nobody may ask for in their name.

use crate::fixture::{Answer, Arena, FORMULA_TEAM, ORGANISER, RUDE_TEAM, TOKEN};
use avln_store::{AuditNote, Store, TokenKind};
use avln_web::{ActionOrigin, OrganiserAction, Doing, ActionOutcome, ServerHealth, TeamCredential, Management, TeamAction, ActionError};
use axum::{
    body::Body,
    http::{Request, StatusCode, header},
};
use std::sync::{Arc, Mutex};

const LOOKING: &str = "a-token-for-looking";
const NEW_SECRET: &str = "avln_account_shown-once";

/// An management that notes what it is asked for, and rules on runs.
#[derive(Debug)]
struct Clerk {
    store: Store,
    asked: Arc<Mutex<Vec<String>>>,
}

impl Clerk {
    fn note(&self, asked: String) {
        self.asked.lock().expect("no panic").push(asked);
    }
}

impl Management for Clerk {
    fn act(&self, member: TeamCredential, deed: TeamAction) -> Doing {
        self.note(format!("{}: {deed:?}", member.team));
        let secret = matches!(deed, TeamAction::IssueToken { .. }).then(|| NEW_SECRET.to_owned());
        Box::pin(async { Ok(ActionOutcome { words: "It is <done>.".to_owned(), secret }) })
    }

    fn organise(&self, because: ActionOrigin, deed: OrganiserAction) -> Doing {
        self.note(format!("organiser: {deed:?} because {}", because.reason));
        let store = self.store.clone();
        Box::pin(async move {
            let note =
                AuditNote { actor: because.token, reason: because.reason.clone(), ..AuditNote::default() };
            let failed = |error: avln_store::StoreError| ActionError::Failed(error.to_string());
            let (mut secret, reason) = (None, because.reason.as_str());
            match &deed {
                OrganiserAction::Disqualify(run) => store.disqualify_run(run, Some(reason), note, 50).await,
                OrganiserAction::Reinstate(run) => store.disqualify_run(run, None, note, 60).await,
                OrganiserAction::Verify { run, verified } => store.verify_run(run, *verified, note, 70).await,
                OrganiserAction::Admit { .. } => {
                    secret = Some(NEW_SECRET.to_owned());
                    Ok(true)
                }
                OrganiserAction::Grant { .. } => return Err(ActionError::Refused("no such team".to_owned())),
                _ => Ok(true),
            }
            .map_err(failed)?;
            Ok(ActionOutcome { words: format!("{deed:?} is done."), secret })
        })
    }

    fn health(&self) -> ServerHealth {
        ServerHealth { steps: 4321, slots: vec![("run_begun".to_owned(), 2, 77)], ..ServerHealth::default() }
    }
}

/// A browser of somebody who may be signed in.
struct Browser<'a> {
    arena: &'a Arena,
    cookie: String,
}

struct Stage {
    arena: Arena,
    asked: Arc<Mutex<Vec<String>>>,
}

impl Stage {
    async fn new() -> Self {
        let asked = Arc::<Mutex<Vec<String>>>::default();
        let clerk = |store| Arc::new(Clerk { store, asked: asked.clone() }) as Arc<dyn Management>;
        let arena = Arena::staffed(clerk).await;
        arena.issue(LOOKING, TokenKind::ReadOnly, Some(RUDE_TEAM)).await;
        Self { arena, asked }
    }

    fn asked(&self) -> Vec<String> {
        self.asked.lock().expect("no panic").clone()
    }

    fn stranger(&self) -> Browser<'_> {
        Browser { arena: &self.arena, cookie: String::new() }
    }

    async fn signed_in(&self, token: &str) -> Browser<'_> {
        let mut browser = self.stranger();
        let answer = browser.sign_in(token, "").await;
        assert_eq!(answer.status, StatusCode::SEE_OTHER, "{}", answer.body);
        browser
    }
}

impl Browser<'_> {
    fn request(&self, method: &str, address: &str) -> axum::http::request::Builder {
        let request = Request::builder().method(method).uri(address).header(header::HOST, "arena.example");
        if self.cookie.is_empty() { request } else { request.header(header::COOKIE, &self.cookie) }
    }

    async fn get(&self, address: &str) -> Answer {
        self.arena.ask(self.request("GET", address).body(Body::empty()).expect("a request")).await
    }

    /// Sends a form from a page of the same origin.
    async fn post(&self, address: &str, fields: &str) -> Answer {
        let request = self.request("POST", address).header("sec-fetch-site", "same-origin");
        self.arena.ask(request.body(Body::from(fields.to_owned())).expect("a request")).await
    }

    /// The same with the key of the session.
    async fn act(&self, address: &str, fields: &str) -> Answer {
        self.post(address, &format!("{fields}&key={}", self.key().await)).await
    }

    async fn key(&self) -> String {
        let page = self.get("/me").await.body + &self.get("/organise").await.body;
        let rest = page.split_once("name=\"key\" value=\"").expect("a form").1;
        rest.split('"').next().expect("a key").to_owned()
    }

    async fn sign_in(&mut self, token: &str, next: &str) -> Answer {
        let answer = self.post("/sign-in", &format!("token=+{token}%0A&next={next}")).await;
        let cookie = answer.header(header::SET_COOKIE);
        self.cookie = cookie.split(';').next().unwrap_or_default().to_owned();
        answer
    }
}

#[tokio::test]
async fn one_signs_in_by_a_token_and_out_again() {
    let stage = Stage::new().await;
    let mut browser = stage.stranger();
    let page = browser.get("/runs").await;
    assert!(page.body.contains("<a href=\"/sign-in\" aria-current=\"false\">Sign in</a>"), "{}", page.body);
    assert_eq!(browser.get("/sign-in?next=/me").await.status, StatusCode::OK);
    let answer = browser.sign_in(TOKEN, "").await;
    assert_eq!((answer.status, answer.header(header::LOCATION)), (StatusCode::SEE_OTHER, "/me"));
    let cookie = answer.header(header::SET_COOKIE);
    assert!(cookie.ends_with("; Path=/; HttpOnly; SameSite=Strict") && !cookie.contains(TOKEN), "{cookie}");
    let me = browser.get("/me").await;
    assert_eq!(me.header(header::CACHE_CONTROL), "private, no-store");
    assert_eq!(me.header(header::VARY), "authorization, cookie, accept-encoding");
    for words in ["secret walker", "good walker", "this one", "Quota", "/runs/run_sealed"] {
        assert!(me.body.contains(words), "{words}: {}", me.body);
    }
    assert!(!me.body.contains(TOKEN) && !me.body.contains("@walker"), "{}", me.body);
    assert!(!me.body.contains("<script>"), "names are text");
    let own = browser.get("/runs/run_sealed").await;
    assert_eq!((own.status, own.header(header::CACHE_CONTROL)), (StatusCode::OK, "private, no-store"));
    assert!(own.body.contains("<a href=\"/me\" aria-current=\"false\">My page</a>"), "{}", own.body);
    assert_eq!(browser.get("/api/v1/runs/run_sealed").await.status, StatusCode::OK, "the twin too");
    let lost = browser.get("/nowhere").await;
    assert!(lost.body.contains("My page"), "trouble has the same menu");
    let out = browser.act("/sign-out", "").await;
    assert!(out.header(header::SET_COOKIE).contains("Max-Age=0"), "{:?}", out.headers);
    let gone = browser.get("/me").await;
    assert_eq!((gone.status, gone.header(header::LOCATION)), (StatusCode::SEE_OTHER, "/sign-in?next=/me"));
    assert_eq!(browser.get("/runs/run_sealed").await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn nobody_signs_in_where_there_is_no_office() {
    let arena = Arena::new().await;
    for address in ["/sign-in", "/me", "/organise", "/organise/audit"] {
        assert_eq!(arena.get(address).await.status, StatusCode::NOT_FOUND, "{address}");
    }
    assert!(!arena.get("/").await.body.contains("/sign-in"));
}

#[tokio::test]
async fn tokens_that_open_nothing_are_all_refused_alike_and_not_too_often() {
    let stage = Stage::new().await;
    stage.arena.store.revoke_tokens(FORMULA_TEAM, 5).await.expect("a team");
    let mut browser = stage.stranger();
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
async fn one_is_led_where_one_wanted_to_go_and_nowhere_else() {
    let stage = Stage::new().await;
    let wanted = stage.stranger().get("/organise/audit").await;
    assert_eq!(wanted.header(header::LOCATION), "/sign-in?next=/organise/audit");
    let form = stage.stranger().get("/sign-in?next=/organise/audit").await.body;
    assert!(form.contains("name=\"next\" value=\"/organise/audit\""), "{form}");
    let foreign = stage.stranger().get("/sign-in?next=//evil.example").await.body;
    assert!(!foreign.contains("evil"), "{foreign}");
    for (next, to) in
        [("/organise/audit", "/organise/audit"), ("%2F%2Fevil.example", "/organise"), ("", "/organise")]
    {
        let answer = stage.stranger().sign_in(ORGANISER, next).await;
        assert_eq!(answer.header(header::LOCATION), to, "{next}");
    }
}

#[tokio::test]
async fn forms_of_other_sites_and_without_the_key_do_nothing() {
    let stage = Stage::new().await;
    let browser = stage.signed_in(TOKEN).await;
    let other = stage.signed_in(TOKEN).await;
    let (key, foreign_key) = (browser.key().await, other.key().await);
    assert_ne!(key, foreign_key, "each session has its own");
    let fields = |key: &str| format!("deed=revoke&id=abc&key={key}");
    for keyless in ["deed=revoke&id=abc".to_owned(), fields(""), fields("0"), fields(&foreign_key)] {
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
            let answer = stage.arena.ask(request.body(Body::from(fields)).expect("a request")).await;
            assert_eq!(answer.status, StatusCode::FORBIDDEN, "{address} {name}: {value}");
        }
    }
    let unsigned = stage.stranger().post("/me", &fields(&key)).await;
    assert_eq!(unsigned.status, StatusCode::SEE_OTHER, "without the cookie the key is worth nothing");
    let large = browser.post("/me", &format!("{}&x={}", fields(&key), "x".repeat(20_000))).await;
    assert_eq!(large.status, StatusCode::PAYLOAD_TOO_LARGE);
    assert_eq!(stage.asked(), Vec::<String>::new());
    let same = browser.request("POST", "/me").header(header::ORIGIN, "http://arena.example");
    let answer = stage.arena.ask(same.body(Body::from(fields(&key))).expect("a request")).await;
    assert_eq!(answer.status, StatusCode::SEE_OTHER, "{}", answer.body);
    assert_eq!(stage.asked().len(), 1);
}

#[tokio::test]
async fn a_new_token_is_shown_once_and_deeds_are_told_on_the_next_page() {
    let stage = Stage::new().await;
    let browser = stage.signed_in(TOKEN).await;
    let shown = browser.act("/me", "deed=issue&name=laptop&kind=read_only&days=30").await;
    assert_eq!((shown.status, shown.header(header::CACHE_CONTROL)), (StatusCode::OK, "no-store"));
    assert_eq!(shown.body.matches(NEW_SECRET).count(), 1, "{}", shown.body);
    assert!(!browser.get("/me").await.body.contains(NEW_SECRET), "once");
    let cancelled = browser.act("/me", "deed=cancel&run=run_begun").await;
    assert_eq!((cancelled.status, cancelled.header(header::LOCATION)), (StatusCode::SEE_OTHER, "/me"));
    let told = browser.get("/me").await.body;
    assert!(told.contains("It is &#60;done&#62;."), "{told}");
    assert!(!browser.get("/me").await.body.contains("It is"), "once");
    for wrong in ["deed=fly", "deed=issue&name=x&kind=account&days=0", "deed=revoke", ""] {
        assert_eq!(browser.act("/me", wrong).await.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    let issue = "IssueToken { name: \"laptop\", looks_only: true, days: Some(30) }";
    let expected = [issue, "CancelRun { run: \"run_begun\" }"];
    assert_eq!(stage.asked(), expected.map(|deed| format!("{RUDE_TEAM}: {deed}")));
}

#[tokio::test]
async fn a_token_for_looking_shows_the_page_and_changes_nothing() {
    let stage = Stage::new().await;
    let browser = stage.signed_in(LOOKING).await;
    let page = browser.get("/me").await.body;
    assert!(page.contains("looks and changes nothing") && page.contains("secret walker"), "{page}");
    assert!(!page.contains("name=\"deed\""), "{page}");
    assert_eq!(browser.act("/me", "deed=revoke&id=abc").await.status, StatusCode::CONFLICT);
    assert_eq!(stage.asked(), Vec::<String>::new());
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
async fn a_team_cannot_organise() {
    let stage = Stage::new().await;
    let browser = stage.signed_in(TOKEN).await;
    let nothing = browser.get("/nowhere").await;
    for address in ORGANISERS {
        let answer = browser.get(address).await;
        assert_eq!((answer.status, &answer.body), (StatusCode::NOT_FOUND, &nothing.body), "{address}");
        let stranger = stage.stranger().get(address).await;
        let to = format!("/sign-in?next={address}");
        assert_eq!(stranger.header(header::LOCATION), to);
    }
    let key = browser.key().await;
    for (address, deed) in [
        ("/organise/phases/open", "deed=pause&reason=x"),
        ("/organise/teams", "deed=admit&team=x&reason="),
        ("/organise/runs/run_formula", "deed=disqualify&reason=x"),
    ] {
        let answer = browser.post(address, &format!("{deed}&key={key}")).await;
        assert_eq!((answer.status, &answer.body), (StatusCode::NOT_FOUND, &nothing.body), "{address}");
    }
    assert_eq!(stage.asked(), Vec::<String>::new());
}

#[tokio::test]
async fn the_organisers_pages_are_pages_and_tell_what_is_going_on() {
    let stage = Stage::new().await;
    let browser = stage.signed_in(ORGANISER).await;
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
async fn the_audit_list_comes_in_pages() {
    let stage = Stage::new().await;
    for index in 0..150 {
        let note = AuditNote { what: format!("deed {index}."), ..AuditNote::default() };
        stage.arena.store.note(note, 100).await.expect("a line");
    }
    let browser = stage.signed_in(ORGANISER).await;
    let newest = browser.get("/organise/audit").await.body;
    assert!(
        newest.contains("deed 149.") && newest.contains("deed 50.") && !newest.contains("deed 49."),
        "{newest}"
    );
    assert!(newest.contains("href=\"/organise/audit?before=51\""), "{newest}");
    let older = browser.get("/organise/audit?before=51").await.body;
    assert!(
        older.contains("deed 49.") && older.contains("deed 0.") && !older.contains("Older lines"),
        "{older}"
    );
}

#[tokio::test]
async fn grave_deeds_want_the_phase_typed_and_deeds_want_reasons() {
    let stage = Stage::new().await;
    let browser = stage.signed_in(ORGANISER).await;
    for wrong in [
        "deed=close&reason=over&typed=",
        "deed=close&reason=over&typed=sealed",
        "deed=close&reason=+&typed=open",
        "deed=pause&reason=",
        "deed=pause&reason=a%0Ab",
        "deed=reveal&reason=&typed=opem",
    ] {
        let answer = browser.act("/organise/phases/open", wrong).await;
        assert_eq!(answer.status, StatusCode::BAD_REQUEST, "{wrong}");
    }
    let long = format!("deed=pause&reason={}", "x".repeat(501));
    assert_eq!(browser.act("/organise/phases/open", &long).await.status, StatusCode::BAD_REQUEST);
    assert_eq!(stage.asked(), Vec::<String>::new());
    let closed = browser.act("/organise/phases/open", "deed=close&reason=it+is+over&typed=open").await;
    assert_eq!(closed.header(header::LOCATION), "/organise/phases/open");
    let admitted = browser.act("/organise/teams", "deed=admit&team=blue&reason=").await;
    assert_eq!(admitted.body.matches(NEW_SECRET).count(), 1, "{}", admitted.body);
    let grant = "deed=grant&team=nobody&phase=open&runs=2&reason=a+full+disk";
    let refused = browser.act("/organise/teams", grant).await;
    assert_eq!(refused.status, StatusCode::CONFLICT);
    assert!(refused.body.contains("Sorry, no such team; nothing was done."), "{}", refused.body);
    let expected = [
        "organiser: Close(\"open\") because it is over",
        "organiser: Admit { team: \"blue\" } because ",
        "organiser: Grant { team: \"nobody\", phase: \"open\", runs: 2 } because a full disk",
    ];
    assert_eq!(stage.asked(), expected);
}

#[tokio::test]
async fn a_disqualified_run_leaves_the_board_and_its_page_tells_why() {
    let stage = Stage::new().await;
    let organiser = stage.signed_in(ORGANISER).await;
    let rule = "/organise/runs/run_rude";
    organiser.act(rule, "deed=verify&reason=we+ran+it").await;
    let stranger = stage.stranger();
    let board = stranger.get("/leaderboard/open").await.body;
    assert!(
        board.contains("good walker") && board.contains("<span class=\"badge\">verified</span>"),
        "{board}"
    );
    assert_eq!(board.matches("verified</span>").count(), 1, "the other run is not");
    let json = stranger.get("/api/v1/phases/open/leaderboard").await.json();
    assert_eq!([&json["rows"][0]["verified"], &json["rows"][1]["verified"]], [true, false]);
    assert!(stranger.get("/runs/run_rude").await.body.contains("verified by the organiser"));
    organiser.act(rule, "deed=disqualify&reason=it+read+the+%3Cmap%3E").await;
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
    assert!(page.body.contains("id=\"scores\""), "its scores stay");
    assert!(stranger.get("/runs").await.body.contains(">disqualified</span>"));
    assert!(stranger.get("/runs/run_rude/badge.svg").await.body.contains("disqualified"));
    let run = stranger.get("/api/v1/runs/run_rude").await.json();
    assert_eq!(
        (&run["line"]["disqualified"], &run["eligible"]),
        (&"it read the <map>".into(), &false.into())
    );
    organiser.act(rule, "deed=reinstate&reason=it+did+not").await;
    assert!(stranger.get("/leaderboard/open").await.body.contains("good walker"));
    organiser.act(rule, "deed=unverify&reason=the+machine+was+lost").await;
    assert!(!stranger.get("/leaderboard/open").await.body.contains("verified</span>"));
    let audit = organiser.get("/organise/audit").await.body;
    assert!(audit.contains("it read the &#60;map&#62;") && audit.contains("it did not"), "{audit}");
}

#[tokio::test]
async fn hidden_phases_stay_hidden_from_teams_that_sign_in() {
    let stage = Stage::new().await;
    stage.arena.issue("the-other-team", TokenKind::Account, Some(FORMULA_TEAM)).await;
    let organiser = stage.signed_in(ORGANISER).await;
    organiser.act("/organise/runs/run_sealed", "deed=disqualify&reason=a+canary+reason").await;
    let browser = stage.signed_in("the-other-team").await;
    for address in ["/", "/me", "/runs", "/runs/run_sealed", "/leaderboard/sealed", "/api/v1/runs"] {
        let answer = browser.get(address).await;
        for hidden in ["secret walker", "canary reason"] {
            assert!(!answer.body.contains(hidden), "{address}: {}", answer.body);
        }
    }
    let own = stage.signed_in(TOKEN).await;
    assert!(own.get("/runs/run_sealed").await.body.contains("a canary reason"));
    let board = own.get("/leaderboard/sealed").await.body;
    assert!(!board.contains("secret walker"), "{board}");
}

#[tokio::test]
async fn a_session_ends_with_its_token() {
    let stage = Stage::new().await;
    let browser = stage.signed_in(TOKEN).await;
    assert_eq!(browser.get("/me").await.status, StatusCode::OK);
    stage.arena.store.revoke_tokens(RUDE_TEAM, 5).await.expect("a team");
    assert_eq!(browser.get("/me").await.status, StatusCode::SEE_OTHER);
    assert_eq!(browser.get("/runs/run_sealed").await.status, StatusCode::NOT_FOUND);
}
