use super::{Seen, shelf::Kept};

/// Colours of depth from near to far: cividis, which is read alike by most eyes.
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
/// Where nothing was within reach.
const NOTHING: [u8; 3] = [0, 0, 0];

/// What was seen, as PNG files.
#[derive(Debug, PartialEq)]
pub(super) struct Pictures {
    pub(super) rgb: Vec<u8>,
    pub(super) depth: Vec<u8>,
}

impl Pictures {
    /// `None` where the pixels do not fit the size.
    pub(super) fn of(seen: &Seen, width: u32, height: u32) -> Option<Self> {
        let coloured = |metres: &f32| depth_colour(*metres / seen.depth_max_m.max(f32::MIN_POSITIVE));
        let depth: Vec<u8> = seen.depth_m.iter().flat_map(coloured).collect();
        Some(Self { rgb: png(&seen.rgb, width, height)?, depth: png(&depth, width, height)? })
    }
}

impl Kept for Pictures {
    fn bytes(&self) -> usize {
        self.rgb.len() + self.depth.len()
    }
}

/// The colour of a share of the greatest depth.
fn depth_colour(share: f32) -> [u8; 3] {
    if share <= 0.0 || !share.is_finite() {
        return NOTHING;
    }
    let place = share.min(1.0) * (DEPTH.len() - 1) as f32;
    let below = (place as usize).min(DEPTH.len() - 2);
    let rest = place - below as f32;
    [0, 1, 2].map(|channel| {
        (DEPTH[below][channel] * (1.0 - rest) + DEPTH[below + 1][channel] * rest).round() as u8
    })
}

/// Colours of the legend beside a picture of depth: place in a hundred and colour.
pub(crate) fn depth_strip() -> Vec<(u32, String)> {
    let colour = |place: u32| {
        let [red, green, blue] = depth_colour((place as f32 + 5.0) / 100.0);
        (place, format!("#{red:02x}{green:02x}{blue:02x}"))
    };
    (0..100).step_by(10).map(colour).collect()
}

fn png(pixels: &[u8], width: u32, height: u32) -> Option<Vec<u8>> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_dark_near_bright_far_and_black_where_there_is_nothing() {
        assert_eq!(depth_colour(0.0), NOTHING);
        assert_eq!(depth_colour(f32::NAN), NOTHING);
        assert_eq!(depth_colour(1e-9), [0, 34, 78]);
        assert_eq!(depth_colour(1.0), [254, 232, 56]);
        assert_eq!(depth_colour(7.0), [254, 232, 56]);
        let brightness =
            |share: f32| depth_colour(share).iter().map(|&channel| u32::from(channel)).sum::<u32>();
        assert!((1..20).all(|step| brightness(step as f32 / 20.0) < brightness((step + 1) as f32 / 20.0)));
    }

    #[test]
    fn pixels_that_do_not_fit_are_no_picture() {
        let seen = Seen { rgb: vec![9; 12], depth_m: vec![1.0; 4], depth_max_m: 10.0 };
        let pictures = Pictures::of(&seen, 2, 2).expect("they fit");
        assert!(pictures.rgb.starts_with(b"\x89PNG") && pictures.depth.starts_with(b"\x89PNG"));
        assert_eq!(Pictures::of(&seen, 3, 2), None);
        assert_eq!(Pictures::of(&Seen { depth_m: vec![], ..seen }, 2, 2), None);
    }
}
