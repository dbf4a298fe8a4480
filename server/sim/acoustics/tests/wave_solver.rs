//! Levels behind doors, against what a wave solver finds in the same flat.

use avln_acoustics::{
    Acoustics, Head, Listener, Measures, SURFACE_BANDS, Settings, Source, Surface, Surfaces,
};
use avln_geom::{Point3, RayMesh};
use avln_scene::RoomPlan;
use std::sync::Arc;

/// A room on the left, two on the right, walls of 0.2 m. Doors as high as the rooms: from the left into the upper right
/// at z = 1.0 to 1.9, from there into the lower right at x = 7.0 to 7.9.
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

/// In the lower right room.
const SOURCE: [f32; 3] = [8.225, 1.525, 4.625];

/// Places at a height of 1.225 m, as rows along x and z.
struct Places {
    first_m: [f32; 2],
    step_m: [f32; 2],
    count: [usize; 2],
}

/// Behind one door: all of the upper right room.
const ONE_DOOR: Places = Places { first_m: [4.575, 0.475], step_m: [0.6, 0.4], count: [9, 6] };

/// Behind two doors: all of the left room.
const TWO_DOORS: Places = Places { first_m: [0.575, 0.475], step_m: [0.4, 0.6], count: [8, 9] };

/// Behind two doors: the part of the left room that lies before the first of them.
const BEFORE_THE_DOOR: Places = Places { first_m: [0.575, 1.075], step_m: [0.2, 0.2], count: [6, 6] };

impl Places {
    fn listeners(&self) -> impl Iterator<Item = Listener> {
        let at = |axis: usize, index: usize| self.first_m[axis] + index as f32 * self.step_m[axis];
        let place = move |x, z| Point3::new(at(0, x), 1.225, at(1, z));
        let places = (0..self.count[0]).flat_map(move |x| (0..self.count[1]).map(move |z| place(x, z)));
        places.map(|position| Listener { position, heading_rad: 0.0 })
    }
}

/// The flat, all of one surface, heard without a head.
fn flat(absorption: f32) -> Acoustics {
    let scene = RoomPlan::new(&PLAN, HEIGHT_M).expect("a flat").scene();
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    let all = |share| [share; SURFACE_BANDS];
    let surface = Surface::new(all(absorption), all(0.1), all(0.0)).expect("shares");
    let settings = Settings { head: Head::Omni, ..Settings::default() };
    Acoustics::new(&scene, rays, Surfaces::uniform(&scene, surface), settings)
}

/// Mean energy over places, decibels re the direct wave at 1 m, of the octaves of 250 and 500 Hz.
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

/// Solver: finite differences in time on cubes of 5 cm (scalar wave equation, seven points, Courant number 0.5773), walls of
/// locally reacting impedance whose absorption for sound from everywhere (Paris' formula) is the given one; 1.2 s with
/// absorption 0.1, 0.7 s with 0.3. Octaves are measured as [`Measures`] does. Means over places, because modes move the
/// level of an octave at one place by up to 5 dB.
#[test]
fn levels_behind_doors_are_those_of_a_wave_solver() {
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

/// Across the wall at x = 4.0 to 4.2, on whose other side sound has come through two doors, the solver finds steps of 13.4
/// to 17.4 dB with absorption 0.1 and 23.2 to 26.8 dB with 0.3, mean of three places on either side.
#[test]
fn a_wall_keeps_in_what_does_not_leave_by_the_door() {
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
