use crate::fixture::{Arena, phase};
use avln_episode::Order;
use avln_store::{AuditNote, Pruned, Viewer};

#[tokio::test]
async fn old_records_go_and_results_stay() {
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
    assert_eq!(arena.store.newest_change().await.unwrap(), 0, "nothing was done, nothing is noted");

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
async fn what_is_open_is_not_old() {
    let arena = Arena::new(&phase("practice", 2)).await;
    let digests = Default::default();
    arena.store.start_run(&crate::fixture::new_run(&digests), 1).await.unwrap();
    assert_eq!(arena.store.runs_ended_before(i64::MAX).await.unwrap(), Vec::<String>::new());
}
