//! Encodings: round trips, sizes, and arbitrary bytes from outside.

use avln_proto::wire::{Encoding, SensorKind, Size, audio, depth, is_lossless, most_bytes, offered, rgb};
use bytes::Bytes;
use proptest::prelude::*;

fn layout(width: u32, height: u32, unit_m: f32) -> depth::Layout {
    depth::Layout { size: Size { width, height }, unit_m }
}

fn check_rgb(size: Size, pixels: &[u8]) {
    for &encoding in offered(SensorKind::Rgb) {
        assert!(is_lossless(encoding), "{encoding:?}");
        let packed = rgb::encode(encoding, size, pixels).unwrap();
        assert!(packed.len() as u64 <= most_bytes(pixels.len() as u64), "{encoding:?}: {}", packed.len());
        assert_eq!(rgb::decode(encoding, size, packed).unwrap(), pixels, "{encoding:?}");
    }
}

fn check_depth(layout: depth::Layout, numbers: &[f32]) {
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

/// Pictures with uniform areas, slow changes and noise.
fn pictures() -> impl Strategy<Value = (Size, Vec<u8>)> {
    (1..40u32, 1..40u32, 1..=255u8).prop_flat_map(|(width, height, most)| {
        let pixels = prop::collection::vec(0..=most, 3 * (width * height) as usize);
        (Just(Size { width, height }), pixels)
    })
}

proptest! {
    #[test]
    fn every_picture_round_trips((size, pixels) in pictures()) {
        check_rgb(size, &pixels);
    }

    #[test]
    fn every_bit_pattern_round_trips(
        (width, bits) in (1..40u32, 1..40u32).prop_flat_map(|(width, height)| {
            (Just(width), prop::collection::vec(any::<u32>(), (width * height) as usize))
        }),
    ) {
        let numbers: Vec<f32> = bits.into_iter().map(f32::from_bits).collect();
        let height = numbers.len() as u32 / width;
        check_depth(layout(width, height, 1.0), &numbers);
    }

    #[test]
    fn millimetres_round_to_nearest(
        depths in prop::collection::vec(0.001..65.0f32, 63), unit_m in prop::sample::select(vec![1.0f32, 10.0]),
    ) {
        let layout = layout(9, 7, unit_m);
        let depths: Vec<f32> = depths.into_iter().map(|depth| depth / unit_m).collect();
        for encoding in [Encoding::DepthU16Mm, Encoding::DepthU16MmPacked] {
            let packed = depth::encode(encoding, layout, &depths).unwrap();
            for (back, depth) in depth::decode(encoding, layout, &packed).unwrap().iter().zip(&depths) {
                prop_assert!((back - depth).abs() * unit_m <= 0.51e-3, "{depth} became {back}");
            }
        }
    }

    #[test]
    fn samples_round_to_nearest(samples in prop::collection::vec(-2.0..2.0f32, 0..200)) {
        let packed = audio::encode(Encoding::AudioI16, &samples).unwrap();
        for (back, sample) in audio::decode(Encoding::AudioI16, samples.len(), &packed).unwrap().iter().zip(&samples) {
            prop_assert!((back - sample.clamp(-1.0, 1.0)).abs() <= 0.501 / 32_767.0, "{sample} became {back}");
        }
    }
}

/// Depth image: a plane at 1 m or more, with no hit above a row.
fn floor(width: u32, height: u32) -> Vec<f32> {
    let row = |y: u32| if y < height / 4 { 0.0 } else { 1.0 / (y as f32 / height as f32) };
    (0..height).flat_map(|y| std::iter::repeat_n(row(y), width as usize)).collect()
}

#[test]
fn planes_take_a_tenth_of_their_bytes() {
    let depths = floor(256, 256);
    check_depth(layout(256, 256, 1.0), &depths);
    let packed = depth::encode(Encoding::Packed, layout(256, 256, 1.0), &depths).unwrap();
    assert!(packed.len() < 4 * 256 * 256 / 10, "{} bytes", packed.len());
}

#[test]
fn a_hit_never_rounds_to_no_hit() {
    let layout = layout(3, 1, 1.0);
    let packed = depth::encode(Encoding::DepthU16Mm, layout, &[0.0, 1e-5, 100.0]).unwrap();
    assert_eq!(depth::decode(Encoding::DepthU16Mm, layout, &packed).unwrap(), [0.0, 0.001, 65.535]);
}

#[test]
fn raw_samples_round_trip() {
    let samples = vec![0.5, -0.25, f32::MIN_POSITIVE, 3.0];
    let packed = audio::encode(Encoding::Raw, &samples).unwrap();
    assert_eq!(&packed[..4], 0.5f32.to_le_bytes());
    assert_eq!(audio::decode(Encoding::Raw, 4, &packed).unwrap(), samples);
}

#[test]
fn noise_stays_below_the_announced_size() {
    let mut state = 1u32;
    let mut noise = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 24) as u8
    };
    for size in [Size { width: 64, height: 64 }, Size { width: 1024, height: 1024 }] {
        let pixels: Vec<u8> = (0..3 * size.pixels()).map(|_| noise()).collect();
        check_rgb(size, &pixels);
    }
}

#[test]
fn wrong_sizes_and_foreign_encodings_are_refused() {
    let size = Size { width: 2, height: 2 };
    let short = rgb::encode(Encoding::Packed, size, &[0; 11]).unwrap_err();
    assert_eq!(short.to_string(), "colour image: expected 12 bytes, got 11");
    assert!(depth::encode(Encoding::Packed, layout(2, 2, 1.0), &[0.0; 5]).is_err());
    let foreign = audio::decode(Encoding::Png, 4, &[]).unwrap_err().to_string();
    assert!(foreign.contains("ENCODING_PNG is not an encoding of SENSOR_KIND_AUDIO"), "{foreign}");
    assert!(rgb::decode(Encoding::AudioI16, size, Bytes::new()).is_err());
    assert!(depth::decode(Encoding::Qoi, layout(2, 2, 1.0), &[]).is_err());
}

const SIZE: Size = Size { width: 20, height: 10 };
const LAYOUT: depth::Layout = depth::Layout { size: SIZE, unit_m: 1.0 };

fn decode_all(bytes: &[u8]) {
    for &encoding in offered(SensorKind::Rgb) {
        if let Ok(pixels) = rgb::decode(encoding, SIZE, Bytes::copy_from_slice(bytes)) {
            assert_eq!(pixels.len(), 3 * SIZE.pixels(), "{encoding:?}");
        }
    }
    for &encoding in offered(SensorKind::Depth) {
        if let Ok(depths) = depth::decode(encoding, LAYOUT, bytes) {
            assert_eq!(depths.len(), SIZE.pixels(), "{encoding:?}");
        }
    }
    for &encoding in offered(SensorKind::Audio) {
        if let Ok(samples) = audio::decode(encoding, 8, bytes) {
            assert_eq!(samples.len(), 8, "{encoding:?}");
        }
    }
}

/// Valid files in every encoding.
fn good() -> Vec<Vec<u8>> {
    let pixels: Vec<u8> = (0..3 * SIZE.pixels()).map(|i| (i * i / 7) as u8).collect();
    let depths: Vec<f32> = (0..SIZE.pixels()).map(|i| (i % 17) as f32 / 3.0).collect();
    let colours = offered(SensorKind::Rgb).iter().map(|e| rgb::encode(*e, SIZE, &pixels).unwrap());
    let distances = offered(SensorKind::Depth).iter().map(|e| depth::encode(*e, LAYOUT, &depths).unwrap());
    colours.chain(distances).map(Vec::from).collect()
}

proptest! {
    #[test]
    fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        decode_all(&bytes);
    }

    #[test]
    fn damaged_files_never_panic(
        which in any::<prop::sample::Index>(),
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        keep in any::<prop::sample::Index>(),
    ) {
        let mut files = good();
        let mut file = files.swap_remove(which.index(files.len()));
        for (at, byte) in damage {
            let at = at.index(file.len());
            file[at] = byte;
        }
        decode_all(&file);
        file.truncate(keep.index(file.len()));
        decode_all(&file);
    }
}

#[test]
fn a_small_file_cannot_claim_a_large_picture() {
    let large = Size { width: 20_000, height: 20_000 };
    let mut file = rgb::encode(Encoding::Png, SIZE, &[0; 600]).unwrap().to_vec();
    file[16..24].copy_from_slice(&[0, 0, 0x4e, 0x20, 0, 0, 0x4e, 0x20]);
    assert!(rgb::decode(Encoding::Png, SIZE, file.into()).is_err());
    let qoi = rgb::encode(Encoding::Qoi, SIZE, &[0; 600]).unwrap();
    let error = rgb::decode(Encoding::Qoi, Size { width: 21, ..SIZE }, qoi).unwrap_err().to_string();
    assert!(error.contains("21 x 10"), "{error}");
    assert!(depth::decode(Encoding::Packed, depth::Layout { size: large, unit_m: 1.0 }, &[0; 64]).is_err());
}

#[test]
fn trailing_bytes_are_refused() {
    for (file, encoding) in good().into_iter().zip(offered(SensorKind::Rgb)) {
        if *encoding == Encoding::Png {
            continue; // bytes after the last chunk do not belong to the file
        }
        let longer = [&file[..], &[0]].concat();
        assert!(rgb::decode(*encoding, SIZE, longer.into()).is_err(), "{encoding:?}");
    }
}
