//! An agent that leaves ends its run: state, charge, quota, and the answers to a late caller.

use avln_client::{Action, Client, EndReason, Reason, Run, RunOptions, RunState};
use avln_store::Visibility;
use avln_tests::scripted_run::NO_SENSORS;
use avln_tests::{
    PHASE, TestServer, TestSetup, change_phase,
    raw::{MOVE_FORWARD, RawClient},
    set_up,
};

/// A server whose phase allows a team one open run.
async fn server() -> TestServer {
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
    let server = server().await;
    let (client, run) = start(&server).await;
    let refused = client.start_run(RunOptions::new(PHASE, "leaver")).await.expect_err("a run is open");
    assert_eq!(refused.reason(), Some(Reason::QuotaConcurrent), "{refused}");
    let play = client.play(&run, NO_SENSORS).await.expect("a stream");
    let summary = play.finish().await.expect("a summary");
    assert!(!summary.complete && summary.ends.is_empty(), "{summary:?}");
    let status = client.run(&run.id).await.expect("the run");
    assert_eq!((status.state, status.charged), (RunState::Cancelled, false), "{status:?}");
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
    let server = server().await;
    let (client, run) = start(&server).await;
    let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("an answer").expect("an episode");
    episode.step(Action::Stop).await.expect("a legal step");
    let summary = play.finish().await.expect("a summary");
    assert_eq!((summary.complete, summary.progress.done), (false, 1));
    let status = client.run(&run.id).await.expect("the run");
    assert_eq!((status.state, status.charged), (RunState::Cancelled, true), "{status:?}");
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
    assert_eq!(client.run(&run.id).await.expect("the run").state, RunState::Completed);
}

#[tokio::test(flavor = "multi_thread")]
async fn unary_goodbye_ends_the_run() {
    let server = server().await;
    let (client, run) = start(&server).await;
    let mut caller = RawClient::connect(&server.agents_url(), &run.token).await;
    caller.play(&[MOVE_FORWARD], true).await.expect("an episode");
    assert_eq!(client.run(&run.id).await.expect("the run").state, RunState::Cancelled);
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
