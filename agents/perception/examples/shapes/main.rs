//! Writes what the eyes tell of every segment in pictures with what they show, for `training/shapes.py`: rows of 32-bit floats,
//! the number of the house, the category that the segment truly shows, and what it is judged by.
//!
//! ```sh
//! cargo run --release -p avln-perception --example shapes -- FRAMES FIRST_HOUSE FILE
//! ```

#[path = "../measure/frames.rs"]
mod frames;

use avln_perception::{Depth, Eyes, Perception, Picture, Seen, Segment, lift};
use frames::Record;
use std::{collections::BTreeMap, fs::File, io::BufWriter, io::Write, path::PathBuf};

/// Segments of fewer pixels are not learnt from.
const LEAST_PX: usize = 24;

fn main() -> std::io::Result<()> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let [folder, first, file] = given.as_slice() else {
        eprintln!("name the folder of pictures, the number of the first house and the file to write");
        std::process::exit(2);
    };
    let folder = PathBuf::from(folder);
    let manifest = frames::manifest(&folder);
    let mut out = BufWriter::new(File::create(file)?);
    let mut eyes = Eyes::new().expect("the weights of the crate");
    let first = first.parse().expect("the number of a house");
    for (number, house) in manifest.houses.iter().enumerate().skip(first) {
        for record in frames::house(&folder.join(&house.file), manifest.side_px) {
            let rows = rows(&mut eyes, &record, manifest.side_px);
            for value in rows.into_iter().flat_map(|row| std::iter::once(number as f32).chain(row)) {
                out.write_all(&value.to_le_bytes())?;
            }
        }
    }
    out.flush()
}

/// For each segment that shows one category on more than half of it: that, and what it is judged by.
fn rows(eyes: &mut Eyes, record: &Record, side_px: usize) -> Vec<Vec<f32>> {
    let picture = Picture { width: side_px, height: side_px, rgb: &record.rgb };
    let depth = Depth { metres: &record.depth_m };
    let seen = eyes.see(&picture, Some((&depth, &record.camera))).expect("a picture");
    let row = |segment: &Segment| {
        let category = category(&seen, segment, record, side_px)?;
        let solid = lift(&seen, segment, &picture, &depth, &record.camera)?;
        let features = Eyes::features(&seen, segment, &solid);
        Some(std::iter::once(f32::from(category)).chain(features).collect())
    };
    seen.segments.iter().filter(|segment| segment.mask.len() >= LEAST_PX).filter_map(row).collect()
}

fn category(seen: &Seen, segment: &Segment, record: &Record, side_px: usize) -> Option<u8> {
    let step = side_px / seen.width;
    let mut counts = BTreeMap::<u8, usize>::new();
    for &pixel in &segment.mask {
        let (row, column) = (pixel as usize / seen.width, pixel as usize % seen.width);
        *counts.entry(record.categories[row * step * side_px + column * step]).or_default() += 1;
    }
    let (category, count) = counts.into_iter().max_by_key(|(_, count)| *count)?;
    (2 * count > segment.mask.len() && category < u8::MAX).then_some(category)
}
