//! Reverberation as it is heard, against theory.

mod common;

use avln_acoustics::{
    Acoustics, Head, ImpulseResponse, Listener, Measures, SURFACE_BANDS, Settings, Surface, Surfaces,
};
use avln_geom::RayMesh;
use avln_scene::{RoomPlan, Scene};
use common::{energy_db, first_wave, listener, opaque_rooms, point, two_rooms};
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

/// Sabine and Eyring, and the energy after the direct wave, for a box of 6 x 5 x 3 m.
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
fn a_room_reverberates_as_theory_says_in_every_band() {
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
fn reflections_take_no_energy_from_the_rest_and_add_none() {
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
fn walls_keep_reverberation_in_its_room() {
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
fn sound_leaves_a_room_without_a_ceiling() {
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
fn no_rays_no_reverberation() {
    let silent = opaque_rooms(true, first_wave());
    let response: ImpulseResponse =
        silent.source(&point(1.2, 1.0, 3.0)).impulse_response(&listener(3.0, 2.0, 0.0));
    assert!(response.len() < 400, "{}", response.len());
}

#[test]
fn broken_triangles_are_no_surfaces() {
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
