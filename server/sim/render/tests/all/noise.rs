//! Sensor noise: documented magnitude, repeatable, only on hits.

use avln_render::{CameraImage, DepthNoise, Noise, RgbNoise};
use avln_scene::InstanceId;

const REDWOOD: Noise = Noise { depth: DepthNoise::Redwood, rgb: RgbNoise::None, seed: 7 };
const GAUSSIAN: Noise = Noise { depth: DepthNoise::None, rgb: RgbNoise::Gaussian, seed: 7 };
const BOTH: Noise = Noise { rgb: RgbNoise::Gaussian, ..REDWOOD };
const REACH_M: f32 = 10.0;

/// A frame with constant depth and grey.
fn flat(side: u32, depth_m: f32, grey: u8) -> CameraImage {
    let pixels = (side * side) as usize;
    CameraImage {
        width: side,
        height: side,
        rgb: vec![grey; 3 * pixels],
        depth: vec![depth_m; pixels],
        instances: vec![InstanceId(4); pixels],
    }
}

fn noisy(noise: &Noise, mut frame: CameraImage, index: u64) -> CameraImage {
    noise.apply(&mut frame, index, REACH_M);
    frame
}

/// Mean and deviation.
fn spread(errors: &[f64]) -> (f64, f64) {
    let count = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / count;
    (mean, (errors.iter().map(|error| (error - mean).powi(2)).sum::<f64>() / count).sqrt())
}

#[test]
fn depth_deviation_is_as_documented() {
    for (depth_m, documented_m) in [(1.0, 0.0013), (3.0, 0.012), (5.0, 0.032)] {
        // Many depths around it, so that rounding varies.
        let errors: Vec<f64> = (0..400)
            .flat_map(|index| {
                let clean_m = depth_m * (0.95 + 0.1 * index as f32 / 400.0);
                let read = noisy(&REDWOOD, flat(16, clean_m, 0), index).depth;
                read.into_iter().map(move |read_m| f64::from(read_m) - f64::from(clean_m))
            })
            .collect();
        let (mean, deviation) = spread(&errors);
        assert!((deviation / documented_m - 1.0).abs() < 0.06, "{depth_m} m: {deviation} m");
        assert!(mean.abs() < 0.05 * documented_m, "{depth_m} m: {mean} m");
    }
}

#[test]
fn depth_is_quantised_by_disparity() {
    let frame = noisy(&REDWOOD, flat(64, 3.0, 0), 0);
    let mut levels: Vec<f32> = frame.depth;
    levels.sort_by(f32::total_cmp);
    levels.dedup();
    assert!((2..=4).contains(&levels.len()), "{levels:?}");
    for level in levels {
        let steps = 8.0 * 35.13 / level;
        assert!((steps - steps.round()).abs() < 1e-4, "{level}");
    }
}

#[test]
fn pixels_without_depth_stay_empty() {
    let mut frame = flat(40, 4.0, 100);
    // The left half is empty.
    (0..1600).filter(|pixel| pixel % 40 < 20).for_each(|pixel| frame.depth[pixel] = 0.0);
    for index in 0..20 {
        let read = noisy(&BOTH, frame.clone(), index).depth;
        assert!((0..1600).filter(|pixel| pixel % 40 < 20).all(|pixel| read[pixel] == 0.0));
        assert!((0..1600).filter(|pixel| pixel % 40 > 23).all(|pixel| read[pixel] > 3.5));
    }
    let beyond = noisy(&REDWOOD, flat(8, 10.0, 0), 0).depth;
    assert!(beyond.iter().all(|depth| *depth == 0.0), "beyond the sensor's reach");
    let near_the_end = noisy(&REDWOOD, flat(64, 9.99, 0), 0).depth;
    assert!(near_the_end.iter().all(|depth| *depth <= REACH_M) && near_the_end.contains(&0.0));
    let mut short = flat(8, 4.0, 0);
    REDWOOD.apply(&mut short, 0, 3.5);
    assert!(short.depth.iter().all(|depth| *depth == 0.0), "beyond the track's reach");
}

#[test]
fn edges_move_by_two_pixels_at_most() {
    let mut frame = flat(64, 2.0, 0);
    (0..4096).filter(|pixel| pixel % 64 >= 31).for_each(|pixel| frame.depth[pixel] = 6.0);
    let (mut moved, mut kept) = (0, 0);
    for index in 0..10 {
        let read = noisy(&REDWOOD, frame.clone(), index).depth;
        for (pixel, depth) in read.iter().enumerate() {
            let (column, far) = (pixel % 64, *depth > 4.0);
            let was_far = column >= 31;
            moved += usize::from(far != was_far);
            kept += usize::from(far == was_far);
            assert!(far == was_far || (29..=33).contains(&column), "column {column}");
        }
    }
    assert!(moved > 100 && kept > 10 * moved, "{moved} of {kept} edge pixels moved");
}

#[test]
fn colour_deviation_is_as_documented() {
    let frame = noisy(&GAUSSIAN, flat(200, 2.0, 128), 3);
    let (mean, deviation) =
        spread(&frame.rgb.iter().map(|value| f64::from(*value) - 128.0).collect::<Vec<_>>());
    assert!(mean.abs() < 0.6, "{mean}");
    // 1.3 % of the deviates are clamped.
    assert!((deviation - 51.0).abs() < 1.0, "{deviation}");
    let dark = noisy(&GAUSSIAN, flat(100, 2.0, 0), 3).rgb;
    let at_zero = dark.iter().filter(|value| **value == 0).count() as f64 / dark.len() as f64;
    assert!((at_zero - 0.5).abs() < 0.02, "half the deviates of black are clamped: {at_zero}");
}

#[test]
fn noise_depends_on_seed_image_and_pixel() {
    let clean = flat(48, 3.0, 90);
    let first = noisy(&BOTH, clean.clone(), 5);
    assert_eq!(noisy(&BOTH, clean.clone(), 5), first);
    let others = [noisy(&BOTH, clean.clone(), 6), noisy(&Noise { seed: 8, ..BOTH }, clean.clone(), 5)];
    for other in others {
        let same = first.rgb.iter().zip(&other.rgb).filter(|(a, b)| a == b).count();
        assert!(same < first.rgb.len() / 50, "{same} channels are equal");
        assert_ne!(first.depth, other.depth);
    }
    let row = |frame: &CameraImage, row: usize| frame.rgb[row * 144..(row + 1) * 144].to_vec();
    assert!((1..48).all(|other| row(&first, other) != row(&first, 0)));
    assert_eq!(first.instances, clean.instances);
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..4).map(|_| scope.spawn(|| noisy(&BOTH, flat(48, 3.0, 90), 5))).collect();
        threads.into_iter().for_each(|thread| assert_eq!(thread.join().expect("no panic"), first));
    });
}

#[test]
fn noise_bits_are_equal_on_all_platforms() {
    let frame = noisy(&BOTH, flat(64, 2.5, 120), 1);
    let bytes = frame.depth.iter().flat_map(|depth| depth.to_bits().to_le_bytes()).chain(frame.rgb);
    let hash = bytes.fold(0xcbf2_9ce4_8422_2325_u64, |hash, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3)
    });
    assert_eq!(
        hash, 6_066_247_626_871_291_096,
        "noise of a seed may not change: episodes of noisy tracks are repeated with it"
    );
}

#[test]
fn disabled_noise_and_empty_images_change_nothing() {
    let clean = flat(9, 3.0, 90);
    assert_eq!(noisy(&Noise { seed: 3, ..Noise::default() }, clean.clone(), 1), clean);
    for (width, height) in [(0, 0), (0, 5), (5, 0)] {
        let none = CameraImage { width, height, ..CameraImage::default() };
        assert_eq!(noisy(&BOTH, none.clone(), 1), none);
    }
    assert_eq!(noisy(&BOTH, flat(1, 3.0, 90), 1).depth.len(), 1);
}

#[test]
fn models_have_names() {
    assert_eq!(DepthNoise::from_name("redwood"), Some(DepthNoise::Redwood));
    assert_eq!(RgbNoise::from_name("gaussian"), Some(RgbNoise::Gaussian));
    assert_eq!(DepthNoise::from_name("none"), Some(DepthNoise::default()));
    assert_eq!(RgbNoise::from_name("none"), Some(RgbNoise::default()));
    assert_eq!((DepthNoise::from_name("gaussian"), RgbNoise::from_name("")), (None, None));
}
