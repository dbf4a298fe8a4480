//! Steps per second with one and sixteen slots, locally and at 50 ms round-trip time.
//!
//! `cargo bench -p avln-tests --bench slots`. Without sensors for the connection only, and with all sensors.

use avln_client::{Action, Client, Order, Play, RunOptions, Sensors};
use avln_tests::{PHASE, TestServer, TestSetup, clients::NO_SENSORS, proxies::FaultProxy};
use std::time::{Duration, Instant};
use tokio::task::JoinSet;

const ALL: Sensors = Sensors { rgb: true, depth: true, audio: true, width: 128, height: 128, hfov_rad: 1.57 };
/// Steps per slot.
const STEPS: usize = 120;
const WARM_UP: usize = 20;
/// One-way delay for a 50 ms round trip.
const FAR: Duration = Duration::from_millis(25);

#[tokio::main]
async fn main() {
    let server = TestServer::open(&TestSetup { houses: 1, missions: 32, ..TestSetup::default() }).await;
    println!("{:>16} {:>10} {:>8} {:>10}", "senses", "round trip", "slots", "steps/s");
    for (senses, sensors) in [("none", NO_SENSORS), ("all, 128 x 128", ALL)] {
        for delay in [Duration::ZERO, FAR] {
            let wire = FaultProxy::open_delayed(server.servers.grpc, delay).await;
            let client = Client::connect(wire.url(), &server.token).await.expect("a connection");
            for slots in [1, 16] {
                let rate = rate(&client, sensors.clone(), slots).await;
                println!("{senses:>16} {:>7} ms {slots:>8} {rate:>10.0}", 2 * delay.as_millis());
            }
        }
    }
}

/// Total steps per second.
async fn rate(client: &Client, sensors: Sensors, slots: u32) -> f64 {
    let options = RunOptions::new(PHASE, "slots").order(Order::Unordered);
    let run = client.start_run(options).await.expect("a run");
    let mut plays = client.play_slots(&run, sensors, slots).await.expect("a stream");
    plays = all(plays, WARM_UP).await;
    let begun = Instant::now();
    drop(all(plays, STEPS).await);
    let rate = f64::from(slots) * STEPS as f64 / begun.elapsed().as_secs_f64();
    client.cancel_run(&run.id).await.expect("it can be cancelled");
    rate
}

async fn all(plays: Vec<Play>, steps: usize) -> Vec<Play> {
    let players: JoinSet<_> = plays.into_iter().map(|play| turn_round(play, steps)).collect();
    players.join_all().await
}

async fn turn_round(mut play: Play, steps: usize) -> Play {
    let mut episode = play.next_episode().await.expect("no refusal").expect("an episode");
    for _ in 0..steps {
        episode.step(Action::TurnLeft).await.expect("a step");
    }
    play
}
