//! Sound over time: continuity, switches, superposition; levels without signals, against rendered sound.

use crate::common::{free_field, listener, noise, point, two_rooms};
use avln_acoustics::{
    Acoustics, Bank, ClipLevels, Ears, Emitter, HeardLevels, LevelMeter, Listener, SAMPLE_RATE_HZ, Source,
    interaural_delay_s,
};
use avln_geom::{Point3, Rng};
use std::sync::Arc;

const STEP: usize = 4000;

fn emitter(house: &Acoustics, position: Point3<f32>, seed: u64) -> Emitter {
    Emitter { source: house.source(&position), clip: noise(seed, 20_011), offset_samples: 17 }
}

/// Joins the left ear's samples.
fn left(steps: &[Vec<f32>]) -> Vec<f32> {
    steps.iter().flat_map(|step| step[..step.len() / 2].to_vec()).collect()
}

fn energy(samples: &[f32]) -> f64 {
    samples.iter().map(|sample| f64::from(sample * sample)).sum()
}

#[test]
fn constant_pose_equals_one_convolution() {
    let emitter = emitter(&two_rooms(true), point(2.5, 1.0, 3.4), 1);
    let place = listener(6.0, 3.0, 30.0);
    let response = emitter.source.impulse_response(&place);
    let clip = emitter.clip.samples.clone();
    let mut ears = Ears::new(vec![emitter], STEP);
    let heard = left(&(0..100).map(|_| ears.hear(&place, Some(0))).collect::<Vec<_>>());
    let mut rng = Rng::new(2);
    let fade = |t: usize| ((t as f32 + 0.5) / 160.0).min(1.0);
    for _ in 0..3000 {
        let now = rng.below(heard.len());
        let reach = response.left.len().min(now + 1);
        let tap = |k: usize| f64::from(response.left[k] * fade(now - k) * clip[(17 + now - k) % clip.len()]);
        let expected: f64 = (0..reach).map(tap).sum();
        assert!(
            (expected - f64::from(heard[now])).abs() < 1e-6,
            "sample {now}: {} not {expected}",
            heard[now]
        );
    }
}

#[test]
fn step_size_does_not_change_the_sound() {
    let house = two_rooms(true);
    let place = listener(5.0, 1.5, 0.0);
    let hear = |size: usize| {
        let mut ears = Ears::new(vec![emitter(&house, point(1.0, 1.0, 1.0), 3)], size);
        left(&(0..12_000 / size).map(|_| ears.hear(&place, Some(0))).collect::<Vec<_>>())
    };
    let whole = hear(12_000);
    for size in [4000, 1000, 250] {
        assert!(hear(size).iter().zip(&whole).all(|(a, b)| (a - b).abs() < 1e-5), "steps of {size}");
    }
    assert!(Ears::new(vec![emitter(&house, point(1.0, 1.0, 1.0), 3)], 0).hear(&place, Some(0)).is_empty());
}

#[test]
fn moving_and_turning_cause_no_clicks() {
    let house = two_rooms(true);
    let tone: Vec<f32> = (0..16_000).map(|n| (std::f32::consts::TAU * n as f32 / 16.0).sin()).collect();
    for samples in [tone.into(), noise(4, 16_000).samples] {
        let mut emitter = emitter(&house, point(2.5, 1.0, 1.4), 0);
        emitter.clip.samples = samples;
        let mut ears = Ears::new(vec![emitter], STEP);
        let pose = |step: usize| match step % 2 {
            0 => listener(1.0 + 0.125 * step as f32, 1.5, 30.0 * step as f32),
            _ => listener(0.875 + 0.125 * step as f32, 1.5, 30.0 * step as f32),
        };
        let heard = left(&(0..40).map(|step| ears.hear(&pose(step), Some(0))).collect::<Vec<_>>());
        let bend = |n: usize| (heard[n - 1] - 2.0 * heard[n] + heard[n + 1]).abs();
        for border in (2 * STEP..39 * STEP).step_by(STEP) {
            let mut inside: Vec<f32> =
                (border - 3000..border + 3000).filter(|n| n.abs_diff(border) > 8).map(bend).collect();
            inside.sort_by(f32::total_cmp);
            let worst = (border - 2..=border + 2).map(bend).fold(0.0, f32::max);
            assert!(
                worst <= 1.5 * inside[inside.len() * 999 / 1000],
                "a click of {worst} at sample {border}"
            );
        }
    }
}

/// Lag at the left ear, samples, by plain correlation.
fn lag(left: &[f32], right: &[f32]) -> i32 {
    let similarity = |lag: i32| -> f32 {
        let pairs = 20..left.len() as i32 - 20;
        pairs.map(|n| left[n as usize] * right[(n - lag) as usize]).sum()
    };
    (-14..=14).max_by(|a, b| similarity(*a).total_cmp(&similarity(*b))).unwrap_or(0)
}

#[test]
fn switches_move_the_sound_at_once() {
    let house = free_field();
    let sides = [point(3.0, 1.0, -0.5), point(-3.0, 1.0, -0.5)];
    let emitters = vec![emitter(&house, sides[0], 5), emitter(&house, sides[1], 6)];
    let mut ears = Ears::new(emitters, STEP);
    let place = listener(0.0, 0.0, 0.0);
    for step in 0..12 {
        let sounding = step / 3 % 2;
        let heard = ears.hear(&place, Some(sounding));
        // 3.04 m take 142 samples; the old source fades within 160 samples after the switch.
        let (left, right) = (&heard[400..STEP], &heard[STEP + 400..]);
        let expected = if sounding == 0 { 10 } else { -10 };
        assert!((lag(left, right) - expected).abs() <= 2, "step {step}: {}", lag(left, right));
        if step == 0 {
            assert!(heard[..100].iter().all(|sample| sample.abs() < 1e-3), "sound before it can arrive");
        }
    }
}

#[test]
fn stopped_sources_ring_out_to_silence() {
    let house = two_rooms(true);
    let place = listener(7.0, 3.0, 0.0);
    let source = emitter(&house, point(1.0, 1.0, 3.0), 7);
    let tail = source.source.impulse_response(&place).len();
    let mut ears = Ears::new(vec![source], 500);
    let before = energy(&(0..4).flat_map(|_| ears.hear(&place, Some(0))).collect::<Vec<_>>()[3000..]);
    let ringing = ears.hear(&place, None);
    assert!(energy(&ringing) > 0.1 * before / 2.0 && tail > 300, "the way is {tail} samples long");
    let silent_after = (160 + tail).div_ceil(500) - 1;
    for step in 0..80 {
        let heard = ears.hear(&place, if step % 2 == 0 { None } else { Some(99) });
        assert!(step < silent_after || heard.iter().all(|sample| *sample == 0.0), "step {step}");
    }
}

#[test]
fn two_sources_add_up() {
    let house = two_rooms(true);
    let emitters = [emitter(&house, point(1.0, 1.0, 3.0), 8), emitter(&house, point(7.0, 0.5, 0.5), 9)];
    let schedule = [Some(0), Some(1), Some(1), None, Some(0), Some(1)];
    let pose = |step: usize| listener(5.0 + 0.1 * step as f32, 2.0, 30.0 * step as f32);
    let mut both = Ears::new(emitters.to_vec(), STEP);
    let mut alone = emitters.map(|emitter| Ears::new(vec![emitter], STEP));
    for (step, sounding) in schedule.into_iter().enumerate() {
        let together = both.hear(&pose(step), sounding);
        let parts: Vec<_> = (0..2)
            .map(|index| alone[index].hear(&pose(step), (sounding == Some(index)).then_some(0)))
            .collect();
        for (n, sample) in together.iter().enumerate() {
            assert!((sample - parts[0][n] - parts[1][n]).abs() <= 1e-5);
        }
    }
}

#[test]
fn clips_advance_during_silence() {
    let house = free_field();
    let place = listener(0.0, 0.0, 0.0);
    let hear = |schedule: &[Option<usize>]| {
        let mut ears = Ears::new(vec![emitter(&house, point(0.0, 1.0, -2.0), 10)], STEP);
        schedule.iter().map(|sounding| ears.hear(&place, *sounding)).next_back().expect("a step")
    };
    let (always, paused) = (hear(&[Some(0); 4]), hear(&[Some(0), None, Some(0), Some(0)]));
    assert!(always.iter().zip(&paused).all(|(a, b)| (a - b).abs() < 1e-6));
}

#[test]
fn repeated_episodes_have_equal_bits() {
    let house = two_rooms(true);
    let bank: Vec<_> = Bank::default().clips().take(2).collect();
    let run = || {
        let emitters = [point(1.0, 0.4, 1.0), point(7.0, 0.8, 3.2)].into_iter().zip(&bank);
        let emitters = emitters.map(|(position, clip)| Emitter {
            source: house.source(&position),
            clip: clip.clone(),
            offset_samples: usize::MAX - 3,
        });
        let mut ears = Ears::new(emitters.collect(), STEP);
        let mut rng = Rng::new(12);
        let walk = (0..20).map(|step| {
            let place = Listener {
                position: point(rng.range(0.5, 7.5), 1.0, rng.range(0.5, 3.5)),
                heading_rad: rng.range(-4.0, 4.0),
            };
            ears.hear(&place, Some(step / 5 % 2))
        });
        walk.flatten().collect::<Vec<_>>()
    };
    let first = run();
    assert!(first.iter().all(|sample| sample.is_finite()) && energy(&first) > 1.0);
    let bits = |samples: &[f32]| samples.iter().map(|sample| sample.to_bits()).collect::<Vec<_>>();
    assert_eq!(bits(&first), bits(&run()));
    let threads: Vec<_> = std::thread::scope(|scope| {
        let running: Vec<_> = (0..2).map(|_| scope.spawn(run)).collect();
        running.into_iter().map(|thread| thread.join().expect("no panic")).collect()
    });
    assert!(threads.iter().all(|other| bits(other) == bits(&first)));
}

#[test]
fn clips_at_one_metre_keep_their_level() {
    let house = free_field();
    let emitter = Emitter {
        source: house.source(&point(0.0, 1.0, -1.0)),
        clip: Bank::default().clip(0).expect("a clip"),
        offset_samples: 0,
    };
    let mut ears = Ears::new(vec![emitter], SAMPLE_RATE_HZ as usize);
    let place = listener(0.0, 0.0, 0.0);
    let heard: Vec<f32> = (0..12).flat_map(|_| ears.hear(&place, Some(0))).collect();
    let level = (energy(&heard) / heard.len() as f64).sqrt();
    // The head weighs the bands: 0.05 within 3 dB.
    assert!((0.035..0.071).contains(&level), "{level}");
}

#[test]
fn ringing_keeps_its_pose_and_new_sound_follows() {
    let house = two_rooms(true);
    let place = |heading_deg: f32| listener(3.0, 1.5, heading_deg);
    let mut ears = Ears::new(vec![emitter(&house, point(1.0, 1.0, 3.0), 5)], STEP);
    let mut still = Ears::new(vec![emitter(&house, point(1.0, 1.0, 3.0), 5)], STEP);
    for ears in [&mut ears, &mut still] {
        (0..2).for_each(|_| drop(ears.hear(&place(0.0), Some(0))));
        ears.hear(&place(0.0), None);
    }
    // A quarter of a second after the end, only the tail remains.
    for step in 1..4 {
        let (turning, standing) =
            (ears.hear(&place(30.0 * step as f32), None), still.hear(&place(0.0), None));
        assert_eq!(turning, standing);
        assert!(energy(&turning) > 0.0, "step {step} is silent");
    }
    let mut fresh = Ears::new(vec![emitter(&house, point(1.0, 1.0, 3.0), 5)], STEP);
    (0..6).for_each(|_| drop(fresh.hear(&place(90.0), None)));
    let again = ears.hear(&place(90.0), Some(0));
    let new = fresh.hear(&place(90.0), Some(0));
    // After the fade the sound has the new heading, plus the old tail.
    let (late, new) = (&again[2000..STEP], &new[2000..STEP]);
    let rest: Vec<f32> = late.iter().zip(new).map(|(a, b)| a - b).collect();
    assert!(energy(&rest) < 0.05 * energy(new), "{} of {}", energy(&rest), energy(new));
}

/// Emits white noise.
fn noisy(source: Source) -> Emitter {
    Emitter { source, clip: noise(1, 48_000), offset_samples: 17 }
}

fn meter(source: Source) -> LevelMeter {
    let emitter = noisy(source);
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
    let mut ears = Ears::new(vec![noisy(acoustics.source(&place))], STEP);
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
