//! Audible reverberation against theory.

use crate::common::{energy_db, first_wave, listener, opaque_rooms, point, two_rooms};
use avln_acoustics::{
    Acoustics, Head, ImpulseResponse, Listener, Measures, SURFACE_BANDS, Settings, Source, Surface, Surfaces,
};
use avln_geom::{Point3, RayMesh};
use avln_scene::{RoomPlan, Scene};
use std::sync::Arc;

const SPEED_M_S: f64 = 343.0;

fn acoustics(scene: &Scene, surface: Surface, settings: Settings) -> Acoustics {
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    Acoustics::new(scene, rays, Surfaces::uniform(scene, surface), settings)
}

fn omni(rays: usize) -> Settings {
    Settings { head: Head::Omni, ray_count: rays, ..Settings::default() }
}

fn measures(acoustics: &Acoustics, from: [f32; 3], to: [f32; 3]) -> Measures {
    let listener = Listener { position: to.into(), heading_rad: 0.0 };
    let source = acoustics.source(&from.into());
    let first = source.first_wave(&listener).expect("finite places");
    Measures::of(&source.impulse_response(&listener), first.delay_s, 1.0)
}

/// Sabine and Eyring times, and the energy after the direct wave, for a box of 6 x 5 x 3 m.
struct Theory {
    sabine_s: f64,
    eyring_s: f64,
    diffuse: f64,
}

fn theory(absorption: f64, air_db_per_m: f64) -> Theory {
    let (volume, area) = (90.0, 126.0);
    let per_second = |nepers_m2: f64| {
        // Energy falls by 60 dB in this time, plus air absorption.
        let air = air_db_per_m / 10.0 * std::f64::consts::LN_10;
        24.0 * std::f64::consts::LN_10 / 4.0 / (SPEED_M_S * (nepers_m2 / (4.0 * volume) + air))
    };
    Theory {
        sabine_s: per_second(area * absorption),
        eyring_s: per_second(-area * (1.0 - absorption).ln()),
        diffuse: 16.0 * std::f64::consts::PI * (1.0 - absorption)
            / (area * absorption + 4.0 * volume * air_db_per_m / 4.343),
    }
}

#[test]
fn reverberation_matches_theory_in_every_band() {
    const ABSORPTION: [f32; SURFACE_BANDS] = [0.12, 0.15, 0.2, 0.25, 0.3, 0.4];
    const AIR_DB_PER_M: [f64; SURFACE_BANDS] = [0.000_44, 0.001_31, 0.002_73, 0.004_67, 0.009_89, 0.0297];
    let surface = Surface::new(ABSORPTION, [0.4; SURFACE_BANDS], [0.0; SURFACE_BANDS]).expect("shares");
    let scene = RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
    let acoustics = acoustics(&scene, surface, omni(4096));
    let (from, to) = ([1.5, 1.2, 1.4], [4.6, 1.5, 3.7]);
    let distance = f64::from((point(1.5, 1.2, 1.4) - point(4.6, 1.5, 3.7)).norm());
    let found = measures(&acoustics, from, to);
    for (band, measured) in found.bands.iter().enumerate() {
        let theory = theory(f64::from(ABSORPTION[band]), AIR_DB_PER_M[band]);
        let t30_s = measured.t30_s.expect("a decay");
        assert!((0.9 * theory.eyring_s..1.1 * theory.sabine_s).contains(&t30_s), "band {band}: {t30_s} s");
        let due_db = 10.0 * (theory.diffuse + 1.0 / (distance * distance)).log10();
        let level_db = measured.level_db.expect("sound");
        assert!((level_db - due_db).abs() < 2.0, "band {band}: {level_db}, not {due_db} dB");
    }
}

#[test]
fn reflection_order_does_not_change_the_level() {
    let surface =
        Surface::new([0.15; SURFACE_BANDS], [0.2; SURFACE_BANDS], [0.0; SURFACE_BANDS]).expect("shares");
    let scene = RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
    let levels = |order: usize| {
        let acoustics = acoustics(&scene, surface, Settings { reflection_order: order, ..omni(4096) });
        let places = [[4.6, 1.5, 3.7], [3.1, 1.0, 1.2], [5.0, 2.0, 0.9], [1.0, 1.4, 4.0]];
        let sum: f64 = places
            .iter()
            .map(|place| measures(&acoustics, [1.5, 1.2, 1.4], *place))
            .flat_map(|measures| measures.bands[2..5].to_vec())
            .map(|band| 10.0_f64.powf(band.level_db.expect("sound") / 10.0))
            .sum();
        10.0 * sum.log10()
    };
    let (none, first, second) = (levels(0), levels(1), levels(2));
    assert!((none - second).abs() < 0.5 && (first - second).abs() < 0.5, "{none}, {first}, {second} dB");
}

#[test]
fn walls_confine_reverberation() {
    let source = two_rooms(true).source(&point(1.2, 1.0, 3.0));
    let at = |x: f32, z: f32| energy_db(&source.impulse_response(&listener(x, z, 0.0)));
    for z in [2.6, 3.0, 3.5] {
        let step_db = at(3.8, z) - at(4.4, z);
        assert!(step_db > 9.0, "{step_db} dB across the wall at z = {z}");
    }
}

#[test]
#[expect(clippy::disallowed_methods, reason = "threads are what is tested")]
fn reverberation_has_the_same_bits_on_every_thread() {
    let hear = || {
        let house = opaque_rooms(true, Settings { ray_count: 500, ..Settings::default() });
        house.source(&point(1.2, 1.0, 3.0)).impulse_response(&listener(5.0, 2.0, 30.0))
    };
    let here = hear();
    let threads: Vec<_> = (0..3).map(|_| std::thread::spawn(hear)).collect();
    assert!(threads.into_iter().all(|thread| thread.join().expect("no panic") == here));
    assert!(here.len() > 4000);
}

#[test]
fn missing_ceilings_lose_energy() {
    let mut scene = RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
    let surface =
        Surface::new([0.1; SURFACE_BANDS], [0.3; SURFACE_BANDS], [0.0; SURFACE_BANDS]).expect("shares");
    let closed = acoustics(&scene, surface, omni(2048));
    let ceiling: Vec<bool> = scene.mesh.material_of.iter().map(|material| *material == 2).collect();
    let mut keep = ceiling.iter().map(|ceiling| !ceiling);
    scene.mesh.triangles.retain(|_| keep.next().unwrap_or(true));
    let open = acoustics(&scene, surface, omni(2048));
    let (from, to) = ([1.5, 1.2, 1.4], [4.6, 1.5, 3.7]);
    assert_eq!(closed.source(&from.into()).lost_share(), 0.0);
    let lost = open.source(&from.into()).lost_share();
    assert!((0.5..1.0).contains(&lost), "{lost}");
    let level = |acoustics: &Acoustics| measures(acoustics, from, to).bands[3].level_db.expect("sound");
    assert!(level(&closed) > level(&open) + 3.0);
}

#[test]
fn zero_rays_give_no_reverberation() {
    let silent = opaque_rooms(true, first_wave());
    let response: ImpulseResponse =
        silent.source(&point(1.2, 1.0, 3.0)).impulse_response(&listener(3.0, 2.0, 0.0));
    assert!(response.len() < 400, "{}", response.len());
}

#[test]
fn degenerate_triangles_do_not_change_sound() {
    let mut scene = RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
    let surface =
        Surface::new([0.2; SURFACE_BANDS], [0.3; SURFACE_BANDS], [0.1; SURFACE_BANDS]).expect("shares");
    let hear = |scene: &Scene| {
        let source = acoustics(scene, surface, omni(500)).source(&point(1.5, 1.2, 1.4));
        source.impulse_response(&listener(4.6, 3.7, 0.0))
    };
    let whole = hear(&scene);
    let without_area = [scene.mesh.triangles[0][0]; 3];
    scene.mesh.triangles.push(without_area);
    scene.mesh.material_of.push(0);
    scene.mesh.instance_of.push(scene.mesh.instance_of[0]);
    assert_eq!(hear(&scene), whole);
    scene.mesh.positions[0].y = f32::NAN;
    let broken = hear(&scene);
    assert!(broken.left.iter().chain(&broken.right).all(|sample| sample.is_finite()));
}

/// A room on the left, two on the right, walls of 0.2 m. Room-high doors connect the left with the upper
/// right room at z = 1.0 to 1.9, and the right rooms at x = 7.0 to 7.9.
const PLAN: [[f32; 2]; 20] = [
    [0.0, 0.0],
    [4.0, 0.0],
    [4.0, 1.0],
    [4.2, 1.0],
    [4.2, 0.0],
    [10.0, 0.0],
    [10.0, 3.0],
    [7.9, 3.0],
    [7.9, 3.2],
    [10.0, 3.2],
    [10.0, 6.0],
    [4.2, 6.0],
    [4.2, 3.2],
    [7.0, 3.2],
    [7.0, 3.0],
    [4.2, 3.0],
    [4.2, 1.9],
    [4.0, 1.9],
    [4.0, 6.0],
    [0.0, 6.0],
];

const HEIGHT_M: f32 = 2.6;

/// Source position in the lower right room.
const SOURCE: [f32; 3] = [8.225, 1.525, 4.625];

/// Listener rows in x and z at a height of 1.225 m.
struct Places {
    first_m: [f32; 2],
    step_m: [f32; 2],
    count: [usize; 2],
}

/// The whole upper right room.
const ONE_DOOR: Places = Places { first_m: [4.575, 0.475], step_m: [0.6, 0.4], count: [9, 6] };

/// The whole left room.
const TWO_DOORS: Places = Places { first_m: [0.575, 0.475], step_m: [0.4, 0.6], count: [8, 9] };

/// The left room near the door.
const BEFORE_THE_DOOR: Places = Places { first_m: [0.575, 1.075], step_m: [0.2, 0.2], count: [6, 6] };

impl Places {
    fn listeners(&self) -> impl Iterator<Item = Listener> {
        let at = |axis: usize, index: usize| self.first_m[axis] + index as f32 * self.step_m[axis];
        let place = move |x, z| Point3::new(at(0, x), 1.225, at(1, z));
        let places = (0..self.count[0]).flat_map(move |x| (0..self.count[1]).map(move |z| place(x, z)));
        places.map(|position| Listener { position, heading_rad: 0.0 })
    }
}

/// The flat with uniform surfaces and without a head.
fn flat(absorption: f32) -> Acoustics {
    let scene = RoomPlan::new(&PLAN, HEIGHT_M).expect("a flat").scene();
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let all = |share| [share; SURFACE_BANDS];
    let surface = Surface::new(all(absorption), all(0.1), all(0.0)).expect("shares");
    let settings = Settings { head: Head::Omni, ..Settings::default() };
    Acoustics::new(&scene, rays, Surfaces::uniform(&scene, surface), settings)
}

/// Mean energy in the 250 and 500 Hz octaves, decibels re the direct wave at 1 m.
fn levels_db(source: &Source, places: &Places) -> [f64; 2] {
    let energies: Vec<_> = places
        .listeners()
        .map(|listener| {
            let first = source.first_wave(&listener).expect("a way through the doors");
            let measures = Measures::of(&source.impulse_response(&listener), first.delay_s, 1.0);
            [1, 2].map(|band: usize| 10.0_f64.powf(measures.bands[band].level_db.expect("sound") / 10.0))
        })
        .collect();
    [0, 1].map(|band| {
        10.0 * (energies.iter().map(|energy| energy[band]).sum::<f64>() / energies.len() as f64).log10()
    })
}

/// Solver: finite differences in time on 5 cm cubes (scalar wave equation, seven points, Courant number
/// 0.5773), locally reacting walls with the given absorption for diffuse sound (Paris' formula); 1.2 s with
/// absorption 0.1, 0.7 s with 0.3. Octaves as in [`Measures`]. Means over positions, because modes change an
/// octave's level at a position by up to 5 dB.
#[test]
fn levels_behind_doors_match_a_wave_solver() {
    let cases = [
        (0.1, &ONE_DOOR, [0.5, 0.1]),
        (0.1, &TWO_DOORS, [-5.5, -5.7]),
        (0.1, &BEFORE_THE_DOOR, [-5.4, -5.6]),
        (0.3, &ONE_DOOR, [-7.1, -7.1]),
        (0.3, &TWO_DOORS, [-17.4, -18.6]),
        (0.3, &BEFORE_THE_DOOR, [-16.9, -18.0]),
    ];
    let flats = [0.1, 0.3].map(|absorption| (absorption, flat(absorption)));
    for (absorption, places, due_db) in cases {
        let (_, flat) = flats.iter().find(|(known, _)| *known == absorption).expect("a flat");
        let found_db = levels_db(&flat.source(&SOURCE.into()), places);
        for (found_db, due_db) in found_db.iter().zip(due_db) {
            assert!(
                (found_db - due_db).abs() < 3.0,
                "absorption {absorption}, from {:?} on: {found_db}, not {due_db} dB",
                places.first_m
            );
        }
    }
}

/// Sound reaches the other side of the wall at x = 4.0 to 4.2 through two doors. The solver finds steps of
/// 13.4 to 17.4 dB with absorption 0.1 and 23.2 to 26.8 dB with 0.3, mean over three positions on both sides.
#[test]
fn steps_across_walls_match_a_wave_solver() {
    for absorption in [0.1, 0.3] {
        let flat = flat(absorption);
        let source = flat.source(&[1.525, 1.525, 3.025].into());
        for z_m in [3.625, 4.425, 5.225] {
            let beside = |x_m: f32| Places { first_m: [x_m, z_m], step_m: [0.125, 0.0], count: [3, 1] };
            let [this_side, other_side] = [3.675, 4.325].map(|x_m| levels_db(&source, &beside(x_m)));
            for (this_db, other_db) in this_side.iter().zip(other_side) {
                let step_db = this_db - other_db;
                assert!(step_db >= 10.0, "absorption {absorption}, z = {z_m}: {step_db} dB");
            }
        }
    }
}
