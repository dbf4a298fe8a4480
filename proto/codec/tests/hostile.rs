//! Bytes from outside: any of them give numbers of the agreed size or an error, never a panic.

use avln_codec::{Size, audio, depth, offered, rgb};
use avln_proto::v1::{Encoding, SensorKind};
use bytes::Bytes;
use proptest::prelude::*;

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

/// Good files of every kind, to be damaged.
fn good() -> Vec<Vec<u8>> {
    let pixels: Vec<u8> = (0..3 * SIZE.pixels()).map(|i| (i * i / 7) as u8).collect();
    let depths: Vec<f32> = (0..SIZE.pixels()).map(|i| (i % 17) as f32 / 3.0).collect();
    let colours = offered(SensorKind::Rgb).iter().map(|e| rgb::encode(*e, SIZE, &pixels).unwrap());
    let distances = offered(SensorKind::Depth).iter().map(|e| depth::encode(*e, LAYOUT, &depths).unwrap());
    colours.chain(distances).map(Vec::from).collect()
}

proptest! {
    #[test]
    fn any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..2000)) {
        decode_all(&bytes);
    }

    #[test]
    fn damaged_files(
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
fn a_small_file_cannot_ask_for_a_large_picture() {
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
            continue; // what follows the last chunk is no part of the file
        }
        let longer = [&file[..], &[0]].concat();
        assert!(rgb::decode(*encoding, SIZE, longer.into()).is_err(), "{encoding:?}");
    }
}
