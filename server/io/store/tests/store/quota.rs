//! Quotas of teams.

use crate::{Arena, Played, TEAM, new_run, phase};
use avln_challenge::{Quota, QuotaLimits, QuotaWindow, RunState, calendar::unix_ms};
use avln_episode::{EndReason, Order};
use avln_store::{AuditNote, NewGrant, NewRun, Phase, StartedRun, StoreError};
use std::collections::BTreeMap;
use tokio::task::JoinSet;

fn limited(quotas: QuotaLimits) -> Phase {
    Phase { quotas, ..phase("practice", 2) }
}

/// Returns a timestamp in 2026, UTC.
fn at(month: u8, day: u8, second_of_day: u32) -> i64 {
    unix_ms(2026, month, day, second_of_day).expect("a moment")
}

const LAST_SECOND: u32 = 86_399;

async fn start(arena: &Arena, id: &str, now: i64) -> Result<StartedRun, StoreError> {
    let digests = BTreeMap::new();
    arena.store.start_run(&NewRun { id, token: id, ..new_run(&digests) }, now).await
}

async fn quota(arena: &Arena, window: QuotaWindow, now: i64) -> Quota {
    let quotas = arena.store.quotas(TEAM, Some("practice"), now).await.expect("quotas");
    quotas.into_iter().find(|quota| quota.window == window).expect("the window is limited")
}

fn refused_for(started: Result<StartedRun, StoreError>) -> (QuotaWindow, Option<i64>) {
    match started {
        Err(StoreError::QuotaUsed(quota)) => (quota.window, quota.next_increase_unix_ms),
        other => panic!("not refused by a quota: {other:?}"),
    }
}

/// Plays the next episode of a run to `end`.
async fn play(arena: &Arena, run: &str, end: EndReason) {
    let assigned = arena.assign(run, &format!("{run}-{}", rand_suffix())).await.expect("an episode");
    let played = Played::new(&assigned, Order::Unordered, 1, end);
    arena.record(run, &assigned.handle, &played).await.expect("a result");
}

/// Returns a new number per call, for unique handles.
fn rand_suffix() -> u64 {
    use std::sync::atomic::{AtomicU64, Ordering};
    static NEXT: AtomicU64 = AtomicU64::new(0);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

#[tokio::test]
async fn one_of_many_starts_gets_last_run() {
    let arena = Arena::new(&limited(QuotaLimits { total: Some(1), ..QuotaLimits::default() })).await;
    let mut starts = JoinSet::new();
    for number in 0..100 {
        let store = arena.store.clone();
        starts.spawn(async move {
            let (id, digests) = (format!("run_{number}"), BTreeMap::new());
            store.start_run(&NewRun { id: &id, token: &id, ..new_run(&digests) }, 10).await
        });
    }
    let results = starts.join_all().await;
    assert_eq!(results.iter().filter(|result| result.is_ok()).count(), 1);
    let refusals = results.into_iter().filter(Result::is_err).map(refused_for);
    assert!(refusals.into_iter().all(|refusal| refusal == (QuotaWindow::Total, None)));
    assert_eq!(arena.store.runs_of(TEAM).await.expect("a list").len(), 1);
}

#[tokio::test]
async fn daily_quota_ends_at_utc_midnight() {
    let arena = Arena::new(&limited(QuotaLimits { day: Some(1), ..QuotaLimits::default() })).await;
    start(&arena, "run_1", at(7, 1, LAST_SECOND)).await.expect("the first of the day");
    let used = quota(&arena, QuotaWindow::Day, at(7, 1, LAST_SECOND)).await;
    assert_eq!((used.used, used.remaining), (1, Some(0)));
    assert_eq!((used.window_start_unix_ms, used.next_increase_unix_ms), (at(7, 1, 0), Some(at(7, 2, 0))));
    assert_eq!((used.charges[0].run.as_str(), used.charges[0].charged), ("run_1", true));
    let early = start(&arena, "run_2", at(7, 1, LAST_SECOND) + 999).await;
    let said = early.as_ref().expect_err("used up").to_string();
    assert!(said.contains("2026-07-02T00:00:00Z"), "{said}");
    assert_eq!(refused_for(early), (QuotaWindow::Day, Some(at(7, 2, 0))));
    start(&arena, "run_2", at(7, 2, 0)).await.expect("the first of the next day");
    let fresh = quota(&arena, QuotaWindow::Day, at(7, 3, 5)).await;
    assert_eq!((fresh.used, fresh.remaining, fresh.next_increase_unix_ms), (0, Some(1), None));
}

#[tokio::test]
async fn monthly_quota_refills_but_total_does_not() {
    let limits = QuotaLimits { month: Some(1), total: Some(2), ..QuotaLimits::default() };
    let arena = Arena::new(&limited(limits)).await;
    start(&arena, "run_1", at(1, 31, LAST_SECOND)).await.expect("January's");
    let refused = refused_for(start(&arena, "run_2", at(1, 31, LAST_SECOND)).await);
    assert_eq!(refused, (QuotaWindow::Month, Some(at(2, 1, 0))));
    start(&arena, "run_2", at(2, 1, 0)).await.expect("February's");
    assert_eq!(refused_for(start(&arena, "run_3", at(3, 1, 0)).await), (QuotaWindow::Total, None));
}

#[tokio::test]
async fn concurrent_quota_limits_open_runs() {
    let arena = Arena::new(&limited(QuotaLimits { concurrent: Some(1), ..QuotaLimits::default() })).await;
    start(&arena, "run_1", 10).await.expect("a run");
    assert_eq!(refused_for(start(&arena, "run_2", 11).await), (QuotaWindow::Concurrent, None));
    arena.store.cancel_run("run_1", 12).await.expect("the run");
    start(&arena, "run_2", 13).await.expect("the first is over");
}

#[tokio::test]
async fn stored_facts_decide_charges() {
    let arena = Arena::new(&limited(QuotaLimits { total: Some(9), ..QuotaLimits::default() })).await;
    let charge = async |run: &str| arena.store.charge(run).await.expect("a run").charged;
    let runs =
        ["run_open", "run_idle", "run_left", "run_seen", "run_whole", "run_lost", "run_failed", "run_late"];
    for run in runs {
        start(&arena, run, 10).await.expect("a run");
    }
    play(&arena, "run_left", EndReason::Abandoned).await;
    let seen = arena.assign("run_seen", "seen").await.expect("an episode");
    play(&arena, "run_late", EndReason::TimeBudget).await;
    for _ in 0..2 {
        play(&arena, "run_whole", EndReason::Disconnected).await;
    }
    for _ in 0..6 {
        play(&arena, "run_lost", EndReason::ServerFault).await;
    }
    for run in ["run_idle", "run_left", "run_seen", "run_lost"] {
        arena.store.cancel_run(run, 20).await.expect("a run");
    }
    arena.store.end_run("run_failed", RunState::Failed, 20).await.expect("a run");
    arena.store.end_run("run_late", RunState::Expired, 20).await.expect("a run");
    let expected = [
        ("run_open", true),
        ("run_idle", false),
        ("run_left", true),
        ("run_seen", true),
        ("run_whole", true),
        ("run_lost", false),
        ("run_failed", false),
        ("run_late", true),
    ];
    for (run, charged) in expected {
        assert_eq!(charge(run).await, charged, "{run}");
    }
    let total = quota(&arena, QuotaWindow::Total, 30).await;
    assert_eq!((total.used, total.remaining), (5, Some(4)));
    let closed = Played::new(&seen, Order::Unordered, 0, EndReason::Abandoned);
    arena.record("run_seen", "seen", &closed).await.expect("a result");
    assert!(charge("run_seen").await, "a result after the end changes nothing");
}

#[tokio::test]
async fn runs_without_step_are_charged() {
    let arena = Arena::new(&limited(QuotaLimits { total: Some(9), ..QuotaLimits::default() })).await;
    let charge = async |run: &str| arena.store.charge(run).await.expect("a run");
    for run in ["run_seen", "run_lost"] {
        start(&arena, run, 10).await.expect("a run");
        let assigned = arena.assign(run, &format!("{run}-h")).await.expect("an episode");
        let end = if run == "run_seen" { EndReason::Abandoned } else { EndReason::ServerFault };
        let mut played = Played::new(&assigned, Order::Unordered, 0, end);
        played.metrics.steps = 0;
        arena.record(run, &assigned.handle, &played).await.expect("a result");
        arena.store.cancel_run(run, 20).await.expect("a run");
    }
    let seen = charge("run_seen").await;
    assert_eq!((seen.charged, seen.reason), (true, "it ended after its first episode began"));
    let lost = charge("run_lost").await;
    assert_eq!((lost.charged, lost.reason), (false, "the server lost every episode that began"));
}

#[tokio::test]
async fn counted_phases_limit_uncharged_runs() {
    let counted = limited(QuotaLimits { month: Some(900), ..QuotaLimits::default() });
    let arena = Arena::new(&counted).await;
    assert_eq!(quota(&arena, QuotaWindow::Uncharged, 10).await.limit, Some(20));
    let open = limited(QuotaLimits { concurrent: Some(1), ..QuotaLimits::default() });
    arena.store.upsert_phase(&open, 11).await.expect("another quota");
    let windows = arena.store.quotas(TEAM, Some("practice"), 12).await.expect("quotas").into_iter();
    let windows: Vec<_> = windows.map(|quota| quota.window).collect();
    assert_eq!(windows, [QuotaWindow::Total, QuotaWindow::Concurrent]);
}

#[tokio::test]
async fn uncharged_runs_are_limited() {
    let limits = QuotaLimits { total: Some(1), uncharged: Some(2), ..QuotaLimits::default() };
    let arena = Arena::new(&limited(limits)).await;
    for number in 0..2 {
        let run = format!("run_{number}");
        start(&arena, &run, 10).await.expect("the run before it was not charged");
        arena.store.cancel_run(&run, 11).await.expect("the run");
    }
    let free = quota(&arena, QuotaWindow::Uncharged, 12).await;
    assert_eq!((free.used, free.remaining, free.charges[0].charged), (2, Some(0), false));
    assert_eq!(refused_for(start(&arena, "run_2", 12).await), (QuotaWindow::Uncharged, None));
    assert_eq!(arena.store.runs_of(TEAM).await.expect("a list").len(), 2);
}

#[tokio::test]
async fn grants_count_in_their_window() {
    let limits = QuotaLimits { day: Some(1), total: Some(1), ..QuotaLimits::default() };
    let arena = Arena::new(&limited(limits)).await;
    start(&arena, "run_1", at(7, 1, 0)).await.expect("a run");
    let grant = NewGrant { phase: "practice", team: TEAM, runs: 1, reason: "our disk was full" };
    let note = AuditNote { what: "granted".to_owned(), ..AuditNote::default() };
    arena.store.grant(&grant, note.clone(), at(7, 1, 5)).await.expect("a grant");
    start(&arena, "run_2", at(7, 1, 6)).await.expect("the granted run");
    assert_eq!(refused_for(start(&arena, "run_3", at(7, 2, 0)).await), (QuotaWindow::Total, None));
    let day = quota(&arena, QuotaWindow::Day, at(7, 2, 0)).await;
    assert_eq!((day.limit, day.remaining), (Some(1), Some(1)));
    assert_eq!(arena.store.audit().await.expect("a list").len(), 1);
    let other = NewGrant { team: "nobody", ..grant };
    assert!(matches!(
        arena.store.grant(&other, note, 1).await,
        Err(StoreError::Unknown { what: "team", .. })
    ));
}
