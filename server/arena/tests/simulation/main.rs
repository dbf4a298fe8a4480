//! Simulation of the server: sessions, slots, leases, quotas and the store, with the real arena and its data folder, without a
//! network, in simulated time and with injected faults.
//!
//! `AVLN_SIMULATION_SEED` repeats a world, `AVLN_SIMULATION_STEPS` sets the steps of all worlds together.

mod agent;
mod answers;
mod calls;
mod database;
mod faults;
mod generator;
mod host;
mod ledger;
mod model;
mod organiser;
mod proof;
mod properties;
mod server;
mod setting;
mod trace;
mod world;

use avln_geom::Rng;
use std::{
    env,
    sync::atomic::{AtomicU64, Ordering},
    thread,
    time::{Instant, SystemTime, UNIX_EPOCH},
};
use world::World;

/// Steps of all worlds together, unless `AVLN_SIMULATION_STEPS` is set.
const STEPS: u64 = 15_000;
/// Steps of a world.
const WORLD_STEPS: u64 = 5000;
/// Seeds of worlds that every simulation contains.
const FIXED_SEEDS: [u64; 2] = [1, 2];

/// Returns an environment variable as a number.
fn number(name: &str) -> Option<u64> {
    let value = env::var(name).ok()?;
    Some(value.parse().unwrap_or_else(|_| panic!("{name} is '{value}', but must be a whole number")))
}

/// Plays a world. Returns the digest of its events.
fn simulate(seed: u64, steps: u64) -> String {
    let begun = Instant::now();
    let mut world = World::new(seed, steps);
    let ended = world.run();
    let digest = world.trace.digest();
    if let Err(violation) = ended {
        let World { step, trace, .. } = &world;
        panic!(
            "simulation with seed {seed}, step {step}: {violation}\nlast events:\n{trace}\
             repeat with: AVLN_SIMULATION_SEED={seed} AVLN_SIMULATION_STEPS={steps} cargo test -p avln-arena --test simulation"
        );
    }
    println!("seed {seed}: {}, digest {digest}, {:.1} s", world.summary(), begun.elapsed().as_secs_f64());
    digest
}

/// Plays worlds with fixed and fresh seeds in parallel.
#[test]
fn random_worlds_keep_all_properties() {
    if let Some(seed) = number("AVLN_SIMULATION_SEED") {
        simulate(seed, number("AVLN_SIMULATION_STEPS").unwrap_or(WORLD_STEPS));
        return;
    }
    let worlds = number("AVLN_SIMULATION_STEPS").unwrap_or(STEPS).div_ceil(WORLD_STEPS);
    let now = SystemTime::now().duration_since(UNIX_EPOCH).expect("a clock after 1970");
    let fresh = now.as_nanos() as u64;
    println!("{worlds} worlds of {WORLD_STEPS} steps, seeds from {fresh}");
    let next = AtomicU64::new(0);
    let work = || {
        while let index @ 0.. = next.fetch_add(1, Ordering::Relaxed)
            && index < worlds
        {
            // Short numbers, which are easily copied.
            let seed = FIXED_SEEDS.get(index as usize).copied();
            simulate(seed.unwrap_or_else(|| Rng::word(fresh, index) >> 32), WORLD_STEPS);
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
