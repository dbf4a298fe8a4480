//! Small buildings and measurements for several tests.

use avln_acoustics::{
    Acoustics, Clip, ImpulseResponse, Listener, SAMPLE_RATE_HZ, SURFACE_BANDS, Settings, Surface, Surfaces,
};
use avln_geom::{Aabb, Point3, RayMesh, Rng};
use avln_scene::{InstanceId, Lighting, Mesh, Scene};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Solid boxes, given by opposite corners, with default settings and an unnamed material.
pub(crate) fn building(boxes: &[[[f32; 3]; 2]]) -> Acoustics {
    acoustics(boxes, Settings::default(), Surfaces::by_material)
}

/// Solid boxes without transmission.
pub(crate) fn opaque_building(boxes: &[[[f32; 3]; 2]], settings: Settings) -> Acoustics {
    let plaster = [0.02, 0.02, 0.03, 0.03, 0.04, 0.05];
    let surface = Surface::new(plaster, [0.1; SURFACE_BANDS], [0.0; SURFACE_BANDS]).expect("shares");
    acoustics(boxes, settings, |scene| Surfaces::uniform(scene, surface))
}

/// Settings without reflections and late energy.
pub(crate) fn first_wave() -> Settings {
    Settings { reflection_order: 0, ray_count: 0, ..Settings::default() }
}

fn acoustics(
    boxes: &[[[f32; 3]; 2]],
    settings: Settings,
    surfaces: impl Fn(&Scene) -> Surfaces,
) -> Acoustics {
    let mut mesh = Mesh::default();
    for [low, high] in boxes {
        add_box(&mut mesh, &Aabb::new((*low).into(), (*high).into()));
    }
    let rays = Arc::new(RayMesh::new(&mesh.positions, &mesh.triangles));
    let scene = Scene {
        name: "test".into(),
        mesh,
        materials: Vec::new(),
        textures: Vec::new(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    };
    let surfaces = surfaces(&scene);
    Acoustics::new(&scene, rays, surfaces, settings)
}

fn add_box(mesh: &mut Mesh, bounds: &Aabb) {
    const FACES: [[usize; 4]; 6] =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let first = mesh.positions.len() as u32;
    let ends = [bounds.min, bounds.max];
    for corner in 0..8_usize {
        mesh.positions.push(Point3::new(ends[corner >> 2].x, ends[corner >> 1 & 1].y, ends[corner & 1].z));
        mesh.uvs.push(Default::default());
        mesh.colors.push([255; 3]);
    }
    for [a, b, c, d] in FACES.map(|face| face.map(|corner| first + corner as u32)) {
        for triangle in [[a, b, c], [a, c, d]] {
            mesh.triangles.push(triangle);
            mesh.material_of.push(0);
            mesh.instance_of.push(InstanceId::NONE);
        }
    }
}

/// Open air.
pub(crate) fn free_field() -> Acoustics {
    building(&[])
}

/// Two rooms, each 4 x 4 x 2.6 m, divided at x = 4.0 to 4.2 by a wall with a room-high door at z = 1.0 to
/// 1.9, open if `door`.
pub(crate) fn two_rooms(door: bool) -> Acoustics {
    building(&two_rooms_boxes(door))
}

/// Two rooms without transmission.
pub(crate) fn opaque_rooms(door: bool, settings: Settings) -> Acoustics {
    opaque_building(&two_rooms_boxes(door), settings)
}

/// Two rooms with a single kind of surface.
pub(crate) fn rooms_of(surface: Surface, settings: Settings) -> Acoustics {
    acoustics(&two_rooms_boxes(true), settings, |scene| Surfaces::uniform(scene, surface))
}

fn two_rooms_boxes(door: bool) -> Vec<[[f32; 3]; 2]> {
    let mut boxes = vec![
        [[-0.2, -0.2, -0.2], [8.4, 0.0, 4.2]],
        [[-0.2, 2.6, -0.2], [8.4, 2.8, 4.2]],
        [[-0.2, 0.0, -0.2], [0.0, 2.6, 4.2]],
        [[8.2, 0.0, -0.2], [8.4, 2.6, 4.2]],
        [[0.0, 0.0, -0.2], [8.2, 2.6, 0.0]],
        [[0.0, 0.0, 4.0], [8.2, 2.6, 4.2]],
        [[4.0, 0.0, 0.0], [4.2, 2.6, 1.0]],
        [[4.0, 0.0, 1.9], [4.2, 2.6, 4.0]],
    ];
    if !door {
        boxes.push([[4.0, 0.0, 1.0], [4.2, 2.6, 1.9]]);
    }
    boxes
}

pub(crate) fn point(x: f32, y: f32, z: f32) -> Point3<f32> {
    Point3::new(x, y, z)
}

/// A listener 1 m above the floor.
pub(crate) fn listener(x: f32, z: f32, heading_deg: f32) -> Listener {
    Listener { position: point(x, 1.0, z), heading_rad: heading_deg.to_radians() }
}

/// Real and imaginary part at a frequency.
pub(crate) fn bin(ear: &[f32], frequency_hz: f64) -> (f64, f64) {
    let turn = TAU * frequency_hz / f64::from(SAMPLE_RATE_HZ);
    ear.iter().enumerate().fold((0.0, 0.0), |(re, im), (n, tap)| {
        let phase = turn * n as f64;
        (re + f64::from(*tap) * phase.cos(), im - f64::from(*tap) * phase.sin())
    })
}

/// Level at a frequency, decibels.
pub(crate) fn level_db(ear: &[f32], frequency_hz: f64) -> f64 {
    let (re, im) = bin(ear, frequency_hz);
    10.0 * (re * re + im * im).log10()
}

/// Energy at both ears, decibels.
pub(crate) fn energy_db(response: &ImpulseResponse) -> f64 {
    let energy = |ear: &[f32]| ear.iter().map(|tap| f64::from(tap * tap)).sum::<f64>();
    10.0 * (energy(&response.left) + energy(&response.right)).log10()
}

/// Lag at the left ear, microseconds: cross-correlation peak from `low_hz` to `high_hz` within 1 ms.
pub(crate) fn lag_us(response: &ImpulseResponse, low_hz: f64, high_hz: f64) -> f64 {
    lag_of_spectra_us(|hz| [bin(&response.left, hz), bin(&response.right, hz)], low_hz, high_hz)
}

/// Lag from two spectra by frequency: real and imaginary parts, left ear first.
pub(crate) fn lag_of_spectra_us(spectra: impl Fn(f64) -> [(f64, f64); 2], low_hz: f64, high_hz: f64) -> f64 {
    let steps = 40;
    let products: Vec<_> = (0..=steps)
        .map(|i| low_hz + (high_hz - low_hz) * f64::from(i) / f64::from(steps))
        .map(|hz| (hz, spectra(hz)))
        .map(|(hz, [l, r])| (hz, l.0 * r.0 + l.1 * r.1, l.1 * r.0 - l.0 * r.1))
        .collect();
    let similarity = |lag_us: f64| -> f64 {
        let turned = |(hz, re, im): &(f64, f64, f64)| {
            let phase = TAU * hz * lag_us * 1e-6;
            re * phase.cos() - im * phase.sin()
        };
        products.iter().map(turned).sum()
    };
    let best_of = |middle_us: f64, reach: i32, step_us: f64| {
        let lags = (-reach..=reach)
            .map(|step| middle_us + f64::from(step) * step_us)
            .map(|lag| (similarity(lag), lag));
        lags.max_by(|a, b| a.0.total_cmp(&b.0)).map_or(f64::NAN, |(_, lag)| lag)
    };
    best_of(best_of(0.0, 100, 10.0), 10, 1.0)
}

/// White noise with `length` samples.
pub(crate) fn noise(seed: u64, length: usize) -> Clip {
    let mut rng = Rng::new(seed);
    Clip { name: "noise".into(), samples: (0..length).map(|_| rng.range(-1.0, 1.0)).collect() }
}
