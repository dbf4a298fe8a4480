//! Assignment of episodes, results, crashes, deadlines and downtime.

use crate::{Arena, EPISODE, Played, TEAM, new_run, phase};
use avln_challenge::{EpisodeState, RunState, Schedule};
use avln_episode::{EndReason, Order, TimeLimits};
use avln_scoring::score;
use avln_store::{AuditNote, DowntimeCredit, NewRun, Phase, Run, StoreError, Viewer};
use std::collections::BTreeMap;

const HOUR_MS: i64 = 3_600_000;

async fn started(episodes: usize) -> Arena {
    let arena = Arena::new(&phase("practice", episodes)).await;
    arena.store.start_run(&new_run(&BTreeMap::new()), 10).await.expect("a run");
    arena
}

#[tokio::test]
async fn episodes_are_assigned_once_in_order() {
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
async fn facts_round_trip_bit_for_bit() {
    let arena = started(1).await;
    let assigned = arena.assign("run_1", "h").await.expect("an episode");
    let played = Played::new(&assigned, Order::Unordered, 1, EndReason::StepLimit);
    arena.record("run_1", "h", &played).await.expect("a result");
    let facts = arena.store.facts("run_1", 0).await.expect("an answer").expect("facts");
    assert_eq!((&facts.truth, &facts.record), (&played.truth, &played.record));
    assert_eq!(score(&facts.truth, &facts.record, &avln_episode::Rules::paper()), played.metrics);
}

#[tokio::test]
async fn last_result_completes_run() {
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
async fn result_without_running_episode_is_rejected() {
    let arena = started(1).await;
    let assigned = arena.assign("run_1", "h").await.expect("an episode");
    let played = Played::new(&assigned, Order::Unordered, 1, EndReason::Stopped);
    assert!(matches!(arena.record("run_1", "other", &played).await, Err(StoreError::Unknown { .. })));
    assert!(matches!(arena.record("run_2", "h", &played).await, Err(StoreError::Unknown { .. })));
}

#[tokio::test]
async fn interrupted_episodes_reopen_after_crash() {
    let arena = started(2).await;
    let first = arena.assign("run_1", "h0").await.expect("an episode");
    let played = Played::new(&first, Order::Unordered, 1, EndReason::Stopped);
    arena.record("run_1", "h0", &played).await.expect("a result");
    arena.assign("run_1", "h1").await.expect("an episode");
    let arena = arena.after_crash().await;
    let running = arena.store.running_episodes().await.expect("a list");
    assert_eq!(running.iter().map(|lost| lost.handle.as_str()).collect::<Vec<_>>(), ["h1"]);
    let status = |handle| arena.store.episode_status("run_1", handle);
    let ended = status("h0").await.expect("an answer").expect("it was handed out");
    assert_eq!((ended.state, ended.end), (EpisodeState::Terminated, Some(EndReason::Stopped)));
    assert_eq!(ended.metrics.expect("scored").found, 1);
    assert_eq!(status("h1").await.expect("an answer").expect("it too").end, None);
    assert_eq!(status("h7").await.expect("an answer"), None);
    assert!(arena.store.reopen_episode("run_1", "h1", 40).await.expect("an answer"));
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
async fn server_faults_are_retried_twice() {
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
async fn crashing_episode_is_abandoned() {
    let mut arena = started(1).await;
    for attempt in 0..3 {
        arena.assign("run_1", &format!("h{attempt}")).await.expect("an attempt");
        arena = arena.after_crash().await;
        assert!(arena.store.reopen_episode("run_1", &format!("h{attempt}"), 40).await.expect("an answer"));
    }
    assert_eq!(arena.assign("run_1", "h3").await, None);
    assert_eq!(arena.store.run("run_1").await.expect("the run").state, RunState::Completed);
}

#[tokio::test]
async fn failing_starts_are_abandoned() {
    let arena = started(1).await;
    for attempt in 1..=3 {
        let handle = format!("h{attempt}");
        arena.assign("run_1", &handle).await.expect("an attempt");
        arena.store.reopen_episode("run_1", "other", 40).await.expect("no such episode");
        assert_eq!(arena.store.run("run_1").await.expect("the run").state, RunState::Running);
        arena.store.reopen_episode("run_1", &handle, 40).await.expect("reopened");
    }
    assert_eq!(arena.assign("run_1", "h4").await, None);
    assert_eq!(arena.store.run("run_1").await.expect("the run").state, RunState::Completed);
}

#[tokio::test]
async fn returned_episodes_count_no_fault() {
    let arena = started(1).await;
    for attempt in 0..5 {
        let handle = format!("h{attempt}");
        arena.assign("run_1", &handle).await.expect("the episode is pending again");
        assert!(!arena.store.return_episode("run_1", "other").await.expect("an answer"));
        assert!(arena.store.return_episode("run_1", &handle).await.expect("an answer"));
    }
    for attempt in 5..8 {
        let handle = format!("h{attempt}");
        let assigned = arena.assign("run_1", &handle).await.expect("only faults are counted");
        let fault = Played::new(&assigned, Order::Unordered, 2, EndReason::ServerFault);
        let run = arena.record("run_1", &handle, &fault).await.expect("an answer").run;
        assert_eq!(run.state == RunState::Completed, attempt == 7);
    }
}

#[tokio::test]
async fn parallel_results_add_up() {
    let arena = started(8).await;
    let mut seats = Vec::new();
    for index in 0..8 {
        seats.push(arena.assign("run_1", &format!("h{index}")).await.expect("an episode"));
    }
    let results = seats.into_iter().enumerate().map(|(index, seat)| {
        let (store, found) = (arena.store.clone(), (index % 3) as u8);
        tokio::spawn(async move {
            let played = Played::new(&seat, Order::Unordered, found, EndReason::Stopped);
            store.record_result(&played.result("run_1", &seat.handle), 30).await.expect("a result").is_new
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

fn timed(run_s: u32, closes_unix_ms: Option<i64>) -> Phase {
    let time = TimeLimits { run_s, ..TimeLimits::default() };
    let schedule = Schedule { closes_unix_ms, ..Schedule::default() };
    Phase { time, schedule, ..phase("practice", 2) }
}

async fn started_in(phase: &Phase, now: i64) -> (Arena, Run) {
    let arena = Arena::new(phase).await;
    let digests = BTreeMap::new();
    let new = NewRun { id: "run_1", token: "run_1", ..new_run(&digests) };
    let run = arena.store.start_run(&new, now).await.expect("a run").run;
    (arena, run)
}

async fn deadline(arena: &Arena) -> Option<i64> {
    arena.store.run("run_1").await.expect("the run").deadline_unix_ms
}

#[tokio::test]
async fn wall_time_outlasts_closing_phase() {
    let (arena, run) = started_in(&timed(3600, Some(50)), 10).await;
    assert_eq!(run.deadline_unix_ms, Some(10 + HOUR_MS), "a started run keeps its wall time");
    assert_eq!(arena.store.overdue(9 + HOUR_MS).await.expect("a list"), Vec::<String>::new());
    assert_eq!(arena.store.overdue(10 + HOUR_MS).await.expect("a list"), ["run_1"]);
    let late = arena.store.assign_next_episode("run_1", "h", 10 + HOUR_MS).await;
    assert!(matches!(late, Err(StoreError::RunOver { state: "expired", .. })), "{late:?}");
    let ended = arena.store.end_run("run_1", RunState::Expired, 11 + HOUR_MS).await.expect("the run");
    assert_eq!(ended.state, RunState::Expired);
    assert_eq!(arena.store.overdue(i64::MAX).await.expect("a list"), Vec::<String>::new());
}

#[tokio::test]
async fn run_without_wall_time_ends_with_phase() {
    let (arena, run) = started_in(&timed(0, Some(HOUR_MS)), 10).await;
    assert_eq!(run.deadline_unix_ms, Some(HOUR_MS));
    arena.store.upsert_phase(&timed(0, Some(2 * HOUR_MS)), 20).await.expect("a later date");
    assert_eq!(deadline(&arena).await, Some(2 * HOUR_MS), "it follows the date");
    arena.store.upsert_phase(&timed(0, None), 20).await.expect("no date");
    assert_eq!(deadline(&arena).await, None);
    let schedule = Schedule { closed: true, ..Schedule::default() };
    arena.store.upsert_phase(&Phase { schedule, ..timed(0, None) }, 20).await.expect("closed by hand");
    assert_eq!(arena.store.overdue(20).await.expect("a list"), ["run_1"]);
}

#[tokio::test]
async fn secret_is_kept_until_runs_end() {
    let (arena, _) = started_in(&timed(3600, Some(50)), 10).await;
    arena.store.commit_phase("practice", &"0f".repeat(32), "1.0.0", 20).await.expect("a promise");
    let early = arena.store.reveal_phase("practice", None, AuditNote::default(), 60).await;
    assert!(matches!(early, Err(StoreError::StillPlayed { until_unix_ms: 3_600_010, .. })), "{early:?}");
    arena
        .store
        .reveal_phase("practice", None, AuditNote::default(), 10 + HOUR_MS)
        .await
        .expect("its time is over");
}

#[tokio::test]
async fn crash_downtime_extends_runs_only() {
    let (arena, _) = started_in(&timed(3600, Some(2 * HOUR_MS)), 10).await;
    assert_eq!(arena.store.credit_downtime(20).await.expect("a first start"), DowntimeCredit::default());
    arena.store.record_heartbeat(5_000).await.expect("alive");
    let credit = arena.store.credit_downtime(5_000 + HOUR_MS).await.expect("a second start");
    assert_eq!(credit, DowntimeCredit { away_ms: HOUR_MS, runs: 1, phases: vec![] });
    assert_eq!(deadline(&arena).await, Some(10 + 2 * HOUR_MS));
    let audit = arena.store.audit().await.expect("the audit list");
    let line = audit.last().expect("a line");
    assert_eq!((line.subject.as_str(), line.what.as_str()), ("runs", "deadline"));
    assert_eq!(line.after.as_deref(), Some("+3600 s for 1 open runs"));
}

#[tokio::test]
async fn maintenance_extends_runs_and_phases() {
    let (arena, _) = started_in(&timed(3600, Some(HOUR_MS)), 10).await;
    arena.store.credit_downtime(20).await.expect("a first start");
    arena.store.record_drain("new disks", 1_000_000).await.expect("a note");
    arena.store.record_drain("again", 1_100_000).await.expect("no second one");
    arena.store.record_heartbeat(1_500_000).await.expect("alive while it drains");
    let back = 1_000_000 + 2 * HOUR_MS;
    let credit = arena.store.credit_downtime(back).await.expect("the next start");
    assert_eq!(credit, DowntimeCredit { away_ms: 2 * HOUR_MS, runs: 1, phases: vec!["practice".to_owned()] });
    assert_eq!(deadline(&arena).await, Some(10 + 3 * HOUR_MS), "it counts from the announcement");
    let closes = arena.store.phase("practice").await.expect("the phase").schedule.closes_unix_ms;
    assert_eq!(closes, Some(3 * HOUR_MS), "although the date passed during the maintenance");
    let audit = arena.store.audit().await.expect("the audit list");
    let listed: Vec<_> = audit.iter().map(|line| (line.subject.as_str(), line.reason.as_str())).collect();
    assert_eq!(listed, [("server", "new disks"), ("runs", "new disks"), ("phase practice", "new disks")]);
    assert_eq!(audit[2].before.as_deref(), Some("1970-01-01T01:00:00Z"));
    assert_eq!(
        arena.store.credit_downtime(back + 500).await.expect("a restart").runs,
        0,
        "a maintenance counts once"
    );
}

#[tokio::test]
async fn clock_change_is_no_downtime() {
    let (arena, _) = started_in(&timed(3600, Some(100 * HOUR_MS)), 10).await;
    arena.store.credit_downtime(20).await.expect("a first start");
    arena.store.record_drain("new disks", 1_000_000).await.expect("a note");
    let set_ms = 72 * HOUR_MS;
    arena.store.follow_clock(set_ms, 1_001_000 + set_ms).await.expect("an answer");
    let credit = arena.store.credit_downtime(1_005_000 + set_ms).await.expect("the next start");
    assert_eq!(credit, DowntimeCredit { away_ms: 5_000, runs: 1, phases: vec!["practice".to_owned()] });
    assert_eq!(deadline(&arena).await, Some(10 + HOUR_MS + set_ms + 5_000));
}

#[tokio::test]
async fn clock_change_keeps_remaining_time() {
    let (arena, _) = started_in(&timed(3600, None), 10).await;
    assert_eq!(arena.store.follow_clock(-5_000, 20).await.expect("an answer"), 1);
    assert_eq!(deadline(&arena).await, Some(10 + HOUR_MS - 5_000));
    let credit =
        arena.store.credit_downtime(20).await.and(arena.store.credit_downtime(10).await).expect("a start");
    assert_eq!(credit, DowntimeCredit::default(), "no credit for a clock before the last heartbeat");
    assert_eq!(arena.store.runs_of(TEAM).await.expect("runs").len(), 1);
}
