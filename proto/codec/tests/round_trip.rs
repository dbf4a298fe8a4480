//! What is packed comes back, bit for bit where the encoding says so, and takes no more bytes than announced.

use avln_codec::{Size, audio, depth, is_lossless, most_bytes, offered, rgb};
use avln_proto::v1::{Encoding, SensorKind};
use bytes::Bytes;
use proptest::prelude::*;

fn layout(width: u32, height: u32, unit_m: f32) -> depth::Layout {
    depth::Layout { size: Size { width, height }, unit_m }
}

fn rgb_comes_back(size: Size, pixels: &[u8]) {
    for &encoding in offered(SensorKind::Rgb) {
        assert!(is_lossless(encoding), "{encoding:?}");
        let packed = rgb::encode(encoding, size, pixels).unwrap();
        assert!(packed.len() as u64 <= most_bytes(pixels.len() as u64), "{encoding:?}: {}", packed.len());
        assert_eq!(rgb::decode(encoding, size, packed).unwrap(), pixels, "{encoding:?}");
    }
}

fn depth_comes_back(layout: depth::Layout, numbers: &[f32]) {
    for &encoding in offered(SensorKind::Depth).iter().filter(|encoding| is_lossless(**encoding)) {
        let packed = depth::encode(encoding, layout, numbers).unwrap();
        assert!(
            packed.len() as u64 <= most_bytes(4 * numbers.len() as u64),
            "{encoding:?}: {}",
            packed.len()
        );
        let back = depth::decode(encoding, layout, &packed).unwrap();
        let bits = |numbers: &[f32]| numbers.iter().map(|number| number.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&back), bits(numbers), "{encoding:?}");
    }
}

/// Pictures with areas of one colour and slow changes as well as noise.
fn pictures() -> impl Strategy<Value = (Size, Vec<u8>)> {
    (1..40u32, 1..40u32, 1..=255u8).prop_flat_map(|(width, height, most)| {
        let pixels = prop::collection::vec(0..=most, 3 * (width * height) as usize);
        (Just(Size { width, height }), pixels)
    })
}

proptest! {
    #[test]
    fn any_picture_comes_back((size, pixels) in pictures()) {
        rgb_comes_back(size, &pixels);
    }

    #[test]
    fn any_numbers_come_back_whatever_their_bits(
        (width, bits) in (1..40u32, 1..40u32).prop_flat_map(|(width, height)| {
            (Just(width), prop::collection::vec(any::<u32>(), (width * height) as usize))
        }),
    ) {
        let numbers: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
        let height = numbers.len() as u32 / width;
        depth_comes_back(layout(width, height, 1.0), &numbers);
    }

    #[test]
    fn millimetres_come_back_to_the_nearest(
        depths in prop::collection::vec(0.001..65.0f32, 63), unit_m in prop::sample::select(vec![1.0f32, 10.0]),
    ) {
        let layout = layout(9, 7, unit_m);
        let depths: Vec<f32> = depths.into_iter().map(|depth| depth / unit_m).collect();
        for encoding in [Encoding::DepthU16Mm, Encoding::DepthU16MmPacked] {
            let packed = depth::encode(encoding, layout, &depths).unwrap();
            for (back, depth) in depth::decode(encoding, layout, &packed).unwrap().iter().zip(&depths) {
                prop_assert!((back - depth).abs() * unit_m <= 0.51e-3, "{depth} came back as {back}");
            }
        }
    }

    #[test]
    fn samples_come_back_to_the_nearest(samples in prop::collection::vec(-2.0..2.0f32, 0..200)) {
        let packed = audio::encode(Encoding::AudioI16, &samples).unwrap();
        for (back, sample) in audio::decode(Encoding::AudioI16, samples.len(), &packed).unwrap().iter().zip(&samples) {
            prop_assert!((back - sample.clamp(-1.0, 1.0)).abs() <= 0.501 / 32_767.0, "{sample} came back as {back}");
        }
    }
}

/// What the camera sees of a plane that is no nearer than 1 m, and nothing above a row.
fn floor(width: u32, height: u32) -> Vec<f32> {
    let row = |y: u32| if y < height / 4 { 0.0 } else { 1.0 / (y as f32 / height as f32) };
    (0..height).flat_map(|y| std::iter::repeat_n(row(y), width as usize)).collect()
}

#[test]
fn planes_take_a_tenth_of_their_bytes() {
    let depths = floor(256, 256);
    depth_comes_back(layout(256, 256, 1.0), &depths);
    let packed = depth::encode(Encoding::Packed, layout(256, 256, 1.0), &depths).unwrap();
    assert!(packed.len() < 4 * 256 * 256 / 10, "{} bytes", packed.len());
}

#[test]
fn what_is_seen_never_turns_into_nothing() {
    let layout = layout(3, 1, 1.0);
    let packed = depth::encode(Encoding::DepthU16Mm, layout, &[0.0, 1e-5, 100.0]).unwrap();
    assert_eq!(depth::decode(Encoding::DepthU16Mm, layout, &packed).unwrap(), [0.0, 0.001, 65.535]);
}

#[test]
fn raw_samples_come_back_as_they_were() {
    let samples = vec![0.5, -0.25, f32::MIN_POSITIVE, 3.0];
    let packed = audio::encode(Encoding::Raw, &samples).unwrap();
    assert_eq!(&packed[..4], 0.5f32.to_le_bytes());
    assert_eq!(audio::decode(Encoding::Raw, 4, &packed).unwrap(), samples);
}

#[test]
fn the_largest_and_the_noisiest_pictures_stay_below_the_announced_size() {
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    for size in [Size { width: 64, height: 64 }, Size { width: 1024, height: 1024 }] {
        let pixels: Vec<u8> = (0..3 * size.pixels()).map(|_| noise()).collect();
        rgb_comes_back(size, &pixels);
    }
}

#[test]
fn numbers_that_do_not_fill_the_picture_and_foreign_encodings_are_refused() {
    let size = Size { width: 2, height: 2 };
    let short = rgb::encode(Encoding::Packed, size, &[0; 11]).unwrap_err();
    assert_eq!(short.to_string(), "a colour picture of 11 bytes, agreed were 12");
    assert!(depth::encode(Encoding::Packed, layout(2, 2, 1.0), &[0.0; 5]).is_err());
    let foreign = audio::decode(Encoding::Png, 4, &[]).unwrap_err().to_string();
    assert!(foreign.contains("ENCODING_PNG is not an encoding of SENSOR_KIND_AUDIO"), "{foreign}");
    assert!(rgb::decode(Encoding::AudioI16, size, Bytes::new()).is_err());
    assert!(depth::decode(Encoding::Qoi, layout(2, 2, 1.0), &[]).is_err());
}
