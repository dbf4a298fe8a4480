/// A picture: `height × width × 3` bytes, sRGB, row by row from the top-left; 8 to 4096 pixels along a side.
#[derive(Clone, Copy, Debug)]
pub struct Picture<'a> {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The bytes.
    pub rgb: &'a [u8],
}

/// Depth for each pixel of a picture, along the viewing direction, metres; 0 where it is not known.
#[derive(Clone, Copy, Debug)]
pub struct Depth<'a> {
    /// As many as the picture has pixels, row by row from the top-left.
    pub metres: &'a [f32],
}

/// How a camera with square pixels stands to the floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Angle between the left and the right border, radians, in (0, pi).
    pub hfov_rad: f32,
    /// Above the floor on which its body stands, metres.
    pub height_m: f32,
    /// Of its viewing direction above the horizon, radians.
    pub pitch_rad: f32,
}

/// Why a picture cannot be looked at.
#[derive(Debug, PartialEq, thiserror::Error)]
pub enum SeeError {
    /// Its size is beyond the limits, or its bytes are not as many as its size asks for.
    #[error("cannot look at a picture of {width} x {height} pixels in {bytes} bytes")]
    Picture {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes.
        bytes: usize,
    },
    /// Depth is not of the picture's size.
    #[error("a picture of {width} x {height} pixels came with {values} depths")]
    Depth {
        /// Pixels in a row.
        width: usize,
        /// Rows.
        height: usize,
        /// Depths.
        values: usize,
    },
}

impl Camera {
    /// The direction of a pixel, for a depth of 1 m: metres to the right, up and ahead of a level camera.
    pub(crate) fn ray(&self, [width, height]: [usize; 2], [column, row]: [f32; 2]) -> [f32; 3] {
        let metres_per_px = 2.0 * (0.5 * self.hfov_rad).tan() / width as f32;
        let right = (column + 0.5 - 0.5 * width as f32) * metres_per_px;
        let up = (0.5 * height as f32 - row - 0.5) * metres_per_px;
        let (sin, cos) = self.pitch_rad.sin_cos();
        [right, up * cos + sin, cos - up * sin]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_follow_the_pinhole() {
        let level = Camera { hfov_rad: 1.570_796_4, height_m: 1.0, pitch_rad: 0.0 };
        let [right, up, ahead] = level.ray([4, 4], [3.5, -0.5]);
        assert!((right - 1.0).abs() < 1e-6 && (up - 1.0).abs() < 1e-6 && ahead == 1.0);
        // The lowest row of 4 looks down by 0.75 m a metre.
        assert!((level.ray([4, 4], [0.0, 3.0])[1] + 0.75).abs() < 1e-6);
        let up = Camera { pitch_rad: 0.5, ..level };
        assert!((up.ray([2, 2], [0.5, 0.5])[1] - 0.5_f32.sin()).abs() < 1e-6);
    }
}
