//! Every way to end a run, with the agent's knowledge and the charge: the table in PROTOCOL.md, which `AVLN_BLESS=1` writes; and
//! agents that leave: state, charge, quota, and the answers to a late caller.

use crate::faults::{at_first, begin, brief, disturbed, expect, play_on, server, set_up_with, verdict};
use avln_arena::budget::Budget;
use avln_arena::now_unix_ms;
use avln_client::{Action, Client, EndReason, Order, Play, Reason, Run, RunOptions, Sensors};
use avln_store::{RunState, Visibility};
use avln_tests::clients::{MOVE_FORWARD, NO_SENSORS, RawClient};
use avln_tests::machine::{root, text};
use avln_tests::{PHASE, TestServer, TestSetup, change_phase, set_up, store};
use std::collections::BTreeSet;
use std::path::Path;
use std::pin::pin;
use std::time::Duration;
use tempfile::TempDir;
use tokio::time::{sleep, timeout};

const PAGE: &str = "proto/PROTOCOL.md";
const HEAD: &str = "| end | the agent has seen | state | charged |\n| --- | --- | --- | --- |\n";

/// Missions and steps that an agent has received in a run of two episodes.
#[derive(Default)]
struct Seen {
    missions: BTreeSet<String>,
    steps: u32,
}

impl Seen {
    /// Begins the next episode and takes `steps` steps. Returns false at the end of the run.
    async fn episode(&mut self, play: &mut Play, steps: u32) -> bool {
        let Some(mut episode) = play.next_episode().await.expect("an answer") else { return false };
        self.missions.insert(format!("{:?}", episode.mission()));
        for _ in 0..steps {
            episode.step(Action::TurnLeft).await.expect("a step, or the end");
            self.steps += u32::from(episode.end().is_none_or(|end| end.reason != EndReason::ServerFault));
        }
        true
    }

    fn words(&self) -> String {
        match (self.missions.len(), self.steps) {
            (0, _) => "nothing".to_owned(),
            (missions, 0) => format!("{missions} of 2 missions, no step"),
            (missions, 1) => format!("{missions} of 2 missions, 1 step"),
            (missions, steps) => format!("{missions} of 2 missions, {steps} steps"),
        }
    }
}

/// Row of the table.
fn row(end: &str, seen: &Seen, state: RunState, charged: bool) -> String {
    let charged = if charged { "yes" } else { "no" };
    format!("| {end} | {} | `{}` | {charged} |\n", seen.words(), state.as_str().to_uppercase())
}

async fn judged(end: &str, seen: &Seen, server: &TestServer, run: &Run) -> String {
    let (_, state, charged) = verdict(server.folder.path(), &run.id).await;
    row(end, seen, state, charged)
}

async fn cancel(server: &TestServer, run: &Run) {
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    client.cancel_run(&run.id).await.expect("it is its own");
}

async fn played_to_the_end() -> Vec<String> {
    let server = server(|_| ()).await;
    let mut rows = Vec::new();
    for (steps, end) in [(1, "all episodes played"), (0, "all episodes abandoned before a step")] {
        let (run, mut play) = begin(&server.agents_url(), &server.token).await;
        let mut seen = Seen::default();
        while seen.episode(&mut play, steps).await {}
        rows.push(judged(end, &seen, &server, &run).await);
    }
    rows
}

async fn cancelled() -> Vec<String> {
    let server = server(|_| ()).await;
    let ways = [
        (None, false, "cancelled before the first `Ready`"),
        (Some(0), false, "cancelled after the first `EpisodeStart`"),
        (Some(0), true, "an episode abandoned before a step, then cancelled"),
        (Some(1), false, "cancelled after a step"),
    ];
    let mut rows = Vec::new();
    for (steps, abandons, end) in ways {
        let (run, mut play) = begin(&server.agents_url(), &server.token).await;
        let mut seen = Seen::default();
        if let Some(steps) = steps {
            seen.episode(&mut play, steps).await;
        }
        if abandons {
            play.finish().await.expect("a summary");
        }
        cancel(&server, &run).await;
        rows.push(judged(end, &seen, &server, &run).await);
    }
    rows
}

async fn left_open() -> Vec<String> {
    let server = server(brief).await;
    let mut rows = Vec::new();
    for (begins, end) in [(false, "`Goodbye` before the first `Ready`"), (true, "`Goodbye` after it")] {
        let (run, mut play) = begin(&server.agents_url(), &server.token).await;
        let mut seen = Seen::default();
        if begins {
            seen.episode(&mut play, 0).await;
        }
        play.finish().await.expect("a summary");
        rows.push(judged(end, &seen, &server, &run).await);
    }
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut seen = Seen::default();
    seen.episode(&mut play, 0).await;
    drop(play);
    sleep(Duration::from_millis(1500)).await;
    rows.push(judged("disconnected and not resumed", &seen, &server, &run).await);
    cancel(&server, &run).await;
    rows.push(judged("disconnected, then cancelled", &seen, &server, &run).await);
    rows
}

async fn expired() -> Vec<String> {
    let server = server(|phase| phase.time.run_s = 3).await;
    let mut rows = Vec::new();
    let ways = [(false, "wall time used up before the first `Ready`"), (true, "wall time used up after it")];
    for (begins, end) in ways {
        let (run, mut play) = begin(&server.agents_url(), &server.token).await;
        let mut seen = Seen::default();
        if begins {
            seen.episode(&mut play, 0).await;
        }
        sleep(Duration::from_secs(5)).await;
        rows.push(judged(end, &seen, &server, &run).await);
    }
    rows
}

async fn lost_by_the_server() -> Vec<String> {
    let mut rows = Vec::new();
    let server = disturbed(at_first(3, || panic!("a fault of the simulator"))).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut seen = Seen::default();
    while seen.episode(&mut play, 1).await {}
    rows.push(judged("an episode lost by the server three times", &seen, &server, &run).await);

    let server = disturbed(at_first(1, || panic!("a fault of the simulator"))).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut seen = Seen::default();
    seen.episode(&mut play, 1).await;
    cancel(&server, &run).await;
    rows.push(judged("cancelled after the server lost the only episode", &seen, &server, &run).await);
    rows
}

async fn cancelled_without_server() -> Vec<String> {
    let server = server(|_| ()).await;
    let (run, mut play) = begin(&server.agents_url(), &server.token).await;
    let mut seen = Seen::default();
    seen.episode(&mut play, 0).await;
    let TestServer { folder, servers, .. } = server;
    servers.close().await.expect("a shutdown");
    let store = store(folder.path()).await;
    assert_eq!(
        store.running_episodes().await.expect("a list").len(),
        1,
        "its result comes at the next start"
    );
    let state = store.cancel_run(&run.id, now_unix_ms()).await.expect("the run").state;
    let charged = store.charge(&run.id).await.expect("a charge").charged;
    vec![row("cancelled while the server is stopped, with an open episode", &seen, state, charged)]
}

#[tokio::test(flavor = "multi_thread")]
async fn protocol_lists_every_end_with_its_charge() {
    let rows = [
        played_to_the_end().await,
        cancelled().await,
        cancelled_without_server().await,
        left_open().await,
        expired().await,
        lost_by_the_server().await,
    ];
    let rows = rows.concat();
    let free = ["lost by the server", "server lost", "| nothing | `CANCELLED`", "| nothing | `EXPIRED`"];
    for row in &rows {
        let is_free = free.iter().any(|words| row.contains(words));
        assert_eq!(row.ends_with("| no |\n"), is_free, "a look at a mission is charged: {row}");
    }
    let page = text(PAGE);
    let (before, rest) = page.split_once(HEAD).expect("the table of charges");
    let after: String = rest.split_inclusive('\n').skip_while(|line| line.starts_with('|')).collect();
    let expected = format!("{before}{HEAD}{}{after}", rows.concat());
    if std::env::var_os("AVLN_BLESS").is_some() {
        std::fs::write(root().join(PAGE), &expected).expect("the page can be written");
    }
    assert_eq!(text(PAGE), expected, "run AVLN_BLESS=1 cargo test -p avln-tests charges");
}

/// Pictures of 10 MiB in the memory of a session.
const LARGE: Sensors = Sensors { rgb: true, width: 512, height: 512, ..NO_SENSORS };
/// Pictures of 40 MiB.
const HUGE: Sensors = Sensors { width: 1024, height: 1024, ..LARGE };

async fn begin_seeing(url: &str, token: &str, sensors: Sensors, slots: u32) -> (Run, Vec<Play>) {
    let client = Client::connect(url, token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, "m").order(Order::Unordered)).await.expect("a run");
    let plays = client.play_slots(&run, sensors, slots).await.expect("a stream");
    (run, plays)
}

/// Data folder with two episodes in a house, and the team's token.
async fn house() -> (TempDir, String) {
    set_up_with(|phase| {
        (phase.sensors.width, phase.sensors.height, phase.sensors.audio) = (1024, 1024, false);
    })
    .await
}

async fn with_memory(folder: TempDir, token: String, session_memory_mib: u32) -> TestServer {
    let budget = Budget { session_memory_mib, ..Budget::default() };
    TestServer::open_with(folder, token, |arena| arena.with_budget(budget), |limits| limits).await
}

async fn charge(folder: &Path, run: &Run) -> bool {
    store(folder).await.charge(&run.id).await.expect("a charge").charged
}

#[tokio::test(flavor = "multi_thread")]
async fn slots_without_memory_wait_and_count() {
    let (folder, token) = house().await;
    // One episode is charged 32 MiB for the house and 10 MiB for the pictures.
    let server = with_memory(folder, token, 64).await;
    let (run, mut plays) = begin_seeing(&server.agents_url(), &server.token, LARGE, 2).await;
    let (mut right, mut left) = (plays.pop().expect("two slots"), plays.pop().expect("two slots"));
    let mut first = left.next_episode().await.expect("an answer").expect("an episode");
    let mut waiting = pin!(right.next_episode());
    assert!(timeout(Duration::from_secs(2), waiting.as_mut()).await.is_err(), "no fault and no episode");
    first.step(Action::Stop).await.expect("a whole episode");
    let mut second = waiting.await.expect("an answer").expect("an episode");
    second.step(Action::Stop).await.expect("a whole episode");
    play_on(left).await.expect("the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected, "slots make no run free");
}

#[tokio::test(flavor = "multi_thread")]
async fn pictures_beyond_the_memory_are_refused() {
    let (folder, token) = house().await;
    let server = with_memory(folder, token, 64).await;
    let (run, mut plays) = begin_seeing(&server.agents_url(), &server.token, HUGE, 1).await;
    for _ in 0..4 {
        let Err(refused) = plays[0].next_episode().await else { panic!("an episode without memory began") };
        assert_eq!(refused.reason(), Some(Reason::SensorNotAllowed), "{refused}");
        assert!(!refused.to_string().contains("MiB"), "how large a scene is is hidden: {refused}");
    }
    assert!(charge(server.folder.path(), &run).await, "it is open");
    cancel(&server, &run).await;
    assert!(!charge(server.folder.path(), &run).await, "no mission was sent");
    let (run, play) = begin(&server.agents_url(), &server.token).await;
    play_on(play).await.expect("without pictures to the end");
    let expected = expect("stopped stopped", RunState::Completed, true);
    assert_eq!(verdict(server.folder.path(), &run.id).await, expected);
}

/// A server whose phase allows a team one open run.
async fn single_run_server() -> TestServer {
    let folder = tempfile::tempdir().expect("a folder");
    let token = set_up(folder.path(), &TestSetup::default()).await;
    change_phase(folder.path(), |phase| phase.quotas.concurrent = Some(1)).await;
    TestServer::open_with(folder, token, |arena| arena, |limits| limits).await
}

async fn start(server: &TestServer) -> (Client, Run) {
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, "leaver")).await.expect("a run");
    (client, run)
}

#[tokio::test(flavor = "multi_thread")]
async fn goodbye_before_an_episode_is_free() {
    let server = single_run_server().await;
    let (client, run) = start(&server).await;
    let refused = client.start_run(RunOptions::new(PHASE, "leaver")).await.expect_err("a run is open");
    assert_eq!(refused.reason(), Some(Reason::QuotaConcurrent), "{refused}");
    let play = client.play(&run, NO_SENSORS).await.expect("a stream");
    let summary = play.finish().await.expect("a summary");
    assert!(!summary.complete && summary.ends.is_empty(), "{summary:?}");
    let status = client.run(&run.id).await.expect("the run");
    assert_eq!((status.state, status.charged), (avln_client::RunState::Cancelled, false), "{status:?}");
    // An agent that has seen a mission is charged.
    let (client, run) = start(&server).await;
    let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
    play.next_episode().await.expect("an answer").expect("an episode");
    let summary = play.finish().await.expect("a summary");
    assert_eq!(summary.ends, [(EndReason::Abandoned, 1)]);
    assert!(client.run(&run.id).await.expect("the run").charged);
    start(&server).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn goodbye_after_an_episode_ends_the_run() {
    let server = single_run_server().await;
    let (client, run) = start(&server).await;
    let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    episode.step(Action::Stop).await.expect("a legal step");
    let summary = play.finish().await.expect("a summary");
    assert_eq!((summary.complete, summary.progress.done), (false, 1));
    let status = client.run(&run.id).await.expect("the run");
    assert_eq!((status.state, status.charged), (avln_client::RunState::Cancelled, true), "{status:?}");
    let over = client.play(&run, NO_SENSORS).await.expect_err("the run is over");
    assert_eq!(over.reason(), Some(Reason::RunOver), "{over}");
    start(&server).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn unary_callers_learn_the_end_repeatedly() {
    let server = TestServer::open(&TestSetup::default()).await;
    let (client, run) = start(&server).await;
    let mut caller = RawClient::connect(&server.agents_url(), &run.token).await;
    for _ in 0..2 {
        caller.play(&[MOVE_FORWARD], false).await.expect("an episode");
    }
    for _ in 0..2 {
        assert_eq!(caller.reset().await.expect("the end"), Some(true));
        assert!(caller.leave().await.expect("the end"));
    }
    assert_eq!(client.run(&run.id).await.expect("the run").state, avln_client::RunState::Completed);
}

#[tokio::test(flavor = "multi_thread")]
async fn unary_goodbye_ends_the_run() {
    let server = single_run_server().await;
    let (client, run) = start(&server).await;
    let mut caller = RawClient::connect(&server.agents_url(), &run.token).await;
    caller.play(&[MOVE_FORWARD], true).await.expect("an episode");
    assert_eq!(client.run(&run.id).await.expect("the run").state, avln_client::RunState::Cancelled);
    assert!(!caller.leave().await.expect("the end again"));
    assert_eq!(caller.reset().await.expect("the end again"), Some(false));
    start(&server).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn late_clients_learn_steps_in_hidden_phases() {
    let setup = TestSetup { missions: 1, visible_to: Visibility::Organiser, ..TestSetup::default() };
    let server = TestServer::open(&setup).await;
    let (client, run) = start(&server).await;
    let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    let id = episode.id().to_owned();
    episode.step(Action::TurnLeft).await.expect("a legal step");
    episode.step(Action::Stop).await.expect("a legal step");
    play.finish().await.expect("a summary");
    let mut late = RawClient::connect(&server.agents_url(), &run.token).await;
    assert_eq!(late.late_result(&id).await.expect("the result"), (2, 1));
}
