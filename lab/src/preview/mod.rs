//! Pictures that show a person what a scene is like: each storey from above, and views from inside its rooms.

mod storey;
mod views;

use avln_geom::Aabb;
use avln_render::CameraImage;
use avln_scene::Scene;
use std::io::Write;

pub use storey::storeys;
pub use views::{Viewer, indoors};

/// A picture and what it shows.
#[derive(Clone, Debug)]
pub struct Picture {
    /// A word for its file: `storey-0`, `view-3-kitchen` …
    pub name: String,
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// `height × width × 3` bytes, sRGB.
    pub rgb: Vec<u8>,
}

impl Picture {
    /// A rendered frame as a picture.
    pub fn of(name: String, frame: CameraImage) -> Self {
        Self { name, width: frame.width, height: frame.height, rgb: frame.rgb }
    }

    /// Writes it as a PNG file.
    ///
    /// # Errors
    /// When `out` cannot be written.
    pub fn write_png(&self, out: impl Write) -> Result<(), png::EncodingError> {
        let mut encoder = png::Encoder::new(out, self.width, self.height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_compression(png::Compression::Fast);
        encoder.write_header()?.write_image_data(&self.rgb)
    }
}

/// The rooms of a scene as boxes, each with its name; the whole scene where none are known.
fn rooms(scene: &Scene) -> Vec<(String, Aabb)> {
    let rooms: Vec<_> = scene.regions.iter().map(|region| (region.label.clone(), region.bounds)).collect();
    match scene.bounds() {
        Some(bounds) if rooms.is_empty() => vec![("scene".to_owned(), bounds)],
        _ => rooms,
    }
}
