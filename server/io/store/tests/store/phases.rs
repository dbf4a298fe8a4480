//! Phases, admission, commitments, the audit list, tokens and the start of runs.

use crate::{Arena, TEAM, new_run, note, phase};
use avln_challenge::{
    Admission, CommitmentValues, MethodInfo, MethodType, RunState, Sample, Sampling, Schedule, TokenScope,
    Visibility, pool_digest,
};
use avln_episode::{Order, TimeLimits};
use avln_store::{
    Member, NewRun, NewToken, Phase, Run, Split, StartedRun, Store, StoreError, TokenState, Viewer,
};
use serde_json::json;
use sqlx::{ConnectOptions, sqlite::SqliteConnectOptions};
use std::collections::{BTreeMap, BTreeSet};

const SECRET: &str = "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff";

async fn start(store: &Store, id: &str, now: i64) -> Result<StartedRun, StoreError> {
    let digests = BTreeMap::new();
    store.start_run(&NewRun { id, token: id, ..new_run(&digests) }, now).await
}

#[tokio::test]
async fn runs_start_only_in_open_phases() {
    let schedule = Schedule { opens_unix_ms: Some(10), closes_unix_ms: Some(20), ..Schedule::default() };
    let time = TimeLimits { run_s: 1, ..TimeLimits::default() };
    let mut dated = Phase { schedule, time, ..phase("practice", 2) };
    let arena = Arena::new(&dated).await;
    let early = start(&arena.store, "run_0", 9).await;
    assert!(matches!(early, Err(StoreError::PhaseNotOpen { opens_unix_ms: 10, .. })), "{early:?}");
    start(&arena.store, "run_1", 10).await.expect("it is open");
    dated.schedule.paused = Some("disk replacement".to_owned());
    arena.store.upsert_phase(&dated, 11).await.expect("a pause");
    let paused = start(&arena.store, "run_2", 12).await.expect_err("a pause");
    assert!(paused.to_string().contains("disk replacement"), "{paused}");
    assert!(matches!(start(&arena.store, "run_2", 20).await, Err(StoreError::PhaseClosed(_))));
    // The wall time continues after the phase closes.
    assert!(arena.assign("run_1", "h").await.is_some());
}

#[tokio::test]
async fn only_admitted_teams_start_runs() {
    let admission = Admission { approval: true, deny: vec!["blue".to_owned()], ..Admission::default() };
    let mut closed = Phase { admission, ..phase("practice", 2) };
    let arena = Arena::new(&closed).await;
    let refused = start(&arena.store, "run_1", 10).await;
    assert!(matches!(refused, Err(StoreError::TeamNotApproved { .. })), "{refused:?}");
    assert!(arena.store.approve("practice", TEAM, true, note("approved"), 11).await.expect("a team"));
    assert!(!arena.store.approve("practice", TEAM, true, note("approved"), 12).await.expect("a team"));
    start(&arena.store, "run_1", 13).await.expect("it was approved");
    assert!(arena.store.approve("practice", TEAM, false, note("withdrawn"), 13).await.expect("a team"));
    let withdrawn = start(&arena.store, "run_2", 13).await;
    assert!(matches!(withdrawn, Err(StoreError::TeamNotApproved { .. })), "{withdrawn:?}");
    let digests = BTreeMap::new();
    let blue = NewRun { id: "run_2", token: "t", team: "blue", ..new_run(&digests) };
    arena.store.approve("practice", "blue", true, note("approved"), 14).await.expect("a team");
    assert!(matches!(arena.store.start_run(&blue, 15).await, Err(StoreError::TeamNotApproved { .. })));
    closed.admission = Admission { allow: vec!["blue".to_owned()], ..Admission::default() };
    arena.store.upsert_phase(&closed, 16).await.expect("other teams");
    assert!(matches!(start(&arena.store, "run_3", 17).await, Err(StoreError::PhaseNotVisible { .. })));
    arena.store.start_run(&blue, 18).await.expect("the team is allowed");
    assert_eq!(arena.store.audit().await.expect("a list").len(), 3);
}

#[tokio::test]
async fn restricted_phase_is_hidden_from_others() {
    let admission = Admission { allow: vec!["blue".to_owned()], ..Admission::default() };
    let arena = Arena::new(&Phase { admission, ..phase("practice", 2) }).await;
    let reader = arena.store.reader();
    let blue = Viewer::Team("blue".to_owned());
    let red = Viewer::Team(TEAM.to_owned());
    for (viewer, sees) in [(Viewer::Anonymous, 0), (red, 0), (blue, 1), (Viewer::Organiser, 1)] {
        assert_eq!(reader.phases(&viewer, 1).await.expect("a list").len(), sees, "{viewer:?}");
        assert_eq!(reader.phase(&viewer, "practice", 1).await.expect("an answer").is_some(), sees == 1);
    }
    assert_eq!(arena.store.quotas(TEAM, None, 1).await.expect("quotas"), []);
}

#[tokio::test]
async fn person_has_one_team_per_phase() {
    let arena = Arena::new(&phase("practice", 1)).await;
    arena.store.upsert_phase(&phase("second", 1), 1).await.expect("another phase");
    let member = |phase: &str, team: &str| Member {
        phase: phase.to_owned(),
        team: team.to_owned(),
        person: "ada@example.org".to_owned(),
    };
    let (red, blue) = (member("practice", TEAM), member("practice", "blue"));
    assert!(arena.store.add_member(&red, note("entered"), 1).await.expect("entered"));
    assert!(!arena.store.add_member(&red, note("entered"), 2).await.expect("as before"));
    let second = arena.store.add_member(&blue, note("entered"), 3).await;
    assert!(matches!(second, Err(StoreError::InAnotherTeam { ref team, .. }) if team == TEAM), "{second:?}");
    arena.store.add_member(&member("second", "blue"), note("entered"), 4).await.expect("another phase");
    assert!(!arena.store.remove_member(&blue, note("out"), 5).await.expect("not in it"));
    assert!(arena.store.remove_member(&red, note("out"), 6).await.expect("out"));
    assert!(arena.store.add_member(&blue, note("entered"), 7).await.expect("entered"));
    assert_eq!(arena.store.members("blue").await.expect("a list").len(), 2);
    assert_eq!(arena.store.audit().await.expect("a list").len(), 4);
}

#[tokio::test]
async fn secret_and_run_determine_sample() {
    let sampling = Sampling { shuffle: true, sample: Some(Sample { episodes: 5, anchors: 2 }) };
    let drawn = Phase { sampling, ..phase("practice", 12) };
    let mut runs = Vec::new();
    for _ in 0..2 {
        let arena = Arena::new(&drawn).await;
        let unsealed = start(&arena.store, "run_1", 5).await;
        assert!(matches!(unsealed, Err(StoreError::Unknown { .. })), "no draw without a secret");
        assert!(arena.store.commit_phase("practice", SECRET, "1.0.0", 6).await.expect("a commitment"));
        let started = start(&arena.store, "run_1", 7).await.expect("a run");
        assert_eq!((started.run.episodes, started.run.done), (5, 0));
        let mut episodes = Vec::new();
        while let Some(assigned) = arena.assign("run_1", "random").await {
            episodes.push((assigned.handle, assigned.episode));
        }
        assert_eq!(episodes.iter().map(|(_, episode)| episode).collect::<BTreeSet<_>>().len(), 5);
        assert!(episodes.iter().all(|(handle, _)| handle.starts_with("ep_")), "{episodes:?}");
        let view = arena.store.reader().phase(&Viewer::Anonymous, "practice", 8).await.expect("an answer");
        assert_eq!(view.expect("the phase").episodes, 5);
        runs.push(episodes);
    }
    assert_eq!(runs[0], runs[1], "secret and run determine the draw");
}

#[tokio::test]
async fn runs_fix_the_sampling() {
    let mut fixed = Phase { sampling: Sampling { shuffle: true, sample: None }, ..phase("practice", 3) };
    let arena = Arena::new(&fixed).await;
    arena.store.commit_phase("practice", SECRET, "1.0.0", 1).await.expect("a commitment");
    start(&arena.store, "run_1", 2).await.expect("a run");
    fixed.sampling.sample = Some(Sample { episodes: 1, anchors: 0 });
    assert!(matches!(arena.store.upsert_phase(&fixed, 3).await, Err(StoreError::Taken { .. })));
}

#[tokio::test]
async fn commitment_is_revealed_after_closing() {
    let mut promised = phase("practice", 3);
    let arena = Arena::new(&promised).await;
    assert!(arena.store.commit_phase("practice", SECRET, "1.0.0", 1).await.expect("a commitment"));
    let other = SECRET.replace('0', "1");
    assert!(!arena.store.commit_phase("practice", &other, "1.0.0", 2).await.expect("the same episodes"));
    let promise = arena.store.commitment("practice").await.expect("an answer").expect("a promise");
    assert_eq!((promise.committed_unix_ms, &promise.revealed), (1, &None));
    let shown = arena.store.reader().phases(&Viewer::Organiser, 3).await.expect("phases");
    assert!(!serde_json::to_string(&shown).expect("JSON").contains(SECRET), "not even to the organiser");
    let early = arena.store.reveal_phase("practice", None, note("revealed"), 4).await;
    assert!(matches!(early, Err(StoreError::NotClosed(_))), "{early:?}");
    promised.schedule.closed = true;
    arena.store.upsert_phase(&promised, 5).await.expect("closed");
    let (after, values) =
        arena.store.reveal_phase("practice", None, note("revealed"), 6).await.expect("closed");
    assert_eq!((&after.commitment, &values.commitment()), (&promise.commitment, &promise.commitment));
    assert_eq!((values.secret.as_str(), values.scorer.as_str()), (SECRET, "1.0.0"));
    let ids = promised.episodes.iter().map(|episode| episode.episode.as_str());
    assert_eq!(values.pool, pool_digest("d", ids));
    for wrong in [
        CommitmentValues { secret: other, ..values.clone() },
        CommitmentValues { scorer: "1.0.1".to_owned(), ..values.clone() },
        CommitmentValues { pool: pool_digest("e", ["a"]), ..values.clone() },
    ] {
        assert_ne!(wrong.commitment(), promise.commitment);
    }
    let public = arena.store.commitment("practice").await.expect("an answer").expect("a promise");
    assert_eq!(public.revealed, Some(values));
    promised.scores = Visibility::Public;
    arena.store.upsert_phase(&promised, 7).await.expect("publication after the phase");
    promised.schedule.closed = false;
    let reopened = arena.store.upsert_phase(&promised, 8).await;
    assert!(matches!(reopened, Err(StoreError::Revealed(_))), "{reopened:?}");
}

#[tokio::test]
async fn published_split_accepts_no_hidden_phase() {
    let hidden =
        |id, split: &str| Phase { split: split.to_owned(), scores: Visibility::Organiser, ..phase(id, 3) };
    let mut first = hidden("practice", "val");
    let arena = Arena::new(&first).await;
    for (name, digest) in [("twin", "d"), ("new", "e")] {
        let split = Split { name: name.to_owned(), digest: digest.to_owned(), scenes: 2, episodes: 9 };
        arena.store.upsert_split(&split).await.expect("a split");
    }
    arena.store.upsert_phase(&hidden("before", "val"), 1).await.expect("the secret is not published");
    arena.store.commit_phase("practice", SECRET, "1.0.0", 2).await.expect("a commitment");
    let schedule = Schedule { closed: true, ..Schedule::default() };
    for id in ["practice", "before"] {
        let closed = Phase { schedule: schedule.clone(), ..hidden(id, "val") };
        arena.store.upsert_phase(&closed, 3).await.expect("closed");
    }
    let seed = json!({ "secret": SECRET });
    let revealed = arena.store.reveal_phase("practice", Some(&seed), note("revealed"), 4).await;
    assert!(revealed.expect("closed").0.seed.is_some());
    for refused in [hidden("before", "val"), hidden("late", "val"), hidden("late", "twin")] {
        let refused = arena.store.upsert_phase(&refused, 5).await.expect_err("a published secret");
        assert!(matches!(refused, StoreError::SecretPublished { .. }), "{refused}");
        for part in [" is hidden", "published with phase 'practice'", "avln data split make"] {
            assert!(refused.to_string().contains(part), "{refused}");
        }
    }
    first.split = "new".to_owned();
    first.schedule = schedule;
    let moved = arena.store.upsert_phase(&first, 6).await;
    assert!(matches!(moved, Err(StoreError::Revealed(_))), "its commitment is published: {moved:?}");
    let mut late = phase("late", 3);
    arena.store.upsert_phase(&late, 7).await.expect("a public phase");
    late.replays = Visibility::Team;
    let refused = arena.store.upsert_phase(&late, 8).await;
    assert!(matches!(refused, Err(StoreError::SecretPublished { .. })), "{refused:?}");
    arena.store.upsert_phase(&hidden("late", "new"), 9).await.expect("a new split");
}

#[tokio::test]
async fn new_episodes_before_first_run_renew_commitment() {
    let arena = Arena::new(&phase("practice", 3)).await;
    arena.store.commit_phase("practice", SECRET, "1.0.0", 1).await.expect("a commitment");
    let first = arena.store.commitment("practice").await.expect("an answer").expect("a promise");
    arena.store.upsert_phase(&phase("practice", 4), 2).await.expect("no run yet");
    assert!(arena.store.commit_phase("practice", SECRET, "1.0.0", 3).await.expect("other episodes"));
    let second = arena.store.commitment("practice").await.expect("an answer").expect("a promise");
    assert_ne!(first.commitment, second.commitment);
}

#[tokio::test]
async fn changes_and_audit_lines_are_atomic() {
    let arena = Arena::new(&phase("practice", 2)).await;
    let before = arena.store.newest_audit_id().await.expect("a number");
    let (good, mut bad) = (Phase { max_slots: 9, ..phase("practice", 2) }, phase("bad", 1));
    bad.split = "nowhere".to_owned();
    let refused = arena.store.change_phases(&[good.clone(), bad], &[note("max_slots")], 3).await;
    assert!(matches!(refused, Err(StoreError::Unknown { what: "split", .. })), "{refused:?}");
    assert_eq!(arena.store.phase("practice").await.expect("the phase").max_slots, 4);
    assert_eq!(arena.store.newest_audit_id().await.expect("a number"), before);
    arena.store.change_phases(&[good], &[note("max_slots")], 4).await.expect("a change");
    assert!(arena.store.newest_audit_id().await.expect("a number") > before);
    let options = SqliteConnectOptions::new().filename(arena.path());
    let mut other = options.connect().await.expect("a connection");
    for sql in ["DELETE FROM audit", "UPDATE audit SET actor = 'nobody'"] {
        let refused = sqlx::query(sql).execute(&mut other).await.expect_err(sql);
        assert!(refused.to_string().contains("append-only"), "{refused}");
    }
    let line = &arena.store.audit().await.expect("a list")[0];
    assert_eq!((line.at_ms, line.actor.as_str(), line.what.as_str()), (4, "ada", "max_slots"));
}

#[tokio::test]
async fn tokens_are_listed_without_secrets_and_revoked() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let new = |secret, kind, team| NewToken { secret, kind, name: "laptop", team, expires_unix_ms: None };
    let looking = new("secret-for-looking", TokenScope::ReadOnly, Some(TEAM));
    arena.store.issue_token(&looking, 1).await.expect("a token");
    let organiser = new("secret-of-organiser", TokenScope::Organiser, None);
    arena.store.issue_token(&organiser, 2).await.expect("a token");
    let lines = arena.store.tokens().await.expect("a list");
    let text = serde_json::to_string(&lines).expect("JSON");
    assert!(!text.contains("secret-"), "{text}");
    assert_eq!(lines.iter().map(|line| line.kind.as_str()).collect::<Vec<_>>(), ["organiser", "read_only"]);
    arena.store.revoke_token(&lines[1].id, note("revoked"), 3).await.expect("a token");
    let state = arena.store.find_token("secret-for-looking", 4).await.expect("an answer");
    assert_eq!(state, TokenState::Revoked);
    assert!(arena.store.reader().viewer("secret-of-organiser", 4).await.expect("an answer").is_some());
    let unknown = arena.store.revoke_token("nothing", note("revoked"), 5).await;
    assert!(matches!(unknown, Err(StoreError::Unknown { what: "token", .. })));
}

#[tokio::test]
async fn runs_of_hidden_phases_are_hidden() {
    let mut shown = phase("practice", 1);
    let arena = Arena::new(&shown).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    shown.admission.allow = vec!["green".to_owned()];
    shown.scores = Visibility::Public;
    arena.store.upsert_phase(&shown, 40).await.expect("for one team");
    let reader = arena.store.reader();
    assert!(reader.run(&Viewer::Anonymous, "run_1").await.expect("an answer").is_none());
    assert!(reader.run(&Viewer::Team(TEAM.to_owned()), "run_1").await.expect("an answer").is_some());
}

#[tokio::test]
async fn phases_round_trip() {
    let written = phase("practice", 3);
    let arena = Arena::new(&written).await;
    assert_eq!(arena.store.phase("practice").await.expect("the phase"), written);
    assert!(matches!(arena.store.phase("other").await, Err(StoreError::Unknown { .. })));
}

#[tokio::test]
async fn runs_fix_episodes_but_not_state() {
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
async fn sealed_phase_requires_sealed_runs() {
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
async fn tokens_are_valid_until_expiry_or_revocation() {
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
        panic!("the token is valid")
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
async fn token_of_unknown_team_is_rejected() {
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
async fn repeated_request_returns_same_run() {
    let mut only_two = phase("practice", 2);
    only_two.quotas.total = Some(2);
    let arena = Arena::new(&only_two).await;
    let digests = BTreeMap::from([("split".to_owned(), "d".to_owned())]);
    let method = MethodInfo {
        method_type: Some(MethodType::LearntPerception),
        paper_url: "https://example.org/paper".to_owned(),
        ..MethodInfo::new("walker", "1")
    };
    let first = NewRun { client_request_id: Some("r-1"), method: &method, ..new_run(&digests) };
    let again = NewRun { id: "run_2", token: "second-secret", ..first };
    let made = arena.store.start_run(&first, 10).await.expect("a run");
    let found = arena.store.start_run(&again, 11).await.expect("the same run");
    assert_eq!(
        (made.is_new, found.is_new, made.quotas[0].remaining, found.quotas[0].remaining),
        (true, false, Some(1), Some(1))
    );
    assert_eq!(made.run, found.run);
    assert_eq!(made.run.method, method, "the description is stored");
    let view = arena.store.reader().run(&Viewer::Organiser, "run_1").await.expect("a view").expect("the run");
    let page = serde_json::to_value(&view).expect("JSON");
    assert_eq!(page["method"]["paper_url"], "https://example.org/paper");
    assert_eq!([&page["method"]["type"], &page["line"]["type"]], ["learnt-perception"; 2]);
    assert_eq!((made.run.episodes, made.run.state, &made.run.digests), (2, RunState::Created, &digests));
    let TokenState::Valid(token) = arena.store.find_token("second-secret", 12).await.expect("an answer")
    else {
        panic!("the second token plays the run")
    };
    assert_eq!((token.kind, token.run.as_deref()), (TokenScope::Run, Some("run_1")));
    let other = MethodInfo::new("runner", "1");
    let different = NewRun { method: &other, ..again };
    assert!(matches!(arena.store.start_run(&different, 12).await, Err(StoreError::Taken { .. })));
}

#[tokio::test]
async fn order_outside_phase_is_rejected() {
    let mut one_order = phase("practice", 2);
    one_order.orders = vec![Order::Ordered];
    let arena = Arena::new(&one_order).await;
    let started = arena.store.start_run(&new_run(&BTreeMap::new()), 10).await;
    assert!(matches!(started, Err(StoreError::OrderNotAllowed { order: "unordered", .. })));
}
