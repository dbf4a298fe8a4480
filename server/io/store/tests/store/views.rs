//! Pages of open runs, comparisons, missions, quotas and phases; access to logs; numbers for monitoring.

use crate::{Arena, CATEGORY, SCENES, TEAM, new_run, phase};
use avln_challenge::{Admission, PhaseState, QuotaLimits, Schedule, Visibility};
use avln_episode::Order;
use avln_scoring::Key;
use avln_store::{Incomparable, LogAccess, MissionsView, NewRun, Phase, SceneMap, Viewer};
use std::collections::BTreeMap;

fn red() -> Viewer {
    Viewer::Team(TEAM.to_owned())
}

/// Returns a phase of two episodes with public scores; only teams see their replays.
fn guarded() -> Phase {
    Phase { replays: Visibility::Team, ..phase("practice", 2) }
}

/// Starts a run of the team `red`.
async fn open(arena: &Arena, id: &str, phase: &str, now: i64) {
    let digests = BTreeMap::new();
    let new = NewRun { id, token: id, phase, ..new_run(&digests) };
    arena.store.start_run(&new, now).await.expect("a run");
}

#[tokio::test]
async fn open_runs_show_progress_by_visibility() {
    let arena = Arena::new(&guarded()).await;
    arena.play("run_over", "walker", Order::Unordered, 1).await;
    open(&arena, "run_1", "practice", 40).await;
    open(&arena, "run_2", "practice", 50).await;
    arena.assign("run_1", "h").await.expect("an episode");
    let reader = arena.store.reader();
    for (viewer, steps_visible) in [(Viewer::Anonymous, false), (red(), true)] {
        let run = reader.live_run(&viewer, "run_1").await.expect("an answer").expect("the run");
        assert_eq!((run.line.run.as_str(), run.playing, run.line.isr), ("run_1", 1, None));
        assert_eq!(run.steps_visible, steps_visible, "{viewer:?}");
    }
    assert_eq!(reader.live_run(&red(), "run_9").await.expect("an answer"), None);
    for (limit, expected) in [(9, vec!["run_2", "run_1"]), (1, vec!["run_2"])] {
        let live = reader.live_runs(&Viewer::Anonymous, limit).await.expect("a list");
        assert_eq!(live.iter().map(|run| run.line.run.as_str()).collect::<Vec<_>>(), expected);
    }
}

#[tokio::test]
async fn times_without_replays_are_whole_seconds() {
    let arena = Arena::new(&Phase { replays: Visibility::Team, ..phase("practice", 3) }).await;
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    let reader = arena.store.reader();
    for (viewer, run_s, episode_s) in
        [(Viewer::Anonymous, (2.0, 5.0), (1.0, 2.0)), (red(), (1.5, 4.5), (0.5, 1.5))]
    {
        let run = reader.run(&viewer, "run_1").await.expect("an answer").expect("the run");
        assert_eq!((run.time.simulation_s, run.time.thinking_s), run_s, "{viewer:?}");
        let episode = reader.episode(&viewer, "run_1", 0).await.expect("an answer").expect("the episode");
        assert_eq!((episode.time.simulation_s, episode.time.thinking_s), episode_s, "{viewer:?}");
    }
}

#[tokio::test]
async fn run_list_continues_after_last_run() {
    let arena = Arena::new(&guarded()).await;
    for (id, now) in [("run_1", 40), ("run_2", 50), ("run_3", 60)] {
        open(&arena, id, "practice", now).await;
    }
    let reader = arena.store.reader();
    let page = async |before: Option<&str>| {
        let page = reader.older_runs(&Viewer::Anonymous, Some("practice"), before, 2).await;
        let page = page.expect("an answer")?;
        Some((page.runs.into_iter().map(|line| line.run).collect::<Vec<_>>(), page.next))
    };
    let newest = vec!["run_3".to_owned(), "run_2".to_owned()];
    assert_eq!(page(None).await, Some((newest, Some("run_2".to_owned()))));
    assert_eq!(page(Some("run_2")).await, Some((vec!["run_1".to_owned()], None)));
    assert_eq!(page(Some("run_9")).await, None);
}

#[tokio::test]
async fn cancelled_runs_are_listed_for_their_team() {
    let arena = Arena::new(&phase("practice", 2)).await;
    for (id, now) in [("run_1", 40), ("run_2", 50), ("run_3", 60)] {
        open(&arena, id, "practice", now).await;
    }
    arena.store.cancel_run("run_2", 70).await.expect("an open run");
    let reader = arena.store.reader();
    let blue = Viewer::Team("blue".to_owned());
    for (viewer, count) in [(&blue, 0), (&red(), 3), (&Viewer::Organiser, 0)] {
        let own = reader.own_runs(viewer, 9).await.expect("a list");
        assert_eq!(own.len(), count, "own runs of {viewer:?} in a public phase");
    }
    for (viewer, expected) in [
        (Viewer::Anonymous, ["run_3", "run_1"]),
        (blue, ["run_3", "run_1"]),
        (red(), ["run_3", "run_2"]),
        (Viewer::Organiser, ["run_3", "run_2"]),
    ] {
        let page = reader.older_runs(&viewer, None, None, 2).await.expect("an answer").expect("a page");
        let runs: Vec<_> = page.runs.iter().map(|line| line.run.as_str()).collect();
        let next = (expected[1] != "run_1").then_some(expected[1]);
        assert_eq!((runs, page.next.as_deref()), (expected.to_vec(), next), "{viewer:?}");
        assert!(reader.run(&viewer, "run_2").await.expect("an answer").is_some(), "its page: {viewer:?}");
    }
    let older = reader.older_runs(&Viewer::Anonymous, None, Some("run_2"), 2).await.expect("an answer");
    assert_eq!(older.expect("a page").runs.len(), 1, "lists continue after a cancelled run");
}

#[tokio::test]
async fn logs_open_with_replays_after_run() {
    let arena = Arena::new(&guarded()).await;
    arena.play("run_over", "walker", Order::Unordered, 1).await;
    open(&arena, "run_1", "practice", 40).await;
    let reader = arena.store.reader();
    for (viewer, run, access) in [
        (red(), "run_over", LogAccess::Now),
        (red(), "run_1", LogAccess::Later),
        (red(), "run_9", LogAccess::None),
        (Viewer::Anonymous, "run_over", LogAccess::None),
        (Viewer::Anonymous, "run_1", LogAccess::None),
    ] {
        let found = reader.log_access(&viewer, run).await.expect("an answer");
        assert_eq!(found, access, "{viewer:?}, {run}");
    }
}

#[tokio::test]
async fn comparison_needs_equal_missions_and_visible_replays() {
    let arena = Arena::new(&guarded()).await;
    arena.play("run_a", "walker", Order::Unordered, 2).await;
    arena.play("run_b", "runner", Order::Unordered, 1).await;
    arena.play("run_ordered", "walker", Order::Ordered, 2).await;
    arena.play_as("blue", "run_blue", "walker", Order::Unordered, 2).await;
    arena.store.upsert_phase(&phase("second", 1), 40).await.expect("another phase");
    open(&arena, "run_second", "second", 50).await;
    let (reader, red) = (arena.store.reader(), red());
    let compared =
        async |first: &str, second: &str| reader.compare(&red, [first, second]).await.expect("an answer");
    for (other, reason) in [
        ("run_ordered", Incomparable::Apart),
        ("run_second", Incomparable::Apart),
        ("run_blue", Incomparable::Hidden),
    ] {
        assert_eq!(compared("run_a", other).await, Some(Err(reason)), "{other}");
        assert_eq!(compared(other, "run_a").await, Some(Err(reason)), "{other}");
    }
    assert_eq!(compared("run_a", "run_9").await, None);
    let view = compared("run_a", "run_b").await.expect("both runs").expect("comparable runs");
    let pairs: Vec<_> = view
        .episodes
        .iter()
        .map(|pair| (pair.episode.as_str(), pair.second_ordinal, pair.first.found, pair.second.found))
        .collect();
    assert_eq!(pairs, [("canary-episode-0", 0, 2, 1), ("canary-episode-1", 1, 2, 1)]);
    let comparison = view.comparison.expect("two common episodes");
    let isr = comparison.differences.iter().find(|difference| difference.key == Key::Isr).expect("a key");
    assert_eq!((comparison.episodes, isr.first, isr.second, isr.estimate.value), (2, 1.0, 0.5, 0.5));
}

#[tokio::test]
async fn missions_are_counted_with_latest_reference_paths() {
    let arena = Arena::new(&phase("practice", 3)).await;
    let reader = arena.store.reader();
    let mut expected = MissionsView {
        goals: BTreeMap::from([(2, 3)]),
        modalities: BTreeMap::from([("category", 3), ("description", 3)]),
        categories: BTreeMap::from([(CATEGORY.to_owned(), 3)]),
        reference_m: vec![],
        scenes: BTreeMap::from([(SCENES[0].to_owned(), 2), (SCENES[1].to_owned(), 1)]),
    };
    let missions = async || reader.missions(&Viewer::Anonymous, "practice").await.expect("an answer");
    assert_eq!(missions().await.as_ref(), Some(&expected));
    arena.play("run_1", "walker", Order::Unordered, 1).await;
    // The fixture's reference tours are 1.1 m long.
    expected.reference_m = vec![1.1; 3];
    assert_eq!(missions().await.as_ref(), Some(&expected));
}

#[tokio::test]
async fn scene_map_needs_episode_in_phase() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let reader = arena.store.reader();
    let map =
        async |scene: &str| reader.scene_map(&Viewer::Anonymous, "practice", scene).await.expect("an answer");
    let polygons = vec![vec![[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [0.0, 0.0, 4.25]]];
    assert_eq!(map(SCENES[0]).await, Some(SceneMap { min: [0.0; 3], max: [4.0, 3.0, 4.0], polygons }));
    assert_eq!(map(SCENES[1]).await, None);
}

#[tokio::test]
async fn teams_read_own_quotas_of_visible_phases() {
    let quotas = QuotaLimits { total: Some(3), ..QuotaLimits::default() };
    let arena = Arena::new(&Phase { quotas, ..phase("practice", 1) }).await;
    let admission = Admission { allow: vec!["blue".to_owned()], ..Admission::default() };
    arena.store.upsert_phase(&Phase { admission, ..phase("second", 1) }, 2).await.expect("another phase");
    open(&arena, "run_1", "practice", 40).await;
    let reader = arena.store.reader();
    let listed = async |viewer: Viewer| {
        let quotas = reader.quotas(&viewer, 50).await.expect("a list").into_iter();
        quotas.map(|quota| (quota.phase, quota.limit, quota.used)).collect::<Vec<_>>()
    };
    let [practice, second] = ["practice", "second"].map(str::to_owned);
    let uncharged = (practice.clone(), Some(QuotaLimits::DEFAULT_UNCHARGED), 0);
    assert_eq!(listed(red()).await, [(practice.clone(), Some(3), 1), uncharged.clone()]);
    let blue = Viewer::Team("blue".to_owned());
    assert_eq!(listed(blue).await, [(practice, Some(3), 0), uncharged, (second, None, 0)]);
    assert!(listed(Viewer::Anonymous).await.is_empty() && listed(Viewer::Organiser).await.is_empty());
}

#[tokio::test]
async fn reason_is_shown_during_pause_only() {
    let paused = Some("new disks".to_owned());
    let schedule = Schedule { opens_unix_ms: Some(10), paused: paused.clone(), ..Schedule::default() };
    let arena = Arena::new(&Phase { schedule, ..phase("practice", 1) }).await;
    let reader = arena.store.reader();
    let shown = async |now: i64| {
        let view = reader.phase(&Viewer::Anonymous, "practice", now).await;
        let view = view.expect("an answer").expect("the phase");
        (view.state, view.state_reason)
    };
    assert_eq!(shown(9).await, (PhaseState::Upcoming, None));
    assert_eq!(shown(10).await, (PhaseState::Paused, paused));
}

#[tokio::test]
async fn closing_by_hand_differs_from_closing_date() {
    let dated = Schedule { closes_unix_ms: Some(10), ..Schedule::default() };
    let arena = Arena::new(&Phase { schedule: dated.clone(), ..phase("practice", 1) }).await;
    let by_hand = Schedule { closed: true, ..dated };
    arena.store.upsert_phase(&Phase { schedule: by_hand, ..phase("second", 1) }, 2).await.expect("a phase");
    let reader = arena.store.reader();
    let shown = async |id: &str, now: i64| {
        let view = reader.phase(&Viewer::Anonymous, id, now).await.expect("an answer").expect("the phase");
        (view.state, view.closed_by_hand)
    };
    assert_eq!(shown("practice", 9).await, (PhaseState::Open, false));
    assert_eq!(shown("practice", 10).await, (PhaseState::Closed, false));
    assert_eq!(shown("second", 9).await, (PhaseState::Closed, true));
}

#[tokio::test]
async fn census_counts_by_state_and_end() {
    let arena = Arena::new(&phase("practice", 2)).await;
    arena.play("run_over", "walker", Order::Unordered, 1).await;
    open(&arena, "run_1", "practice", 40).await;
    arena.assign("run_1", "h").await.expect("an episode");
    let census = arena.store.reader().census().await.expect("counts");
    let runs: Vec<_> = census.runs.iter().map(|(state, count)| (state.as_str(), *count)).collect();
    assert_eq!(runs, [("completed", 1), ("running", 1)]);
    let episodes: Vec<_> =
        census.episodes.iter().map(|(state, end, count)| (state.as_str(), end.as_deref(), *count)).collect();
    assert_eq!(episodes, [("pending", None, 1), ("running", None, 1), ("terminated", Some("stopped"), 2)]);
}

#[tokio::test]
async fn closed_database_fails_the_ping() {
    let arena = Arena::new(&phase("practice", 1)).await;
    let reader = arena.store.reader();
    reader.ping().await.expect("a readable database");
    arena.store.close().await;
    reader.ping().await.expect_err("no connection is left");
}
