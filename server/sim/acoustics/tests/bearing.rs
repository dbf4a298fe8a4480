//! What an agent makes of it: where a sound comes from, by the lag between its ears in each step.

mod common;

use avln_acoustics::{Acoustics, Bank, Clip, Ears, Emitter, Listener, Settings, Surface, Surfaces};
use avln_geom::{Point3, RayMesh, Rng, angle};
use avln_scene::procedural::{HouseOptions, house};
use avln_scene::{RoomPlan, Scene};
use common::lag::{FRAME, Fourier};
use common::{free_field, rooms_of};
use std::sync::Arc;

/// One clip of each family.
fn clips() -> Vec<Clip> {
    Bank::default().clips().step_by(10).collect()
}

fn acoustics(scene: &Scene, surfaces: Surfaces) -> Acoustics {
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    Acoustics::new(scene, rays, surfaces, Settings { ray_count: 4096, ..Settings::default() })
}

/// From lags to bearings: what ears in the open hear of a source 3 m away.
struct Bearings {
    fourier: Fourier,
    /// Lag, samples, for each of [`Bearings::DEGREES`].
    lags: Vec<f32>,
}

impl Bearings {
    const DEGREES: [f32; 37] = {
        let mut degrees = [0.0; 37];
        let mut index = 0;
        while index < 37 {
            degrees[index] = index as f32 * 5.0 - 90.0;
            index += 1;
        }
        degrees
    };

    fn new() -> Self {
        let (open, mut fourier) = (free_field(), Fourier::default());
        let source = open.source(&Point3::new(0.0, 1.0, -3.0));
        let lags = Self::DEGREES.map(|degrees| {
            let listener = Listener { position: [0.0, 1.0, 0.0].into(), heading_rad: -degrees.to_radians() };
            let emitter = Emitter { source: source.clone(), clip: clips().remove(0), offset_samples: 0 };
            let mut ears = Ears::new(vec![emitter], FRAME);
            ears.hear(&listener, Some(0));
            let heard = ears.hear(&listener, Some(0));
            fourier.lag(&heard[..FRAME], &heard[FRAME..])
        });
        Self { fourier, lags: lags.to_vec() }
    }

    /// Degrees to the left at which a source in front has this lag.
    fn degrees(&self, lag: f32) -> f32 {
        let off = |index: &usize| (self.lags[*index] - lag).abs();
        let best = (0..self.lags.len()).min_by(|a, b| off(a).total_cmp(&off(b))).expect("some");
        Self::DEGREES[best]
    }

    /// Bearings found in some steps of every family's clip, degrees to the left.
    fn found(&mut self, house: &Acoustics, source: &Point3<f32>, listener: &Listener) -> Vec<f32> {
        let mut found = Vec::new();
        for clip in clips() {
            let mut ears =
                Ears::new(vec![Emitter { source: house.source(source), clip, offset_samples: 0 }], FRAME);
            for step in 0..8 {
                let heard = ears.hear(listener, Some(0));
                if step >= 2 {
                    let lag = self.fourier.lag(&heard[..FRAME], &heard[FRAME..]);
                    found.push(self.degrees(lag));
                }
            }
        }
        found
    }
}

/// The listener with `source` at so many degrees to the left.
fn facing(place: Point3<f32>, source: &Point3<f32>, degrees: f32) -> Listener {
    let offset = source - place;
    let bearing_rad = angle::atan2(-offset.x, -offset.z);
    Listener { position: place, heading_rad: bearing_rad - degrees.to_radians() }
}

fn share(found: &[bool]) -> f64 {
    found.iter().filter(|found| **found).count() as f64 / found.len() as f64
}

#[test]
fn sources_in_sight_are_placed_in_a_room_of_a_quarter_of_a_second() {
    let scene = RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
    let surface = Surface::new([0.4; 6], [0.3; 6], [0.0; 6]).expect("shares");
    let room = acoustics(&scene, Surfaces::uniform(&scene, surface));
    let (mut bearings, mut rng, mut hits) = (Bearings::new(), Rng::new(8), Vec::new());
    for _ in 0..8 {
        let (from_rad, away_m) = (rng.range(-3.1, 3.1), rng.range(0.8, 2.0));
        let (sin, cos) = angle::sin_cos(from_rad);
        let ears = Point3::new(3.0, 1.0, 2.5);
        let source = Point3::new(3.0 + away_m * sin, 1.2, 2.5 + away_m * cos);
        let degrees = rng.range(-75.0, 75.0);
        let found = bearings.found(&room, &source, &facing(ears, &source, degrees));
        hits.extend(found.into_iter().map(|found| (found - degrees).abs() <= 15.0));
    }
    assert!(share(&hits) >= 0.95, "{} of {} steps", share(&hits), hits.len());
}

#[test]
fn sources_in_sight_are_placed_in_houses() {
    let scene = house("bearing", 5, &HouseOptions::small());
    let home = acoustics(&scene, Surfaces::by_material(&scene));
    let rays = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
    let (mut bearings, mut rng, mut hits) = (Bearings::new(), Rng::new(9), Vec::new());
    let mut pairs = 0;
    while pairs < 16 {
        let room = rng.choose(&scene.regions).expect("rooms").bounds;
        let mut place = |height_m: f32| {
            let along = |rng: &mut Rng, axis: usize| rng.range(room.min[axis] + 0.4, room.max[axis] - 0.4);
            Point3::new(along(&mut rng, 0), room.min.y + height_m, along(&mut rng, 2))
        };
        let (source, ears) = (place(0.8), place(1.0));
        let distance_m = (source - ears).norm();
        if !(0.7..5.0).contains(&distance_m) || !rays.is_clear(&ears, &source) {
            continue;
        }
        pairs += 1;
        let degrees = rng.range(-75.0, 75.0);
        let found = bearings.found(&home, &source, &facing(ears, &source, degrees));
        hits.extend(found.into_iter().map(|found| (found - degrees).abs() <= 15.0));
    }
    assert!(share(&hits) >= 0.6, "{} of {} steps", share(&hits), hits.len());
}

#[test]
fn sources_behind_a_door_are_placed_in_the_door() {
    let settings = Settings { ray_count: 4096, ..Settings::default() };
    let surface = Surface::new([0.3; 6], [0.3; 6], [0.0; 6]).expect("shares");
    let flat = rooms_of(surface, settings);
    let (mut bearings, mut hits) = (Bearings::new(), Vec::new());
    let door = [Point3::new(4.1, 1.0, 1.0), Point3::new(4.1, 1.0, 1.9)];
    for (source, ears) in [([1.0, 1.2, 3.3], [6.4, 1.0, 3.3]), ([1.5, 1.0, 3.6], [5.6, 1.0, 3.0])] {
        let (source, ears) = (Point3::from(source), Point3::from(ears));
        for degrees in [-40.0, 0.0, 40.0] {
            let listener = facing(ears, &Point3::new(4.1, 1.0, 1.45), degrees);
            let edges = door.map(|edge| {
                let offset = edge - ears;
                let off_rad = angle::atan2(-offset.x, -offset.z) - listener.heading_rad;
                angle::wrap(off_rad).to_degrees()
            });
            let (low, high) = (edges[0].min(edges[1]) - 20.0, edges[0].max(edges[1]) + 20.0);
            let found = bearings.found(&flat, &source, &listener);
            hits.extend(found.into_iter().map(|found| (low..=high).contains(&found)));
        }
    }
    assert!(share(&hits) >= 0.7, "{} of {} steps", share(&hits), hits.len());
}
