//! Jumps of the wall clock while a server hosts runs.

use avln_arena::{clock::Clock, servers::Limits};
use avln_client::{Action, Client, EndReason, Error, Reason, Run, RunOptions};
use avln_store::{NewToken, Phase, RunState, TokenScope, Viewer};
use avln_tests::{PHASE, TEAM, TestServer, TestSetup, change_phase, clients::NO_SENSORS, set_up, store};
use std::time::Duration;
use tokio::time::sleep;

const HOUR_MS: i64 = 3_600_000;
const DAY_MS: i64 = 24 * HOUR_MS;
const JUMPS_MS: [i64; 4] = [2 * HOUR_MS, -2 * HOUR_MS, 3 * DAY_MS, -3 * DAY_MS];

/// A server whose wall clock tests can set, with a phase modified by `change`.
async fn server(missions: usize, limits: Limits, change: impl FnOnce(&mut Phase)) -> (TestServer, Clock) {
    let folder = tempfile::tempdir().expect("a folder");
    let token = set_up(folder.path(), &TestSetup { missions, ..TestSetup::default() }).await;
    change_phase(folder.path(), change).await;
    let clock = Clock::default();
    let shared = clock.clone();
    let server = TestServer::open_with(folder, token, |arena| arena.with_clock(shared), |_| limits).await;
    (server, clock)
}

/// Limits of a server that looks for expired runs only at its start: nothing but the calls of agents notices a jump.
fn blind() -> Limits {
    Limits { overdue_interval: Duration::from_secs(3600), ..Limits::default() }
}

/// Limits of a server that looks for expired runs all the time.
fn watchful() -> Limits {
    Limits { overdue_interval: Duration::from_millis(20), ..Limits::default() }
}

async fn client(server: &TestServer) -> Client {
    Client::connect(server.agents_url(), &server.token).await.expect("a connection")
}

async fn start(client: &Client) -> Result<Run, Error> {
    client.start_run(RunOptions::new(PHASE, "walker")).await
}

async fn stored(server: &TestServer, run: &str) -> avln_store::Run {
    let store = store(server.folder.path()).await;
    let stored = store.run(run).await.expect("the run");
    store.close().await;
    stored
}

async fn jumping_run_is_played_once(limits: Limits) {
    let (server, clock) = server(JUMPS_MS.len() + 1, limits, |phase| phase.time.run_s = 3600).await;
    let client = client(&server).await;
    let run = start(&client).await.expect("a run");
    let deadline_ms = stored(&server, &run.id).await.deadline_unix_ms.expect("a wall time");
    let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
    let mut moved_ms = 0;
    for by_ms in JUMPS_MS.map(Some).into_iter().chain([None]) {
        let mut episode = play.next_episode().await.expect("the run is open").expect("an episode");
        let deadline_unix_ms = stored(&server, &run.id).await.deadline_unix_ms.expect("a wall time");
        assert!((deadline_unix_ms - deadline_ms - moved_ms).abs() < 1000, "the deadline follows the clock");
        episode.step(Action::TurnLeft).await.expect("before the jump");
        clock.set_by(by_ms.unwrap_or_default());
        moved_ms += by_ms.unwrap_or_default();
        episode.step(Action::TurnLeft).await.expect("after the jump");
        episode.step(Action::Stop).await.expect("the end");
        let end = episode.end().map(|end| (end.reason, end.steps));
        assert_eq!(end, Some((EndReason::Stopped, 3)), "a jump of {by_ms:?} ms costs no thinking time");
    }
    assert!(play.next_episode().await.expect("an answer").is_none());
    play.finish().await.expect("the end of the run");

    let store = store(server.folder.path()).await;
    assert_eq!(store.run(&run.id).await.expect("the run").state, RunState::Completed);
    let view = store.reader().run(&Viewer::Organiser, &run.id).await.expect("an answer").expect("the run");
    let ends: Vec<_> = view.episodes.iter().map(|line| line.end.map(|end| end.as_str())).collect();
    assert_eq!(ends, [Some("stopped"); JUMPS_MS.len() + 1]);
    let audit = store.audit().await.expect("the audit list");
    let moves = audit.iter().filter(|line| line.reason == "the clock was set").count();
    assert_eq!(moves, JUMPS_MS.len(), "{audit:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn jumping_clock_ends_no_run() {
    jumping_run_is_played_once(watchful()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn jump_before_the_next_look_ends_no_run() {
    jumping_run_is_played_once(blind()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn farewell_after_a_jump_is_no_expiry() {
    for by_ms in JUMPS_MS {
        let (server, clock) = server(2, blind(), |phase| phase.time.run_s = 3600).await;
        let client = client(&server).await;
        let run = start(&client).await.expect("a run");
        let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
        play.next_episode().await.expect("an answer").expect("an episode");
        clock.set_by(by_ms);
        play.finish().await.expect("a summary");
        assert_eq!(stored(&server, &run.id).await.state, RunState::Cancelled, "after {by_ms} ms");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn run_started_after_a_jump_has_its_time() {
    for by_ms in JUMPS_MS {
        let (server, clock) = server(2, watchful(), |phase| phase.time.run_s = 3600).await;
        let client = client(&server).await;
        clock.set_by(by_ms);
        let run = start(&client).await.expect("a run");
        sleep(Duration::from_millis(200)).await;
        let stored = stored(&server, &run.id).await;
        let left_ms = stored.deadline_unix_ms.expect("a wall time") - clock.now_unix_ms();
        assert!(stored.state.is_open() && (HOUR_MS - 60_000..=HOUR_MS).contains(&left_ms), "{left_ms} ms");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn set_back_clock_buys_no_time() {
    let (server, clock) = server(2, watchful(), |phase| phase.time.run_s = 1).await;
    let run = start(&client(&server).await).await.expect("a run");
    clock.set_by(-2 * HOUR_MS);
    for _ in 0..600 {
        if stored(&server, &run.id).await.state == RunState::Expired {
            return;
        }
        sleep(Duration::from_millis(100)).await;
    }
    panic!("a run of one second is open after a minute");
}

#[tokio::test(flavor = "multi_thread")]
async fn quota_windows_follow_the_wall_clock() {
    let (server, clock) = server(2, watchful(), |phase| phase.quotas.day = Some(1)).await;
    let client = client(&server).await;
    let refused = async || start(&client).await.expect_err("one run a day").reason();
    start(&client).await.expect("the run of today");
    assert_eq!(refused().await, Some(Reason::QuotaDay));
    clock.set_by(DAY_MS);
    start(&client).await.expect("the run of tomorrow");
    assert_eq!(refused().await, Some(Reason::QuotaDay));
    clock.set_by(-DAY_MS);
    assert_eq!(refused().await, Some(Reason::QuotaDay), "today's run still counts");
}

#[tokio::test(flavor = "multi_thread")]
async fn tokens_expire_by_the_wall_clock() {
    let (server, clock) = server(2, watchful(), |_| ()).await;
    let secret = avln_arena::ids::new_token("account").expect("randomness");
    let expires_unix_ms = Some(clock.now_unix_ms() + HOUR_MS);
    let kind = TokenScope::Participant;
    let token = NewToken { secret: &secret, kind, name: "", team: Some(TEAM), expires_unix_ms };
    let store = store(server.folder.path()).await;
    store.issue_token(&token, clock.now_unix_ms()).await.expect("a token");
    let client = Client::connect(server.agents_url(), &secret).await.expect("a connection");
    client.whoami().await.expect("within the hour");
    clock.set_by(2 * HOUR_MS);
    let late = client.whoami().await.expect_err("after the hour");
    assert_eq!(late.reason(), Some(Reason::TokenExpired), "{late}");
    clock.set_by(-2 * HOUR_MS);
    client.whoami().await.expect("within the hour again");
}
