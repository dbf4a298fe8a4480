//! When phases take runs, from whom, which episodes they draw, what was promised, and the list of changes.

use crate::fixture::{Arena, TEAM, new_run, phase};
use avln_episode::TimeLimits;
use avln_store::{
    Admission, AuditNote, Member, NewRun, NewToken, Phase, Sample, Sampling, Schedule, StartedRun, Store,
    StoreError, TokenScope, TokenState, Viewer, Visibility, pool_digest,
};
use sqlx::{ConnectOptions, sqlite::SqliteConnectOptions};
use std::collections::{BTreeMap, BTreeSet};

const SECRET: &str = "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff";

async fn start(store: &Store, id: &str, now: i64) -> Result<StartedRun, StoreError> {
    let digests = BTreeMap::new();
    store.start_run(&NewRun { id, token: id, ..new_run(&digests) }, now).await
}

fn note(what: &str) -> AuditNote {
    AuditNote { actor: "ada".to_owned(), what: what.to_owned(), ..AuditNote::default() }
}

#[tokio::test]
async fn runs_start_between_the_dates_and_not_in_a_pause() {
    let schedule = Schedule { opens_unix_ms: Some(10), closes_unix_ms: Some(20), ..Schedule::default() };
    let time = TimeLimits { run_s: 1, ..TimeLimits::default() };
    let mut dated = Phase { schedule, time, ..phase("practice", 2) };
    let arena = Arena::new(&dated).await;
    let early = start(&arena.store, "run_0", 9).await;
    assert!(matches!(early, Err(StoreError::PhaseNotOpen { opens_unix_ms: 10, .. })), "{early:?}");
    start(&arena.store, "run_1", 10).await.expect("it is open");
    dated.schedule.paused = Some("the roof leaks".to_owned());
    arena.store.upsert_phase(&dated, 11).await.expect("a pause");
    let paused = start(&arena.store, "run_2", 12).await.expect_err("a pause");
    assert!(paused.to_string().contains("the roof leaks"), "{paused}");
    assert!(matches!(start(&arena.store, "run_2", 20).await, Err(StoreError::PhaseClosed(_))));
    // A run that was started in time has its whole wall time.
    assert!(arena.assign("run_1", "h").await.is_some());
}

#[tokio::test]
async fn a_phase_takes_the_teams_that_it_is_for() {
    let admission = Admission { approval: true, deny: vec!["blue".to_owned()], ..Admission::default() };
    let mut closed = Phase { admission, ..phase("practice", 2) };
    let arena = Arena::new(&closed).await;
    let refused = start(&arena.store, "run_1", 10).await;
    assert!(matches!(refused, Err(StoreError::TeamNotApproved { .. })), "{refused:?}");
    assert!(arena.store.approve("practice", TEAM, true, note("approved"), 11).await.expect("a team"));
    assert!(!arena.store.approve("practice", TEAM, true, note("approved"), 12).await.expect("a team"));
    start(&arena.store, "run_1", 13).await.expect("it was approved");
    let digests = BTreeMap::new();
    let blue = NewRun { id: "run_2", token: "t", team: "blue", ..new_run(&digests) };
    arena.store.approve("practice", "blue", true, note("approved"), 14).await.expect("a team");
    assert!(matches!(arena.store.start_run(&blue, 15).await, Err(StoreError::TeamNotApproved { .. })));
    closed.admission = Admission { allow: vec!["blue".to_owned()], ..Admission::default() };
    arena.store.upsert_phase(&closed, 16).await.expect("other teams");
    assert!(matches!(start(&arena.store, "run_3", 17).await, Err(StoreError::PhaseNotVisible { .. })));
    arena.store.start_run(&blue, 18).await.expect("it is for them");
    assert_eq!(arena.store.audit().await.expect("a list").len(), 2);
}

#[tokio::test]
async fn a_phase_for_some_teams_is_shown_to_them_alone() {
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
async fn a_person_is_in_one_team_of_a_phase() {
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
async fn a_run_plays_the_sample_that_secret_and_run_draw() {
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
    assert_eq!(runs[0], runs[1], "secret and run say it all");
}

#[tokio::test]
async fn a_played_phase_keeps_its_sampling() {
    let mut fixed = Phase { sampling: Sampling { shuffle: true, sample: None }, ..phase("practice", 3) };
    let arena = Arena::new(&fixed).await;
    arena.store.commit_phase("practice", SECRET, "1.0.0", 1).await.expect("a commitment");
    start(&arena.store, "run_1", 2).await.expect("a run");
    fixed.sampling.sample = Some(Sample { episodes: 1, anchors: 0 });
    assert!(matches!(arena.store.upsert_phase(&fixed, 3).await, Err(StoreError::Taken { .. })));
}

#[tokio::test]
async fn a_commitment_holds_and_opens_after_the_phase() {
    let mut promised = phase("practice", 3);
    let arena = Arena::new(&promised).await;
    assert!(arena.store.commit_phase("practice", SECRET, "1.0.0", 1).await.expect("a commitment"));
    let other = SECRET.replace('0', "1");
    assert!(!arena.store.commit_phase("practice", &other, "1.0.0", 2).await.expect("the same episodes"));
    let promise = arena.store.promise("practice").await.expect("an answer").expect("a promise");
    assert_eq!((promise.committed_unix_ms, &promise.revealed), (1, &None));
    let shown = arena.store.reader().phases(&Viewer::Organiser, 3).await.expect("phases");
    assert!(!serde_json::to_string(&shown).expect("JSON").contains(SECRET), "not even to the organiser");
    let early = arena.store.reveal_phase("practice", note("revealed"), 4).await;
    assert!(matches!(early, Err(StoreError::NotClosed(_))), "{early:?}");
    promised.schedule.closed = true;
    arena.store.upsert_phase(&promised, 5).await.expect("closed");
    let (after, values) = arena.store.reveal_phase("practice", note("revealed"), 6).await.expect("closed");
    assert_eq!((&after.commitment, &values.commitment()), (&promise.commitment, &promise.commitment));
    assert_eq!((values.secret.as_str(), values.scorer.as_str()), (SECRET, "1.0.0"));
    let ids = promised.episodes.iter().map(|episode| episode.episode.as_str());
    assert_eq!(values.pool, pool_digest("d", ids));
    for wrong in [
        avln_store::CommitmentValues { secret: other, ..values.clone() },
        avln_store::CommitmentValues { scorer: "1.0.1".to_owned(), ..values.clone() },
        avln_store::CommitmentValues { pool: pool_digest("e", ["a"]), ..values.clone() },
    ] {
        assert_ne!(wrong.commitment(), promise.commitment);
    }
    let public = arena.store.promise("practice").await.expect("an answer").expect("a promise");
    assert_eq!(public.revealed, Some(values));
}

#[tokio::test]
async fn other_episodes_before_the_first_run_are_another_promise() {
    let arena = Arena::new(&phase("practice", 3)).await;
    arena.store.commit_phase("practice", SECRET, "1.0.0", 1).await.expect("a commitment");
    let first = arena.store.promise("practice").await.expect("an answer").expect("a promise");
    arena.store.upsert_phase(&phase("practice", 4), 2).await.expect("no run yet");
    assert!(arena.store.commit_phase("practice", SECRET, "1.0.0", 3).await.expect("other episodes"));
    let second = arena.store.promise("practice").await.expect("an answer").expect("a promise");
    assert_ne!(first.commitment, second.commitment);
}

#[tokio::test]
async fn changes_and_notes_are_written_together_and_notes_stay() {
    let arena = Arena::new(&phase("practice", 2)).await;
    let before = arena.store.newest_change().await.expect("a number");
    let (good, mut bad) = (Phase { max_slots: 9, ..phase("practice", 2) }, phase("bad", 1));
    bad.split = "nowhere".to_owned();
    let refused = arena.store.change_phases(&[good.clone(), bad], &[note("max_slots")], 3).await;
    assert!(matches!(refused, Err(StoreError::Unknown { what: "split", .. })), "{refused:?}");
    assert_eq!(arena.store.phase("practice").await.expect("the phase").max_slots, 4);
    assert_eq!(arena.store.newest_change().await.expect("a number"), before);
    arena.store.change_phases(&[good], &[note("max_slots")], 4).await.expect("a change");
    assert!(arena.store.newest_change().await.expect("a number") > before);
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
async fn tokens_are_listed_without_secrets_and_taken_back_one_by_one() {
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
async fn a_run_of_a_phase_for_others_is_hidden_from_those_who_may_not_know_it() {
    let mut shown = phase("practice", 1);
    let arena = Arena::new(&shown).await;
    arena.play("run_1", "walker", avln_episode::Order::Unordered, 1).await;
    shown.admission.allow = vec!["green".to_owned()];
    shown.scores = Visibility::Public;
    arena.store.upsert_phase(&shown, 40).await.expect("for one team");
    let reader = arena.store.reader();
    assert!(reader.run(&Viewer::Anonymous, "run_1").await.expect("an answer").is_none());
    assert!(reader.run(&Viewer::Team(TEAM.to_owned()), "run_1").await.expect("an answer").is_some());
}
