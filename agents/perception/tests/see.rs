//! What the eyes tell of pictures of a house is in order, and is the same each time.

use avln_perception::{Camera, Depth, Eyes, Perception, Picture, lift};

/// The first example: a picture of 64 x 64 pixels with depth.
fn example() -> (Camera, Vec<u8>, Vec<f32>) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/examples/0.bin");
    let file = std::fs::read(path).expect("an example");
    let floats = |bytes: &[u8]| -> Vec<f32> {
        bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect()
    };
    let camera = floats(&file[4..16]);
    let camera = Camera { hfov_rad: camera[0], height_m: camera[1], pitch_rad: camera[2] };
    let depth_at = 16 + 3 * 64 * 64;
    (camera, file[16..depth_at].to_vec(), floats(&file[depth_at..depth_at + 4 * 64 * 64]))
}

#[test]
fn segments_are_apart_and_add_up() {
    let (camera, rgb, metres) = example();
    let picture = Picture { width: 64, height: 64, rgb: &rgb };
    let depth = Depth { metres: &metres };
    let mut eyes = Eyes::new().expect("the weights of the crate");
    let seen = eyes.see(&picture, Some((&depth, &camera))).expect("a picture");
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
    // Another picture in between leaves nothing behind.
    eyes.look_at_picture(&picture).expect("a picture");
    assert_eq!(eyes.see(&picture, Some((&depth, &camera))), Ok(seen));
}

#[test]
fn floors_are_below_and_ceilings_above() {
    let (camera, rgb, metres) = example();
    let picture = Picture { width: 64, height: 64, rgb: &rgb };
    let mut eyes = Eyes::new().expect("the weights of the crate");
    let number = |eyes: &Eyes, name: &str| eyes.categories().iter().position(|category| category == name);
    let (floor, ceiling) = (number(&eyes, "floor"), number(&eyes, "ceiling"));
    let seen = eyes.see(&picture, Some((&Depth { metres: &metres }, &camera))).expect("a picture");
    let count = |kind: Option<usize>, rows: std::ops::Range<usize>| {
        let pixels = &seen.categories[rows.start * 96..rows.end * 96];
        pixels.iter().filter(|category| Some(usize::from(**category)) == kind).count()
    };
    assert!(count(floor, 48..96) > 200 && count(floor, 0..40) == 0);
    assert!(count(ceiling, 0..48) > 200 && count(ceiling, 56..96) == 0);
}

#[test]
fn weights_that_are_cut_off_are_refused() {
    let whole = include_bytes!("../weights/eyes.safetensors");
    for length in [0, 7, 100, whole.len() / 2, whole.len() - 1] {
        assert!(Eyes::from_bytes(&whole[..length]).is_err(), "{length} bytes");
    }
    assert!(Eyes::from_bytes(whole).is_ok());
}
