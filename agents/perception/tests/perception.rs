//! The engine against PyTorch, and properties of segmentations.

use avln_perception::{CameraModel, Depth, Perception, Picture, VisionNetwork, lift};

/// The expected output contains every fourth pixel per axis.
const KEPT: usize = 4;

fn take<'a>(bytes: &mut &'a [u8], count: usize) -> &'a [u8] {
    let (taken, rest) = bytes.split_at(count);
    *bytes = rest;
    taken
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
}

#[test]
fn engine_matches_pytorch() {
    let mut network = VisionNetwork::new().expect("the weights of the crate");
    let numbers = network.info().categories.len() + 2 + network.info().embedding;
    for number in 0..4 {
        let path = format!("{}/tests/examples/{number}.bin", env!("CARGO_MANIFEST_DIR"));
        let file = std::fs::read(&path).expect("an example");
        let mut bytes = file.as_slice();
        let side = u32::from_le_bytes(take(&mut bytes, 4).try_into().expect("four bytes")) as usize;
        let camera = floats(take(&mut bytes, 12));
        let camera = CameraModel { hfov_rad: camera[0], height_m: camera[1], pitch_rad: camera[2] };
        let picture = Picture { width: side, height: side, rgb: take(&mut bytes, 3 * side * side) };
        let metres = floats(take(&mut bytes, 4 * side * side));
        let depth = Depth { metres: &metres };
        let known = metres.iter().any(|depth_m| *depth_m > 0.0);
        let told = network.raw(&picture, known.then_some((&depth, &camera))).expect("a picture");
        let wanted = floats(bytes);
        let half = side / 2;
        assert_eq!(told.len(), half * half * numbers);
        assert_eq!(wanted.len(), (half / KEPT) * (half / KEPT) * numbers);
        let pixels = (0..half).step_by(KEPT).flat_map(|y| (0..half).step_by(KEPT).map(move |x| y * half + x));
        let mut greatest = 0.0_f32;
        for (pixel, wanted) in pixels.zip(wanted.chunks(numbers)) {
            for (told, wanted) in told[pixel * numbers..].iter().zip(wanted) {
                assert!(told.is_finite());
                greatest = greatest.max((told - wanted).abs());
            }
        }
        assert!(greatest < 1e-3, "example {number}: {greatest}");
    }
}

/// The first example: an image with 64 x 64 pixels and depth.
fn example() -> (CameraModel, Vec<u8>, Vec<f32>) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/examples/0.bin");
    let file = std::fs::read(path).expect("an example");
    let floats = |bytes: &[u8]| -> Vec<f32> {
        bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
    };
    let camera = floats(&file[4..16]);
    let camera = CameraModel { hfov_rad: camera[0], height_m: camera[1], pitch_rad: camera[2] };
    let depth_at = 16 + 3 * 64 * 64;
    (camera, file[16..depth_at].to_vec(), floats(&file[depth_at..depth_at + 4 * 64 * 64]))
}

#[test]
fn segments_are_disjoint_and_normalised() {
    let (camera, rgb, metres) = example();
    let picture = Picture { width: 64, height: 64, rgb: &rgb };
    let depth = Depth { metres: &metres };
    let mut network = VisionNetwork::new().expect("the weights of the crate");
    let seen = network.see(&picture, Some((&depth, &camera))).expect("a picture");
    assert_eq!((seen.width, seen.height, seen.categories.len()), (96, 96, 96 * 96));
    assert!(seen.confidences.iter().all(|confidence| (0.0..=1.0).contains(confidence)));
    assert!(!seen.segments.is_empty());
    let mut taken = vec![false; 96 * 96];
    for segment in &seen.segments {
        assert!(segment.mask.iter().all(|pixel| !std::mem::replace(&mut taken[*pixel as usize], true)));
        assert!((segment.categories.iter().sum::<f32>() - 1.0).abs() < 1e-4);
        assert!((segment.cosine(segment) - 1.0).abs() < 1e-4);
        let solid = lift(&seen, segment, &picture, &depth, &camera).expect("depth");
        assert!((0..3).all(|axis| solid.min_m[axis] <= solid.max_m[axis]));
        assert!(solid.min_m[1] > -0.3 && solid.max_m[1] < 3.0, "between floor and ceiling: {solid:?}");
    }
    // Another image leaves no trace in the buffers.
    network.look_at_picture(&picture).expect("a picture");
    assert_eq!(network.see(&picture, Some((&depth, &camera))), Ok(seen));
}

#[test]
fn floors_are_low_and_ceilings_high() {
    let (camera, rgb, metres) = example();
    let picture = Picture { width: 64, height: 64, rgb: &rgb };
    let mut network = VisionNetwork::new().expect("the weights of the crate");
    let number = |network: &VisionNetwork, name: &str| {
        network.categories().iter().position(|category| category == name)
    };
    let (floor, ceiling) = (number(&network, "floor"), number(&network, "ceiling"));
    let seen = network.see(&picture, Some((&Depth { metres: &metres }, &camera))).expect("a picture");
    let count = |kind: Option<usize>, rows: std::ops::Range<usize>| {
        let pixels = &seen.categories[rows.start * 96..rows.end * 96];
        pixels.iter().filter(|category| Some(usize::from(**category)) == kind).count()
    };
    assert!(count(floor, 48..96) > 200 && count(floor, 0..40) == 0);
    assert!(count(ceiling, 0..48) > 200 && count(ceiling, 56..96) == 0);
}

#[test]
fn truncated_weights_are_refused() {
    let whole = include_bytes!("../weights/network.safetensors");
    for length in [0, 7, 100, whole.len() / 2, whole.len() - 1] {
        assert!(VisionNetwork::from_bytes(&whole[..length]).is_err(), "{length} bytes");
    }
    assert!(VisionNetwork::from_bytes(whole).is_ok());
}
