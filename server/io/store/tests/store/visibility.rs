//! Canaries: hidden names are searched for in everything that a viewer can get.

use crate::fixture::{Arena, CATEGORY, EPISODE, SCENES, SENTENCE, TEAM, phase};
use avln_episode::Order;
use avln_scoring::Key;
use avln_store::{Board, RunChoice, Viewer, Visibility};

/// Length of the walk of every episode: only a score can show it.
const SCORE: &str = "\"path_m\":1.25";
/// Coordinates that only the map, the reference tour and the target have.
const PLACES: [&str; 3] = ["4.25", "3.875", "[1.0,0.0,1.0]"];
const NAMES: [&str; 4] = ["canary-scene", CATEGORY, SENTENCE, EPISODE];
/// What pages never show, not even to the organiser: instance ids and seeds.
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
        let board = Board {
            phase: "practice",
            order,
            key: Key::Sr,
            pick: RunChoice::Best,
            as_of_unix_ms: None,
            now_unix_ms: 50,
        };
        seen.push(serde_json::to_string(&reader.leaderboard(viewer, &board).await.expect("a board")));
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

/// Whether the run's team is this viewer or above it, seen from a visibility.
fn expected(visibility: Visibility, viewer: &Viewer) -> bool {
    match visibility {
        Visibility::Public => true,
        Visibility::Team => matches!(viewer, Viewer::Organiser) || *viewer == Viewer::Team(TEAM.to_owned()),
        Visibility::Organiser => matches!(viewer, Viewer::Organiser),
    }
}

#[tokio::test]
async fn each_viewer_finds_what_the_phase_shows_and_nothing_else() {
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
async fn a_team_ranks_among_its_own_where_scores_are_for_teams() {
    let mut teams_only = phase("practice", 2);
    teams_only.scores = Visibility::Team;
    let arena = Arena::new(&teams_only).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let board = Board {
        phase: "practice",
        order: Order::Unordered,
        key: Key::Sr,
        pick: RunChoice::Best,
        as_of_unix_ms: None,
        now_unix_ms: 50,
    };
    let rows = |viewer| {
        let reader = arena.store.reader();
        async move {
            let view = reader.leaderboard(&viewer, &board).await.expect("an answer").expect("the phase");
            (view.rows.len(), view.complete)
        }
    };
    assert_eq!(rows(Viewer::Team(TEAM.to_owned())).await, (1, false));
    assert_eq!(rows(Viewer::Team("blue".to_owned())).await, (0, false));
    assert_eq!(rows(Viewer::Organiser).await, (1, true));
}
