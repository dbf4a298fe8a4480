//! Clip families.

use super::synthesis::{
    add, beats, bell, buzz, hump, low_pass, normalized, note, pink, recur, resonate, samples, shaped,
    silence, sweep, white,
};
use avln_geom::Rng;
use std::f32::consts::TAU;

/// A sound generator with random traits.
pub(super) struct Family {
    pub(super) name: &'static str,
    /// Returns a loop at any level.
    pub(super) generate: fn(&mut Rng) -> Vec<f32>,
}

pub(super) const FAMILIES: [Family; 10] = [
    Family { name: "pink-bursts", generate: pink_bursts },
    Family { name: "noise-bursts", generate: noise_bursts },
    Family { name: "claps", generate: claps },
    Family { name: "chirps", generate: chirps },
    Family { name: "babble", generate: babble },
    Family { name: "rattle", generate: rattle },
    Family { name: "gusts", generate: gusts },
    Family { name: "bells", generate: bells },
    Family { name: "notes", generate: notes },
    Family { name: "grains", generate: grains },
];

/// Regular bursts of pink noise, 3.5 to 7 per second.
fn pink_bursts(rng: &mut Rng) -> Vec<f32> {
    let noise = pink(rng);
    let (rate_hz, duty) = (rng.range(3.5, 7.0), rng.range(0.6, 0.75));
    let attack = rng.range(0.05, 0.2);
    let mut sound = silence();
    for start in beats(rng, rate_hz, 0.1) {
        let burst = hump(samples(duty / rate_hz), attack);
        add(&mut sound, &shaped(&noise[start % (noise.len() / 2)..], &burst), start, 1.0);
    }
    sound
}

/// Pairs with a strong and a weak noise burst; spectra fall by 0 to 6 dB per octave.
fn noise_bursts(rng: &mut Rng) -> Vec<f32> {
    let mut noise = white(rng);
    recur(&mut noise, rng.range(0.0, 0.8), 0.0);
    let (rate_hz, weak) = (rng.range(4.0, 7.0), rng.range(0.45, 0.75));
    let mut sound = silence();
    for (number, start) in beats(rng, rate_hz, 0.2).into_iter().enumerate() {
        let burst = hump(samples(rng.range(0.4, 0.6) / rate_hz), 0.04);
        let gain = if number % 2 == 0 { 1.0 } else { weak };
        add(&mut sound, &shaped(&noise[rng.below(noise.len() / 2)..], &burst), start, gain);
    }
    sound
}

/// Claps: short decays of coloured noise, 9 to 16 per second.
fn claps(rng: &mut Rng) -> Vec<f32> {
    let color_hz = rng.range(700.0, 2500.0);
    let raw = white(rng);
    let mut noise = resonate(&raw, color_hz, color_hz);
    add(&mut noise, &raw, 0, 0.1);
    let rate_hz = rng.range(9.0, 16.0);
    let length = samples(rng.range(0.03, 0.05));
    let mut sound = silence();
    for start in beats(rng, rate_hz, 0.4) {
        let from = rng.below(noise.len() / 2);
        add(&mut sound, &shaped(&noise[from..], &hump(length, 0.04)), start, rng.range(0.7, 1.0));
    }
    sound
}

/// Sweeps over five octaves, up, down or alternating, 5 to 8 per second, with noise.
fn chirps(rng: &mut Rng) -> Vec<f32> {
    let noise = normalized(&pink(rng));
    let (low_hz, high_hz) = (rng.range(150.0, 240.0), rng.range(6400.0, 7500.0));
    let (rate_hz, rush) = (rng.range(5.0, 8.0), rng.range(0.5, 0.7));
    let manner = rng.below(3);
    let mut sound = silence();
    for (number, start) in beats(rng, rate_hz, 0.15).into_iter().enumerate() {
        let up = manner == 0 || (manner == 2 && number % 2 == 0);
        let (from_hz, to_hz) = if up { (low_hz, high_hz) } else { (high_hz, low_hz) };
        let length = samples(0.85 / rate_hz);
        // Nearly flat, to preserve both ends of the sweep.
        let envelope: Vec<f32> = hump(length, 0.2).iter().map(|height| (3.0 * height).min(1.0)).collect();
        let tone = normalized(&sweep(from_hz, to_hz, length));
        add(&mut sound, &shaped(&tone, &envelope), start, 1.0);
        add(&mut sound, &shaped(&noise[rng.below(noise.len() / 2)..], &envelope), start, rush);
    }
    sound
}

/// Babble: a buzzing voice through four formants, with hisses in between.
fn babble(rng: &mut Rng) -> Vec<f32> {
    let (pitch_hz, rate_hz) = (rng.range(95.0, 230.0), rng.range(3.8, 5.5));
    let stretch = rng.range(0.9, 1.2);
    let (mut voice, mut hiss) = (silence(), silence());
    let breath = white(rng);
    for start in beats(rng, rate_hz, 0.25) {
        let length = samples(rng.range(0.6, 0.75) / rate_hz);
        let syllable = buzz(pitch_hz * rng.range(0.85, 1.2), length);
        add(&mut voice, &shaped(&syllable, &hump(length, 0.2)), start, 1.0);
        let length = samples(rng.range(0.3, 0.4) / rate_hz);
        let start = start + samples(0.68 / rate_hz);
        add(&mut hiss, &shaped(&breath[length..], &hump(length, 0.15)), start, rng.range(0.6, 1.0));
    }
    let mut sound = silence();
    for (formant_hz, width_hz, gain) in
        [(550.0, 90.0, 1.0), (1400.0, 120.0, 0.8), (2500.0, 180.0, 0.7), (3500.0, 250.0, 0.6)]
    {
        add(&mut sound, &resonate(&voice, formant_hz * stretch, width_hz), 0, gain);
    }
    add(&mut sound, &resonate(&hiss, 4800.0 * stretch, 2500.0), 0, 0.6);
    sound
}

/// A shaken box: random knocks on a few resonances, louder 4 to 6 times per second.
fn rattle(rng: &mut Rng) -> Vec<f32> {
    let mut knocks = silence();
    let accents = beats(rng, rng.clone().range(4.0, 6.0), 0.1);
    for start in beats(rng, 45.0, 1.0) {
        add(&mut knocks, &[rng.range(-0.5, 0.5)], start, 1.0);
    }
    for start in accents {
        for _ in 0..12 {
            add(&mut knocks, &[rng.range(-1.0, 1.0)], start + rng.below(samples(0.06)), 1.0);
        }
    }
    let mut sound = silence();
    for octave in 0..8 {
        let center_hz = 300.0 * libm::expf(octave as f32 * 0.43) * rng.range(0.85, 1.15);
        let width_hz = rng.range(0.04, 0.1) * center_hz;
        add(&mut sound, &resonate(&knocks, center_hz.min(7000.0), width_hz + 20.0), 0, rng.range(0.6, 1.0));
    }
    sound
}

/// Wind: noise more than three octaves wide with drifting edges, in puffs.
fn gusts(rng: &mut Rng) -> Vec<f32> {
    /// Upper over lower edge.
    const WIDTH: f32 = 12.0;
    let (lowest_hz, octaves) = (rng.range(150.0, 220.0), rng.range(1.0, 1.8));
    let (waves, phase) = ((3 + rng.below(4)) as f32, rng.range(0.0, TAU));
    let edge_hz = |share: f32| {
        let height = 0.5 + 0.5 * libm::sinf(TAU * waves * share + phase);
        lowest_hz * libm::exp2f(octaves * height)
    };
    let mut band = low_pass(&white(rng), |share| WIDTH * edge_hz(share));
    let below = low_pass(&band, edge_hz);
    add(&mut band, &below, 0, -1.0);
    let mut sound: Vec<f32> = band.iter().map(|sample| 0.1 * sample).collect();
    let rate_hz = rng.range(4.0, 6.0);
    for start in beats(rng, rate_hz, 0.2) {
        let puff = hump(samples(0.8 / rate_hz), rng.range(0.08, 0.2));
        let from_here: Vec<f32> = band.iter().cycle().skip(start).take(puff.len()).copied().collect();
        add(&mut sound, &shaped(&from_here, &puff), start, rng.range(0.7, 1.0));
    }
    sound
}

/// Bells with gliding overtones, struck with a hiss.
fn bells(rng: &mut Rng) -> Vec<f32> {
    let noise = normalized(&white(rng));
    let (rate_hz, ratio) = (rng.range(4.5, 7.0), rng.range(1.3, 2.9));
    let (low_hz, depth, hiss) = (rng.range(300.0, 600.0), rng.range(3.0, 6.0), rng.range(0.5, 0.9));
    let mut sound = silence();
    for start in beats(rng, rate_hz, 0.2) {
        let length = samples(0.95 / rate_hz);
        let envelope = hump(length, 0.03);
        let pitch_hz = low_hz * libm::exp2f(rng.range(0.0, 1.0));
        let tone = normalized(&bell(pitch_hz, ratio, depth, length));
        add(&mut sound, &shaped(&tone, &envelope), start, 1.0);
        add(&mut sound, &shaped(&noise[rng.below(noise.len() / 2)..], &envelope), start, hiss);
    }
    sound
}

/// A reed melody with breath 0 to 6 dB below the notes.
fn notes(rng: &mut Rng) -> Vec<f32> {
    /// Pentatonic scale, semitones.
    const SCALE: [f32; 5] = [0.0, 2.0, 4.0, 7.0, 9.0];
    let mut breath = pink(rng);
    add(&mut breath, &white(rng), 0, 0.3);
    let breath = normalized(&breath);
    let (rate_hz, lowest_hz) = (rng.range(4.0, 6.5), rng.range(140.0, 260.0));
    let blown = rng.range(0.5, 1.0);
    let mut sound = silence();
    for start in beats(rng, rate_hz, 0.1) {
        let length = samples(0.9 / rate_hz);
        let envelope = hump(length, 0.06);
        let semitones = SCALE[rng.below(SCALE.len())];
        let pitch_hz = lowest_hz * libm::exp2f(semitones / 12.0);
        add(&mut sound, &shaped(&normalized(&note(pitch_hz, length)), &envelope), start, 1.0);
        add(&mut sound, &shaped(&breath[rng.below(breath.len() / 2)..], &envelope), start, blown);
    }
    sound
}

/// A swarm of tonal and noisy grains, denser 4 to 6 times per second.
fn grains(rng: &mut Rng) -> Vec<f32> {
    let noise = pink(rng);
    let (rate_hz, tonal) = (rng.range(4.0, 6.0), rng.range(0.3, 0.7));
    let mut sound = silence();
    for beat in beats(rng, rate_hz, 0.1) {
        for number in 0..8 {
            let length = samples(rng.range(0.02, 0.06));
            let start = beat + if number < 5 { rng.below(200) } else { rng.below(samples(1.0 / rate_hz)) };
            let grain = if rng.chance(f64::from(tonal)) {
                let from_hz = 250.0 * libm::expf(rng.range(0.0, 3.2));
                sweep(from_hz, from_hz * rng.range(0.7, 1.4), length)
            } else {
                noise[rng.below(noise.len() / 2)..].to_vec()
            };
            let gain = if number < 5 { 1.0 } else { 0.35 };
            add(&mut sound, &shaped(&grain, &hump(length, 0.1)), start, gain);
        }
    }
    sound
}
