//! Writes rows of f32 for `agents/perception/training/shapes.py`: house number, true category and features of a segment.
//!
//! ```sh
//! cargo run --release -p avln-perception --example shapes -- FRAMES FIRST_HOUSE FILE
//! ```

#[path = "measure/frames.rs"]
mod frames;

use avln_perception::{Depth, Perception, Picture, Segment, Segmentation, VisionNetwork, lift};
use frames::Record;
use std::{collections::BTreeMap, fs::File, io::BufWriter, io::Write, path::PathBuf};

/// Fewest pixels in a training segment.
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
    let mut network = VisionNetwork::new().expect("the weights of the crate");
    let first = first.parse().expect("the number of a house");
    for (number, house) in manifest.houses.iter().enumerate().skip(first) {
        for record in frames::house(&folder.join(&house.file), manifest.side_px) {
            let rows = rows(&mut network, &record, manifest.side_px);
            for value in rows.into_iter().flat_map(|row| std::iter::once(number as f32).chain(row)) {
                out.write_all(&value.to_le_bytes())?;
            }
        }
    }
    out.flush()
}

/// Returns category and features for segments with a majority category.
fn rows(network: &mut VisionNetwork, record: &Record, side_px: usize) -> Vec<Vec<f32>> {
    let picture = Picture { width: side_px, height: side_px, rgb: &record.rgb };
    let depth = Depth { metres: &record.depth_m };
    let seen = network.see(&picture, Some((&depth, &record.camera))).expect("a picture");
    let row = |segment: &Segment| {
        let category = category(&seen, segment, record, side_px)?;
        let solid = lift(&seen, segment, &picture, &depth, &record.camera)?;
        let features = VisionNetwork::features(&seen, segment, &solid);
        Some(std::iter::once(f32::from(category)).chain(features).collect())
    };
    seen.segments.iter().filter(|segment| segment.mask.len() >= LEAST_PX).filter_map(row).collect()
}

fn category(seen: &Segmentation, segment: &Segment, record: &Record, side_px: usize) -> Option<u8> {
    let step = side_px / seen.width;
    let mut counts = BTreeMap::<u8, usize>::new();
    for &pixel in &segment.mask {
        let (row, column) = (pixel as usize / seen.width, pixel as usize % seen.width);
        *counts.entry(record.categories[row * step * side_px + column * step]).or_default() += 1;
    }
    let (category, count) = counts.into_iter().max_by_key(|(_, count)| *count)?;
    (2 * count > segment.mask.len() && category < u8::MAX).then_some(category)
}
