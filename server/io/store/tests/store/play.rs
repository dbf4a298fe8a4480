//! Handing out episodes, recording results, crashes.

use crate::fixture::{Arena, EPISODE, Played, new_run, phase};
use avln_episode::{EndReason, Order};
use avln_scoring::score;
use avln_store::{EpisodeState, RunState, StoreError, Viewer};
use std::collections::BTreeMap;

async fn started(episodes: usize) -> Arena {
    let arena = Arena::new(&phase("practice", episodes)).await;
    arena.store.start_run(&new_run(&BTreeMap::new()), 10).await.expect("a run");
    arena
}

#[tokio::test]
async fn episodes_are_handed_out_once_each_in_order() {
    let arena = started(3).await;
    for index in 0..3 {
        let next = arena.store.next_pending("run_1").await.expect("an answer");
        assert_eq!(next, Some(format!("{EPISODE}-{index}")));
        let assigned = arena.assign("run_1", &format!("h{index}")).await.expect("an episode");
        assert_eq!((assigned.ordinal, assigned.episode), (index, format!("{EPISODE}-{index}")));
    }
    assert_eq!(arena.assign("run_1", "h3").await, None);
    assert_eq!(arena.store.next_pending("run_1").await.expect("an answer"), None);
}

#[tokio::test]
async fn facts_come_back_bit_for_bit_and_score_the_same() {
    let arena = started(1).await;
    let assigned = arena.assign("run_1", "h").await.expect("an episode");
    let played = Played::new(&assigned, Order::Unordered, 1, EndReason::StepLimit);
    arena.record("run_1", "h", &played).await.expect("a result");
    let facts = arena.store.facts("run_1", 0).await.expect("an answer").expect("facts");
    assert_eq!((&facts.truth, &facts.record), (&played.truth, &played.record));
    assert_eq!(score(&facts.truth, &facts.record, &avln_episode::Rules::paper()), played.metrics);
}

#[tokio::test]
async fn the_last_result_completes_the_run_and_a_second_one_changes_nothing() {
    let arena = started(2).await;
    let mut recorded = None;
    for handle in ["h0", "h1"] {
        let assigned = arena.assign("run_1", handle).await.expect("an episode");
        assert_eq!(arena.store.finish_run("run_1", 25).await.expect("the run").state, RunState::Running);
        let played = Played::new(&assigned, Order::Unordered, 2, EndReason::FinalSubmit);
        recorded = Some(arena.record("run_1", handle, &played).await.expect("a result"));
        let worse = Played::new(&assigned, Order::Unordered, 0, EndReason::Abandoned);
        assert!(!arena.record("run_1", handle, &worse).await.expect("an answer").is_new);
    }
    let run = recorded.expect("two results").run;
    assert_eq!((run.state, run.done, run.finished_unix_ms), (RunState::Completed, 2, Some(30)));
    let view =
        arena.store.reader().run(&Viewer::Anonymous, "run_1").await.expect("an answer").expect("the run");
    let summary = view.summary.expect("two scores");
    assert_eq!((summary.episodes, summary.sr.value, summary.isr_by_goal), (2, 1.0, 1.0));
    assert_eq!((view.line.isr, view.eligible, view.time.thinking_s), (Some(1.0), true, 3.0));
    assert_eq!(view.health, BTreeMap::from([("final_submit", 2)]));
    let goals: Vec<_> = view.modalities.iter().map(|m| (m.goals, m.found, m.isr)).collect();
    assert_eq!(goals, [(2, 2, Some(1.0)), (2, 2, Some(1.0)), (0, 0, None)]);
}

#[tokio::test]
async fn a_result_for_an_episode_that_nobody_plays_is_refused() {
    let arena = started(1).await;
    let assigned = arena.assign("run_1", "h").await.expect("an episode");
    let played = Played::new(&assigned, Order::Unordered, 1, EndReason::Stopped);
    assert!(matches!(arena.record("run_1", "other", &played).await, Err(StoreError::Unknown { .. })));
    assert!(matches!(arena.record("run_2", "h", &played).await, Err(StoreError::Unknown { .. })));
}

#[tokio::test]
async fn what_was_played_when_the_server_died_is_played_again_and_results_stay() {
    let arena = started(2).await;
    let first = arena.assign("run_1", "h0").await.expect("an episode");
    let played = Played::new(&first, Order::Unordered, 1, EndReason::Stopped);
    arena.record("run_1", "h0", &played).await.expect("a result");
    arena.assign("run_1", "h1").await.expect("an episode");
    let arena = arena.after_crash().await;
    let underway = arena.store.underway().await.expect("a list");
    assert_eq!(underway.iter().map(|lost| lost.handle.as_str()).collect::<Vec<_>>(), ["h1"]);
    let standing = |handle| arena.store.handed_out("run_1", handle);
    let ended = standing("h0").await.expect("an answer").expect("it was handed out");
    assert_eq!((ended.state, ended.end), (EpisodeState::Terminated, Some(EndReason::Stopped)));
    assert_eq!(ended.metrics.expect("scored").found, 1);
    assert_eq!(standing("h1").await.expect("an answer").expect("it too").end, None);
    assert_eq!(standing("h7").await.expect("an answer"), None);
    assert!(arena.store.take_back("run_1", "h1", 40).await.expect("an answer"));
    let open = arena.store.open_runs().await.expect("a list");
    assert_eq!((open.len(), open[0].done), (1, 1));
    let stale = arena.record("run_1", "h1", &played).await;
    assert!(matches!(stale, Err(StoreError::Unknown { .. })), "the old attempt is gone");
    let again = arena.assign("run_1", "h2").await.expect("the same episode");
    assert_eq!(again.ordinal, 1);
    let done = arena.record("run_1", "h2", &played).await.expect("a result").run;
    assert_eq!((done.state, done.done), (RunState::Completed, 2));
}

#[tokio::test]
async fn the_servers_fault_does_not_count_and_is_tried_three_times() {
    let arena = started(1).await;
    for attempt in 1..=3 {
        let handle = format!("h{attempt}");
        let assigned = arena.assign("run_1", &handle).await.expect("another attempt");
        let fault = Played::new(&assigned, Order::Unordered, 2, EndReason::ServerFault);
        let recorded = arena.record("run_1", &handle, &fault).await.expect("an answer");
        assert!(recorded.is_new && !recorded.counts);
        assert_eq!(recorded.run.state == RunState::Completed, attempt == 3);
    }
    let view =
        arena.store.reader().run(&Viewer::Organiser, "run_1").await.expect("an answer").expect("the run");
    assert_eq!((view.eligible, view.summary, view.server_faults), (false, None, 3));
    assert_eq!(view.episodes[0].state, EpisodeState::Infra);
}

#[tokio::test]
async fn an_episode_that_takes_the_server_down_is_given_up() {
    let mut arena = started(1).await;
    for attempt in 0..3 {
        arena.assign("run_1", &format!("h{attempt}")).await.expect("an attempt");
        arena = arena.after_crash().await;
        assert!(arena.store.take_back("run_1", &format!("h{attempt}"), 40).await.expect("an answer"));
    }
    assert_eq!(arena.assign("run_1", "h3").await, None);
    assert_eq!(arena.store.run("run_1").await.expect("the run").state, RunState::Completed);
}

#[tokio::test]
async fn an_episode_that_cannot_be_started_is_taken_back_and_given_up_in_the_end() {
    let arena = started(1).await;
    for attempt in 1..=3 {
        let handle = format!("h{attempt}");
        arena.assign("run_1", &handle).await.expect("an attempt");
        arena.store.take_back("run_1", "other", 40).await.expect("nobody's episode");
        assert_eq!(arena.store.run("run_1").await.expect("the run").state, RunState::Running);
        arena.store.take_back("run_1", &handle, 40).await.expect("taken back");
    }
    assert_eq!(arena.assign("run_1", "h4").await, None);
    assert_eq!(arena.store.run("run_1").await.expect("the run").state, RunState::Completed);
}

#[tokio::test]
async fn results_of_many_slots_at_once_add_up() {
    let arena = started(8).await;
    let mut seats = Vec::new();
    for index in 0..8 {
        seats.push(arena.assign("run_1", &format!("h{index}")).await.expect("an episode"));
    }
    let results = seats.into_iter().enumerate().map(|(index, seat)| {
        let (store, found) = (arena.store.clone(), (index % 3) as u8);
        tokio::spawn(async move {
            let played = Played::new(&seat, Order::Unordered, found, EndReason::Stopped);
            store.record_result(&played.finished("run_1", &seat.handle), 30).await.expect("a result").is_new
        })
    });
    for result in results.collect::<Vec<_>>() {
        assert!(result.await.expect("no panic"));
    }
    let view =
        arena.store.reader().run(&Viewer::Anonymous, "run_1").await.expect("an answer").expect("the run");
    // Found goals by episode: 0 1 2 0 1 2 0 1 of 2 each.
    assert_eq!(view.line.isr, Some(3.5 / 8.0));
    assert_eq!(view.summary.expect("scores").isr_by_goal, 7.0 / 16.0);
}
