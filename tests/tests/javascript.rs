//! The example client in JavaScript plays runs on this program.

use avln_tests::{
    PHASE, TestServer, TestSetup,
    machine::{root, skipped, text},
    proxies::FaultProxy,
};
use std::{
    io::{BufRead, BufReader, Read},
    process::{Command, Output, Stdio},
    time::Duration,
};
use tokio::{task::spawn_blocking, time::sleep};

const PROGRAM: &str = env!("CARGO_BIN_EXE_avln_under_test");
const FOLDER: &str = "client-sdk/javascript";
const REMEDY: &str = "install Node 20 and run `npm ci` in client-sdk/javascript";

/// Words in PROTOCOL.md and keys in the client for reactions to a refusal; the client stops after others.
const REACTIONS: [(&str, &str); 3] = [("wait", "wait"), ("`Ready`", "ready"), ("resume", "resume")];

/// The client, as a command; `None` without Node or the client's packages.
fn client(test: &str, server: &str, token: &str) -> Option<Command> {
    let folder = root().join(FOLDER);
    let mut version = Command::new("node");
    let version = version.arg("--version").stdout(Stdio::null()).status();
    if !version.is_ok_and(|status| status.success()) || !folder.join("node_modules").exists() {
        skipped(&format!("{test} of {FOLDER}"), REMEDY);
        return None;
    }
    let mut client = Command::new("node");
    client.args(["play.mjs", "--server", server, "--token", token]).current_dir(folder).stdin(Stdio::null());
    // A proxy of the machine cannot reach this test.
    client.env("no_grpc_proxy", "127.0.0.1");
    Some(client)
}

async fn server() -> TestServer {
    TestServer::open(&TestSetup { missions: 4, ..TestSetup::default() }).await
}

fn shown(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// Plays a run to its summary; returns the output and the digests of the sensors, sorted.
async fn play(mut client: Command, options: &[&str]) -> (String, Vec<String>) {
    client.args(["--phase", PHASE, "--digest", "--steps", "150", "--side", "64"]).args(options);
    let output = spawn_blocking(move || client.output().expect("Node starts")).await.expect("no panic");
    let text = shown(&output);
    assert!(output.status.success() && text.contains("4 of 4 episodes, complete"), "{text}");
    let digests = text.lines().filter_map(|line| line.split_once(", sensors "));
    let mut digests: Vec<_> = digests.map(|(_, digest)| digest.to_owned()).collect();
    digests.sort();
    assert_eq!(digests.len(), 4, "{text}");
    (text, digests)
}

#[tokio::test(flavor = "multi_thread")]
async fn packed_images_equal_raw_images() {
    let server = server().await;
    let test = "packed_images_equal_raw_images";
    let Some(packed) = client(test, &server.agents_url(), &server.token) else { return };
    let Some(raw) = client(test, &server.agents_url(), &server.token) else { return };
    let (_, packed) = play(packed, &["--slots", "2"]).await;
    let (_, raw) = play(raw, &["--slots", "2", "--encoding", "raw"]).await;
    assert_eq!(packed, raw);
}

#[tokio::test(flavor = "multi_thread")]
async fn cut_connections_change_no_observation() {
    let server = server().await;
    let test = "cut_connections_change_no_observation";
    let proxy = FaultProxy::open(server.servers.grpc).await;
    let Some(calm) = client(test, &server.agents_url(), &server.token) else { return };
    let Some(stormy) = client(test, &proxy.url(), &server.token) else { return };
    let (_, calm) = play(calm, &["--slots", "2"]).await;
    let playing = tokio::spawn(async move { play(stormy, &["--slots", "2"]).await });
    let mut pause_ms = 60;
    while !playing.is_finished() {
        sleep(Duration::from_millis(pause_ms)).await;
        proxy.cut();
        // Growing, so that slow machines also make progress.
        pause_ms += 5;
    }
    let (text, stormy) = playing.await.expect("no panic");
    let resumed = text.lines().filter(|line| line.ends_with("; resume")).count();
    assert!(resumed >= 3, "{text}");
    assert_eq!(stormy, calm);
}

#[tokio::test(flavor = "multi_thread")]
async fn unary_run_equals_a_stream() {
    let server = server().await;
    let test = "unary_run_equals_a_stream";
    let Some(stream) = client(test, &server.agents_url(), &server.token) else { return };
    let Some(unary) = client(test, &server.agents_url(), &server.token) else { return };
    let (_, stream) = play(stream, &[]).await;
    let (_, unary) = play(unary, &["--unary"]).await;
    assert_eq!(unary, stream);
}

#[tokio::test(flavor = "multi_thread")]
async fn refusals_are_shown_with_their_reason() {
    let server = server().await;
    let test = "refusals_are_shown_with_their_reason";
    for (token, phase, reason) in
        [("nonsense", PHASE, "TOKEN_MALFORMED"), (server.token.as_str(), "other", "PHASE_UNKNOWN")]
    {
        let Some(mut client) = client(test, &server.agents_url(), token) else { return };
        client.args(["--phase", phase]);
        let output = spawn_blocking(move || client.output().expect("Node starts")).await.expect("no panic");
        let text = shown(&output);
        assert!(output.status.code() == Some(1) && text.contains(reason), "{text}");
    }
}

#[test]
fn client_survives_every_kit_fault() {
    let test = "client_survives_every_kit_fault";
    if client(test, "", "").is_none() {
        return;
    }
    let mut kit = Command::new(PROGRAM);
    kit.args(["lab", "conformance", "--client", "127.0.0.1:0"]).stdout(Stdio::piped());
    let mut kit = kit.spawn().expect("the program runs");
    let mut reader = BufReader::new(kit.stdout.take().expect("its output"));
    let mut report = String::new();
    reader.read_line(&mut report).expect("an address");
    let url = report.split_whitespace().last().expect("an address").to_owned();
    let mut client = client(test, &url, "any").expect("it was here before");
    let played = client.args(["--phase", "any"]).output().expect("Node starts");
    if !played.status.success() {
        // A kit without a client waits for ever.
        kit.kill().expect("it runs");
    }
    reader.read_to_string(&mut report).expect("its checks");
    let is_passed = kit.wait().expect("it ends").success();
    assert!(is_passed && report.contains("none broken"), "{report}\n{}", shown(&played));
}

#[test]
fn client_reacts_as_the_protocol_demands() {
    let (page, client) = (text("proto/PROTOCOL.md"), text(format!("{FOLDER}/play.mjs")));
    let (_, refusals) = page.split_once("## Refusals").expect("the table of refusals");
    let rows: Vec<Vec<_>> = refusals
        .lines()
        .filter(|line| line.starts_with("| `"))
        .map(|line| line.split('|').map(str::trim).collect())
        .collect();
    assert!(rows.len() > 30, "{} reasons", rows.len());
    for row in rows {
        let reason = format!("'{}'", row[1].trim_matches('`'));
        for (word, key) in REACTIONS {
            let list = format!("{key}: [");
            let mut lists = client.lines().filter(|line| line.trim_start().starts_with(&list));
            let is_listed = lists.any(|line| line.contains(&reason));
            assert_eq!(is_listed, row[4].starts_with(word), "{reason}: {word}");
        }
    }
}
