//! Procedural houses: sight compared with images; statistics in the range of real buildings.

mod worlds;

use avln_geom::angle;
use avln_houses::{HouseOptions, house};
use avln_scene::stats::{census, divergence_from_matterport};
use avln_world::stats::{closed_share, walk_stats};
use avln_world::{Body, Camera, InstanceId, Point3, Rng, SceneAssets};
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};
use std::ops::RangeInclusive;

/// Pixels of each instance in four pictures that together show the whole horizon.
fn pixels_around(assets: &SceneAssets, eye: Point3<f32>) -> BTreeMap<InstanceId, usize> {
    let mut pixels = BTreeMap::new();
    for quarter in 0..4 {
        let world_from_camera = angle::about_up(quarter as f32 * FRAC_PI_2);
        let camera =
            Camera { eye, world_from_camera, width: 64, height: 64, hfov_rad: FRAC_PI_2, depth_max_m: 10.0 };
        for instance in assets.render(&camera).instances {
            *pixels.entry(instance).or_insert(0) += 1;
        }
    }
    pixels.remove(&InstanceId::NONE);
    pixels
}

#[test]
fn sight_agrees_with_camera_images() {
    let assets = SceneAssets::prepare(house("seen", 4, &HouseOptions::default()), &Body::default());
    let assets = assets.expect("a procedural house is walkable");
    let mut rng = Rng::new(12);
    let (mut clear, mut missed, mut hidden, mut invented) = (0, 0, 0, 0);
    for _ in 0..60 {
        let stand = assets.navmesh.sample(&mut rng, assets.navmesh.largest_island());
        let eye = stand.position() + avln_geom::Vector3::y();
        let pixels = pixels_around(&assets, eye);
        for object in &assets.scene.objects {
            let count = pixels.get(&object.id).copied().unwrap_or(0);
            let seen = assets.sees(&eye, object.id, FRAC_PI_4);
            clear += usize::from(count >= 40);
            missed += usize::from(count >= 40 && !seen);
            hidden += usize::from(count == 0);
            invented += usize::from(count == 0 && seen);
        }
    }
    assert!(clear > 300 && hidden > 300, "{clear} in clear view, {hidden} hidden");
    assert!(missed * 50 <= clear, "{missed} of {clear} clearly visible objects were missed");
    assert!(invented * 50 <= hidden, "{invented} of {hidden} hidden objects were seen");
}

/// Range of real buildings, required for procedural houses.
const COMPLEXITY: RangeInclusive<f64> = 2.0..=10.0;
const CLUTTER: RangeInclusive<f64> = 1.0..=4.0;
const LEAST_PER_100_M2: f64 = 25.0;

#[test]
fn house_statistics_are_in_real_building_ranges() {
    let mut together: BTreeMap<String, usize> = BTreeMap::new();
    let mut two_storeys = 0;
    for seed in 0..14 {
        let scene = house("measured", seed, &HouseOptions::default());
        let (walk, census) = (walk_stats(&scene, 0).expect("a house to walk in"), census(&scene));
        assert!(walk.largest_island >= 0.95, "seed {seed}: {walk:?}");
        assert_eq!(walk.rooms_reached, 1.0, "seed {seed}: {walk:?}");
        assert!(CLUTTER.contains(&walk.clutter), "seed {seed}: {walk:?}");
        assert!(COMPLEXITY.contains(&walk.complexity), "seed {seed}: {walk:?}");
        assert!(walk.complexity_of_all >= walk.complexity, "seed {seed}: {walk:?}");
        assert!((45.0..330.0).contains(&(walk.floor_m2 / census.storeys as f64)), "seed {seed}: {walk:?}");
        let per_100_m2 = 100.0 * census.objects as f64 / walk.floor_m2;
        assert!(per_100_m2 >= LEAST_PER_100_M2, "seed {seed}: {per_100_m2}");
        two_storeys += usize::from(census.storeys == 2);
        census.categories.into_iter().for_each(|(category, n)| *together.entry(category).or_default() += n);
    }
    assert!((3..=11).contains(&two_storeys), "{two_storeys} of the houses have two storeys");
    let divergence = divergence_from_matterport(&together);
    assert!(divergence < 0.15, "{divergence} nats from Matterport3D's categories");
}

#[test]
fn stairs_reach_every_room() {
    for seed in 0..6 {
        let scene =
            house("stairs", seed, &HouseOptions { rooms: 11..=24, storeys: 2..=2, ..Default::default() });
        assert_eq!(census(&scene).storeys, 2);
        let walk = walk_stats(&scene, 0).expect("a house to walk in");
        assert!(walk.largest_island >= 0.95, "seed {seed}: {walk:?}");
        assert_eq!(walk.rooms_reached, 1.0, "seed {seed}: {walk:?}");
    }
}

#[test]
fn houses_are_closed() {
    for seed in 0..12 {
        let options = HouseOptions { storeys: 1..=1 + (seed % 2) as u8, ..Default::default() };
        let closed = closed_share(&house("closed", seed, &options));
        assert!(closed == 1.0, "seed {seed}: {closed} of all rays have a hit");
    }
}
