//! Procedural houses in numbers: whole, closed, and as hard to walk in as real buildings.

use avln_scene::procedural::{HouseOptions, house};
use avln_scene::stats::census;
use avln_world::stats::{closed_share, walk_stats};

#[test]
fn houses_are_one_floor_for_every_body_and_hard_to_walk_in() {
    for seed in 0..3 {
        let scene = house("measured", seed, &HouseOptions::default());
        let walk = walk_stats(&scene, 0).expect("a house to walk in");
        assert!(walk.largest_island >= 0.95, "seed {seed}: {walk:?}");
        assert!(walk.rooms_reached > 0.0, "seed {seed}: {walk:?}");
        assert!(walk.clutter >= 1.0, "seed {seed}: {walk:?}");
        assert!(walk.complexity >= 2.0 && walk.complexity_of_all >= walk.complexity, "seed {seed}: {walk:?}");
        let storeys = census(&scene).storeys as f64;
        assert!((45.0..330.0).contains(&(walk.floor_m2 / storeys)), "seed {seed}: {walk:?}");
    }
}

#[test]
fn stairs_lead_from_storey_to_storey() {
    for seed in 0..3 {
        let scene =
            house("stairs", seed, &HouseOptions { rooms: 11..=24, storeys: 2..=2, ..Default::default() });
        assert_eq!(census(&scene).storeys, 2);
        let walk = walk_stats(&scene, 0).expect("a house to walk in");
        assert!(walk.largest_island >= 0.95, "seed {seed}: {walk:?}");
    }
}

#[test]
fn nothing_looks_out_into_the_void() {
    for seed in 0..12 {
        let options = HouseOptions { storeys: 1..=1 + (seed % 2) as u8, ..Default::default() };
        let closed = closed_share(&house("closed", seed, &options));
        assert!(closed == 1.0, "seed {seed}: {closed} of all rays meet something");
    }
}
