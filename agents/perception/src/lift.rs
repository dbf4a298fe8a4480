use crate::{Camera, Depth, Picture, Seen, Segment};

/// Share of the points at each end that do not count for a box: edges of depth belong to what is behind.
const OUTLIERS: f32 = 0.03;

/// A box around what is seen of an instance, in the frame of the body: x to the right, y up from the floor that it stands on,
/// z backwards, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solid {
    /// The least x, y and z.
    pub min_m: [f32; 3],
    /// The greatest.
    pub max_m: [f32; 3],
}

/// The box around the points of a segment of `seen`, which is what `picture` shows; `None` without depth at its pixels.
pub fn lift(
    seen: &Seen,
    segment: &Segment,
    picture: &Picture,
    depth: &Depth,
    camera: &Camera,
) -> Option<Solid> {
    let mut axes: [Vec<f32>; 3] = Default::default();
    for &pixel in &segment.mask {
        let (row, column) = (pixel as usize / seen.width, pixel as usize % seen.width);
        let (x, y) = (column * picture.width / seen.width, row * picture.height / seen.height);
        let depth_m = *depth.metres.get(y * picture.width + x)?;
        if depth_m > 0.0 && depth_m.is_finite() {
            let [right, up, ahead] = camera.ray([picture.width, picture.height], [x as f32, y as f32]);
            axes[0].push(right * depth_m);
            axes[1].push(camera.height_m + up * depth_m);
            axes[2].push(-ahead * depth_m);
        }
    }
    let [x, y, z] = axes.map(extent);
    let (x, y, z) = (x?, y?, z?);
    Some(Solid { min_m: [x[0], y[0], z[0]], max_m: [x[1], y[1], z[1]] })
}

/// The least and the greatest of some coordinates, but for the outliers that edges of depth make; `None` of none.
pub fn extent(mut numbers: Vec<f32>) -> Option<[f32; 2]> {
    numbers.sort_unstable_by(f32::total_cmp);
    let last = numbers.len().checked_sub(1)?;
    let left_out = (OUTLIERS * last as f32) as usize;
    Some([numbers[left_out], numbers[last - left_out]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Histogram, PixelBox};

    #[test]
    fn a_board_before_the_camera_is_where_it_is() {
        // The whole of a 90 degree picture shows a board 2 m ahead: 4 m wide and high.
        let mask: Vec<u32> = (0..64).collect();
        let segment = Segment {
            bounds: PixelBox::around(&mask, 8).expect("pixels"),
            mask,
            categories: vec![1.0],
            embedding: vec![1.0],
            histogram: Histogram::default(),
        };
        let seen = Seen {
            width: 8,
            height: 8,
            categories: vec![0; 64],
            confidences: vec![1.0; 64],
            segments: vec![],
        };
        let (rgb, metres) = ([0; 3 * 256], [2.0; 256]);
        let picture = Picture { width: 16, height: 16, rgb: &rgb };
        let camera = Camera { hfov_rad: std::f32::consts::FRAC_PI_2, height_m: 1.0, pitch_rad: 0.0 };
        let solid = lift(&seen, &segment, &picture, &Depth { metres: &metres }, &camera).expect("depth");
        // Every second pixel counts, their middles from 1/16 to 13/16 of a half.
        let near = |a: f32, b: f32| (a - b).abs() < 0.3;
        assert!(near(solid.min_m[0], -1.9) && near(solid.max_m[0], 1.7), "{solid:?}");
        assert!(near(solid.min_m[1], -0.7) && near(solid.max_m[1], 2.9), "{solid:?}");
        assert_eq!((solid.min_m[2], solid.max_m[2]), (-2.0, -2.0));
        let blind = lift(&seen, &segment, &picture, &Depth { metres: &[0.0; 256] }, &camera);
        assert_eq!(blind, None);
    }
}
