use crate::fixture::{Arena, phase};
use avln_episode::Order;
use avln_store::{Store, StoreError, Viewer, copy_database, inspect_database};
use std::fs;

#[tokio::test]
async fn a_copy_is_made_while_somebody_writes_and_holds_one_moment() {
    let arena = Arena::new(&phase("practice", 3)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    arena.assign("run_1", "unused").await.ok_or(()).unwrap_err();
    let digests = Default::default();
    let new =
        avln_store::NewRun { id: "run_2", token: "t", method: "slow", ..crate::fixture::new_run(&digests) };
    arena.store.start_run(&new, 40).await.unwrap();
    arena.assign("run_2", "ep_first").await.expect("an episode");
    let to = arena.folder.path().join("copy.db");
    copy_database(&arena.path(), &to).await.unwrap();
    arena.assign("run_2", "ep_later").await.expect("an episode");

    let inventory = inspect_database(&to).await.unwrap();
    assert_eq!((inventory.schema, inventory.teams, inventory.results), (avln_store::SCHEMA_VERSION, 2, 3));
    assert_eq!(inventory.splits, ["val"]);
    let settled: Vec<_> = inventory.runs.iter().map(|run| (run.id.as_str(), run.is_settled)).collect();
    assert_eq!(settled, [("run_1", true), ("run_2", false)]);
    assert_eq!(inventory.runs[1].attempts, [(0, 1), (1, 0), (2, 0)].into());
    let copy = Store::open(&to).await.unwrap();
    let run = async |store: &Store| store.reader().run(&Viewer::Organiser, "run_1").await.unwrap();
    assert_eq!(run(&copy).await, run(&arena.store).await);
    let refused = copy_database(&arena.path(), &to).await.unwrap_err();
    assert!(matches!(refused, StoreError::CannotOpen { .. } | StoreError::Database(_)), "{refused}");
}

#[tokio::test]
async fn a_damaged_copy_and_a_foreign_file_are_found() {
    let arena = Arena::new(&phase("practice", 40)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let to = arena.folder.path().join("copy.db");
    copy_database(&arena.path(), &to).await.unwrap();
    let mut bytes = fs::read(&to).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 4096].fill(0xA5);
    fs::write(&to, bytes).unwrap();
    inspect_database(&to).await.expect_err("pages are damaged");
    fs::write(&to, "a letter, and no database at all").unwrap();
    let refused = inspect_database(&to).await.unwrap_err();
    assert!(matches!(refused, StoreError::NotOurs { .. }), "{refused}");
}
