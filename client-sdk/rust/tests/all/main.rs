//! Tests against scripted servers: connecting, playing, and everything around it.

mod conversation;
mod fake;

use avln_client::{Client, Error, Order, PhaseState, QuotaWindow, Reason, RunOptions, RunState};
use fake::{TOKEN, serve};
use std::io::{Read, Write};

async fn connect() -> Client {
    Client::connect(serve(|_| async {}).await, TOKEN).await.unwrap()
}

#[tokio::test]
async fn bad_token_error_names_the_flag() {
    let address = serve(|_| async {}).await;
    let error = Client::connect(&address, "bad").await.unwrap_err();
    assert_eq!(error.reason(), Some(Reason::TokenMalformed));
    assert!(error.to_string().contains("--token"), "{error}");
}

#[tokio::test]
async fn closed_port_error_names_the_flag() {
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let error = Client::connect(format!("http://127.0.0.1:{port}"), TOKEN).await.unwrap_err();
    assert!(matches!(error, Error::Unreachable { .. }), "{error}");
    assert!(error.to_string().contains("--server"), "{error}");
}

#[tokio::test]
async fn a_web_port_is_recognised() {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    std::thread::spawn(move || {
        let (mut peer, _) = listener.accept().unwrap();
        let _ = peer.read(&mut [0; 1024]);
        let _ = peer.write_all(b"HTTP/1.1 400 Bad Request\r\nconnection: close\r\n\r\n");
    });
    let error = Client::connect(&address, TOKEN).await.unwrap_err();
    assert!(matches!(error, Error::NotArena { .. }), "{error}");
    assert!(error.to_string().contains("instead of the web port"), "{error}");
}

#[tokio::test]
async fn server_and_phases_are_public() {
    let client = Client::connect(serve(|_| async {}).await, "").await.unwrap();
    assert_eq!(client.server_info().await.unwrap().name, "fake");
    let phases = client.phases().await.unwrap();
    assert_eq!(
        (phases[0].id.as_str(), phases[0].state, phases[0].episodes),
        ("practice", PhaseState::Open, 2)
    );
    assert_eq!(phases[0].orders, [Order::Ordered, Order::Unordered]);
}

#[tokio::test]
async fn an_unknown_phase_is_refused_with_its_reason() {
    let error = connect().await.start_run(RunOptions::new("moon", "walker")).await.unwrap_err();
    assert_eq!(error.reason(), Some(Reason::PhaseUnknown));
    assert!(error.to_string().starts_with("start a run"), "{error}");
}

#[tokio::test]
async fn team_sees_runs_and_quota() {
    let client = connect().await;
    assert_eq!(client.whoami().await.unwrap().team, "red");
    assert_eq!(client.run("run_9").await.unwrap().id, "run_9");
    let ids: Vec<_> = client.runs().await.unwrap().into_iter().map(|run| run.id).collect();
    assert_eq!(ids, ["run_2", "run_1"]);
    assert_eq!(client.cancel_run("run_1").await.unwrap().state, RunState::Cancelled);
    let quota = &client.quota().await.unwrap()[0];
    assert_eq!((quota.window, quota.used, quota.limit), (QuotaWindow::Day, 3, None));
}

#[tokio::test]
async fn watch_ends_with_the_run() {
    let mut watch = connect().await.watch("run_1").await.unwrap();
    let mut states = Vec::new();
    while let Some(run) = watch.next().await.unwrap() {
        states.push(run.state);
    }
    assert_eq!(states, [RunState::Running, RunState::Completed]);
    assert!(states[1].is_over());
}
