//! Step latency over loopback while 100 hostile clients attack.

#[allow(dead_code, unused_imports, reason = "the tests use more of the toy host")]
#[path = "../tests/all/common/mod.rs"]
mod common;

use common::{Agent, Attack, Plan, Siege, TestServer};
use std::time::{Duration, Instant};

const FORWARD: i32 = 1;
const ATTACKERS: usize = 100;
const WARM_UP: u32 = 100;
const STEPS: u32 = 3000;

fn main() {
    println!("{:>14} {:>10} {:>10}", "attack", "p50 us", "p95 us");
    for attack in std::iter::once(None).chain(Attack::ALL.map(Some)) {
        let name = attack.map_or_else(|| "none".to_owned(), |attack| format!("{attack:?}"));
        let [p50, p95] = measure(attack);
        println!("{name:>14} {p50:>10.0} {p95:>10.0}");
    }
}

/// Microseconds of a step, the middle one and the 95th of 100.
fn measure(attack: Option<Attack>) -> [f64; 2] {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let server = TestServer::open(Plan { max_steps: WARM_UP + STEPS + 1, ..Plan::plain(1) }).await;
        let mut agent = Agent::enter_with(&server, 1, 256).await;
        let start = agent.ready(0).await;
        let siege = attack.map(|attack| Siege::lay(attack, server.address, ATTACKERS));
        tokio::time::sleep(Duration::from_millis(500)).await;
        let mut times_us = Vec::new();
        for step in 1..=WARM_UP + STEPS {
            let begun = Instant::now();
            agent.act(0, &start.episode, step, FORWARD).await;
            agent.observation().await;
            if step > WARM_UP {
                times_us.push(begun.elapsed().as_secs_f64() * 1e6);
            }
        }
        drop(siege);
        times_us.sort_by(f64::total_cmp);
        [times_us[times_us.len() / 2], times_us[times_us.len() * 95 / 100]]
    })
}
