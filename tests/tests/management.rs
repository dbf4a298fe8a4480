//! Signing in at the people's door of a real server: what a team does to what is its own, and what the organiser does to all.

use avln_client::{Action, Client, EndReason, Error, Order, Reason, RunOptions, Sensors};
use avln_store::AuditLine;
use avln_tests::{
    PHASE, TEAM, TestServer, TestSetup, http,
    http::{Answer, Visitor},
    scripted_run::play_script,
    store,
};
use std::time::Duration;
use tokio::time::sleep;
use tokio_stream::StreamExt;

/// The token that a page shows.
fn shown_token(page: &Answer) -> String {
    let secret = page.body.split("<code>avln_").nth(1).and_then(|rest| rest.split('<').next());
    format!("avln_{}", secret.unwrap_or_else(|| panic!("no token in {}", page.body)))
}

async fn audit(house: &TestServer) -> Vec<AuditLine> {
    let store = store(house.folder.path()).await;
    let lines = store.audit().await.expect("the audit list");
    store.close().await;
    lines
}

async fn start(house: &TestServer) -> Result<String, Error> {
    let arena = Client::connect(house.agents_url(), &house.token).await.expect("the door is open");
    Ok(arena.start_run(RunOptions::new(PHASE, "walker").order(Order::Unordered)).await?.id)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_team_makes_and_takes_back_tokens_and_cancels_its_runs() {
    let house = TestServer::open(&TestSetup::default()).await;
    let team = Visitor::sign_in(house.doors.web, &house.token).await;
    let page = team
        .act("/me", &[("action", "issue"), ("name", "laptop"), ("kind", "read_only"), ("days", "2")])
        .await;
    let token = shown_token(&page);
    let looking = Client::connect(house.agents_url(), &token).await.expect("the door is open");
    let account = looking.whoami().await.expect("an account");
    assert_eq!((account.team.as_str(), account.token_name.as_str()), (TEAM, "laptop"));
    let refused = looking.start_run(RunOptions::new(PHASE, "walker")).await.expect_err("it is for looking");
    assert_eq!(refused.reason(), Some(Reason::TokenScope), "{refused}");
    let looker = Visitor::sign_in(house.doors.web, &token).await;
    assert_eq!(looker.get("/me").await.status, 200);

    let run = start(&house).await.expect("a run");
    let cancelled = team.act("/me", &[("action", "cancel"), ("run", &run)]).await;
    assert_eq!(cancelled.status, 303, "{}", cancelled.body);
    assert!(team.get("/me").await.body.contains(&format!("Run {run} is cancelled.")));
    let again = team.act("/me", &[("action", "cancel"), ("run", &run)]).await;
    assert_eq!((again.status, again.body.contains("is cancelled")), (409, true), "{}", again.body);

    let tokens = store(house.folder.path()).await.tokens().await.expect("tokens");
    let id = tokens.iter().find(|token| token.name == "laptop").expect("the token").id.clone();
    assert_eq!(team.act("/me", &[("action", "revoke"), ("id", &id)]).await.status, 303);
    looking.whoami().await.expect_err("it is void");
    assert_eq!(looker.get("/me").await.status, 303, "its session is over too");
    let deeds: Vec<_> =
        audit(&house).await.into_iter().filter(|line| line.actor.starts_with("token ")).collect();
    let told: Vec<_> = deeds.iter().map(|line| (line.subject.as_str(), line.what.as_str())).collect();
    let (of_team, of_run, of_token) = (format!("team {TEAM}"), format!("run {run}"), format!("token {id}"));
    let expected = [
        (of_team.as_str(), "token for looking"),
        (of_run.as_str(), "cancelled"),
        (of_token.as_str(), "revoked"),
    ];
    assert_eq!(told, expected);
    assert!(deeds.iter().all(|line| line.actor.ends_with(&format!(" of team {TEAM}"))), "{deeds:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_that_is_cancelled_on_a_page_is_over_for_the_agent_that_plays_it() {
    let house = TestServer::open(&TestSetup { houses: 1, missions: 2, ..TestSetup::default() }).await;
    let arena = Client::connect(house.agents_url(), &house.token).await.expect("the door is open");
    let run = arena.start_run(RunOptions::new(PHASE, "walker")).await.expect("a run");
    let blind = Sensors { rgb: false, depth: false, audio: false, width: 64, height: 64, hfov_rad: 1.57 };
    let mut episodes = arena.play(&run, blind).await.expect("a stream").episodes();
    let mut episode = episodes.try_next().await.expect("an answer").expect("an episode");
    episode.step(Action::TurnLeft).await.expect("it is open");
    let team = Visitor::sign_in(house.doors.web, &house.token).await;
    assert_eq!(team.act("/me", &[("action", "cancel"), ("run", &run.id)]).await.status, 303);
    let mut steps = 0;
    while steps < 500 && episode.end().is_none() && episode.step(Action::TurnLeft).await.is_ok() {
        steps += 1;
        sleep(Duration::from_millis(20)).await;
    }
    assert!(steps < 500, "it plays on");
    assert!(episode.end().is_none_or(|end| end.reason == EndReason::Abandoned), "{:?}", episode.end());
    drop(episode);
    let over = episodes.try_next().await.expect_err("nothing is left to play");
    assert_eq!(over.reason(), Some(Reason::RunOver), "{over}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_team_touches_nothing_that_is_not_its_own() {
    let house = TestServer::open(&TestSetup::default()).await;
    let organiser = house.organiser().await;
    let office = Visitor::sign_in(house.doors.web, &organiser).await;
    let page = office.act("/organise/teams", &[("action", "admit"), ("team", "blue"), ("reason", "")]).await;
    let blue = Visitor::sign_in(house.doors.web, &shown_token(&page)).await;
    let run = start(&house).await.expect("a run");
    for (what, id) in [("cancel", run.as_str()), ("cancel", "run_of_nobody")] {
        let refused = blue.act("/me", &[("action", what), ("run", id)]).await;
        assert_eq!(refused.status, 409, "{}", refused.body);
        assert!(refused.body.contains("there is no run"), "{}", refused.body);
    }
    let tokens = store(house.folder.path()).await.tokens().await.expect("tokens");
    for token in tokens.iter().filter(|token| token.team.as_deref() != Some("blue")) {
        assert_eq!(blue.act("/me", &[("action", "revoke"), ("id", &token.id)]).await.status, 409);
    }
    start(&house).await.expect("the other team goes on");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_organiser_pauses_rules_and_grants() {
    let house = TestServer::open(&TestSetup::default()).await;
    let organiser = Visitor::sign_in(house.doors.web, &house.organiser().await).await;
    let phase = format!("/organise/phases/{PHASE}");
    let paused = organiser.act(&phase, &[("action", "pause"), ("reason", "the roof leaks")]).await;
    assert_eq!(paused.status, 303, "{}", paused.body);
    let refused = start(&house).await.expect_err("a paused phase");
    assert_eq!(refused.reason(), Some(Reason::PhasePaused), "{refused}");
    assert!(refused.to_string().contains("the roof leaks"), "{refused}");
    assert_eq!(organiser.act(&phase, &[("action", "resume"), ("reason", "it is dry")]).await.status, 303);
    let run = play_script(&house.agents_url(), &house.token, "walker").await;
    let rule = format!("/organise/runs/{run}");
    assert_eq!(organiser.act(&rule, &[("action", "verify"), ("reason", "we ran it")]).await.status, 303);
    let board = format!("/leaderboard/{PHASE}?order=unordered");
    assert!(http::get(house.doors.web, &board).await.body.contains(">verified</span>"));
    let out = [("action", "disqualify"), ("reason", "it knew the houses")];
    assert_eq!(organiser.act(&rule, &out).await.status, 303);
    assert!(!http::get(house.doors.web, &board).await.body.contains(&run));
    assert!(http::get(house.doors.web, &format!("/runs/{run}")).await.body.contains("it knew the houses"));
    let grant =
        [("action", "grant"), ("team", TEAM), ("phase", PHASE), ("runs", "2"), ("reason", "a full disk")];
    assert_eq!(organiser.act("/organise/teams", &grant).await.status, 303);
    let unknown = [("action", "grant"), ("team", "nobody"), ("phase", PHASE), ("runs", "2"), ("reason", "x")];
    assert_eq!(organiser.act("/organise/teams", &unknown).await.status, 409);
    assert!(organiser.get("/organise/health").await.body.contains("Steps since the start"));
    let reveal = [("action", "reveal"), ("reason", ""), ("typed", PHASE)];
    assert_eq!(organiser.act(&phase, &reveal).await.status, 409, "it is open");
    let close = [("action", "close"), ("reason", "it is over"), ("typed", PHASE)];
    assert_eq!(organiser.act(&phase, &close).await.status, 303);
    assert_eq!(organiser.act(&phase, &reveal).await.status, 303);
    assert!(organiser.get(&phase).await.body.contains("; revealed"));
    let lines = audit(&house).await;
    let told = |what: &str, reason: &str| {
        lines.iter().any(|line| {
            line.what == what && line.reason == reason && line.actor.ends_with(" of the organiser")
        })
    };
    let granted = format!("granted in phase {PHASE}");
    for (what, reason) in [
        ("paused", "the roof leaks"),
        ("paused", "it is dry"),
        ("verified", "we ran it"),
        ("disqualified", "it knew the houses"),
        (granted.as_str(), "a full disk"),
        ("closed", "it is over"),
        ("revealed", ""),
    ] {
        assert!(told(what, reason), "{what} because {reason}: {lines:?}");
    }
}
