//! Every fault ends an episode for exactly one reason, leaves its run in exactly one state and either counts
//! towards the quota or not. The faults are real: panics, hanging threads, dead connections, full disks,
//! locked databases.

use avln_arena::{budget::Budget, servers::Limits};
use avln_client::{Action, Client, EndReason, Episode, Error, Order, Play, Reason, Run, RunOptions};
use avln_store::{Phase, RunState, Viewer};
use avln_tests::{
    PHASE, Server, TestServer, TestSetup, change_phase,
    clients::NO_SENSORS,
    machine::Disk,
    proxies::{self, FaultProxy},
    set_up, store,
};
use sqlx::{Connection, SqliteConnection, sqlite::SqliteConnectOptions};
use std::{
    path::Path,
    process::Command,
    sync::{
        Arc, Mutex,
        atomic::{AtomicU32, Ordering},
        mpsc,
    },
    time::Duration,
};
use tempfile::TempDir;
use tokio::time::{sleep, timeout};

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");

/// Outcome of a run: episode ends in order (`-` for open ones), run state, and whether it counts.
type Verdict = (String, RunState, bool);

/// A data folder with one phase of two episodes, modified by `change`.
pub(crate) async fn set_up_with(change: impl FnOnce(&mut Phase)) -> (TempDir, String) {
    let folder = tempfile::tempdir().expect("a folder");
    let token = set_up(folder.path(), &TestSetup { houses: 1, missions: 2, ..TestSetup::default() }).await;
    change_phase(folder.path(), change).await;
    (folder, token)
}

pub(crate) async fn server(change: impl FnOnce(&mut Phase)) -> TestServer {
    let (folder, token) = set_up_with(change).await;
    TestServer::open_with(folder, token, |arena| arena, |limits| limits).await
}

pub(crate) async fn begin(url: &str, token: &str) -> (Run, Play) {
    let client = Client::connect(url, token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, "m").order(Order::Unordered)).await.expect("a run");
    let play = client.play(&run, NO_SENSORS).await.expect("a stream");
    (run, play)
}

pub(crate) fn end_of(episode: &Episode<'_>) -> Option<EndReason> {
    episode.end().map(|end| end.reason)
}

/// Plays the remaining episodes, a step and a Stop each.
pub(crate) async fn play_on(mut play: Play) -> Result<(), Error> {
    while let Some(mut episode) = play.next_episode().await? {
        episode.step(Action::TurnLeft).await?;
        if !episode.is_over() {
            episode.step(Action::Stop).await?;
        }
    }
    Ok(())
}

/// Final outcome of a run.
pub(crate) async fn verdict(folder: &Path, run: &str) -> Verdict {
    let store = store(folder).await;
    let mut before = None;
    for _ in 0..150 {
        let view = store.reader().run(&Viewer::Organiser, run).await.expect("an answer").expect("the run");
        let end = |line: &avln_store::EpisodeLine| line.end.map_or("-", |end| end.as_str());
        let ends: Vec<_> = view.episodes.iter().map(end).collect();
        let state = store.run(run).await.expect("the run").state;
        let charged = store.charge(run).await.expect("a charge").charged;
        let now = (ends.join(" "), state, charged);
        let underway = store.running_episodes().await.expect("a list").len();
        if underway == 0 && before.as_ref() == Some(&now) {
            store.close().await;
            return now;
        }
        before = Some(now);
        sleep(Duration::from_millis(100)).await;
    }
    panic!("episodes are still being played: {before:?}");
}

pub(crate) fn expect(ends: &str, state: RunState, charged: bool) -> Verdict {
    (ends.to_owned(), state, charged)
}

/// Allows a disconnection of one second.
pub(crate) fn brief(phase: &mut Phase) {
    (phase.time.disconnect_s, phase.time.disconnect_total_s) = (1, 600);
}

#[tokio::test(flavor = "multi_thread")]
async fn agent_an_illegal_message_costs_nothing() {
    let server = server(|_| ()).await;
    let proxy = proxies::RecordingProxy::open(server.servers.grpc).await;
    let (run, mut play) = begin(&proxy.url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    for spoil in [proxies::illegal_action(), proxies::wrong_step(9)] {
        proxy.corrupt(spoil);
        assert!(episode.step(Action::MoveForward).await.is_err(), "the server refuses it");
    }
    episode.step(Action::Stop).await.expect("and goes on");
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn agent_too_slow_ends_the_episode() {
    let server = server(|phase| phase.time.step_ms = 300).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    episode.step(Action::TurnLeft).await.expect("in time");
    sleep(Duration::from_millis(600)).await;
    episode.step(Action::TurnLeft).await.expect("it learns of the end");
    assert_eq!(end_of(&episode), Some(EndReason::TimeBudget));
    play_on(play).await.expect("to the end");
    let expected = expect("time_budget stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn agent_gone_ends_episode_but_not_run() {
    let server = server(brief).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    play.next_episode().await.expect("an answer").expect("an episode");
    drop(play);
    let expected = expect("disconnected -", RunState::Running, true);
    sleep(Duration::from_millis(1500)).await;
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn agent_cancelling_before_first_step_is_charged() {
    let server = server(|_| ()).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    play.next_episode().await.expect("an answer").expect("an episode");
    play.finish().await.expect("a summary");
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    client.cancel_run(&run.id).await.expect("it is its own");
    let expected = expect("abandoned -", RunState::Cancelled, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn agent_cancelled_by_team_does_not_complete_run() {
    let server = server(|_| ()).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut first = play.next_episode().await.expect("an answer").expect("an episode");
    first.step(Action::Stop).await.expect("in time");
    let mut last = play.next_episode().await.expect("an answer").expect("an episode");
    last.step(Action::TurnLeft).await.expect("in time");
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    let output = client.cancel_run(&run.id).await.expect("it is its own");
    assert_eq!((output.state, output.progress.in_flight), (avln_client::RunState::Cancelled, 0));
    let expected = expect("stopped abandoned", RunState::Cancelled, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
    let log = find(server.folder.path(), &run.id);
    let verify = Command::new(PROGRAM)
        .arg("--data")
        .arg(server.folder.path())
        .args(["run", "verify"])
        .arg(log)
        .output();
    let verify = verify.expect("the program runs");
    assert!(verify.status.success(), "{}", String::from_utf8_lossy(&verify.stderr));
    assert!(matches!(last.step(Action::TurnLeft).await, Err(_) | Ok(_)) && last.is_over());
}

#[tokio::test(flavor = "multi_thread")]
async fn agent_sending_nonsense_counts_as_disconnected() {
    let server = server(brief).await;
    let proxy = proxies::RecordingProxy::open(server.servers.grpc).await;
    let (run, mut play) = begin(&proxy.url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    // Invalid HTTP/2 frames from here on.
    proxy.corrupt(Box::new(|bytes| {
        bytes.fill(0xff);
        false
    }));
    let _ = timeout(Duration::from_millis(300), episode.step(Action::TurnLeft)).await;
    proxy.cut();
    drop(play);
    let expected = expect("disconnected -", RunState::Running, true);
    sleep(Duration::from_millis(1500)).await;
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn expired_wall_time_ends_run_with_results() {
    let server = server(|phase| phase.time.run_s = 3).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    episode.step(Action::Stop).await.expect("a whole episode");
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    while !episode.is_over() {
        episode.step(Action::TurnLeft).await.expect("a step, or the end");
        sleep(Duration::from_millis(50)).await;
    }
    assert_eq!(end_of(&episode), Some(EndReason::TimeBudget));
    assert!(play.next_episode().await.expect("an answer").is_none(), "the run is over");
    assert!(!play.finish().await.expect("a summary").complete);
    let expected = expect("stopped time_budget", RunState::Expired, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    let idle = client.start_run(RunOptions::new(PHASE, "idle").order(Order::Unordered)).await.expect("a run");
    sleep(Duration::from_millis(4500)).await;
    let expected = expect("- -", RunState::Expired, false);
    assert_eq!(verdict(server.folder.path(), &idle.id).await, expected, "no agent played");
}

#[tokio::test(flavor = "multi_thread")]
async fn network_that_is_cut_or_stalls_costs_nothing() {
    let server = server(|_| ()).await;
    let proxy = FaultProxy::open(server.servers.grpc).await;
    let (run, mut play) = begin(&proxy.url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    proxy.cut();
    episode.step(Action::TurnLeft).await.expect("after another connection");
    proxy.hold(true);
    let step = episode.step(Action::TurnLeft);
    let (stepped, ()) = tokio::join!(step, async {
        sleep(Duration::from_secs(1)).await;
        proxy.hold(false);
    });
    stepped.expect("when the proxy is back");
    episode.step(Action::Stop).await.expect("and goes on");
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn network_dead_silently_counts_as_disconnect() {
    let (folder, token) = set_up_with(brief).await;
    let keen = |limits: Limits| Limits {
        keepalive_interval: Duration::from_millis(300),
        keepalive_timeout: Duration::from_millis(300),
        ..limits
    };
    let server = TestServer::open_with(folder, token, |arena| arena, keen).await;
    let proxy = FaultProxy::open(server.servers.grpc).await;
    let (run, mut play) = begin(&proxy.url(), &server.token).await;
    play.next_episode().await.expect("an answer").expect("an episode");
    proxy.hold(true);
    sleep(Duration::from_secs(3)).await;
    let expected = expect("disconnected -", RunState::Running, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

/// A simulator fault at certain steps.
type SimulatorFault = Arc<dyn Fn(u32) + Send + Sync>;

pub(crate) async fn disturbed(mischief: SimulatorFault) -> TestServer {
    let (folder, token) = set_up_with(|_| ()).await;
    let hasty = |limits: Limits| Limits { step: Duration::from_millis(500), ..limits };
    TestServer::open_with(
        folder,
        token,
        |arena| arena.with_fault_injection(move |step| mischief(step)),
        hasty,
    )
    .await
}

/// The first `times` steps fail, as `fail` has it.
pub(crate) fn at_first(times: u32, fail: impl Fn() + Send + Sync + 'static) -> SimulatorFault {
    let left = AtomicU32::new(times);
    Arc::new(move |_| {
        let fails =
            left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).is_ok();
        if fails {
            fail();
        }
    })
}

#[tokio::test(flavor = "multi_thread")]
async fn server_panic_in_step_costs_no_quota() {
    let server = disturbed(at_first(1, || panic!("the secret of this scene"))).await;
    let (run, play) = begin(&server.agents_url(), &server.token).await;
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

#[tokio::test(flavor = "multi_thread")]
async fn server_failing_repeatedly_drops_episode_without_charge() {
    let server = disturbed(at_first(3, || panic!("the secret of this scene"))).await;
    let (run, play) = begin(&server.agents_url(), &server.token).await;
    play_on(play).await.expect("to the end");
    let expected = expect("server_fault stopped", RunState::Completed, false);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

/// A server whose first step hangs until the sender is dropped.
pub(crate) async fn hanging() -> (TestServer, mpsc::Sender<()>) {
    let (go_on, wait) = mpsc::channel::<()>();
    let wait = Mutex::new(wait);
    let server = disturbed(at_first(1, move || {
        let _ = wait.lock().expect("one hangs").recv();
    }))
    .await;
    (server, go_on)
}

#[tokio::test(flavor = "multi_thread")]
async fn server_hanging_in_step_costs_no_quota() {
    let (server, go_on) = hanging().await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    episode.step(Action::TurnLeft).await.expect("it learns of the end");
    assert_eq!(end_of(&episode), Some(EndReason::ServerFault));
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
    drop(go_on);
}

#[tokio::test(flavor = "multi_thread")]
async fn server_without_memory_begins_no_episode() {
    let (folder, token) = set_up_with(|_| ()).await;
    let poor = Budget { session_memory_mib: 0, ..Budget::default() };
    let server = TestServer::open_with(folder, token, |arena| arena.with_budget(poor), |limits| limits).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let Err(refused) = play.next_episode().await else { panic!("an episode without memory began") };
    assert_eq!(refused.reason(), Some(Reason::SimFault), "{refused}");
    assert!(!refused.to_string().contains("MiB"), "how large a scene is is hidden: {refused}");
    while play.next_episode().await.is_err() {}
    let expected = expect("server_fault server_fault", RunState::Completed, false);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

/// A hanging file system: the scene is a pipe without a writer.
#[cfg(unix)]
#[tokio::test(flavor = "multi_thread")]
async fn server_hanging_in_preparation_costs_one_episode() {
    let (folder, token) = set_up_with(|_| ()).await;
    let server = Server::start_with(PROGRAM, folder.path(), &["--preparation-limit", "1"]);
    let missions = find(folder.path(), "/missions/");
    std::fs::remove_file(&missions).expect("a file of missions");
    assert!(Command::new("mkfifo").arg(&missions).status().expect("mkfifo").success());
    let (run, mut play) = begin(&format!("http://{}", server.grpc), &token).await;
    let refused = timeout(Duration::from_secs(30), play.next_episode()).await.expect("an answer in time");
    assert!(refused.is_err(), "the episode cannot be had");
    drop(play);
    server.kill();
    let store = store(folder.path()).await;
    assert_eq!(store.running_episodes().await.expect("a list").len(), 0);
    store.cancel_run(&run.id, 1).await.expect("the run");
    assert!(!store.charge(&run.id).await.expect("a charge").charged, "and costs nothing");
}

/// A file below `folder` with `part` in its path.
fn find(folder: &Path, part: &str) -> std::path::PathBuf {
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).expect("a folder") {
            let path = entry.expect("an entry").path();
            match path.is_dir() {
                true => folders.push(path),
                false if path.to_string_lossy().contains(part) => return path,
                false => {}
            }
        }
    }
    panic!("no file is called {part}");
}

#[tokio::test(flavor = "multi_thread")]
async fn server_that_dies_costs_nothing() {
    let (folder, token) = set_up_with(|phase| phase.time.run_s = 3600).await;
    let server = Server::start(PROGRAM, folder.path());
    let proxy = FaultProxy::open(server.grpc).await;
    let (run, mut play) = begin(&proxy.url(), &token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    episode.step(Action::TurnLeft).await.expect("a step");
    server.kill();
    proxy.cut();
    sleep(Duration::from_secs(2)).await;
    let server = Server::start(PROGRAM, folder.path());
    proxy.redirect(server.grpc);
    episode.step(Action::Stop).await.expect("on another server");
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(folder.path(), &run.id).await, expected);
    let audit = store(folder.path()).await.audit().await.expect("the audit list");
    let given_back = audit.iter().any(|line| line.subject == "runs" && line.what == "deadline");
    assert!(given_back, "the wall time that passed meanwhile is given back: {audit:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn full_run_log_disk_costs_no_quota() {
    let (folder, token) = set_up_with(|_| ()).await;
    let logs = folder.path().join("runs");
    std::fs::create_dir_all(&logs).expect("a folder");
    let Some(disk) = Disk::mount(&logs, "256k") else { return };
    let server = TestServer::open_with(folder, token, |arena| arena, |limits| limits).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    disk.fill();
    while !episode.is_over() {
        episode.step(Action::TurnLeft).await.expect("a step, or the end");
    }
    assert_eq!(end_of(&episode), Some(EndReason::ServerFault), "what is not written down does not count");
    disk.empty();
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
    drop(disk);
}

#[tokio::test(flavor = "multi_thread")]
async fn full_database_disk_costs_no_quota() {
    let small = tempfile::tempdir().expect("a folder");
    let Some(disk) = Disk::mount(small.path(), "64m") else { return };
    let (folder, token) = set_up_with(|_| ()).await;
    std::fs::rename(folder.path().join("splits"), folder.path().join("splits_kept")).expect("its splits");
    copy(folder.path(), small.path());
    std::os::unix::fs::symlink(folder.path().join("splits_kept"), small.path().join("splits"))
        .expect("a link");
    let logs = tempfile::tempdir().expect("a folder");
    std::os::unix::fs::symlink(logs.path(), small.path().join("runs")).expect("a link");
    let server = Server::start(PROGRAM, small.path());
    let (run, mut play) = begin(&format!("http://{}", server.grpc), &token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    disk.fill();
    episode.step(Action::TurnLeft).await.expect("the log lies elsewhere");
    episode.step(Action::Stop).await.expect("it learns of the end");
    assert_eq!(end_of(&episode), Some(EndReason::ServerFault), "what is not stored does not count");
    disk.empty();
    sleep(Duration::from_secs(3)).await;
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(small.path(), &run.id).await, expected);
    server.kill();
    drop(disk);
}

fn copy(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_file() {
            std::fs::copy(&path, to.join(path.file_name().expect("a name"))).expect("a copy");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn locked_database_is_retried() {
    let server = server(|_| ()).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    let database = SqliteConnectOptions::new().filename(server.folder.path().join("avln.db"));
    let mut other = SqliteConnection::connect_with(&database).await.expect("another program");
    sqlx::query("BEGIN IMMEDIATE").execute(&mut other).await.expect("the right to write");
    let release = async {
        sleep(Duration::from_secs(2)).await;
        sqlx::query("ROLLBACK").execute(&mut other).await.expect("the end of it");
    };
    let (stopped, ()) = tokio::join!(episode.step(Action::Stop), release);
    stopped.expect("once the database is free");
    assert_eq!(end_of(&episode), Some(EndReason::Stopped));
    play_on(play).await.expect("to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}
