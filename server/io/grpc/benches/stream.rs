//! Transport over loopback without simulation: steps per second, or with the argument `attacks` the step latency while 100
//! hostile clients attack.

#[allow(dead_code, unused_imports, reason = "the tests use more of the toy host")]
#[path = "../tests/all/common/mod.rs"]
mod common;

use common::{Agent, Attack, Plan, Siege, TestServer};
use std::time::{Duration, Instant};
use tokio::time::sleep;

const FORWARD: i32 = 1;
const ATTACKERS: usize = 100;
const WARM_UP: u32 = 100;
const STEPS: u32 = 2000;

/// Step times in microseconds, ascending, and the size of an observation.
struct Measured {
    times_us: Vec<f64>,
    bytes: usize,
}

#[tokio::main]
async fn main() {
    if std::env::args().any(|argument| argument == "attacks") {
        return measure_attacks().await;
    }
    println!("{:>10} {:>14} {:>10} {:>10}", "side", "bytes a step", "steps/s", "p50 us");
    for side in [64, 128, 256, 512] {
        let Measured { times_us, bytes } = measure(side, None).await;
        let rate = times_us.len() as f64 * 1e6 / times_us.iter().sum::<f64>();
        println!("{side:>10} {bytes:>14} {rate:>10.0} {:>10.0}", times_us[times_us.len() / 2]);
    }
}

async fn measure_attacks() {
    println!("{:>14} {:>10} {:>10}", "attack", "p50 us", "p95 us");
    for attack in std::iter::once(None).chain(Attack::ALL.map(Some)) {
        let name = attack.map_or_else(|| "none".to_owned(), |attack| format!("{attack:?}"));
        let Measured { times_us, .. } = measure(256, attack).await;
        let [p50, p95] = [50, 95].map(|percent| times_us[times_us.len() * percent / 100]);
        println!("{name:>14} {p50:>10.0} {p95:>10.0}");
    }
}

async fn measure(side: u32, attack: Option<Attack>) -> Measured {
    let server = TestServer::open(Plan { max_steps: WARM_UP + STEPS + 1, ..Plan::plain(1) }).await;
    let mut agent = Agent::enter_with(&server, 1, side).await;
    let start = agent.ready(0).await;
    let siege = attack.map(|attack| Siege::lay(attack, server.address, ATTACKERS));
    if siege.is_some() {
        sleep(Duration::from_millis(500)).await;
    }
    let mut measured = Measured { times_us: Vec::new(), bytes: 0 };
    for step in 1..=WARM_UP + STEPS {
        let begun = Instant::now();
        agent.act(0, &start.episode, step, FORWARD).await;
        let observation = agent.observation().await;
        if step > WARM_UP {
            measured.times_us.push(begun.elapsed().as_secs_f64() * 1e6);
        }
        measured.bytes = observation.tensors.iter().map(|tensor| tensor.data.len()).sum();
    }
    drop(siege);
    measured.times_us.sort_by(f64::total_cmp);
    measured
}
