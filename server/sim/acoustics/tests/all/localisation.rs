//! Localisation by an agent: bearings from the interaural lag in a step.

use crate::common::{free_field, rooms_of};
use avln_acoustics::{
    Acoustics, Bank, Clip, Ears, Emitter, Listener, SAMPLE_RATE_HZ, Settings, Source, Surface, Surfaces,
};
use avln_geom::{Point3, RayMesh, Rng, angle};
use avln_houses::{HouseOptions, house};
use avln_scene::{RoomPlan, Scene};
use realfft::{RealFftPlanner, num_complex::Complex32};
use std::ops::RangeInclusive;
use std::sync::Arc;

/// A clip from each family.
fn clips() -> Vec<Clip> {
    Bank::default().clips().step_by(10).collect()
}

fn acoustics(scene: &Scene, surfaces: Surfaces) -> Acoustics {
    let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
    Acoustics::new(scene, rays, surfaces, Settings { ray_count: 4096, ..Settings::default() })
}

const ALL_HZ: RangeInclusive<f32> = 0.0..=8000.0;

/// Frequencies without head shadow at the far ear.
const LOW_HZ: RangeInclusive<f32> = 100.0..=4000.0;

/// Conversion from lags to bearings, measured in the open at 3 m.
struct Bearings {
    fourier: Fourier,
    /// Analysed frequencies.
    band_hz: RangeInclusive<f32>,
    /// Lag in samples per bearing.
    lags: Vec<f32>,
}

impl Bearings {
    /// Bearings from -90 to 90 degrees to the left.
    const COUNT: usize = 73;
    const STEP_DEGREES: f32 = 2.5;

    fn degrees_of(index: usize) -> f32 {
        index as f32 * Self::STEP_DEGREES - 90.0
    }

    fn within(band_hz: RangeInclusive<f32>) -> Self {
        let source = free_field().source(&Point3::new(0.0, 1.0, -3.0));
        let mut bearings = Self { fourier: Fourier::default(), band_hz, lags: Vec::new() };
        for index in 0..Self::COUNT {
            let heading_rad = -Self::degrees_of(index).to_radians();
            let listener = Listener { position: [0.0, 1.0, 0.0].into(), heading_rad };
            let mut lags = bearings.lags_of(&source, &listener, &clips()[..3]);
            lags.sort_by(f32::total_cmp);
            bearings.lags.push(lags[lags.len() / 2]);
        }
        bearings
    }

    /// Bearing with this lag, degrees to the left: the mean over the nearest bearings.
    fn degrees(&self, lag: f32) -> f32 {
        let off = |index: &usize| (self.lags[*index] - lag).abs();
        let least = (0..Self::COUNT).map(|index| off(&index)).fold(f32::INFINITY, f32::min);
        let nearest: Vec<_> = (0..Self::COUNT).filter(|index| off(index) <= least + 1e-3).collect();
        nearest.iter().map(|index| Self::degrees_of(*index)).sum::<f32>() / nearest.len() as f32
    }

    /// Lags in some steps per clip.
    fn lags_of(&mut self, source: &Source, listener: &Listener, clips: &[Clip]) -> Vec<f32> {
        let mut lags = Vec::new();
        for clip in clips {
            let emitter = Emitter { source: source.clone(), clip: clip.clone(), offset_samples: 0 };
            let mut ears = Ears::new(vec![emitter], FRAME);
            for step in 0..8 {
                let heard = ears.hear(listener, Some(0));
                if step >= 2 {
                    let (left, right) = heard.split_at(FRAME);
                    lags.push(self.fourier.lag_within(left, right, self.band_hz.clone()));
                }
            }
        }
        lags
    }

    /// Bearings in some steps per clip, degrees to the left.
    fn found(&mut self, house: &Acoustics, source: &Point3<f32>, listener: &Listener) -> Vec<f32> {
        let lags = self.lags_of(&house.source(source), listener, &clips());
        lags.into_iter().map(|lag| self.degrees(lag)).collect()
    }
}

/// A listener with `source` at the given angle to the left.
fn facing(place: Point3<f32>, source: &Point3<f32>, degrees: f32) -> Listener {
    let offset = source - place;
    let bearing_rad = angle::atan2(-offset.x, -offset.z);
    Listener { position: place, heading_rad: bearing_rad - degrees.to_radians() }
}

fn share(found: &[bool]) -> f64 {
    found.iter().filter(|found| **found).count() as f64 / found.len() as f64
}

#[test]
fn visible_sources_are_localised_in_a_reverberant_room() {
    let scene = RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room").scene();
    let surface = Surface::new([0.4; 6], [0.3; 6], [0.0; 6]).expect("shares");
    let room = acoustics(&scene, Surfaces::uniform(&scene, surface));
    let (mut bearings, mut rng, mut hits) = (Bearings::within(ALL_HZ), Rng::new(8), Vec::new());
    let mut pairs = 0;
    while pairs < 16 {
        let mut place = |height_m| Point3::new(rng.range(0.5, 5.5), height_m, rng.range(0.5, 4.5));
        let (source, ears) = (place(1.2), place(1.0));
        if !(0.5..3.5).contains(&(source - ears).norm()) {
            continue;
        }
        pairs += 1;
        let degrees = rng.range(-75.0, 75.0);
        let found = bearings.found(&room, &source, &facing(ears, &source, degrees));
        hits.extend(found.into_iter().map(|found| (found - degrees).abs() <= 15.0));
    }
    assert!(share(&hits) >= 0.95, "{} of {} steps", share(&hits), hits.len());
}

#[test]
fn visible_sources_are_localised_in_houses() {
    let mut agents = [ALL_HZ, LOW_HZ].map(|band_hz| (Bearings::within(band_hz), Vec::new()));
    for seed in [5, 6] {
        let scene = house("bearing", seed, &HouseOptions::small());
        let home = acoustics(&scene, Surfaces::by_material(&scene));
        let mut rng = Rng::new(seed + 4);
        for [source, ears] in pairs_in_sight(&scene, &mut rng) {
            let degrees = rng.range(-75.0, 75.0);
            for (bearings, hits) in &mut agents {
                let found = bearings.found(&home, &source, &facing(ears, &source, degrees));
                hits.extend(found.into_iter().map(|found| (found - degrees).abs() <= 15.0));
            }
        }
    }
    for (bearings, hits) in &agents {
        let share = share(hits);
        assert!(share >= 0.8, "{share} of {} steps within {:?} Hz", hits.len(), bearings.band_hz);
    }
}

/// Sources and visible ears in the same room, up to 5 m apart.
fn pairs_in_sight(scene: &Scene, rng: &mut Rng) -> Vec<[Point3<f32>; 2]> {
    let rays = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
    let mut pairs = Vec::new();
    while pairs.len() < 8 {
        let room = rng.choose(&scene.regions).expect("rooms").bounds;
        let mut place = |height_m: f32| {
            let along = |rng: &mut Rng, axis: usize| rng.range(room.min[axis] + 0.4, room.max[axis] - 0.4);
            Point3::new(along(rng, 0), room.min.y + height_m, along(rng, 2))
        };
        let (source, ears) = (place(0.8), place(1.0));
        if (0.7..5.0).contains(&(source - ears).norm()) && rays.is_clear(&ears, &source) {
            pairs.push([source, ears]);
        }
    }
    pairs
}

#[test]
fn hidden_sources_are_localised_at_the_door() {
    let settings = Settings { ray_count: 4096, ..Settings::default() };
    let surface = Surface::new([0.3; 6], [0.3; 6], [0.0; 6]).expect("shares");
    let flat = rooms_of(surface, settings);
    let (mut bearings, mut hits) = (Bearings::within(LOW_HZ), Vec::new());
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

/// Delay at the right ear, samples: a source 45 degrees to the left.
const LAG: i32 = 8;
/// Two samples are about 15 degrees.
const TOLERANCE: f32 = 2.0;

/// Share of loop frames with the right lag.
fn placed(fourier: &mut Fourier, clip: &[f32]) -> f64 {
    let ears = [0, LAG].map(|lag| heard(fourier, clip, &response(lag)));
    let [left, right] = ears.each_ref().map(|ear| ear.chunks_exact(FRAME));
    let found =
        left.zip(right).map(|(left, right)| (fourier.lag(left, right) - LAG as f32).abs() <= TOLERANCE);
    let found: Vec<bool> = found.collect();
    found.iter().filter(|&&found| found).count() as f64 / found.len() as f64
}

/// The loop `clip` through `response`.
fn heard(fourier: &mut Fourier, clip: &[f32], response: &[f32]) -> Vec<f32> {
    let through = fourier.spectrum(response, clip.len());
    let product = fourier.spectrum(clip, clip.len()).iter().zip(&through).map(|(a, b)| a * b).collect();
    fourier.signal(product, clip.len())
}

/// Direct sound after `lag` samples, and a diffuse tail with fourfold energy: 60 dB in 0.25 s.
fn response(lag: i32) -> Vec<f32> {
    let mut rng = Rng::new(31 + lag as u64);
    let decay = |n: usize| libm::expf(-6.9 * n as f32 / FRAME as f32);
    let tail: Vec<f32> = (0..FRAME).map(|n| decay(n) * rng.range(-1.0, 1.0)).collect();
    let energy: f32 = tail.iter().map(|sample| sample * sample).sum();
    let mut response = vec![0.0; FRAME + 64];
    response[lag as usize] = 1.0;
    response[40..].iter_mut().zip(&tail).for_each(|(sum, sample)| *sum += 2.0 * sample / energy.sqrt());
    response
}

#[test]
fn clips_are_localised_in_95_percent_of_steps() {
    let mut fourier = Fourier::default();
    for clip in Bank::default().clips() {
        let share = placed(&mut fourier, &clip.samples);
        assert!(share >= 0.95, "{}: its lag is found in {share} of the steps", clip.name);
    }
}

#[test]
fn tones_are_not_localised() {
    let mut fourier = Fourier::default();
    let turn = std::f32::consts::TAU * 3000.0 / SAMPLE_RATE_HZ as f32;
    let tone: Vec<f32> =
        (0..24 * FRAME).map(|n| 0.07 * libm::sinf((turn * n as f32) % std::f32::consts::TAU)).collect();
    let share = placed(&mut fourier, &tone);
    assert!(share < 0.7, "{share}");
}

/// A step: a quarter of a second.
const FRAME: usize = 4000;

/// Oversampling factor.
const FINE: usize = 8;

/// Longest interaural lag, samples.
const LONGEST_LAG: i32 = 13;

/// Transforms.
#[derive(Default)]
struct Fourier(RealFftPlanner<f32>);

impl Fourier {
    fn spectrum(&mut self, signal: &[f32], length: usize) -> Vec<Complex32> {
        let mut padded = signal.to_vec();
        padded.resize(length, 0.0);
        let forward = self.0.plan_fft_forward(length);
        let mut spectrum = forward.make_output_vec();
        forward.process(&mut padded, &mut spectrum).expect("lengths agree");
        spectrum
    }

    fn signal(&mut self, mut spectrum: Vec<Complex32>, length: usize) -> Vec<f32> {
        spectrum.resize(length / 2 + 1, Complex32::default());
        (spectrum[0].im, spectrum[length / 2].im) = (0.0, 0.0);
        let inverse = self.0.plan_fft_inverse(length);
        let mut signal = inverse.make_output_vec();
        inverse.process(&mut spectrum, &mut signal).expect("lengths agree");
        signal
    }

    /// Lag at the right ear, samples, by generalised cross-correlation with phase transform (Knapp and Carter
    /// 1976) over all frequencies.
    fn lag(&mut self, left: &[f32], right: &[f32]) -> f32 {
        self.lag_within(left, right, 0.0..=8000.0)
    }

    /// Lag within `band_hz`, with equal weights.
    fn lag_within(&mut self, left: &[f32], right: &[f32], band_hz: RangeInclusive<f32>) -> f32 {
        let length = 2 * FRAME;
        let (left, right) = (self.spectrum(left, length), self.spectrum(right, length));
        let phase = |(bin, (l, r)): (usize, (&Complex32, &Complex32))| {
            let cross = r * l.conj();
            let counts = band_hz.contains(&(bin as f32 * 16_000.0 / length as f32));
            if counts { cross / cross.norm().max(1e-12) } else { Complex32::default() }
        };
        let fine = FINE as i32;
        let phases = left.iter().zip(&right).enumerate().map(phase).collect();
        let correlation = self.signal(phases, FINE * length);
        let at = |lag: i32| correlation[lag.rem_euclid(correlation.len() as i32) as usize];
        let lags = -LONGEST_LAG * fine..=LONGEST_LAG * fine;
        lags.max_by(|&a, &b| at(a).total_cmp(&at(b))).expect("a lag") as f32 / fine as f32
    }
}
