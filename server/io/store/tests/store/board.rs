//! Leaderboards and replays.

use crate::fixture::{Arena, CATEGORY, Played, SCENES, new_run, phase};
use avln_episode::{EndReason, Order, Sensors};
use avln_scoring::Key;
use avln_store::{Board, LeaderboardRow, LeaderboardView, NewRun, Reference, RunChoice, Viewer};
use std::collections::BTreeMap;

const BOARD: Board<'_> = Board {
    phase: "practice",
    order: Order::Unordered,
    key: Key::Isr,
    pick: RunChoice::Best,
    as_of_unix_ms: None,
    now_unix_ms: 100,
};

async fn board(arena: &Arena, board: &Board<'_>) -> LeaderboardView {
    arena.store.reader().leaderboard(&Viewer::Anonymous, board).await.expect("an answer").expect("the phase")
}

/// Rank and tie group of a row that competes.
fn stands(row: &LeaderboardRow) -> (u32, u32) {
    row.standing.map(|standing| (standing.rank, standing.tie_group)).expect("a rank")
}

#[tokio::test]
async fn references_are_shown_in_their_place_and_have_no_rank() {
    let arena = Arena::new(&phase("practice", 4)).await;
    for (team, reference) in [("people", Reference::Human), ("oracle", Reference::Oracle)] {
        arena.store.create_team(team, Some(reference), 1).await.expect("a team");
    }
    arena.play("run_weak", "walker", Order::Unordered, 0).await;
    arena.play_as("people", "run_people", "ada", Order::Unordered, 1).await;
    arena.play_as("oracle", "run_oracle", "shortest-path", Order::Unordered, 2).await;
    let view = board(&arena, &BOARD).await;
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
    let told = serde_json::to_value(&view.rows).expect("JSON");
    assert!(told[0]["rank"].is_null() && told[2]["rank_high"] == 1 && told[0]["reference"] == "oracle");
}

#[tokio::test]
async fn the_best_run_of_each_method_is_ranked_and_orders_do_not_mix() {
    let arena = Arena::new(&phase("practice", 4)).await;
    arena.play("run_weak", "walker", Order::Unordered, 0).await;
    arena.play("run_good", "walker", Order::Unordered, 1).await;
    arena.play("run_best", "runner", Order::Unordered, 2).await;
    arena.play("run_same", "copy", Order::Unordered, 1).await;
    arena.play("run_other", "walker", Order::Ordered, 2).await;
    let view = board(&arena, &BOARD).await;
    let lines: Vec<_> = view
        .rows
        .iter()
        .map(|r| (stands(r), r.run.as_str(), r.runs_count, r.median, r.summary.isr.value))
        .collect();
    assert_eq!(
        lines,
        [
            ((1, 1), "run_best", 1, 1.0, 1.0),
            ((2, 2), "run_same", 1, 0.5, 0.5),
            ((2, 2), "run_good", 2, 0.25, 0.5)
        ]
    );
    assert_eq!(board(&arena, &BOARD).await, view, "asked twice");
    arena.play("run_late", "late", Order::Unordered, 0).await;
    assert_eq!(board(&arena, &BOARD).await.rows.len(), 4);
    let ordered = board(&arena, &Board { order: Order::Ordered, ..BOARD }).await;
    assert_eq!(ordered.rows.len(), 1);
    assert_eq!(ordered.rows[0].health, BTreeMap::from([("stopped", 4)]));
}

#[tokio::test]
async fn the_latest_run_stands_for_its_method_when_asked() {
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
        arena.store.record_result(&played.finished("run_late", handle), 60).await.expect("a result");
    }
    assert_eq!(board(&arena, &BOARD).await.rows[0].run, "run_good");
    assert_eq!(board(&arena, &Board { pick: RunChoice::Latest, ..BOARD }).await.rows[0].run, "run_late");
}

#[tokio::test]
async fn runs_that_are_not_whole_are_not_ranked() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.store.start_run(&new_run(&BTreeMap::new()), 10).await.expect("a run");
    let assigned = arena.assign("run_1", "h").await.expect("an episode");
    let played = Played::new(&assigned, Order::Unordered, 2, EndReason::Stopped);
    arena.record("run_1", "h", &played).await.expect("a result");
    assert!(board(&arena, &BOARD).await.rows.is_empty());
    let runs = arena.store.reader().runs(&Viewer::Anonymous, None, 10).await.expect("a list");
    assert_eq!((runs.len(), runs[0].done, runs[0].episodes, runs[0].isr), (1, 1, 2, Some(1.0)));
}

#[tokio::test]
async fn a_replay_shows_the_walk_the_targets_and_the_floor() {
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
async fn a_board_of_the_past_has_the_runs_that_were_completed_by_then() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let finished = board(&arena, &BOARD).await.rows[0].finished_unix_ms.expect("a completed run");
    let by = |moment: i64| Board { as_of_unix_ms: Some(moment), ..BOARD };
    assert_eq!(board(&arena, &by(finished - 1)).await.rows, []);
    let then = board(&arena, &by(finished)).await;
    assert_eq!((then.rows.len(), then.entries, then.as_of_unix_ms), (1, 1, Some(finished)));
}

#[tokio::test]
async fn a_sense_that_an_agent_had_in_one_session_stays_noted() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let deaf = Sensors { audio: false, ..Sensors::all(64, 64) };
    let blind = Sensors { rgb: false, depth: false, ..Sensors::all(32, 32) };
    for sensors in [&deaf, &blind] {
        arena.store.set_sensors("run_1", sensors).await.expect("a run");
    }
    let run = arena.store.run("run_1").await.expect("a run");
    assert_eq!(run.sensors.as_ref(), Some(&blind), "what the last session asked for");
    let senses = run.senses.expect("senses");
    assert_eq!((senses.rgb, senses.depth, senses.audio, senses.width), (true, true, true, 32));
    let row = board(&arena, &BOARD).await.rows.remove(0);
    assert_eq!(row.sensors, Some(senses));
    arena.store.set_sensors("nobody", &deaf).await.expect_err("no such run");
}
