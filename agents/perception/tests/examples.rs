//! The engine tells what PyTorch tells.

use avln_perception::{Camera, Depth, Eyes, Picture};

/// Of what PyTorch told, every fourth pixel of a row and of a column was kept.
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
fn the_engine_tells_what_pytorch_tells() {
    let mut eyes = Eyes::new().expect("the weights of the crate");
    let numbers = eyes.about().categories.len() + 2 + eyes.about().embedding;
    for number in 0..4 {
        let path = format!("{}/tests/examples/{number}.bin", env!("CARGO_MANIFEST_DIR"));
        let file = std::fs::read(&path).expect("an example");
        let mut bytes = file.as_slice();
        let side = u32::from_le_bytes(take(&mut bytes, 4).try_into().expect("four bytes")) as usize;
        let camera = floats(take(&mut bytes, 12));
        let camera = Camera { hfov_rad: camera[0], height_m: camera[1], pitch_rad: camera[2] };
        let picture = Picture { width: side, height: side, rgb: take(&mut bytes, 3 * side * side) };
        let metres = floats(take(&mut bytes, 4 * side * side));
        let depth = Depth { metres: &metres };
        let known = metres.iter().any(|depth_m| *depth_m > 0.0);
        let told = eyes.raw(&picture, known.then_some((&depth, &camera))).expect("a picture");
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
