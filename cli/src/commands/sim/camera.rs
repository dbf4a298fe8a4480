//! Camera arguments: pose, size, field of view, largest depth.

use avln_geom::{Point3, UnitQuaternion, angle};
use avln_render::Camera;
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Sides of pictures, pixels.
pub(super) const SIDES_PX: RangeInclusive<u32> = 1..=4096;
/// Fields of view of a pinhole camera, degrees.
pub(super) const HFOV_DEG: RangeInclusive<f64> = 0.2..=179.8;
/// Largest camera coordinate, metres.
pub(super) const REACH_M: f64 = 1e6;

/// Size of a picture, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct PictureSize {
    pub(super) width: u32,
    pub(super) height: u32,
}

/// Horizontal field of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hfov {
    pub(super) degrees: f64,
}

/// Position and orientation of a camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CameraPose {
    pub(super) eye: Point3<f32>,
    pub(super) world_from_camera: UnitQuaternion<f32>,
}

/// A distance above 0, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct MaxDepth(pub(super) f32);

impl PictureSize {
    pub(super) fn new(width: u32, height: u32) -> Result<Self, String> {
        let (least, most) = (SIDES_PX.start(), SIDES_PX.end());
        for (name, side) in [("width", width), ("height", height)] {
            if !SIDES_PX.contains(&side) {
                return Err(format!("{name} {side}: pictures have {least} to {most} pixels along a side"));
            }
        }
        Ok(Self { width, height })
    }
}

impl FromStr for PictureSize {
    type Err = String;

    fn from_str(words: &str) -> Result<Self, String> {
        let sides = words.split_once(['x', 'X']);
        let sides = sides.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
        let (width, height) = sides.ok_or("write width x height, such as 256x256")?;
        Self::new(width, height)
    }
}

impl Hfov {
    pub(super) fn new(degrees: f64) -> Result<Self, String> {
        let (least, most) = (HFOV_DEG.start(), HFOV_DEG.end());
        match HFOV_DEG.contains(&degrees) {
            true => Ok(Self { degrees }),
            false => Err(format!("hfov {degrees}: angles of view lie between {least} and {most} degrees")),
        }
    }
}

impl FromStr for Hfov {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        Self::new(word.parse().map_err(|_| "write degrees, such as 90")?)
    }
}

impl FromStr for MaxDepth {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let metres = word.parse().ok().filter(|metres: &f32| *metres > 0.0 && metres.is_finite());
        metres.map(Self).ok_or_else(|| "write metres above 0, such as 10".to_owned())
    }
}

impl FromStr for CameraPose {
    type Err = String;

    fn from_str(words: &str) -> Result<Self, String> {
        let number = |word: &str| word.trim().parse().map_err(|error| format!("'{word}': {error}"));
        let values: Vec<f64> = words.split(',').map(number).collect::<Result<_, _>>()?;
        let (place, heading_deg, pitch_deg) = match *values.as_slice() {
            [x, y, z, heading_deg] => ([x, y, z], heading_deg, 0.0),
            [x, y, z, heading_deg, pitch_deg] => ([x, y, z], heading_deg, pitch_deg),
            _ => {
                return Err(
                    "write x,y,z in metres, the heading and, if you like, the pitch in degrees".into()
                );
            }
        };
        if let Some(value) = [heading_deg, pitch_deg].into_iter().find(|value| !value.is_finite()) {
            return Err(format!("'{value}' is no angle; write degrees"));
        }
        let turned = angle::about_up(heading_deg.to_radians() as f32);
        let tipped = angle::about_right(pitch_deg.to_radians() as f32);
        Ok(Self { eye: eye(place)?, world_from_camera: turned * tipped })
    }
}

/// The pinhole at `position`, metres.
pub(super) fn eye(position: [f64; 3]) -> Result<Point3<f32>, String> {
    match position.iter().find(|value| value.is_nan() || value.abs() > REACH_M) {
        Some(value) => Err(format!("position {value}: cameras stand within {REACH_M} m of the origin")),
        None => Ok(Point3::from(position.map(|value| value as f32))),
    }
}

/// Returns the camera. Depth is unlimited if `reach` is `None`.
pub(super) fn camera(pose: &CameraPose, size: PictureSize, hfov: Hfov, reach: Option<MaxDepth>) -> Camera {
    Camera {
        eye: pose.eye,
        world_from_camera: pose.world_from_camera,
        width: size.width,
        height: size.height,
        hfov_rad: hfov.degrees.to_radians() as f32,
        depth_max_m: reach.map_or(f32::MAX, |reach| reach.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Vector3;

    fn ahead(words: &str) -> Vector3<f32> {
        let pose: CameraPose = words.parse().expect("a pose");
        pose.world_from_camera * -Vector3::z()
    }

    #[test]
    fn headings_turn_left_and_pitches_look_up() {
        let half = std::f32::consts::FRAC_1_SQRT_2;
        for (words, [x, y, z]) in [
            ("1,2,3,0", [0.0, 0.0, -1.0]),
            ("1,2,3,90", [-1.0, 0.0, 0.0]),
            (" -1, 2,3 ,-90", [1.0, 0.0, 0.0]),
            ("1,2,3,0,45", [0.0, half, -half]),
            ("1,2,3,180,-45", [0.0, -half, half]),
            ("1,2,3,77,-90", [0.0, -1.0, 0.0]),
        ] {
            assert!((ahead(words) - Vector3::new(x, y, z)).norm() < 1e-6, "{words}: {:?}", ahead(words));
        }
        let pose: CameraPose = "-1,2.5,3,10,20".parse().expect("a pose");
        assert_eq!(pose.eye, Point3::new(-1.0, 2.5, 3.0));
        assert!((pose.world_from_camera * Vector3::x()).y.abs() < 1e-7, "the horizon is level");
    }

    #[test]
    fn poses_sizes_and_angles_without_sense_are_refused() {
        for bad in
            ["", "1,2,3", "1,2,3,4,5,6", "1,2,three,4", "1,2,3,NaN", "1,2,3,4,inf", "1e7,0,0,0", "nan,0,0,0"]
        {
            assert!(bad.parse::<CameraPose>().is_err(), "{bad}");
        }
        for bad in ["", "256", "0x1", "1x0", "4097x2", "2x4097", "-1x2", "1.5x2", "axb", "1x2x3"] {
            assert!(bad.parse::<PictureSize>().is_err(), "{bad}");
        }
        for bad in ["", "0", "0.1", "179.9", "180", "-90", "NaN", "inf", "wide"] {
            assert!(bad.parse::<Hfov>().is_err(), "{bad}");
        }
        for bad in ["", "0", "-1", "NaN", "inf", "far"] {
            assert!(bad.parse::<MaxDepth>().is_err(), "{bad}");
        }
        assert_eq!("4096x1".parse(), Ok(PictureSize { width: 4096, height: 1 }));
        assert_eq!("0.2".parse(), Ok(Hfov { degrees: 0.2 }));
    }
}
