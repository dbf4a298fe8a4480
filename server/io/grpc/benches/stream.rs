//! Steps per second over loopback without simulation: the cost of transport.

#[allow(dead_code, unused_imports, reason = "the tests use more of the toy host")]
#[path = "../tests/all/common/mod.rs"]
mod common;

use common::{Agent, Plan, TestServer};
use std::time::Instant;

const FORWARD: i32 = 1;
const WARM_UP: u32 = 50;
const STEPS: u32 = 2000;

fn main() {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    println!("{:>10} {:>14} {:>10} {:>10}", "side", "bytes a step", "steps/s", "p50 us");
    for side in [64, 128, 256, 512] {
        runtime.block_on(measure(side));
    }
}

async fn measure(side: u32) {
    let server = TestServer::open(Plan { max_steps: WARM_UP + STEPS + 1, ..Plan::plain(1) }).await;
    let mut agent = Agent::enter_with(&server, 1, side).await;
    let start = agent.ready(0).await;
    let mut bytes = 0;
    let mut times_us = Vec::new();
    for step in 1..=WARM_UP + STEPS {
        let begun = Instant::now();
        agent.act(0, &start.episode, step, FORWARD).await;
        let observation = agent.observation().await;
        if step > WARM_UP {
            times_us.push(begun.elapsed().as_secs_f64() * 1e6);
        }
        bytes = observation.tensors.iter().map(|tensor| tensor.data.len()).sum::<usize>();
    }
    let rate = f64::from(STEPS) * 1e6 / times_us.iter().sum::<f64>();
    times_us.sort_by(f64::total_cmp);
    println!("{side:>10} {bytes:>14} {rate:>10.0} {:>10.0}", times_us[times_us.len() / 2]);
}
