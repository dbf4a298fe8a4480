//! When runs end at the latest, and that the server's absence takes nothing from them.

use crate::fixture::{Arena, TEAM, new_run, phase};
use avln_episode::TimeLimits;
use avln_store::{AuditNote, MadeUp, NewRun, Phase, Run, RunState, Schedule, StoreError};
use std::collections::BTreeMap;

const HOUR_MS: i64 = 3_600_000;

fn timed(run_s: u32, closes_unix_ms: Option<i64>) -> Phase {
    let time = TimeLimits { run_s, ..TimeLimits::default() };
    let schedule = Schedule { closes_unix_ms, ..Schedule::default() };
    Phase { time, schedule, ..phase("practice", 2) }
}

async fn started(phase: &Phase, now: i64) -> (Arena, Run) {
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
async fn a_run_ends_with_its_wall_time_whatever_its_phase_does() {
    let (arena, run) = started(&timed(3600, Some(50)), 10).await;
    assert_eq!(run.deadline_unix_ms, Some(10 + HOUR_MS), "a run that began in time has its whole time");
    assert_eq!(arena.store.overdue(9 + HOUR_MS).await.expect("a list"), Vec::<String>::new());
    assert_eq!(arena.store.overdue(10 + HOUR_MS).await.expect("a list"), ["run_1"]);
    let late = arena.store.assign_next_episode("run_1", "h", 10 + HOUR_MS).await;
    assert!(matches!(late, Err(StoreError::RunOver { state: "expired", .. })), "{late:?}");
    let ended = arena.store.end_run("run_1", RunState::Expired, 11 + HOUR_MS).await.expect("the run");
    assert_eq!(ended.state, RunState::Expired);
    assert_eq!(arena.store.overdue(i64::MAX).await.expect("a list"), Vec::<String>::new());
}

#[tokio::test]
async fn a_run_without_wall_time_ends_with_its_phase() {
    let (arena, run) = started(&timed(0, Some(HOUR_MS)), 10).await;
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
async fn a_phase_keeps_its_secret_until_its_last_run_is_over() {
    let (arena, _) = started(&timed(3600, Some(50)), 10).await;
    arena.store.commit_phase("practice", &"0f".repeat(32), "1.0.0", 20).await.expect("a promise");
    let early = arena.store.reveal_phase("practice", AuditNote::default(), 60).await;
    assert!(matches!(early, Err(StoreError::StillPlayed { until_unix_ms: 3_600_010, .. })), "{early:?}");
    arena.store.reveal_phase("practice", AuditNote::default(), 10 + HOUR_MS).await.expect("its time is over");
}

#[tokio::test]
async fn what_a_death_of_the_server_took_is_given_back_to_runs_and_not_to_phases() {
    let (arena, _) = started(&timed(3600, Some(2 * HOUR_MS)), 10).await;
    assert_eq!(arena.store.make_up(20).await.expect("a first start"), MadeUp::default());
    arena.store.note_alive(5_000).await.expect("alive");
    let made_up = arena.store.make_up(5_000 + HOUR_MS).await.expect("a second start");
    assert_eq!(made_up, MadeUp { away_ms: HOUR_MS, runs: 1, phases: vec![] });
    assert_eq!(deadline(&arena).await, Some(10 + 2 * HOUR_MS));
    let audit = arena.store.audit().await.expect("the audit list");
    let line = audit.last().expect("a line");
    assert_eq!((line.subject.as_str(), line.what.as_str()), ("runs", "deadline"));
    assert_eq!(line.after.as_deref(), Some("+3600 s for 1 open runs"));
}

#[tokio::test]
async fn an_announced_maintenance_postpones_closing_dates_by_its_length() {
    let (arena, _) = started(&timed(3600, Some(HOUR_MS)), 10).await;
    arena.store.make_up(20).await.expect("a first start");
    arena.store.note_drain("new disks", 1_000_000).await.expect("a note");
    arena.store.note_drain("again", 1_100_000).await.expect("no second one");
    arena.store.note_alive(1_500_000).await.expect("alive while it drains");
    let back = 1_000_000 + 2 * HOUR_MS;
    let made_up = arena.store.make_up(back).await.expect("the next start");
    assert_eq!(made_up, MadeUp { away_ms: 2 * HOUR_MS, runs: 1, phases: vec!["practice".to_owned()] });
    assert_eq!(deadline(&arena).await, Some(10 + 3 * HOUR_MS), "it counts from the announcement");
    let closes = arena.store.phase("practice").await.expect("the phase").schedule.closes_unix_ms;
    assert_eq!(closes, Some(3 * HOUR_MS), "although its date had passed meanwhile");
    let audit = arena.store.audit().await.expect("the audit list");
    let told: Vec<_> = audit.iter().map(|line| (line.subject.as_str(), line.reason.as_str())).collect();
    assert_eq!(told, [("server", "new disks"), ("runs", "new disks"), ("phase practice", "new disks")]);
    assert_eq!(audit[2].before.as_deref(), Some("1970-01-01T01:00:00Z"));
    assert_eq!(
        arena.store.make_up(back + 500).await.expect("a restart").runs,
        0,
        "a maintenance counts once"
    );
}

#[tokio::test]
async fn a_clock_that_is_set_takes_nothing_from_runs() {
    let (arena, _) = started(&timed(3600, None), 10).await;
    assert_eq!(arena.store.follow_clock(-5_000, 20).await.expect("an answer"), 1);
    assert_eq!(deadline(&arena).await, Some(10 + HOUR_MS - 5_000));
    let made_up = arena.store.make_up(20).await.and(arena.store.make_up(10).await).expect("a start");
    assert_eq!(made_up, MadeUp::default(), "a clock that stands before the last sign of life gives nothing");
    assert_eq!(arena.store.runs_of(TEAM).await.expect("runs").len(), 1);
}
