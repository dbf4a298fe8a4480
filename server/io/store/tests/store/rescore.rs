use crate::fixture::{Arena, phase};
use avln_episode::Order;
use avln_scoring::Metrics;
use avln_store::{StoreError, Viewer};
use std::collections::BTreeMap;

/// What another scorer says of the run: shares of goals found are halved.
async fn halved(arena: &Arena, run: &str) -> BTreeMap<u32, Metrics> {
    let episodes = arena.store.scored_episodes(run).await.unwrap();
    assert!(episodes.iter().all(|episode| episode.facts.is_some()));
    let halve = |metrics: Metrics| Metrics { isr: metrics.isr / 2.0, ..metrics };
    episodes.into_iter().map(|episode| (episode.ordinal, halve(episode.metrics))).collect()
}

#[tokio::test]
async fn both_scores_are_kept_and_the_first_is_never_changed() {
    let arena = Arena::new(&phase("practice", 4)).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let reader = arena.store.reader();
    let before = reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    let again = halved(&arena, "run_1").await;
    let looked = arena.store.rescore("run_1", "9.0.0", &again, false, 50).await.unwrap();
    assert!(!looked.is_new);
    assert_eq!(reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap(), before, "nothing was kept");

    let kept = arena.store.rescore("run_1", "9.0.0", &again, true, 50).await.unwrap();
    let isr = |summary: &Option<avln_scoring::Summary>| summary.as_ref().unwrap().isr.value;
    assert_eq!((isr(&kept.before), isr(&kept.after), kept.is_new), (1.0, 0.5, true));
    let after = reader.run(&Viewer::Anonymous, "run_1").await.unwrap().unwrap();
    assert_eq!((&after.summary, &after.episodes), (&before.summary, &before.episodes));
    let told: Vec<_> =
        after.rescores.iter().map(|rescore| (rescore.scorer.as_str(), isr(&rescore.summary))).collect();
    assert_eq!(told, [("9.0.0", 0.5)]);

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
    assert!(refused.to_string().contains("4 episodes count, 0"), "{refused}");
}

#[tokio::test]
async fn other_scores_are_hidden_where_scores_are() {
    let mut hidden = phase("practice", 2);
    hidden.scores = avln_store::Visibility::Organiser;
    let arena = Arena::new(&hidden).await;
    arena.play("run_1", "walker", Order::Unordered, 2).await;
    let again = halved(&arena, "run_1").await;
    arena.store.rescore("run_1", "9.0.0", &again, true, 50).await.unwrap();
    for (viewer, count) in [(Viewer::Team("red".to_owned()), 0), (Viewer::Organiser, 1)] {
        let view = arena.store.reader().run(&viewer, "run_1").await.unwrap().unwrap();
        assert_eq!(view.rescores.len(), count, "{viewer:?}");
    }
}
