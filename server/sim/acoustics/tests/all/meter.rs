//! Levels without signals, against rendered sound.

use crate::common::{listener, noise, point, two_rooms};
use avln_acoustics::{
    Acoustics, ClipLevels, Ears, Emitter, HeardLevels, LevelMeter, Listener, SAMPLE_RATE_HZ, Source,
    interaural_delay_s,
};
use std::sync::Arc;

const STEP: usize = 4000;

/// Emits white noise.
fn emitter(source: Source) -> Emitter {
    Emitter { source, clip: noise(1, 48_000), offset_samples: 17 }
}

fn meter(source: Source) -> LevelMeter {
    let emitter = emitter(source);
    let levels = Arc::new(ClipLevels::new(&emitter.clip));
    LevelMeter::new(vec![(emitter, levels)], STEP)
}

/// Poses on both sides of the door, three steps each.
fn walk() -> impl Iterator<Item = Listener> {
    let places = [(1.0, 1.0, 0.0), (1.0, 1.0, 90.0), (3.5, 1.4, -120.0), (5.0, 1.5, 30.0), (7.5, 3.5, 60.0)];
    places.into_iter().flat_map(|(x, z, degrees)| [listener(x, z, degrees); 3])
}

fn db(power: f32) -> f32 {
    10.0 * libm::log10f(power)
}

/// Differences between meter and ears per step and ear, decibels, octaves 125 to 4000 Hz.
fn differences(acoustics: &Acoustics, metered: &Acoustics) -> Vec<f32> {
    let place = point(2.5, 1.0, 3.4);
    let mut ears = Ears::new(vec![emitter(acoustics.source(&place))], STEP);
    let mut meter = meter(metered.source(&place));
    let mut found = Vec::new();
    for pose in walk() {
        let (audio, heard) = (ears.hear(&pose, Some(0)), meter.hear(&pose, Some(0)));
        for (samples, power) in audio.chunks(STEP).zip(&heard.power) {
            let rendered = samples.iter().map(|sample| sample * sample).sum::<f32>() / STEP as f32;
            // White noise has 88 to 5657 Hz of its 8000 Hz in these octaves.
            found.push(db(power.iter().sum()) - db(rendered * (5657.0 - 88.0) / 8000.0));
        }
    }
    found
}

#[test]
fn levels_match_the_rendered_sound() {
    let house = two_rooms(true);
    let same = differences(&house, &house);
    assert!(same.iter().all(|db| db.abs() < 2.0), "{same:?}");
    let cheap = differences(&house, &house.for_levels());
    let mean_db = cheap.iter().map(|db| db.abs()).sum::<f32>() / cheap.len() as f32;
    assert!(mean_db < 2.0 && cheap.iter().all(|db| db.abs() < 6.0), "{cheap:?}");
}

#[test]
fn lead_is_that_of_the_first_wave() {
    let house = two_rooms(true);
    for degrees in [-150.0, -90.0, -45.0, 0.0, 30.0, 90.0, 180.0] {
        let (source, pose) = (house.source(&point(1.5, 1.0, 1.0)), listener(3.0, 1.0, degrees));
        let wave = source.first_wave(&pose).expect("a wave");
        let due_s = interaural_delay_s(&wave.response).expect("sound");
        let first = meter(source).hear(&pose, Some(0)).first.expect("a path");
        // The delay below 1500 Hz exceeds that of the wave front by up to a half (Kuhn 1977).
        let share = f64::from(first.lead_s) / due_s;
        assert!(due_s.abs() < 5e-5 || (0.5..1.2).contains(&share), "{degrees}: {first:?}, not {due_s} s");
        assert!((-20.0..20.0).contains(&first.direct_db), "{first:?}");
    }
}

#[test]
fn sound_rings_out_to_silence() {
    let mut meter = meter(two_rooms(true).for_levels().source(&point(2.5, 1.0, 3.4)));
    let pose = listener(6.0, 3.0, 0.0);
    let sounds = [None, Some(0), Some(0), None, None, None, None, Some(1)];
    let heard: Vec<HeardLevels> = sounds.iter().map(|sounding| meter.hear(&pose, *sounding)).collect();
    let level = |step: usize| heard[step].power.as_flattened().iter().sum::<f32>();
    let levels = [1, 2, 3, 4].map(level);
    // The tail of a hard room has about a third of the energy in the first silent step.
    assert!(levels[1] > levels[0] && levels[2] < 0.5 * levels[1], "{levels:?}");
    assert!(levels[3] > 0.0 && levels[3] < 0.5 * levels[2], "{levels:?}");
    assert!(heard[2].first.is_some() && heard[3].first.is_none());
    for step in [0, 6, 7] {
        assert_eq!(heard[step], HeardLevels::default(), "step {step}");
    }
    const { assert!(STEP * 4 == SAMPLE_RATE_HZ as usize) };
}
