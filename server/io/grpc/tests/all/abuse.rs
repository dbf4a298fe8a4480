//! Hostile clients are bounded, and others play on.

use crate::common::{Agent, Attack, House, Plan, Siege, soon};
use avln_grpc::Limits;
use std::time::Duration;
use tokio::{io::AsyncReadExt, net::TcpStream, time::sleep};

const FORWARD: i32 = 1;

#[tokio::test(flavor = "multi_thread")]
async fn an_agent_plays_on_while_others_attack() {
    for attack in Attack::ALL {
        let house = House::open(Plan { max_steps: 1000, ..Plan::plain(2) }).await;
        let mut agent = Agent::enter(&house, 1).await;
        let start = agent.ready(0).await;
        let siege = Siege::lay(attack, house.address, 20);
        sleep(Duration::from_millis(200)).await;
        for step in 1..=50 {
            agent.act(0, &start.episode, step, FORWARD).await;
            assert_eq!(agent.observation().await.step, step, "{attack:?}");
        }
        let newcomer = TcpStream::connect(house.address).await;
        assert!(newcomer.is_ok(), "{attack:?}: nobody else gets in");
        drop(siege);
        agent.goodbye().await;
        agent.episode_end().await;
        agent.run_end().await;
        house.still_serves().await;
    }
}

/// A client that never says a whole request is closed in its time, even if it keeps saying something.
#[tokio::test]
async fn a_slow_client_does_not_hold_its_place() {
    let limits = Limits { first_request: Duration::from_millis(300), ..Limits::default() };
    let house = House::with_limits(Plan::plain(1), limits).await;
    let mut silent = TcpStream::connect(house.address).await.unwrap();
    let loris = tokio::spawn(Attack::SlowLoris.once(house.address));
    let mut rest = Vec::new();
    // The server says its settings and then closes, with or without a reset.
    let _ = soon(silent.read_to_end(&mut rest)).await;
    assert!(soon(loris).await.unwrap().is_err(), "the server closes while bytes still come");
}

/// Places are counted by address; who is over the limit is closed at once, and a place that is left is given again.
#[tokio::test]
async fn thousands_of_idle_connections_are_bounded() {
    let limits = Limits { max_connections: 64, max_connections_per_address: 64, ..Limits::default() };
    let house = House::with_limits(Plan::plain(1), limits).await;
    let mut idle = Vec::new();
    for _ in 0..64 {
        idle.push(TcpStream::connect(house.address).await.unwrap());
    }
    let mut refused = TcpStream::connect(house.address).await.unwrap();
    let mut rest = Vec::new();
    let _ = soon(refused.read_to_end(&mut rest)).await;
    assert!(rest.is_empty(), "one more than there are places is told nothing");
    drop(idle);
    soon(async {
        while !house.answers().await {
            sleep(Duration::from_millis(20)).await;
        }
    })
    .await;
    house.still_serves().await;
}
