//! Leaderboards, and a search of all pages of each viewer for hidden canary names.

use crate::{Arena, CATEGORY, EPISODE, Played, SCENES, SENTENCE, TEAM, new_run, note, phase};
use avln_challenge::{MethodInfo, MethodType, Reference, Ruling, RunChoice, TokenScope, Visibility};
use avln_episode::{EndReason, Order, Sensors};
use avln_scoring::Key;
use avln_store::{
    LeaderboardQuery, LeaderboardRow, LeaderboardView, NewGrant, NewRun, NewToken, Phase, RowFilter,
    StoreError, TeamsView, TokenHash, Viewer,
};
use std::collections::BTreeMap;

fn query() -> LeaderboardQuery<'static> {
    LeaderboardQuery {
        phase: "practice",
        order: Order::Unordered,
        key: Key::Isr,
        pick: RunChoice::Best,
        as_of_unix_ms: None,
        now_unix_ms: 100,
        filter: RowFilter::default(),
    }
}

async fn leaderboard(arena: &Arena, query: &LeaderboardQuery<'_>) -> LeaderboardView {
    let view = arena.store.reader().leaderboard(&Viewer::Anonymous, query).await;
    view.expect("an answer").expect("the phase")
}

/// Returns rank and tie group of a competing row.
fn standing(row: &LeaderboardRow) -> (u32, u32) {
    row.standing.map(|standing| (standing.rank, standing.tie_group)).expect("a rank")
}

#[tokio::test]
async fn references_are_sorted_in_without_rank() {
    let arena = Arena::new(&phase("practice", 4)).await;
    for (team, reference) in [("people", Reference::Human), ("oracle", Reference::Oracle)] {
        arena.store.create_team(team, Some(reference), 1).await.expect("a team");
    }
    arena.play("run_weak", "walker", Order::Unordered, 0).await;
    arena.play_as("people", "run_people", "ada", Order::Unordered, 1).await;
    arena.play_as("oracle", "run_oracle", "shortest-path", Order::Unordered, 2).await;
    let view = leaderboard(&arena, &query()).await;
    let lines: Vec<_> = view
        .rows
        .iter()
        .map(|row| (row.run.as_str(), row.reference, row.standing.map(|standing| standing.rank)))
        .collect();
    assert_eq!(
        lines,
        [
            ("run_oracle", Some(Reference::Oracle), None),
            ("run_people", Some(Reference::Human), None),
            ("run_weak", None, Some(1))
        ]
    );
    let listed = serde_json::to_value(&view.rows).expect("JSON");
    assert!(listed[0]["rank"].is_null() && listed[2]["rank_high"] == 1 && listed[0]["reference"] == "oracle");
}

#[tokio::test]
async fn best_run_represents_method_per_order() {
    let arena = Arena::new(&phase("practice", 4)).await;
    arena.play("run_weak", "walker", Order::Unordered, 0).await;
    arena.play("run_good", "walker", Order::Unordered, 1).await;
    arena.play("run_best", "runner", Order::Unordered, 2).await;
    arena.play("run_same", "copy", Order::Unordered, 1).await;
    arena.play("run_other", "walker", Order::Ordered, 2).await;
    let view = leaderboard(&arena, &query()).await;
    let lines: Vec<_> = view
        .rows
        .iter()
        .map(|r| (standing(r), r.run.as_str(), r.runs_count, r.median, r.summary.isr.value))
        .collect();
    assert_eq!(
        lines,
        [
            ((1, 1), "run_best", 1, 1.0, 1.0),
            ((2, 2), "run_same", 1, 0.5, 0.5),
            ((2, 2), "run_good", 2, 0.25, 0.5)
        ]
    );
    assert_eq!(leaderboard(&arena, &query()).await, view, "cached");
    arena.play("run_late", "late", Order::Unordered, 0).await;
    assert_eq!(leaderboard(&arena, &query()).await.rows.len(), 4);
    let ordered = leaderboard(&arena, &LeaderboardQuery { order: Order::Ordered, ..query() }).await;
    assert_eq!(ordered.rows.len(), 1);
    assert_eq!(ordered.rows[0].health, BTreeMap::from([("stopped", 4)]));
}

#[tokio::test]
async fn latest_run_represents_method_on_request() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_good", "walker", Order::Unordered, 2).await;
    let digests = BTreeMap::new();
    arena
        .store
        .start_run(&NewRun { id: "run_late", token: "t", ..new_run(&digests) }, 50)
        .await
        .expect("a run");
    for handle in ["l0", "l1"] {
        let assigned = arena.assign("run_late", handle).await.expect("an episode");
        let played = Played::new(&assigned, Order::Unordered, 0, EndReason::Stopped);
        arena.store.record_result(&played.result("run_late", handle), 60).await.expect("a result");
    }
    assert_eq!(leaderboard(&arena, &query()).await.rows[0].run, "run_good");
    assert_eq!(
        leaderboard(&arena, &LeaderboardQuery { pick: RunChoice::Latest, ..query() }).await.rows[0].run,
        "run_late"
    );
}

#[tokio::test]
async fn incomplete_runs_are_not_ranked() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.store.start_run(&new_run(&BTreeMap::new()), 10).await.expect("a run");
    let assigned = arena.assign("run_1", "h").await.expect("an episode");
    let played = Played::new(&assigned, Order::Unordered, 2, EndReason::Stopped);
    arena.record("run_1", "h", &played).await.expect("a result");
    assert!(leaderboard(&arena, &query()).await.rows.is_empty());
    let runs = arena.store.reader().runs(&Viewer::Anonymous, None, 10).await.expect("a list");
    assert_eq!((runs.len(), runs[0].done, runs[0].episodes, runs[0].isr), (1, 1, 2, Some(1.0)));
}

#[tokio::test]
async fn replay_has_path_targets_and_map() {
    let arena = Arena::new(&phase("practice", 1)).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let reader = arena.store.reader();
    let view = reader.episode(&Viewer::Anonymous, "run_1", 0).await.expect("an answer").expect("the episode");
    let replay = view.replay.expect("a public replay");
    assert_eq!((replay.scene.as_str(), replay.path.len(), replay.actions.len()), (SCENES[0], 7, 6));
    assert_eq!((replay.path[0], replay.collisions.as_slice()), ([0.1, 0.0, 0.25], [3].as_slice()));
    assert_eq!(
        (replay.targets[0].category.as_str(), replay.targets[0].position),
        (CATEGORY, [1.5, 0.5, 1.5])
    );
    assert_eq!(replay.map.polygons[0].len(), 3);
    let goals = view.mission.expect("a public mission").goals;
    assert_eq!((goals[0].found_at_step, goals[1].found_at_step), (Some(5), None));
    assert_eq!(goals[0].text.as_deref(), Some(CATEGORY));
    assert_eq!(reader.episode(&Viewer::Anonymous, "run_1", 1).await.expect("an answer"), None);
}

#[tokio::test]
async fn past_leaderboard_has_runs_completed_by_then() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let finished = leaderboard(&arena, &query()).await.rows[0].finished_unix_ms.expect("a completed run");
    let by = |moment: i64| LeaderboardQuery { as_of_unix_ms: Some(moment), ..query() };
    assert_eq!(leaderboard(&arena, &by(finished - 1)).await.rows, []);
    let then = leaderboard(&arena, &by(finished)).await;
    assert_eq!((then.rows.len(), then.entries, then.as_of_unix_ms), (1, 1, Some(finished)));
}

#[tokio::test]
async fn sensors_of_all_sessions_are_recorded() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let deaf = Sensors { audio: false, ..Sensors::all(64, 64) };
    let blind = Sensors { rgb: false, depth: false, ..Sensors::all(32, 32) };
    for sensors in [&deaf, &blind] {
        arena.store.set_sensors("run_1", sensors).await.expect("a run");
    }
    let run = arena.store.run("run_1").await.expect("a run");
    assert_eq!(run.sensors.as_ref(), Some(&blind), "sensors of the last session");
    let senses = run.senses.expect("senses");
    assert_eq!((senses.rgb, senses.depth, senses.audio, senses.width), (true, true, true, 32));
    let row = leaderboard(&arena, &query()).await.rows.remove(0);
    assert_eq!(row.sensors, Some(senses));
    arena.store.set_sensors("nobody", &deaf).await.expect_err("no such run");
}

#[tokio::test]
async fn filters_select_rows_and_keep_ranks() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_best", "runner", Order::Unordered, 2).await;
    let walker = MethodInfo { method_type: Some(MethodType::Imitation), ..MethodInfo::new("Walker", "1") };
    arena.play_method("blue", "run_blue", &walker, Order::Unordered, 1).await;
    arena.play("run_weak", "walker", Order::Unordered, 0).await;
    arena
        .store
        .set_sensors("run_weak", &Sensors { audio: false, ..Sensors::all(64, 64) })
        .await
        .expect("a run");
    let typed = RowFilter { method_type: Some(MethodType::Imitation), ..RowFilter::default() };
    let untyped = RowFilter { method_type: Some(MethodType::Rl), ..RowFilter::default() };
    let filters = [
        (typed, vec![("run_blue", 2)]),
        (untyped, vec![]),
        (
            RowFilter { words: "WALK".to_owned(), ..RowFilter::default() },
            vec![("run_blue", 2), ("run_weak", 3)],
        ),
        (RowFilter { team: TEAM.to_owned(), ..RowFilter::default() }, vec![("run_best", 1), ("run_weak", 3)]),
        (
            RowFilter { senses: [Some(true), None, Some(false)], ..RowFilter::default() },
            vec![("run_weak", 3)],
        ),
        (RowFilter { senses: [None, None, Some(true)], ..RowFilter::default() }, vec![]),
    ];
    for (filter, expected) in filters {
        let view = leaderboard(&arena, &LeaderboardQuery { filter, ..query() }).await;
        let rows: Vec<_> = view.rows.iter().map(|row| (row.run.as_str(), standing(row).0)).collect();
        assert_eq!(rows, expected);
        assert_eq!((view.entries, view.leader.as_deref()), (3, Some("run_best")));
        assert_eq!(view.teams.into_iter().collect::<Vec<_>>(), ["blue", TEAM]);
    }
}

#[test]
fn only_default_filter_is_empty() {
    assert!(RowFilter::default().is_empty());
    for filter in [
        RowFilter { words: "walk".to_owned(), ..RowFilter::default() },
        RowFilter { team: TEAM.to_owned(), ..RowFilter::default() },
        RowFilter { method_type: Some(MethodType::Rl), ..RowFilter::default() },
        RowFilter { senses: [None, Some(false), None], ..RowFilter::default() },
    ] {
        assert!(!filter.is_empty(), "{filter:?}");
    }
}

#[tokio::test]
async fn disqualified_run_is_replaced_until_readmitted() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_good", "walker", Order::Unordered, 2).await;
    arena.play("run_weak", "walker", Order::Unordered, 1).await;
    let before = leaderboard(&arena, &query()).await;
    assert_eq!((before.rows[0].run.as_str(), before.rows[0].runs_count), ("run_good", 2));
    let reason = Some("it was trained on the test scenes");
    for changes in [true, false] {
        let ruled = arena.store.disqualify_run("run_good", reason, note("disqualified"), 40).await;
        assert_eq!(ruled.expect("a run"), changes);
    }
    let without = leaderboard(&arena, &query()).await;
    assert_eq!((without.rows[0].run.as_str(), without.rows[0].runs_count), ("run_weak", 1));
    let view =
        arena.store.reader().run(&Viewer::Anonymous, "run_good").await.expect("an answer").expect("a run");
    assert!(!view.eligible && view.summary.is_some());
    assert_eq!(view.line.disqualified.as_deref(), reason);
    assert!(arena.store.disqualify_run("run_good", None, note("put back"), 50).await.expect("a run"));
    assert_eq!(leaderboard(&arena, &query()).await, before);
    let audit: Vec<String> =
        arena.store.audit().await.expect("a list").into_iter().map(|line| line.what).collect();
    assert_eq!(audit, ["disqualified", "put back"], "unchanged rulings add no audit line");
    arena.store.disqualify_run("nobody", reason, note("x"), 60).await.expect_err("no such run");
}

#[tokio::test]
async fn verification_shows_on_cached_leaderboards() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_good", "walker", Order::Unordered, 2).await;
    assert!(!leaderboard(&arena, &query()).await.rows[0].verified);
    assert!(arena.store.verify_run("run_good", true, note("verified"), 40).await.expect("a run"));
    assert!(leaderboard(&arena, &query()).await.rows[0].verified);
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
async fn accounts_show_own_data_or_all_teams() {
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
    assert_eq!((&holder.viewer, holder.read_only, holder.token.as_str()), (&red, false, of_red.id()));
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
    let listed: Vec<_> = view.teams.iter().map(|team| (team.name.as_str(), team.runs, team.tokens)).collect();
    assert_eq!(listed, [("blue", 0, 1), (TEAM, 1, 1)]);
    assert_eq!((view.grants.len(), view.grants[0].reason.as_str()), (1, "why"));
    assert_eq!(reader.audit(&Viewer::Organiser, None, 10).await.expect("a list").len(), 1);
    arena.store.revoke_own_token(TEAM, of_blue.id(), note("x"), 20).await.expect_err("it is another team's");
    arena.store.revoke_own_token("blue", of_blue.id(), note("x"), 20).await.expect("its own");
    assert_eq!(reader.holder(&of_blue, 30).await.expect("an answer"), None);
}

/// Path length of every episode, visible in scores only.
const SCORE: &str = "\"path_m\":1.25";
/// Coordinates of the map, the reference path and the target only.
const PLACES: [&str; 3] = ["4.25", "3.875", "[1.0,0.0,1.0]"];
const NAMES: [&str; 4] = ["canary-scene", CATEGORY, SENTENCE, EPISODE];
/// Instance ids and seeds, hidden from all viewers including the organiser.
const NEVER: [&str; 2] = ["54321", "77777"];

async fn everything(arena: &Arena, viewer: &Viewer) -> String {
    let reader = arena.store.reader();
    let mut seen = vec![
        serde_json::to_string(&reader.phases(viewer, 50).await.expect("phases")),
        serde_json::to_string(&reader.phase(viewer, "practice", 50).await.expect("a phase")),
        serde_json::to_string(&reader.runs(viewer, Some("practice"), 99).await.expect("runs")),
        serde_json::to_string(&reader.run(viewer, "run_1").await.expect("a run")),
        serde_json::to_string(&reader.run(viewer, "run_1").await.expect("the run that is kept")),
        serde_json::to_string(&reader.missions(viewer, "practice").await.expect("missions")),
        serde_json::to_string(&reader.scene_map(viewer, "practice", SCENES[0]).await.expect("a map")),
    ];
    for order in [Order::Ordered, Order::Unordered] {
        let query = LeaderboardQuery { order, ..query() };
        seen.push(serde_json::to_string(&reader.leaderboard(viewer, &query).await.expect("a leaderboard")));
    }
    for ordinal in 0..2 {
        seen.push(serde_json::to_string(
            &reader.episode(viewer, "run_1", ordinal).await.expect("an episode"),
        ));
    }
    seen.into_iter().map(|view| view.expect("JSON")).collect()
}

fn viewers() -> [Viewer; 4] {
    [Viewer::Anonymous, Viewer::Team("blue".to_owned()), Viewer::Team(TEAM.to_owned()), Viewer::Organiser]
}

/// True if the run's team is this viewer or above it, seen from a visibility.
fn expected(visibility: Visibility, viewer: &Viewer) -> bool {
    match visibility {
        Visibility::Public => true,
        Visibility::Team => matches!(viewer, Viewer::Organiser) || *viewer == Viewer::Team(TEAM.to_owned()),
        Visibility::Organiser => matches!(viewer, Viewer::Organiser),
    }
}

#[tokio::test]
async fn viewers_find_visible_data_only() {
    let mut shown = phase("practice", 2);
    let arena = Arena::new(&shown).await;
    arena.play("run_1", "walker-method", Order::Unordered, 1).await;
    let levels = [Visibility::Public, Visibility::Team, Visibility::Organiser];
    for (scores, replays) in levels.into_iter().flat_map(|a| levels.map(|b| (a, b))) {
        (shown.scores, shown.replays) = (scores, replays);
        arena.store.upsert_phase(&shown, 40).await.expect("a new visibility");
        for viewer in viewers() {
            let seen = everything(&arena, &viewer).await;
            let case = format!("scores {scores:?}, replays {replays:?}, {viewer:?}");
            let may_score = expected(scores, &viewer);
            let may_replay = may_score && expected(replays, &viewer);
            assert_eq!(seen.contains(SCORE), may_score, "{case}");
            for hidden in NAMES.iter().chain(&PLACES) {
                assert_eq!(seen.contains(hidden), may_replay, "{case}: {hidden}");
            }
            let may_know = may_score || viewer == Viewer::Team(TEAM.to_owned());
            assert_eq!(seen.contains("walker-method"), may_know, "{case}");
            assert!(!NEVER.iter().any(|never| seen.contains(never)), "{case}");
        }
    }
}

#[tokio::test]
async fn team_visibility_ranks_own_runs() {
    let mut teams_only = phase("practice", 2);
    teams_only.scores = Visibility::Team;
    let arena = Arena::new(&teams_only).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let query = &query();
    let rows = |viewer| {
        let reader = arena.store.reader();
        async move {
            let view = reader.leaderboard(&viewer, query).await.expect("an answer").expect("the phase");
            (view.rows.len(), view.complete)
        }
    };
    assert_eq!(rows(Viewer::Team(TEAM.to_owned())).await, (1, false));
    assert_eq!(rows(Viewer::Team("blue".to_owned())).await, (0, false));
    assert_eq!(rows(Viewer::Organiser).await, (1, true));
}
