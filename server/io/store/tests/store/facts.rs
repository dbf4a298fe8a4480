//! Rescoring, pruning and copies of a database.

use crate::fixture::{Arena, new_run, phase};
use avln_challenge::{MethodInfo, Visibility};
use avln_episode::Order;
use avln_scoring::Metrics;
use avln_store::{
    AuditNote, NewRun, Pruned, SCHEMA_VERSION, Store, StoreError, Viewer, copy_database, inspect_database,
};
use std::{collections::BTreeMap, fs};

/// Returns the metrics of another scorer, with halved ISR.
async fn halved(arena: &Arena, run: &str) -> BTreeMap<u32, Metrics> {
    let episodes = arena.store.scored_episodes(run).await.unwrap();
    assert!(episodes.iter().all(|episode| episode.facts.is_some()));
    let halve = |metrics: Metrics| Metrics { isr: metrics.isr / 2.0, ..metrics };
    episodes.into_iter().map(|episode| (episode.ordinal, halve(episode.metrics))).collect()
}

#[tokio::test]
async fn rescoring_keeps_first_scores() {
    let arena = Arena::new(&phase("practice", 4)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let reader = arena.store.reader();
    let before = reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    let again = halved(&arena, "run_1").await;
    let compared = arena.store.rescore("run_1", "9.0.0", &again, false, 50).await.unwrap();
    assert!(!compared.is_new);
    assert_eq!(reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap(), before, "not stored");

    let kept = arena.store.rescore("run_1", "9.0.0", &again, true, 50).await.unwrap();
    let isr = |summary: &Option<avln_scoring::Summary>| summary.as_ref().unwrap().isr.value;
    assert_eq!((isr(&kept.before), isr(&kept.after), kept.is_new), (1.0, 0.5, true));
    let after = reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    assert_eq!((&after.summary, &after.episodes), (&before.summary, &before.episodes));
    let listed: Vec<_> =
        after.rescores.iter().map(|rescore| (rescore.scorer.as_str(), isr(&rescore.summary))).collect();
    assert_eq!(listed, [("9.0.0", 0.5)]);

    assert!(!arena.store.rescore("run_1", "9.0.0", &again, true, 60).await.unwrap().is_new);
    let first: BTreeMap<_, _> = arena
        .store
        .scored_episodes("run_1")
        .await
        .unwrap()
        .into_iter()
        .map(|e| (e.ordinal, e.metrics))
        .collect();
    let refused = arena.store.rescore("run_1", "9.0.0", &first, true, 70).await.unwrap_err();
    assert!(matches!(refused, StoreError::ScoresDiffer { .. }), "{refused}");
    let refused = arena.store.rescore("run_1", "9.0.1", &BTreeMap::new(), true, 70).await.unwrap_err();
    assert!(refused.to_string().contains("4 episodes are scored, 0"), "{refused}");
}

#[tokio::test]
async fn rescores_are_as_visible_as_scores() {
    let mut hidden = phase("practice", 2);
    hidden.scores = Visibility::Organiser;
    let arena = Arena::new(&hidden).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let again = halved(&arena, "run_1").await;
    arena.store.rescore("run_1", "9.0.0", &again, true, 50).await.unwrap();
    for (viewer, count) in [(Viewer::Team("red".to_owned()), 0), (Viewer::Organiser, 1)] {
        let view = arena.store.reader().run(&viewer, "run_1").await.unwrap().unwrap();
        assert_eq!(view.rescores.len(), count, "{viewer:?}");
    }
}

#[tokio::test]
async fn pruning_deletes_records_and_keeps_results() {
    let arena = Arena::new(&phase("practice", 4)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let reader = arena.store.reader();
    let view = async || reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    let replay = async || reader.episode(&Viewer::Anonymous, "run_1", 0).await.unwrap().unwrap().replay;
    let before = view().await;
    assert!(replay().await.is_some());
    // Results of the fixture are stored at 30.
    assert_eq!(arena.store.runs_ended_before(30).await.unwrap(), Vec::<String>::new());
    assert_eq!(arena.store.prune_records(30, AuditNote::default(), 50).await.unwrap(), Pruned::default());
    assert_eq!(arena.store.newest_audit_id().await.unwrap(), 0, "no deletion, no audit line");

    assert_eq!(arena.store.runs_ended_before(31).await.unwrap(), ["run_1"]);
    assert_eq!(arena.store.old_records(31).await.unwrap(), 4);
    let note = AuditNote { what: "pruned".to_owned(), ..AuditNote::default() };
    let pruned = arena.store.prune_records(31, note, 50).await.unwrap();
    assert_eq!(pruned, Pruned { records: 4, truths: 4 });
    assert_eq!(view().await, before);
    assert_eq!(replay().await, None);
    assert_eq!(arena.store.audit().await.unwrap().len(), 1);
    let left = arena.store.scored_episodes("run_1").await.unwrap();
    assert!(left.len() == 4 && left.iter().all(|episode| episode.facts.is_none()));
}

#[tokio::test]
async fn open_runs_are_never_pruned() {
    let arena = Arena::new(&phase("practice", 2)).await;
    let digests = Default::default();
    arena.store.start_run(&new_run(&digests), 1).await.unwrap();
    assert_eq!(arena.store.runs_ended_before(i64::MAX).await.unwrap(), Vec::<String>::new());
}

#[tokio::test]
async fn copy_during_writes_is_consistent() {
    let arena = Arena::new(&phase("practice", 3)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    arena.assign("run_1", "unused").await.ok_or(()).unwrap_err();
    let digests = Default::default();
    let method = MethodInfo::new("slow", "1");
    let new = NewRun { id: "run_2", token: "t", method: &method, ..new_run(&digests) };
    arena.store.start_run(&new, 40).await.unwrap();
    arena.assign("run_2", "ep_first").await.expect("an episode");
    let to = arena.folder.path().join("copy.db");
    copy_database(&arena.path(), &to).await.unwrap();
    arena.assign("run_2", "ep_later").await.expect("an episode");

    let inventory = inspect_database(&to).await.unwrap();
    assert_eq!((inventory.schema, inventory.teams, inventory.results), (SCHEMA_VERSION, 2, 3));
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
async fn inspection_finds_damage_and_foreign_files() {
    let arena = Arena::new(&phase("practice", 40)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let to = arena.folder.path().join("copy.db");
    copy_database(&arena.path(), &to).await.unwrap();
    let mut bytes = fs::read(&to).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle..middle + 4096].fill(0xA5);
    fs::write(&to, bytes).unwrap();
    inspect_database(&to).await.expect_err("pages are damaged");
    fs::write(&to, "plain text instead of a database").unwrap();
    let refused = inspect_database(&to).await.unwrap_err();
    assert!(matches!(refused, StoreError::NotOurs { .. }), "{refused}");
}
