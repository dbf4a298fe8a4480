//! Searches all pages of each viewer for hidden canary names.

use crate::fixture::{Arena, CATEGORY, EPISODE, SCENES, SENTENCE, TEAM, phase};
use avln_challenge::{RunChoice, Visibility};
use avln_episode::Order;
use avln_scoring::Key;
use avln_store::{LeaderboardQuery, RowFilter, Viewer};

/// Path length of every episode, visible in scores only.
const SCORE: &str = "\"path_m\":1.25";
/// Coordinates of the map, the reference path and the target only.
const PLACES: [&str; 3] = ["4.25", "3.875", "[1.0,0.0,1.0]"];
const NAMES: [&str; 4] = ["canary-scene", CATEGORY, SENTENCE, EPISODE];
/// Instance ids and seeds, hidden from all viewers including the organiser.
const NEVER: [&str; 2] = ["54321", "77777"];

fn query(order: Order) -> LeaderboardQuery<'static> {
    LeaderboardQuery {
        phase: "practice",
        order,
        key: Key::Sr,
        pick: RunChoice::Best,
        as_of_unix_ms: None,
        now_unix_ms: 50,
        filter: RowFilter::default(),
    }
}

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
        let query = query(order);
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
    let query = &query(Order::Unordered);
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
