//! What the organiser rules on runs, and who sees what of accounts.

use crate::fixture::{Arena, TEAM, new_run, phase};
use avln_episode::Order;
use avln_scoring::Key;
use avln_store::{
    AuditNote, Board, LeaderboardView, NewGrant, NewToken, Phase, Ruling, RunChoice, StoreError, TeamsView,
    TokenHash, TokenScope, Viewer, Visibility,
};
use std::collections::BTreeMap;

async fn board(arena: &Arena) -> LeaderboardView {
    let board = Board {
        phase: "practice",
        order: Order::Unordered,
        key: Key::Isr,
        pick: RunChoice::Best,
        as_of_unix_ms: None,
        now_unix_ms: 100,
    };
    arena.store.reader().leaderboard(&Viewer::Anonymous, &board).await.expect("an answer").expect("the phase")
}

fn note(what: &str) -> AuditNote {
    AuditNote { what: what.to_owned(), ..AuditNote::default() }
}

#[tokio::test]
async fn a_disqualified_run_gives_its_place_to_the_next_and_gets_it_back() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_good", "walker", Order::Unordered, 2).await;
    arena.play("run_weak", "walker", Order::Unordered, 1).await;
    let before = board(&arena).await;
    assert_eq!((before.rows[0].run.as_str(), before.rows[0].runs_count), ("run_good", 2));
    let reason = Some("it knew the houses");
    for changes in [true, false] {
        let ruled = arena.store.disqualify_run("run_good", reason, note("disqualified"), 40).await;
        assert_eq!(ruled.expect("a run"), changes);
    }
    let without = board(&arena).await;
    assert_eq!((without.rows[0].run.as_str(), without.rows[0].runs_count), ("run_weak", 1));
    let view =
        arena.store.reader().run(&Viewer::Anonymous, "run_good").await.expect("an answer").expect("a run");
    assert!(!view.eligible && view.summary.is_some());
    assert_eq!(view.line.disqualified.as_deref(), reason);
    assert!(arena.store.disqualify_run("run_good", None, note("put back"), 50).await.expect("a run"));
    assert_eq!(board(&arena).await, before);
    let audit: Vec<String> =
        arena.store.audit().await.expect("a list").into_iter().map(|line| line.what).collect();
    assert_eq!(audit, ["disqualified", "put back"], "what changes nothing is not noted");
    arena.store.disqualify_run("nobody", reason, note("x"), 60).await.expect_err("no such run");
}

#[tokio::test]
async fn a_mark_is_seen_on_boards_that_were_ranked_before_and_needs_a_run_that_is_over() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_good", "walker", Order::Unordered, 2).await;
    assert!(!board(&arena).await.rows[0].verified);
    assert!(arena.store.verify_run("run_good", true, note("verified"), 40).await.expect("a run"));
    assert!(board(&arena).await.rows[0].verified);
    assert!(
        arena.store.disqualify_run("run_good", Some("why"), note("disqualified"), 50).await.expect("a run")
    );
    let ruling = arena.store.run("run_good").await.expect("a run").ruling;
    assert_eq!(ruling, Ruling { verified: true, disqualified: Some("why".to_owned()) });
    assert!(arena.store.verify_run("run_good", false, note("no more"), 60).await.expect("a run"));
    arena.store.start_run(&new_run(&BTreeMap::new()), 70).await.expect("a run");
    let open = arena.store.verify_run("run_1", true, note("verified"), 80).await.expect_err("it is open");
    assert!(matches!(open, StoreError::RunOpen(_)) && !open.is_fault(), "{open}");
    assert!(arena.store.disqualify_run("run_1", Some("why"), note("disqualified"), 90).await.expect("a run"));
}

#[tokio::test]
async fn a_team_sees_its_own_tokens_and_runs_and_the_organiser_all_teams() {
    let hidden = Phase { scores: Visibility::Organiser, ..phase("practice", 2) };
    let arena = Arena::new(&hidden).await;
    arena.play("run_red", "walker", Order::Unordered, 2).await;
    let token = |secret, team| NewToken {
        secret,
        kind: TokenScope::Participant,
        name: "",
        team,
        expires_unix_ms: None,
    };
    for (secret, team) in [("of-red", TEAM), ("of-blue", "blue")] {
        arena.store.issue_token(&token(secret, Some(team)), 5).await.expect("a token");
    }
    let grant = NewGrant { phase: "practice", team: TEAM, runs: 2, reason: "why" };
    arena.store.grant(&grant, note("granted"), 6).await.expect("a grant");
    let reader = arena.store.reader();
    let [red, blue] = [TEAM, "blue"].map(|team| Viewer::Team(team.to_owned()));
    let [of_red, of_blue] = ["of-red", "of-blue"].map(TokenHash::of);
    let holder = reader.holder(&of_red, 10).await.expect("an answer").expect("a holder");
    assert_eq!((&holder.viewer, holder.looks_only, holder.token.as_str()), (&red, false, of_red.id()));
    assert!(!format!("{of_red:?}").contains("of-red"));
    for (viewer, ids, runs) in
        [(&red, vec![of_red.id()], 1), (&blue, vec![of_blue.id()], 0), (&Viewer::Organiser, vec![], 0)]
    {
        let tokens = reader.own_tokens(viewer).await.expect("a list");
        assert_eq!(tokens.iter().map(|token| token.id.as_str()).collect::<Vec<_>>(), ids);
        let own = reader.own_runs(viewer, 10).await.expect("a list");
        assert_eq!(own.len(), runs, "{viewer:?}");
        assert!(own.iter().all(|run| run.isr.is_none()), "scores are hidden");
    }
    for viewer in [&red, &Viewer::Anonymous] {
        assert_eq!(reader.teams(viewer, 10).await.expect("nothing"), TeamsView::default());
        assert_eq!(reader.audit(viewer, None, 10).await.expect("nothing"), []);
    }
    let view = reader.teams(&Viewer::Organiser, 10).await.expect("all teams");
    let told: Vec<_> = view.teams.iter().map(|team| (team.name.as_str(), team.runs, team.tokens)).collect();
    assert_eq!(told, [("blue", 0, 1), (TEAM, 1, 1)]);
    assert_eq!((view.grants.len(), view.grants[0].reason.as_str()), (1, "why"));
    assert_eq!(reader.audit(&Viewer::Organiser, None, 10).await.expect("a list").len(), 1);
    arena.store.revoke_own_token(TEAM, of_blue.id(), note("x"), 20).await.expect_err("it is another team's");
    arena.store.revoke_own_token("blue", of_blue.id(), note("x"), 20).await.expect("its own");
    assert_eq!(reader.holder(&of_blue, 30).await.expect("an answer"), None);
}
