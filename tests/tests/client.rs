//! The Rust client's stream of episodes, and its calls while a server is away.

use avln_client::{Action, Client, EndReason, Episode, Error, Order, RunOptions};
use avln_tests::scripted_run::NO_SENSORS;
use avln_tests::{PHASE, TestServer, TestSetup, fault_proxy::FaultProxy};
use std::{net::SocketAddr, time::Duration};
use tokio::time::{sleep, timeout};
use tokio_stream::StreamExt;

async fn house(missions: usize) -> TestServer {
    TestServer::open(&TestSetup { houses: 1, missions, ..TestSetup::default() }).await
}

fn options() -> RunOptions {
    RunOptions::new(PHASE, "streamer").order(Order::Unordered)
}

/// One step, and a Stop.
async fn play(mut episode: Episode<'static>) -> Result<EndReason, Error> {
    episode.step(Action::TurnLeft).await?;
    episode.step(Action::Stop).await?;
    Ok(episode.end().expect("it is over").reason)
}

#[tokio::test(flavor = "multi_thread")]
async fn episodes_are_a_stream_that_ends_with_the_run() {
    let house = house(3).await;
    let arena = Client::connect(house.agents_url(), &house.token).await.expect("the door is open");
    let run = arena.start_run(options()).await.expect("a run");
    let mut episodes = arena.play(&run, NO_SENSORS).await.expect("a stream").episodes();
    assert_eq!(episodes.task().rules, "lh-avln-v1");
    let mut ends = Vec::new();
    while let Some(episode) = episodes.try_next().await.expect("an answer") {
        // It borrows nothing: another task can play it.
        ends.push(tokio::spawn(play(episode)).await.expect("no panic").expect("to its end"));
    }
    assert_eq!(ends, [EndReason::Stopped; 3]);
    assert!(episodes.next().await.is_none(), "it has ended for good");
    let summary = episodes.finish().await.expect("a summary");
    assert!(summary.complete && summary.ends == [(EndReason::Stopped, 3)], "{summary:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_next_episode_waits_for_the_one_before_and_gives_it_up_where_it_is_open() {
    let house = house(2).await;
    let arena = Client::connect(house.agents_url(), &house.token).await.expect("the door is open");
    let run = arena.start_run(options()).await.expect("a run");
    let mut episodes = arena.play(&run, NO_SENSORS).await.expect("a stream").episodes();
    let first = episodes.try_next().await.expect("an answer").expect("an episode");
    assert!(timeout(Duration::from_millis(200), episodes.next()).await.is_err(), "one at a time");
    drop(first);
    let second = episodes.try_next().await.expect("an answer").expect("another episode");
    assert_eq!(second.ordinal(), 2);
    assert_eq!(second.progress().done, 1, "the first was given up");
    drop(second);
    let summary = episodes.finish().await.expect("a summary");
    assert_eq!(summary.ends, [(EndReason::Abandoned, 2)]);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stream_goes_on_over_a_lost_connection_and_ends_after_an_error() {
    let house = house(2).await;
    let wire = FaultProxy::open(house.doors.grpc).await;
    let arena = Client::connect(wire.url(), &house.token).await.expect("the door is open");
    let run = arena.start_run(options()).await.expect("a run");
    let mut episodes = arena.play(&run, NO_SENSORS).await.expect("a stream").episodes();
    let mut first = episodes.try_next().await.expect("an answer").expect("an episode");
    wire.cut();
    first.step(Action::TurnLeft).await.expect("the client comes back");
    drop(first);
    let cancelled = arena.cancel_run(&run.id).await.expect("it is its own");
    assert_eq!(cancelled.progress.in_flight, 0);
    let mut items = Vec::new();
    while let Some(item) = episodes.next().await {
        items.push(item.map(|episode| episode.ordinal()));
    }
    assert!(items.len() <= 1 && items.iter().all(Result::is_err), "{items:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn calls_wait_for_a_server_that_is_away_for_a_while_and_begin_one_run() {
    let house = house(1).await;
    let wire = FaultProxy::open(house.doors.grpc).await;
    let arena = Client::connect(wire.url(), &house.token).await.expect("the door is open");
    let nowhere = SocketAddr::from(([127, 0, 0, 1], 9));
    for call in 0..2 {
        wire.redirect(nowhere);
        wire.cut();
        let asking = {
            let arena = arena.clone();
            tokio::spawn(async move {
                match call {
                    0 => arena.start_run(options()).await.map(|_| ()),
                    _ => arena.quota().await.map(|_| ()),
                }
            })
        };
        sleep(Duration::from_millis(500)).await;
        assert!(!asking.is_finished(), "it waits");
        wire.redirect(house.doors.grpc);
        asking.await.expect("no panic").expect("an answer in the end");
    }
    assert_eq!(arena.runs().await.expect("a list").len(), 1);
}
