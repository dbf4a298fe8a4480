//! Labelled images from `avln data dataset frames`.

#![allow(dead_code, reason = "each example reads what it needs")]

use avln_perception::CameraModel;
use serde::Deserialize;
use std::path::Path;

/// The content of `frames.json`.
#[derive(Deserialize)]
pub(crate) struct Manifest {
    pub(crate) purpose: String,
    pub(crate) recipe: String,
    pub(crate) split: String,
    pub(crate) side_px: usize,
    pub(crate) views: usize,
    pub(crate) categories: Vec<String>,
    pub(crate) houses: Vec<House>,
}

#[derive(Deserialize)]
pub(crate) struct House {
    pub(crate) file: String,
    /// File with sentences; optional.
    #[serde(default)]
    pub(crate) sentences: String,
}

/// A sentence for a single instance.
#[derive(Deserialize)]
pub(crate) struct Sentence {
    pub(crate) instance: u16,
    pub(crate) category: String,
    pub(crate) text: String,
}

/// An image with labels per pixel: category (255 for none) and instance (0 for none).
pub(crate) struct Record {
    pub(crate) camera: CameraModel,
    /// Body position in the world, metres, and heading, radians.
    pub(crate) base_m: [f32; 3],
    pub(crate) heading_rad: f32,
    pub(crate) rgb: Vec<u8>,
    pub(crate) depth_m: Vec<f32>,
    pub(crate) categories: Vec<u8>,
    pub(crate) instances: Vec<u16>,
}

pub(crate) fn manifest(folder: &Path) -> Manifest {
    let text = std::fs::read(folder.join("frames.json")).expect("frames.json can be read");
    serde_json::from_slice(&text).expect("frames.json is a list of pictures")
}

pub(crate) fn sentences(path: &Path) -> Vec<Sentence> {
    let text = std::fs::read(path).expect("the house's sentences can be read");
    serde_json::from_slice(&text).expect("a list of sentences")
}

pub(crate) fn house(path: &Path, side_px: usize) -> Vec<Record> {
    let file = std::fs::read(path).expect("the house's file can be read");
    let start = 10 + usize::from(u16::from_le_bytes([file[8], file[9]]));
    let header = std::str::from_utf8(&file[10..start]).expect("a header");
    assert!(header.contains("instance"), "{} holds no pictures of a house", path.display());
    let pixels = side_px * side_px;
    file[start..].chunks_exact(4 * 7 + pixels * 8).map(|record| read(record, pixels)).collect()
}

fn read(record: &[u8], pixels: usize) -> Record {
    let (camera, rest) = record.split_at(4 * 7);
    let (rgb, rest) = rest.split_at(3 * pixels);
    let (depth, rest) = rest.split_at(2 * pixels);
    let (categories, instances) = rest.split_at(pixels);
    let camera: Vec<f32> = camera.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect();
    let shorts = |bytes: &[u8]| -> Vec<u16> {
        bytes.as_chunks().0.iter().map(|two| u16::from_le_bytes(*two)).collect()
    };
    Record {
        camera: CameraModel { height_m: camera[3], pitch_rad: camera[5], hfov_rad: camera[6] },
        base_m: [camera[0], camera[1] - camera[3], camera[2]],
        heading_rad: camera[4],
        rgb: rgb.to_vec(),
        depth_m: shorts(depth).into_iter().map(|depth_mm| f32::from(depth_mm) / 1000.0).collect(),
        categories: categories.to_vec(),
        instances: shorts(instances),
    }
}
