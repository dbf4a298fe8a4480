//! Procedural houses: sight compared with images, and statistics in the range of real buildings; a body in a hand-made building
//! of two rooms.
//!
//! Seen from above, x to the right and z down, metres; the door is 1 m wide and 2.1 m high:
//!
//! ```text
//! (-4,-2)           (0,-2)            (4,-2)
//!    +-----------------+-----------------+
//!    |                 |                 |
//!    |      west      door     east   [1]|   [1] a cabinet at x 3.2 to 3.8, z -0.3 to 0.3, 1 m high
//!    |                 |                 |
//!    +-----------------+-----------------+
//! ```
//! Instance 2 is a lamp under the ceiling of the west room, instance 3 a picture on the north wall of the east room.

use avln_geom::{Point2, Vector3, angle};
use avln_houses::{HouseOptions, house};
use avln_scene::stats::{census, divergence_from_matterport};
use avln_scene::{Lighting, Material, Mesh};
use avln_world::stats::{closed_share, walk_stats};
use avln_world::{
    Bank, Body, Camera, CameraView, DepthNoise, Head, InstanceId, Motion, Moved, Noise, Point3, Pose,
    RgbNoise, Rng, Scene, SceneAssets, SoundSource, StartError, World, WorldOptions,
};
use std::collections::BTreeMap;
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};
use std::ops::RangeInclusive;
use std::sync::{Arc, OnceLock};
use std::thread;

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
    let measure = |seed| {
        let scene = house("measured", seed, &HouseOptions::default());
        (seed, walk_stats(&scene, 0).expect("a house to walk in"), census(&scene))
    };
    let houses: Vec<_> = thread::scope(|scope| {
        let halves = [0..7, 7..14].map(|seeds| scope.spawn(move || seeds.map(measure).collect::<Vec<_>>()));
        halves.into_iter().flat_map(|half| half.join().expect("no panic")).collect()
    });
    for (seed, walk, census) in houses {
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
    for seed in 0..4 {
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

/// Adds a box with outward faces.
fn put(mesh: &mut Mesh, low: [f32; 3], high: [f32; 3], material: u16, instance: u32) {
    for axis in 0..3 {
        for (at, flip) in [(low, true), (high, false)] {
            let corner = |u: bool, v: bool| {
                let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut corner = at;
                corner[next] = if u { high[next] } else { low[next] };
                corner[last] = if v { high[last] } else { low[last] };
                Point3::from(corner)
            };
            let face = [corner(false, false), corner(true, false), corner(true, true), corner(false, true)];
            let base = mesh.positions.len() as u32;
            mesh.positions.extend(face);
            mesh.uvs.extend([Point2::origin(); 4]);
            mesh.colors.extend([[200, 180, 160]; 4]);
            let (b, c, d) = if flip { (3, 2, 1) } else { (1, 2, 3) };
            mesh.triangles.extend([[base, base + b, base + c], [base, base + c, base + d]]);
            mesh.material_of.extend([material; 2]);
            mesh.instance_of.extend([InstanceId(instance); 2]);
        }
    }
}

fn two_rooms() -> Scene {
    let mut mesh = Mesh::default();
    let walls = [
        ([-4.1, -0.1, -2.1], [4.1, 0.0, 2.1]),
        ([-4.1, 2.5, -2.1], [4.1, 2.6, 2.1]),
        ([-4.1, 0.0, -2.1], [-4.0, 2.5, 2.1]),
        ([4.0, 0.0, -2.1], [4.1, 2.5, 2.1]),
        ([-4.0, 0.0, -2.1], [4.0, 2.5, -2.0]),
        ([-4.0, 0.0, 2.0], [4.0, 2.5, 2.1]),
        ([-0.05, 0.0, -2.0], [0.05, 2.5, -0.5]),
        ([-0.05, 0.0, 0.5], [0.05, 2.5, 2.0]),
        ([-0.05, 2.1, -0.5], [0.05, 2.5, 0.5]),
    ];
    for (low, high) in walls {
        put(&mut mesh, low, high, 0, 0);
    }
    put(&mut mesh, [3.2, 0.0, -0.3], [3.8, 1.0, 0.3], 1, 1);
    put(&mut mesh, [-2.1, 2.3, -0.1], [-1.9, 2.45, 0.1], 1, 2);
    put(&mut mesh, [1.5, 1.0, -1.99], [2.5, 1.6, -1.97], 1, 3);
    let paint = |name: &str, base_color| Material {
        name: name.into(),
        base_color,
        texture: None,
        alpha_cutoff: None,
    };
    Scene {
        name: "two-rooms".into(),
        mesh,
        materials: vec![paint("plaster", [250, 250, 240, 255]), paint("wood", [140, 90, 40, 255])],
        textures: Vec::new(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    }
}

fn assets() -> Arc<SceneAssets> {
    static ASSETS: OnceLock<Arc<SceneAssets>> = OnceLock::new();
    let prepare = || Arc::new(SceneAssets::prepare(two_rooms(), &Body::default()).expect("two good rooms"));
    ASSETS.get_or_init(prepare).clone()
}

fn options() -> WorldOptions {
    WorldOptions {
        forward_m: 0.25,
        turn_deg: 30,
        camera_height_m: 1.0,
        ear_height_m: 1.0,
        depth_max_m: 10.0,
        samples_per_step: 4000,
        head: Head::Sphere,
        view: None,
        audio: false,
        noise: Noise::default(),
    }
}

fn body_at(x: f32, z: f32, heading_rad: f32) -> World {
    let start = Pose::new(Point3::new(x, 0.0, z), heading_rad);
    World::new(assets(), start, options(), Vec::new()).expect("on the floor")
}

fn go(world: &mut World, motion: Motion, times: usize) {
    for _ in 0..times {
        world.advance(motion);
    }
}

fn flat_distance(a: &Point3<f32>, b: &Point3<f32>) -> f32 {
    Vector3::new(a.x - b.x, 0.0, a.z - b.z).norm()
}

#[test]
fn twelve_turns_return_to_identical_bits() {
    for heading_rad in [0.0, 0.4, -2.7, 3.1] {
        let mut world = body_at(-2.0, 0.0, heading_rad);
        let start = world.pose();
        for motion in [Motion::Left, Motion::Right] {
            for _ in 0..12 {
                assert_eq!(world.advance(motion), Moved { collided: false, displacement_m: 0.0 });
            }
            assert_eq!(world.pose().heading_rad.to_bits(), start.heading_rad.to_bits());
            assert_eq!(world.pose(), start);
        }
    }
}

#[test]
fn left_is_minus_x_when_facing_minus_z() {
    let mut world = body_at(-2.0, 0.0, 0.0);
    go(&mut world, Motion::Left, 3);
    assert!((world.pose().heading_rad - FRAC_PI_2).abs() < 1e-6);
    world.advance(Motion::Forward);
    assert!((world.pose().position.x + 2.25).abs() < 1e-4);
}

#[test]
fn free_step_is_a_quarter_metre() {
    for turns in 0..12 {
        let mut world = body_at(-2.0, 0.0, 0.1);
        go(&mut world, Motion::Right, turns);
        let before = world.pose();
        let moved = world.advance(Motion::Forward);
        assert!(!moved.collided);
        assert!((moved.displacement_m - 0.25).abs() < 1e-4);
        let expected = before.position + before.forward() * 0.25;
        assert!(flat_distance(&world.pose().position, &expected) < 1e-4);
        assert!((world.eye().y - world.pose().position.y - 1.0).abs() < 1e-6);
    }
}

#[test]
fn walls_stop_or_deflect_steps() {
    // 60 degrees to the left of the north wall's normal: sideways 0.25 sin 60 = 0.217 m a step, towards -x.
    let mut world = body_at(-1.0, -1.0, 60.0_f32.to_radians());
    let angle = world.pose().heading_rad;
    let mut slid = Vec::new();
    for _ in 0..10 {
        slid.push(world.advance(Motion::Forward));
    }
    assert!(!slid[0].collided && slid[9].collided);
    assert!((slid[9].displacement_m - 0.25 * angle.sin()).abs() < 0.02, "{slid:?}");
    // Head on, no sliding is possible.
    let mut world = body_at(-2.0, -1.0, 0.0);
    let moves: Vec<_> = (0..8).map(|_| world.advance(Motion::Forward)).collect();
    assert!(moves[7].collided && moves[7].displacement_m < 1e-3, "{moves:?}");
    let gap_m = world.pose().position.z + 2.0;
    assert!((0.05..0.25).contains(&gap_m), "stands {gap_m} m from the wall, with a radius of 0.1 m");
}

#[test]
fn doors_are_passable_and_walls_are_not() {
    for (z, passes) in [(0.0, true), (1.5, false)] {
        let mut world = body_at(-1.0, z, -FRAC_PI_2);
        go(&mut world, Motion::Forward, 8);
        assert_eq!(world.pose().position.x > 0.5, passes, "at z = {z}");
    }
}

/// Largest distance beyond the target of a sliding step.
const BEYOND_M: f32 = 2e-3;

#[test]
fn two_thousand_random_motions_never_leave_the_floor() {
    let mut rng = Rng::new(21);
    let mut world = body_at(-2.0, 0.5, 1.0);
    let mut walked_m = 0.0;
    for step in 0..2000 {
        let motion =
            *rng.choose(&[Motion::Forward, Motion::Forward, Motion::Left, Motion::Right]).expect("four");
        let before = world.pose().position;
        let moved = world.advance(motion);
        let after = world.pose().position;
        walked_m += moved.displacement_m;
        assert!((flat_distance(&before, &after) - moved.displacement_m).abs() < 1e-6);
        assert!(moved.displacement_m <= 0.25 + BEYOND_M, "step {step} went {} m", moved.displacement_m);
        assert!(assets().navmesh.snap(&after, 0.01).is_some(), "step {step} left the floor at {after}");
        assert!(
            after.x.abs() < 3.95 && after.z.abs() < 1.95 && after.y.abs() < 0.1,
            "step {step} is at {after}"
        );
        let in_wall = after.x.abs() < 0.1 && after.z.abs() > 0.45;
        assert!(!in_wall, "step {step} stands in the wall at {after}");
    }
    assert!(walked_m > 50.0);
}

fn senses_of_a_walk(seed: u64) -> Vec<(u64, Vec<u8>, Vec<u32>)> {
    let view = CameraView { width: 32, height: 24, hfov_rad: FRAC_PI_2 };
    let options = WorldOptions { view: Some(view), audio: true, samples_per_step: 500, ..options() };
    let sources = [(3.0, 1.5), (-3.0, -1.5)].map(|(x, z)| {
        let position = Point3::new(x, 0.8, z);
        SoundSource { position, clip: Bank::default().clip(3).expect("a clip"), offset_samples: 100 }
    });
    let start = Pose::new(Point3::new(-2.0, 0.0, 0.5), 0.3);
    let mut world = World::new(assets(), start, options, sources.to_vec()).expect("on the floor");
    let mut rng = Rng::new(seed);
    let step = |step: usize| {
        let motion =
            *rng.choose(&[Motion::Forward, Motion::Left, Motion::Right, Motion::Stay]).expect("four");
        world.advance(motion);
        let senses = world.sense(Some(step / 10 % 2));
        let frame = senses.frame.expect("the view was requested");
        let depth = frame.depth.iter().flat_map(|depth| depth.to_le_bytes());
        let audio =
            senses.audio.expect("audio was requested").iter().map(|sample| sample.to_bits()).collect();
        (world.state_hash(), frame.rgb.iter().copied().chain(depth).collect(), audio)
    };
    (0..30).map(step).collect()
}

#[test]
fn equal_motions_have_equal_states_images_and_sounds() {
    let first = senses_of_a_walk(5);
    assert!(first == senses_of_a_walk(5), "equal walks have different senses");
    assert!(first.iter().all(|(_, frame, audio)| frame.len() == 32 * 24 * 7 && audio.len() == 1000));
    assert!(first.iter().any(|(.., audio)| audio.iter().any(|&bits| bits != 0)), "the audio is not silent");
    let other = senses_of_a_walk(6);
    assert_ne!(first.last().map(|step| step.0), other.last().map(|step| step.0));
}

#[test]
fn every_motion_changes_the_state_hash() {
    let mut world = body_at(-2.0, 0.0, 0.0);
    let mut hashes = vec![world.state_hash()];
    for motion in [Motion::Left, Motion::Right, Motion::Forward, Motion::Stay, Motion::Stay] {
        world.advance(motion);
        hashes.push(world.state_hash());
    }
    hashes.sort_unstable();
    hashes.dedup();
    assert_eq!(hashes.len(), 6);
}

#[test]
fn unrequested_senses_are_absent() {
    let senses = body_at(-2.0, 0.0, 0.0).sense(None);
    assert_eq!((senses.frame, senses.audio), (None, None));
}

#[test]
fn camera_has_its_height_and_heading() {
    let view = CameraView { width: 33, height: 33, hfov_rad: FRAC_PI_2 };
    let options = WorldOptions { view: Some(view), ..options() };
    let start = Pose::new(Point3::new(1.0, 0.0, 0.0), -FRAC_PI_2);
    let mut world = World::new(assets(), start, options, Vec::new()).expect("on the floor");
    let frame = world.sense(None).frame.expect("the view was requested");
    // The middle row looks over or just at the top edge of the cabinet; the next row hits its front at 3.2 m.
    let below = (33 / 2 + 1) * 33 + 33 / 2;
    assert_eq!(frame.instances[below], InstanceId(1));
    assert!((frame.depth[below] - 2.2).abs() < 0.03, "{}", frame.depth[below]);
}

#[test]
fn noise_changes_only_the_senses() {
    let view = Some(CameraView { width: 32, height: 24, hfov_rad: FRAC_PI_2 });
    let walk = |noise: Noise| {
        let start = Pose::new(Point3::new(1.0, 0.0, 0.0), -FRAC_PI_2);
        let options = WorldOptions { view, noise, ..options() };
        let mut world = World::new(assets(), start, options, Vec::new()).expect("on the floor");
        let mut step = |motion| {
            world.advance(motion);
            let hash = world.state_hash();
            (world.sense(None).frame.expect("the view was requested"), hash)
        };
        [Motion::Stay, Motion::Stay, Motion::Left].map(&mut step)
    };
    let noise = Noise { depth: DepthNoise::Redwood, rgb: RgbNoise::Gaussian, seed: 3 };
    let (clean, noisy) = (walk(Noise::default()), walk(noise));
    assert_eq!(noisy, walk(noise));
    assert_ne!(noisy[0].0, noisy[1].0, "noise differs by step without motion");
    assert_eq!(clean[0].0, clean[1].0);
    for ((clean, clean_hash), (noisy, noisy_hash)) in clean.iter().zip(&noisy) {
        assert_eq!((clean_hash, &clean.instances), (noisy_hash, &noisy.instances));
        assert!(clean.rgb != noisy.rgb && clean.depth != noisy.depth);
    }
    assert_ne!(noisy[0].0.rgb, walk(Noise { seed: 4, ..noise })[0].0.rgb);
}

#[test]
fn sight_ends_at_walls() {
    let house = assets();
    let (cabinet, picture) = (InstanceId(1), InstanceId(3));
    assert!(house.sees(&Point3::new(1.0, 1.0, 1.0), cabinet, FRAC_PI_4), "across the east room");
    assert!(house.sees(&Point3::new(-2.0, 1.0, 0.0), cabinet, FRAC_PI_4), "through the door");
    assert!(!house.sees(&Point3::new(-1.0, 1.0, 1.5), cabinet, FRAC_PI_4), "behind the wall");
    assert!(house.sees(&Point3::new(2.0, 1.0, 0.0), picture, FRAC_PI_4));
    assert!(!house.sees(&Point3::new(-2.0, 1.0, 0.0), picture, FRAC_PI_4), "round the corner of the door");
    for nobody in [InstanceId::NONE, InstanceId(4), InstanceId(60_000)] {
        assert!(!house.sees(&Point3::new(1.0, 1.0, 1.0), nobody, FRAC_PI_4));
    }
}

#[test]
fn objects_above_the_view_are_invisible() {
    let (house, lamp) = (assets(), InstanceId(2));
    // The lamp hangs 1.3 m above the eye: more than 45 degrees from 0.8 m, less from 1.9 m.
    assert!(!house.sees(&Point3::new(-2.0, 1.0, 0.8), lamp, FRAC_PI_4));
    assert!(house.sees(&Point3::new(-2.0, 1.0, 1.9), lamp, FRAC_PI_4));
    assert!(house.sees(&Point3::new(-2.0, 1.0, 0.8), lamp, FRAC_PI_2));
}

#[test]
fn start_in_the_air_is_refused() {
    let start = |x: f32, y: f32| Pose::new(Point3::new(x, y, 0.0), 0.0);
    let refused = World::new(assets(), start(-2.0, 1.2), options(), Vec::new()).err();
    assert!(matches!(refused, Some(StartError::OffNavMesh { limit_m: 0.3, .. })), "{refused:?}");
    assert!(World::new(assets(), start(9.0, 0.0), options(), Vec::new()).is_err());
    assert!(World::new(assets(), start(f32::NAN, 0.0), options(), Vec::new()).is_err());
}
