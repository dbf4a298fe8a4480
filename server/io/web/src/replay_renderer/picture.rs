//! Camera pictures by step.

use super::{ByteSize, MaybeRenderQueue, RenderedView, ViewRequest};
use crate::{
    error::RequestError,
    request::{self, PictureQuery, RequestContext, StrictQuery},
};
use avln_episode::Pose;
use avln_store::{EpisodeView, Replay};
use axum::{
    Extension,
    body::Bytes,
    extract::Path,
    http::header,
    response::{IntoResponse, Response},
};

/// Longest side, pixels.
const MAX_SIDE_PX: u32 = 320;
/// Field of view for runs without recorded sensors, radians.
const DEFAULT_HFOV_RAD: f32 = std::f32::consts::FRAC_PI_2;
/// Depth colour map from near to far: cividis, which also works for colour-blind visitors.
const DEPTH: [[f32; 3]; 9] = [
    [0.0, 34.0, 78.0],
    [27.0, 53.0, 110.0],
    [66.0, 78.0, 108.0],
    [95.0, 100.0, 110.0],
    [124.0, 123.0, 120.0],
    [155.0, 147.0, 119.0],
    [188.0, 174.0, 108.0],
    [223.0, 203.0, 88.0],
    [254.0, 232.0, 56.0],
];
/// Colour for no hit.
const NO_HIT: [u8; 3] = [0, 0, 0];

/// A rendered view as PNG files.
#[derive(Debug, PartialEq)]
pub(super) struct Pictures {
    pub(super) rgb: Vec<u8>,
    pub(super) depth: Vec<u8>,
}

impl Pictures {
    /// Encodes a view; `None` if its pixels do not match the size.
    pub(super) fn new(view: &RenderedView, width: u32, height: u32) -> Option<Self> {
        let colour = |metres: &f32| depth_colour(*metres / view.depth_max_m.max(f32::MIN_POSITIVE));
        let depth: Vec<u8> = view.depth_m.iter().flat_map(colour).collect();
        Some(Self { rgb: encode_png(&view.rgb, width, height)?, depth: encode_png(&depth, width, height)? })
    }
}

impl ByteSize for Pictures {
    fn bytes(&self) -> usize {
        self.rgb.len() + self.depth.len()
    }
}

/// Returns the colour for a depth as a share of the sensor range.
fn depth_colour(share: f32) -> [u8; 3] {
    if share <= 0.0 || !share.is_finite() {
        return NO_HIT;
    }
    let position = share.min(1.0) * (DEPTH.len() - 1) as f32;
    let below = (position as usize).min(DEPTH.len() - 2);
    let rest = position - below as f32;
    [0, 1, 2].map(|channel| {
        (DEPTH[below][channel] * (1.0 - rest) + DEPTH[below + 1][channel] * rest).round() as u8
    })
}

/// Returns the legend colours for depth, with positions in percent.
pub(crate) fn depth_strip() -> Vec<(u32, String)> {
    let colour = |position: u32| {
        let [red, green, blue] = depth_colour((position as f32 + 5.0) / 100.0);
        (position, format!("#{red:02x}{green:02x}{blue:02x}"))
    };
    (0..100).step_by(10).map(colour).collect()
}

fn encode_png(pixels: &[u8], width: u32, height: u32) -> Option<Vec<u8>> {
    if pixels.len() != width as usize * height as usize * 3 {
        return None;
    }
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.write_header().ok()?.write_image_data(pixels).ok()?;
    Some(out)
}

/// Serves the picture `STEP.png`.
pub(crate) async fn picture(
    context: RequestContext,
    Path((run, place, file)): Path<(String, String, String)>,
    Extension(queue): Extension<MaybeRenderQueue>,
    StrictQuery(query): StrictQuery<PictureQuery>,
) -> Result<Response, RequestError> {
    let view = context.reader.episode(&context.viewer, &run, request::ordinal(&place)?).await?;
    let unknown =
        || RequestError::Unknown { what: "picture", name: format!("{file} of episode {place} of run {run}") };
    let queue = queue.ok_or_else(unknown)?;
    let view = view.ok_or_else(unknown)?;
    let step = file.strip_suffix(".png").and_then(|step| step.parse::<usize>().ok()).ok_or_else(unknown)?;
    let view_request = view_request(&view, step).ok_or_else(unknown)?;
    let key = format!("{run} {} {step}", view.ordinal);
    let pictures = queue.pictures(key, view_request).await?;
    let png = Bytes::from(if query.is_depth() { pictures.depth.clone() } else { pictures.rgb.clone() });
    Ok(([(header::CONTENT_TYPE, "image/png")], png).into_response())
}

/// Returns the view after `step` steps; `None` if the viewer may not see it or the episode was shorter.
fn view_request(view: &EpisodeView, step: usize) -> Option<ViewRequest> {
    let replay = view.replay.as_ref()?;
    let [x, y, z] = *replay.path.get(step)?;
    let pose = Pose { position: [x, y, z].into(), heading_rad: *replay.headings_rad.get(step)? };
    let [width, height] = size_px(replay);
    Some(ViewRequest {
        phase: view.run.phase.clone(),
        scene: replay.scene.clone(),
        pose,
        width,
        height,
        hfov_rad: replay.sensors.as_ref().map_or(DEFAULT_HFOV_RAD, |sensors| sensors.hfov_rad),
    })
}

/// Returns width and height in the camera's aspect ratio.
pub(crate) fn size_px(replay: &Replay) -> [u32; 2] {
    let (width, height) = replay.sensors.as_ref().map_or((1, 1), |sensors| (sensors.width, sensors.height));
    let longest = f64::from(width.max(height).max(1));
    [width, height].map(|side| ((f64::from(side.max(1)) / longest * f64::from(MAX_SIDE_PX)) as u32).max(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_colours_grow_brighter_with_distance() {
        assert_eq!(depth_colour(0.0), NO_HIT);
        assert_eq!(depth_colour(f32::NAN), NO_HIT);
        assert_eq!(depth_colour(1e-9), [0, 34, 78]);
        assert_eq!(depth_colour(1.0), [254, 232, 56]);
        assert_eq!(depth_colour(7.0), [254, 232, 56]);
        let brightness =
            |share: f32| depth_colour(share).iter().map(|&channel| u32::from(channel)).sum::<u32>();
        assert!((1..20).all(|step| brightness(step as f32 / 20.0) < brightness((step + 1) as f32 / 20.0)));
    }

    #[test]
    fn views_of_the_wrong_size_are_rejected() {
        let view = RenderedView { rgb: vec![9; 12], depth_m: vec![1.0; 4], depth_max_m: 10.0 };
        let pictures = Pictures::new(&view, 2, 2).expect("the right size");
        assert!(pictures.rgb.starts_with(b"\x89PNG") && pictures.depth.starts_with(b"\x89PNG"));
        assert_eq!(Pictures::new(&view, 3, 2), None);
        assert_eq!(Pictures::new(&RenderedView { depth_m: vec![], ..view }, 2, 2), None);
    }
}
