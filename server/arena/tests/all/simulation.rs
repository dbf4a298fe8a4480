//! Simulation of the server: sessions, slots, leases, quotas and the store, with the real arena and its data folder, without a
//! network, in simulated time and with injected faults.
//!
//! `AVLN_SIMULATION_STEPS` sets the steps of all worlds together, and `AVLN_SIMULATION_SEED` the seed of the first world; the next
//! worlds have the next seeds.

mod agent;
mod answers;
mod database;
mod generator;
mod host;
mod ledger;
mod proof;
mod server;
mod setting;
mod world;

use std::{
    env,
    sync::atomic::{AtomicU64, Ordering},
    thread,
    time::Instant,
};
use world::World;

/// Steps of all worlds together, unless `AVLN_SIMULATION_STEPS` is set.
const STEPS: u64 = 15_000;
/// Steps of a world.
const WORLD_STEPS: u64 = 5000;
/// Returns an environment variable as a number.
fn number(name: &str) -> Option<u64> {
    let value = env::var(name).ok()?;
    Some(value.parse().unwrap_or_else(|_| panic!("{name} is '{value}', but must be a whole number")))
}

/// Plays a world. Returns the digest of its events.
fn simulate(seed: u64, steps: u64) -> String {
    let _memory = crate::MEMORY.blocking_read();
    let begun = Instant::now();
    let mut world = World::new(seed, steps);
    let ended = world.run();
    let digest = world.trace.digest();
    if let Err(violation) = ended {
        let World { step, trace, .. } = &world;
        panic!(
            "simulation with seed {seed}, step {step}: {violation}\nlast events:\n{trace}\
             repeat with: AVLN_SIMULATION_SEED={seed} AVLN_SIMULATION_STEPS={steps} cargo test -p avln-arena --test all simulation::"
        );
    }
    println!("seed {seed}: {}, digest {digest}, {:.1} s", world.summary(), begun.elapsed().as_secs_f64());
    digest
}

/// Plays worlds in parallel.
#[test]
fn random_worlds_keep_all_properties() {
    let steps = number("AVLN_SIMULATION_STEPS").unwrap_or(STEPS);
    let first = number("AVLN_SIMULATION_SEED").unwrap_or(1);
    let worlds = steps.div_ceil(WORLD_STEPS);
    println!("{worlds} worlds, seeds from {first}");
    let next = AtomicU64::new(0);
    let work = || {
        while let index @ 0.. = next.fetch_add(1, Ordering::Relaxed)
            && index < worlds
        {
            simulate(first.wrapping_add(index), steps.min(WORLD_STEPS));
        }
    };
    thread::scope(|scope| {
        let cores = thread::available_parallelism().map_or(2, usize::from) as u64;
        // Twice, because a simulation often waits for the thread of its database.
        (0..worlds.min(2 * cores)).for_each(|_| drop(scope.spawn(work)));
    });
}

#[test]
fn equal_seeds_give_equal_events() {
    assert_eq!(simulate(3, 400), simulate(3, 400));
    assert_ne!(simulate(4, 100), simulate(5, 100));
}
