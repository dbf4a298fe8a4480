use super::*;
use crate::{NewRun, Phase, Scene, SceneMap, Split};
use avln_challenge::{GoalText, PhaseEpisode};
use avln_episode::{Modality, Order, Rules};
use std::{collections::BTreeMap, time::Duration};

const PLACE: &str = "hall";

async fn store_with_a_running_episode(folder: &std::path::Path) -> Result<Store, StoreError> {
    let store = Store::open_waiting(&folder.join("arena.db"), Duration::from_millis(1)).await?;
    let split = Split { name: "val".to_owned(), digest: "d".to_owned(), scenes: 1, episodes: 1 };
    store.upsert_split(&split).await?;
    store
        .upsert_scene(&Scene { name: PLACE.to_owned(), digest: "d".to_owned(), map: SceneMap::default() })
        .await?;
    store.create_team("red", None, 1).await?;
    store.upsert_phase(&phase(), 1).await?;
    let new = NewRun {
        id: "run_1",
        token: "t",
        phase: "p",
        team: "red",
        method: "m",
        version: "1",
        order: Order::Ordered,
        client_request_id: None,
        digests: &BTreeMap::new(),
    };
    store.start_run(&new, 1).await?;
    store.assign_next_episode("run_1", "h", 2).await?;
    Ok(store)
}

fn phase() -> Phase {
    let goals = vec![GoalText { modality: Modality::Image, text: None }];
    let episodes = vec![PhaseEpisode { episode: "e".to_owned(), scene: PLACE.to_owned(), goals }];
    Phase::new("p", "val", Rules::paper(), episodes)
}

fn result() -> (EpisodeTruth, Record, Metrics) {
    let pose = serde_json::json!({ "position": [0.0, 0.0, 0.0], "heading_rad": 0.0 });
    let truth = serde_json::json!({
        "episode": "e", "scene": PLACE, "seed": 1, "start": pose, "order": "ordered", "targets": [],
        "reference_m": 1.0, "reference_path": [],
    });
    let record = serde_json::json!({
        "rules": "lh-avln-v1", "start": pose, "steps": [], "submits": [], "in_region_at_start": [],
        "final_distance_m": [], "end": "stopped",
    });
    let truth: EpisodeTruth = serde_json::from_value(truth).expect("a truth");
    let record: Record = serde_json::from_value(record).expect("a record");
    let metrics = avln_scoring::score(&truth, &record, &Rules::paper());
    (truth, record, metrics)
}

async fn count_rows(store: &Store) -> (i64, i64, i64, String) {
    let select = "SELECT (SELECT COUNT(*) FROM records), (SELECT COUNT(*) FROM truths), \
                  (SELECT SUM(scored) FROM run_summaries), (SELECT state FROM episodes)";
    sqlx::query_as(select).fetch_one(&store.read).await.expect("counts")
}

#[tokio::test]
async fn a_result_that_is_not_committed_leaves_no_trace() {
    let folder = tempfile::tempdir().expect("a folder");
    let store = store_with_a_running_episode(folder.path()).await.expect("a store");
    let (truth, record, metrics) = result();
    let time = TimeAccount::default();
    let finished = Finished {
        run: "run_1",
        handle: "h",
        truth: &truth,
        record: &record,
        metrics: &metrics,
        time: &time,
    };
    let mut tx = store.begin().await.expect("a transaction");
    assert_eq!(write_result(&mut tx, &finished, 3).await.expect("all written"), (true, true));
    drop(tx);
    assert_eq!(count_rows(&store).await, (0, 0, 0, "running".to_owned()));
    assert!(store.record_result(&finished, 4).await.expect("a second try").is_new);
    assert_eq!(count_rows(&store).await, (1, 1, 1, "terminated".to_owned()));
}

#[tokio::test]
async fn a_database_that_another_program_holds_is_said_to_be_busy() {
    let folder = tempfile::tempdir().expect("a folder");
    let store = store_with_a_running_episode(folder.path()).await.expect("a store");
    let other = Store::open_waiting(&folder.path().join("arena.db"), Duration::from_millis(1)).await;
    let other = other.expect("a second program");
    let held = other.begin().await.expect("the right to write");
    let refused = store.create_team("blue", None, 5).await;
    assert!(matches!(refused, Err(StoreError::Busy)), "{refused:?}");
    drop(held);
    other.close().await;
    store.create_team("blue", None, 6).await.expect("the right to write");
}
