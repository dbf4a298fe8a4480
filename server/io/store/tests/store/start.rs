//! Teams, tokens, phases and the start of runs.

use crate::fixture::{Arena, TEAM, new_run, phase};
use avln_episode::Order;
use avln_store::{NewRun, NewToken, Phase, Run, RunState, StoreError, TokenScope, TokenState, Viewer};
use std::collections::BTreeMap;

#[tokio::test]
async fn a_phase_comes_back_as_it_was_written() {
    let written = phase("practice", 3);
    let arena = Arena::new(&written).await;
    assert_eq!(arena.store.phase("practice").await.expect("the phase"), written);
    assert!(matches!(arena.store.phase("other").await, Err(StoreError::Unknown { .. })));
}

#[tokio::test]
async fn a_phase_with_runs_keeps_its_episodes_but_may_close() {
    let mut changed = phase("practice", 3);
    let arena = Arena::new(&changed).await;
    let digests = BTreeMap::new();
    arena.store.start_run(&new_run(&digests), 10).await.expect("a run");
    changed.schedule.closed = true;
    arena.store.upsert_phase(&changed, 11).await.expect("a new state");
    let late = NewRun { id: "run_2", token: "t2", ..new_run(&digests) };
    assert!(matches!(arena.store.start_run(&late, 12).await, Err(StoreError::PhaseClosed(_))));
    changed.episodes.pop();
    assert!(matches!(arena.store.upsert_phase(&changed, 13).await, Err(StoreError::Taken { .. })));
}

#[tokio::test]
async fn a_sealed_phase_takes_sealed_runs_only_and_they_remember_it() {
    let arena = Arena::new(&Phase { sealed: true, ..phase("practice", 1) }).await;
    let open = BTreeMap::new();
    let refused = arena.store.start_run(&new_run(&open), 10).await.unwrap_err();
    assert!(matches!(refused, StoreError::PhaseSealed(_)), "{refused}");
    let digests = BTreeMap::from([(Run::SEALED.to_owned(), "process: no network".to_owned())]);
    arena.store.start_run(&new_run(&digests), 11).await.expect("a sealed run");
    let run = arena.store.run("run_1").await.expect("the run");
    assert!(run.is_sealed() && run.digests == digests);
    assert!(arena.store.phase("practice").await.expect("the phase").sealed);
}

#[tokio::test]
async fn tokens_are_found_by_their_secret_until_they_end() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let secret = "avln-0123456789abcdef";
    let token = NewToken {
        secret,
        kind: TokenScope::Participant,
        name: "laptop",
        team: Some(TEAM),
        expires_unix_ms: Some(100),
    };
    arena.store.issue_token(&token, 5).await.expect("a token");
    let TokenState::Valid(found) = arena.store.find_token(secret, 99).await.expect("an answer") else {
        panic!("the token holds")
    };
    assert_eq!((found.kind, found.team.as_deref(), found.run), (TokenScope::Participant, Some(TEAM), None));
    assert_eq!(arena.store.find_token(secret, 100).await.expect("an answer"), TokenState::Expired);
    assert_eq!(arena.store.find_token("another", 1).await.expect("an answer"), TokenState::Unknown);
    let viewer = arena.store.reader().viewer(secret, 99).await.expect("an answer");
    assert_eq!(viewer, Some(Viewer::Team(TEAM.to_owned())));
    assert_eq!(arena.store.revoke_tokens(TEAM, 50).await.expect("an answer"), 1);
    assert_eq!(arena.store.find_token(secret, 60).await.expect("an answer"), TokenState::Revoked);
    let bytes = [std::fs::read(arena.path()), std::fs::read(arena.path().with_extension("db-wal"))];
    let written = bytes.into_iter().flatten().flatten().collect::<Vec<u8>>();
    assert!(
        !written.windows(secret.len()).any(|window| window == secret.as_bytes()),
        "the secret lies in the file"
    );
}

#[tokio::test]
async fn a_token_for_nobody_is_refused() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let token = NewToken {
        secret: "s",
        kind: TokenScope::Participant,
        name: "laptop",
        team: Some("nobody"),
        expires_unix_ms: None,
    };
    assert!(matches!(
        arena.store.issue_token(&token, 5).await,
        Err(StoreError::Unknown { what: "team", .. })
    ));
}

#[tokio::test]
async fn the_same_request_gives_the_same_run_and_a_different_one_is_refused() {
    let mut only_two = phase("practice", 2);
    only_two.quotas.total = Some(2);
    let arena = Arena::new(&only_two).await;
    let digests = BTreeMap::from([("split".to_owned(), "d".to_owned())]);
    let first = NewRun { client_request_id: Some("r-1"), ..new_run(&digests) };
    let again = NewRun { id: "run_2", token: "second-secret", ..first };
    let made = arena.store.start_run(&first, 10).await.expect("a run");
    let found = arena.store.start_run(&again, 11).await.expect("the same run");
    assert_eq!(
        (made.is_new, found.is_new, made.quotas[0].remaining, found.quotas[0].remaining),
        (true, false, Some(1), Some(1))
    );
    assert_eq!(made.run, found.run);
    assert_eq!((made.run.episodes, made.run.state, &made.run.digests), (2, RunState::Created, &digests));
    let TokenState::Valid(token) = arena.store.find_token("second-secret", 12).await.expect("an answer")
    else {
        panic!("the second token plays the run")
    };
    assert_eq!((token.kind, token.run.as_deref()), (TokenScope::Run, Some("run_1")));
    let different = NewRun { method: "runner", ..again };
    assert!(matches!(arena.store.start_run(&different, 12).await, Err(StoreError::Taken { .. })));
}

#[tokio::test]
async fn an_order_that_is_not_played_is_refused() {
    let mut one_order = phase("practice", 2);
    one_order.orders = vec![Order::Ordered];
    let arena = Arena::new(&one_order).await;
    let started = arena.store.start_run(&new_run(&BTreeMap::new()), 10).await;
    assert!(matches!(started, Err(StoreError::OrderNotAllowed { order: "unordered", .. })));
}
