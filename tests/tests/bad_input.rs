//! Invalid agent input is answered with an error and changes neither the server nor a score.

use avln_client::{Action, Client, EndReason, Error, Reason, Run, RunOptions, RunState, Sensors};
use avln_tests::{
    PHASE, TestServer, TestSetup,
    clients::NO_SENSORS,
    clients::RawClient,
    http,
    proxies::{self, RecordingProxy},
};
use std::{net::SocketAddr, time::Duration};
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    time::timeout,
};

/// Long enough for a busy machine; only a test that fails waits for so long.
const PATIENCE: Duration = Duration::from_secs(60);

async fn start(server: &TestServer) -> (Client, Run) {
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, "clumsy")).await.expect("a run");
    (client, run)
}

async fn play_one(client: &Client, run: &Run) -> avln_client::EpisodeEnd {
    let mut play = client.play(run, NO_SENSORS).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("the run goes on").expect("an episode is left");
    episode.step(Action::MoveForward).await.expect("a legal step");
    episode.step(Action::Stop).await.expect("a legal step");
    episode.end().expect("a Stop ends").clone()
}

#[tokio::test(flavor = "multi_thread")]
async fn unusable_tokens_are_rejected_with_hint() {
    let server = TestServer::open(&TestSetup::default()).await;
    let refused =
        Client::connect(server.agents_url(), "avln_account_wrong").await.expect_err("a wrong token");
    assert!(matches!(&refused, Error::Token { reason: Reason::TokenMalformed, .. }), "{refused}");
    assert!(refused.to_string().contains("--token"), "{refused}");

    let nobody =
        Client::connect(server.agents_url(), "").await.expect("asking what a server is needs no token");
    let refused = nobody.start_run(RunOptions::new(PHASE, "clumsy")).await.expect_err("a missing token");
    assert!(matches!(refused, Error::Token { .. }), "{refused}");

    let refused =
        nobody.play(&Run::from_token(&server.token), NO_SENSORS).await.expect_err("a token of another kind");
    assert!(matches!(refused, Error::Token { .. }), "{refused}");
    let kinds = "this is an account token; this call needs the run token";
    assert!(refused.to_string().contains(kinds), "{refused}");
}

#[tokio::test(flavor = "multi_thread")]
async fn unknown_phase_error_lists_known_phases() {
    let server = TestServer::open(&TestSetup::default()).await;
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    let refused = client.start_run(RunOptions::new("finals", "clumsy")).await.expect_err("no such phase");
    assert_eq!(refused.reason(), Some(Reason::PhaseUnknown), "{refused}");
    assert!(refused.to_string().contains("'finals'") && refused.to_string().contains(PHASE), "{refused}");
    let mut raw = RawClient::connect(&server.agents_url(), &server.token).await;
    raw.quota(PHASE).await.expect("its quota");
    let refused = raw.quota("finals").await.expect_err("no such phase");
    assert!(refused.message().contains("'finals'") && refused.message().contains(PHASE), "{refused}");
    let refused = client.run("run_of_nobody").await.expect_err("no such run");
    assert_eq!(refused.reason(), Some(Reason::RunUnknown), "{refused}");
}

#[tokio::test(flavor = "multi_thread")]
async fn rejected_sensors_leave_the_run_playable() {
    let server = TestServer::open(&TestSetup::default()).await;
    let (client, run) = start(&server).await;
    let absurd = client.play(&run, Sensors::square(4096)).await.expect_err("more than any server offers");
    assert!(matches!(absurd, Error::Sensors { width: 4096, .. }), "{absurd}");
    let refused = client.play(&run, Sensors::square(512)).await.expect_err("more than the phase allows");
    assert_eq!(refused.reason(), Some(Reason::SensorNotAllowed), "{refused}");
    let limits = "the phase allows at most 256 x 256, RGB + DEPTH + AUDIO; requested: 512 x 512";
    assert!(refused.to_string().contains(limits), "{refused}");
    assert_eq!(play_one(&client, &run).await.reason, EndReason::Stopped);
}

#[tokio::test(flavor = "multi_thread")]
async fn illegal_steps_are_rejected_and_episode_continues() {
    let server = TestServer::open(&TestSetup::default()).await;
    let proxy = RecordingProxy::open(server.servers.grpc).await;
    let client = Client::connect(proxy.url(), &server.token).await.expect("a connection");
    let run = client.start_run(RunOptions::new(PHASE, "clumsy")).await.expect("a run");
    let mut play = client.play(&run, NO_SENSORS).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
    for (spoiler, reason) in
        [(proxies::illegal_action(), Reason::ActionOutOfRange), (proxies::wrong_step(9), Reason::StepAhead)]
    {
        proxy.corrupt(spoiler);
        let step = timeout(PATIENCE, episode.step(Action::MoveForward)).await.expect("an answer");
        let refused = step.expect_err("a spoiled step");
        assert_eq!(refused.reason(), Some(reason), "{refused}");
        assert!(!episode.is_over());
    }
    episode.step(Action::MoveForward).await.expect("a legal step");
    assert_eq!(episode.observation().step, 1, "refused steps do not count");
    episode.step(Action::Stop).await.expect("a legal step");
    assert_eq!(episode.end().map(|end| end.reason), Some(EndReason::Stopped));
}

#[tokio::test(flavor = "multi_thread")]
async fn vanished_client_loses_one_episode_of_its_run() {
    let server = TestServer::open(&TestSetup::default()).await;
    let proxy = RecordingProxy::open(server.servers.grpc).await;
    let vanishing = Client::connect(proxy.url(), &server.token).await.expect("a connection");
    let run = vanishing.start_run(RunOptions::new(PHASE, "clumsy")).await.expect("a run");
    let mut play = vanishing.play(&run, NO_SENSORS).await.expect("a stream");
    let mut episode = play.next_episode().await.expect("a stream").expect("an episode");
    episode.step(Action::MoveForward).await.expect("a legal step");
    let lost = episode.id().to_owned();
    proxy.cut();
    drop(play);

    let client = Client::connect(server.agents_url(), &server.token).await.expect("a connection");
    let end = timeout(PATIENCE, play_one(&client, &run)).await.expect("the next episode");
    assert_ne!(end.episode, lost);
    let status = client.run(&run.id).await.expect("the run");
    assert_eq!(status.progress.done, 2);
    assert_eq!(status.ends, [(EndReason::Stopped, 1), (EndReason::Disconnected, 1)]);
}

/// Sends `bytes` to a server and reads until it closes the connection or `PATIENCE` ends.
async fn shout(address: SocketAddr, bytes: &[u8]) {
    let mut stream = TcpStream::connect(address).await.expect("a connection");
    // The server may close the connection in the middle.
    let _ = stream.write_all(bytes).await;
    let _ = stream.shutdown().await;
    let mut answer = Vec::new();
    let ended = timeout(PATIENCE, stream.read_to_end(&mut answer)).await;
    assert!(ended.is_ok(), "the server {address} neither answers nor closes the connection");
}

/// An HTTP/2 connection whose first frame is shorter than its announced `length`.
fn oversized_frame(length: u32) -> Vec<u8> {
    let mut bytes = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec();
    bytes.extend_from_slice(&length.to_be_bytes()[1..]);
    bytes.extend_from_slice(&[0, 0, 0, 0, 0, 1]);
    bytes.resize(bytes.len() + (1 << 20), 0x55);
    bytes
}

#[tokio::test(flavor = "multi_thread")]
async fn random_bytes_and_idle_connections_are_harmless() {
    let server = TestServer::open(&TestSetup::default()).await;
    let (client, run) = start(&server).await;
    let mut idle = Vec::new();
    for address in [server.servers.grpc, server.servers.web] {
        for _ in 0..25 {
            idle.push(TcpStream::connect(address).await.expect("a connection"));
        }
        let noise: Vec<u8> = (0..100_000_u32).map(|n| (n.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        shout(address, &noise).await;
        shout(address, &oversized_frame(0x00ff_ffff)).await;
        shout(address, &[b"GET /".as_slice(), &vec![b'a'; 1 << 20]].concat()).await;
    }
    assert_eq!(play_one(&client, &run).await.reason, EndReason::Stopped);
    assert_eq!(http::get(server.servers.web, "/healthz").await.status, 200);
    assert_eq!(idle.len(), 50);
}

#[tokio::test(flavor = "multi_thread")]
async fn restarted_server_continues_the_run() {
    let server = TestServer::open(&TestSetup::default()).await;
    let (client, run) = start(&server).await;
    let first = play_one(&client, &run).await;
    drop(client);
    let server = timeout(PATIENCE, server.reopen()).await.expect("a shutdown in time");
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a second connection");
    assert_eq!(client.run(&run.id).await.expect("the run").progress.done, 1);
    let second = play_one(&client, &run).await;
    assert_ne!(first.episode, second.episode);
    let over = client.play(&run, NO_SENSORS).await.expect_err("both episodes were played");
    assert_eq!(over.reason(), Some(Reason::RunOver), "{over}");
    let scored = client.run(&run.id).await.expect("the run").metrics;
    assert!(scored.as_ref().is_some_and(|metrics| !metrics.is_empty()), "a public phase shows metrics");
    drop(client);
    let server = timeout(PATIENCE, server.reopen()).await.expect("a shutdown in time");
    let client = Client::connect(server.agents_url(), &server.token).await.expect("a second connection");
    let kept = client.run(&run.id).await.expect("the run");
    assert_eq!((kept.state, kept.progress.done), (RunState::Completed, 2));
    assert_eq!(kept.metrics, scored);
}
