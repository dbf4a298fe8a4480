//! Late energy against theory: Eyring, Sabine, diffuse fields.

use super::LateField;
use super::cells::{CHANNELS, Slice, middle_s, slice_count, start_s};
use super::tail::add_tail;
use super::trace::trace;
use crate::bands::BANDS;
use crate::building::{Building, Settings};
use crate::head::Head;
use crate::images::Images;
use crate::impulse::{ImpulseResponse, Listener};
use crate::surfaces::{SURFACE_BANDS, Surface};
use crate::tests::{Soup, building};
use crate::{SPEED_OF_SOUND_M_S, interaural_delay_s};
use avln_geom::{Point3, Vector3};
use std::f64::consts::PI;

const SIZE_M: [f32; 3] = [6.0, 3.0, 5.0];

fn surface(absorption: f32, scattering: f32) -> Surface {
    let all = |share| [share; SURFACE_BANDS];
    Surface::new(all(absorption), all(scattering), all(0.0)).expect("shares")
}

fn settings(rays: usize) -> Settings {
    Settings { ray_count: rays, reflection_order: 0, ..Settings::default() }
}

fn room(surface: Surface, settings: Settings) -> Building {
    building(&Soup::room(SIZE_M, 1), surface, settings)
}

fn field(building: &Building, source: [f32; 3]) -> LateField {
    LateField::new(building, &source.into(), &Images::new(building, &source.into()))
}

/// Band energy per time slice, averaged over room positions, without air absorption.
fn mean_energy(building: &Building, field: &LateField, band: usize) -> Vec<f64> {
    let places: Vec<_> = (1..6).flat_map(|x| (1..5).map(move |z| [x as f32, 1.3, z as f32])).collect();
    let mut sums = Vec::new();
    for place in &places {
        let echo = field.at(building, &Point3::from(*place));
        sums.resize(echo.len(), 0.0);
        for (sum, slice) in sums.iter_mut().zip(&echo) {
            *sum += f64::from(slice.energy[band]) / places.len() as f64;
        }
    }
    sums
}

fn mid_s(bin: usize) -> f64 {
    f64::from(middle_s(bin))
}

fn width_s(bin: usize) -> f64 {
    f64::from(start_s(bin + 1) - start_s(bin))
}

/// Seconds for 60 dB, from a straight line through the decibels between two times.
fn reverberation_s(energy: &[f64], from_s: f64, to_s: f64) -> f64 {
    let points: Vec<_> = (0..energy.len())
        .filter(|bin| (from_s..to_s).contains(&mid_s(*bin)))
        .map(|bin| (mid_s(bin), 10.0 * (energy[bin] / width_s(bin)).log10()))
        .collect();
    let count = points.len() as f64;
    let (x, y) =
        points.iter().fold((0.0, 0.0), |sum, point| (sum.0 + point.0 / count, sum.1 + point.1 / count));
    let slope = points.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
        / points.iter().map(|p| (p.0 - x) * (p.0 - x)).sum::<f64>();
    -60.0 / slope
}

/// Reverberation times after Eyring and Sabine, seconds.
fn theory(absorption: f64) -> (f64, f64) {
    let [x, y, z] = SIZE_M.map(f64::from);
    let (volume, area) = (x * y * z, 2.0 * (x * y + y * z + z * x));
    let constant = 24.0 * 10.0_f64.ln() / f64::from(SPEED_OF_SOUND_M_S) * volume / area;
    (constant / -(1.0 - absorption).ln(), constant / absorption)
}

#[test]
fn decay_lies_between_eyring_and_sabine() {
    for (absorption, scattering) in [(0.05_f32, 0.5), (0.1, 0.3), (0.2, 0.5), (0.4, 0.9)] {
        let building = room(surface(absorption, scattering), settings(2000));
        let energy = mean_energy(&building, &field(&building, [1.4, 1.2, 1.9]), 1);
        let (eyring_s, sabine_s) = theory(f64::from(absorption));
        // Air takes little at 250 Hz: 1.31 dB per kilometre.
        let air = |time_s: f64| 1.0 / (1.0 / time_s + 0.001_31 * f64::from(SPEED_OF_SOUND_M_S) / 60.0);
        let found_s = reverberation_s(&energy, 0.05 * eyring_s + 0.01, (0.6 * eyring_s).min(0.9));
        assert!(
            (0.93 * air(eyring_s)..1.07 * air(sabine_s)).contains(&found_s),
            "{absorption}, {scattering}: {found_s} s, Eyring {eyring_s}, Sabine {sabine_s}"
        );
    }
}

#[test]
fn energy_is_constant_without_absorption() {
    let building = room(surface(0.0, 0.5), settings(6000));
    let source = Point3::new(1.4, 1.2, 1.9);
    let images = Images::new(&building, &source);
    let bins = slice_count(1.0);
    let tally = trace(&building, &source, &images, 1);
    assert_eq!(tally.lost_share, 0.0);
    let counted: f32 =
        (0..building.cells.len()).map(|cell| building.cells.volume_m3(&building.air, cell)).sum();
    let room: f32 = SIZE_M.iter().product();
    // All rays travel all the time, uniformly in the volume; slices from 80 ms to 1 s.
    for bin in 16..bins - 1 {
        let found: f32 = tally.sums.chunks(bins * CHANNELS).map(|row| row[bin * CHANNELS]).sum();
        let due = 4.0 * PI * width_s(bin) * f64::from(SPEED_OF_SOUND_M_S) * f64::from(counted / room);
        let share = f64::from(found) / due;
        assert!((share - 1.0).abs() < 0.01, "slice {bin}: {share}");
    }
}

#[test]
fn diffuse_level_matches_theory() {
    for absorption in [0.1_f32, 0.3] {
        let building = room(surface(absorption, 0.7), settings(2000));
        let energy: f64 = mean_energy(&building, &field(&building, [1.4, 1.2, 1.9]), 1).iter().sum();
        let [x, y, z] = SIZE_M.map(f64::from);
        let area = 2.0 * (x * y + y * z + z * x) * f64::from(absorption);
        let due_db = 10.0 * (16.0 * PI * (1.0 - f64::from(absorption)) / area).log10();
        let found_db = 10.0 * energy.log10();
        assert!((found_db - due_db).abs() < 1.0, "{absorption}: {found_db}, not {due_db} dB");
    }
}

#[test]
fn full_absorption_leaves_no_late_energy() {
    let building = room(surface(1.0, 0.5), settings(500));
    let energy = mean_energy(&building, &field(&building, [1.4, 1.2, 1.9]), 2);
    assert!(energy.iter().all(|energy| *energy == 0.0));
}

#[test]
fn bands_do_not_mix() {
    let decay = |other: f32| {
        let mut kind = surface(0.2, 0.4);
        kind.absorption[4] = other;
        let building = room(kind, settings(500));
        mean_energy(&building, &field(&building, [1.4, 1.2, 1.9]), 2)
    };
    let (one, other) = (decay(0.1), decay(0.6));
    let (one_s, other_s) = (reverberation_s(&one, 0.02, 0.3), reverberation_s(&other, 0.02, 0.3));
    assert!((one_s / other_s - 1.0).abs() < 0.005, "{one_s} and {other_s}");
}

#[test]
fn responses_match_the_field_energy_and_decay() {
    let building = room(surface(0.2, 0.5), Settings { head: Head::Omni, ..settings(1000) });
    let field = field(&building, [1.4, 1.2, 1.9]);
    let echo = field.at(&building, &Point3::new(4.0, 1.3, 3.0));
    let mut response = ImpulseResponse::default();
    let listener = Listener { position: Point3::new(4.0, 1.3, 3.0), heading_rad: 0.4 };
    add_tail(&mut response, &listener, &echo, 3.0, &building.settings);
    let first = (3.0 / SPEED_OF_SOUND_M_S * 16_000.0) as usize;
    assert!(response.left[..first].iter().all(|sample| *sample == 0.0));
    assert_eq!(response.left, response.right);
    // White noise in octaves: half an octave to both sides, the first and last extended.
    let edges_hz = [40.0, 176.8, 353.6, 707.1, 1414.2, 2828.4, 5656.9, 8000.0];
    for (from_s, to_s) in [(0.0, 0.05), (0.05, 0.16), (0.16, 0.4)] {
        let within = (0..echo.len()).filter(|bin| (from_s..to_s).contains(&mid_s(*bin)));
        let due: f64 = within
            .flat_map(|bin| edges_hz.windows(2).zip(echo[bin].energy))
            .map(|(edges, energy)| (edges[1] - edges[0]) / 8000.0 * f64::from(energy))
            .sum();
        let cut = &response.left[(from_s * 16e3) as usize..(to_s * 16e3) as usize];
        let found: f64 = cut.iter().map(|sample| f64::from(sample * sample)).sum();
        let db = 10.0 * (found / due).log10();
        assert!(db.abs() < 0.5, "{db} dB from {from_s} to {to_s} s");
    }
}

#[test]
fn triangulation_does_not_change_late_energy() {
    let energy = |pieces: usize| {
        let building = building(&Soup::room(SIZE_M, pieces), surface(0.2, 0.4), settings(1000));
        mean_energy(&building, &field(&building, [1.4, 1.2, 1.9]), 3).iter().sum::<f64>()
    };
    let step_db = 10.0 * (energy(1) / energy(14)).log10();
    assert!(step_db.abs() < 0.2, "{step_db} dB");
}

/// Mean squared relative deviation between keys: energy from 10 to 60 ms at some positions.
fn variance(rays: usize) -> f64 {
    const KEYS: u64 = 8;
    let building = room(surface(0.1, 0.4), settings(rays));
    let source = Point3::new(1.4, 1.2, 1.9);
    let images = Images::new(&building, &source);
    let fields: Vec<_> =
        (0..KEYS).map(|key| LateField::with_key(&building, &source, &images, key << 32)).collect();
    let places = (1..6).flat_map(|x| (1..5).map(move |z| Point3::new(x as f32, 1.3, z as f32)));
    let variances = places.map(|place| {
        let early = |field: &LateField| {
            let echo = field.at(&building, &place);
            echo[2..12].iter().map(|slice| f64::from(slice.energy[2])).sum::<f64>()
        };
        let energies: Vec<f64> = fields.iter().map(early).collect();
        let mean = energies.iter().sum::<f64>() / KEYS as f64;
        energies.iter().map(|energy| (energy / mean - 1.0) * (energy / mean - 1.0)).sum::<f64>() / KEYS as f64
    });
    variances.sum::<f64>() / 20.0
}

#[test]
fn four_times_the_rays_halve_the_error() {
    let (few, many) = (variance(400).sqrt(), variance(1600).sqrt());
    assert!((0.4..0.6).contains(&(many / few)), "{many} over {few}");
}

#[test]
fn source_and_listener_are_interchangeable() {
    let building = room(surface(0.15, 0.5), settings(4000));
    let places = [[1.4, 1.2, 1.9], [4.5, 1.6, 3.8], [3.0, 0.9, 0.8], [5.1, 2.2, 1.1]];
    let fields: Vec<_> = places.iter().map(|place| field(&building, *place)).collect();
    let energy_db = |from: usize, to: usize| {
        let echo = fields[from].at(&building, &places[to].into());
        10.0 * echo.iter().map(|slice| f64::from(slice.energy[2])).sum::<f64>().log10()
    };
    for (a, b) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
        let step_db = energy_db(a, b) - energy_db(b, a);
        assert!(step_db.abs() < 0.5, "{a} and {b}: {step_db} dB");
    }
}

#[test]
fn lateral_energy_is_louder_at_the_facing_ear() {
    let slice = Slice { energy: [1e-3; BANDS], flow: Vector3::new(0.95, 0.0, 0.0) };
    let echo = vec![slice; 20];
    let listener = Listener { position: Point3::origin(), heading_rad: 0.0 };
    let mut response = ImpulseResponse::default();
    add_tail(&mut response, &listener, &echo, 1.0, &settings(0));
    let energy = |ear: &[f32]| ear.iter().map(|sample| f64::from(sample * sample)).sum::<f64>();
    // The sound travels to the right, so the left ear faces it.
    let (early, late) = (0..1280, 1400..2000);
    for span in [early, late] {
        let level_db = 10.0 * (energy(&response.left[span.clone()]) / energy(&response.right[span])).log10();
        assert!(level_db > 3.0, "{level_db} dB");
    }
    let early = ImpulseResponse { left: response.left[..1200].into(), right: response.right[..1200].into() };
    let lead_s = interaural_delay_s(&early).expect("sound at both ears");
    assert!((500e-6..800e-6).contains(&lead_s), "{lead_s} s");
}
