//! A person plays as agents do: through the page on the person's machine, by the same door, rules and budgets.

use avln_client::Order;
use avln_human::{HumanArgs, HumanError, RunArgs, run_with};
use avln_tests::{PHASE, TestServer, TestSetup, http};
use serde_json::Value;
use std::net::SocketAddr;
use tokio::{
    io::{AsyncReadExt, AsyncWriteExt},
    net::TcpStream,
    sync::oneshot,
};

fn args(house: &TestServer, page: &str) -> HumanArgs {
    let run = RunArgs {
        server: format!("http://{}", house.doors.grpc),
        ca: None,
        token: house.token.clone(),
        phase: PHASE.to_owned(),
        order: Order::Unordered,
    };
    HumanArgs { run, size: 64, page: page.parse().expect("an address") }
}

/// What the page would be told when the person wants something: the text, and the bytes after it.
async fn request(page: SocketAddr, word: &str) -> (Value, usize) {
    let mut stream = TcpStream::connect(page).await.expect("the page is there");
    let text = format!(
        "POST /request/{word} HTTP/1.1\r\nHost: {page}\r\nX-Avln-Page: 1\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
    );
    stream.write_all(text.as_bytes()).await.expect("it listens");
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).await.expect("it answers");
    let head = answer.windows(4).position(|window| window == b"\r\n\r\n").expect("a head") + 4;
    let body = &answer[head..];
    let length = u32::from_le_bytes(body[..4].try_into().expect("four bytes")) as usize;
    let told = serde_json::from_slice(&body[4..4 + length]).expect("JSON");
    (told, body.len() - 4 - length)
}

/// Plays an episode that has begun: some steps, and as many claims as end it.
async fn play(page: SocketAddr, begun: &Value) -> Value {
    let goals = begun["goals"].as_array().expect("goals").len() as u64;
    assert_eq!((begun["step"].as_u64(), begun["remaining_submits"].as_u64()), (Some(0), Some(goals - 1)));
    for (step, word) in (1..).zip(["left", "forward", "right"]) {
        let (told, bytes) = request(page, word).await;
        assert_eq!((told["state"].as_str(), told["step"].as_u64()), (Some("playing"), Some(step)));
        let samples = told["senses"]["audio"][1].as_u64().expect("sound") as usize;
        assert_eq!(bytes, 64 * 64 * (3 + 4) + 2 * 4 * samples, "colours, depth and both ears");
    }
    let mut told = Value::Null;
    for _ in 0..goals {
        told = request(page, "submit").await.0;
    }
    told
}

#[tokio::test(flavor = "multi_thread")]
async fn a_person_plays_a_run_that_stands_on_the_board() {
    let house = TestServer::open(&TestSetup::default()).await;
    let (found, page) = oneshot::channel();
    let options = args(&house, "127.0.0.1:0");
    let run = tokio::spawn(async move {
        let on_page = |address| found.send(address).expect("somebody asks");
        run_with(options, on_page, &mut |_| {}).await
    });
    let page = page.await.expect("a page");
    let (before, _) = request(page, "look").await;
    assert_eq!((before["state"].as_str(), before["progress"]["total"].as_u64()), (Some("waiting"), Some(2)));
    for episode in 1..=2 {
        let (begun, bytes) = request(page, "next").await;
        assert_eq!((begun["state"].as_str(), begun["episode"].as_u64()), (Some("playing"), Some(episode)));
        assert_eq!(request(page, "look").await, (begun.clone(), bytes), "looking changes nothing");
        let ended = play(page, &begun).await;
        assert_eq!(
            (ended["state"].as_str(), ended["end"]["steps"].as_u64()),
            (Some("waiting"), Some(3 + begun["goals"].as_array().map_or(0, Vec::len) as u64))
        );
    }
    assert_eq!(request(page, "next").await.0["state"], "over");
    let summary = run.await.expect("no panic").expect("a summary");
    assert!(summary.complete, "{summary:?}");
    let board = http::get(house.doors.web, &format!("/leaderboard/{PHASE}?order=unordered")).await;
    assert!(
        board.body.contains(">human</a>") && board.body.contains("colour, depth, sound"),
        "{}",
        board.body
    );
}

#[tokio::test(flavor = "multi_thread")]
async fn the_page_is_for_this_machine_alone() {
    let house = TestServer::open(&TestSetup::default()).await;
    let open = run_with(args(&house, "0.0.0.0:0"), |_| {}, &mut |_| {}).await;
    assert!(matches!(open, Err(HumanError::Open(_))), "{open:?}");
    let taken = house.doors.web.to_string();
    let taken = run_with(args(&house, &taken), |_| {}, &mut |_| {}).await;
    assert!(matches!(taken, Err(HumanError::Page { .. })), "{taken:?}");
}
