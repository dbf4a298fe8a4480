//! From a file's axes and units to the world frame: Y up, metres.

use crate::Report;
use crate::files::Checked;
use avln_geom::{Aabb, Point3, Vector3};
use avln_scene::Mesh;
use avln_scene::limits::{MAX_SCENE_SIDE_M, MIN_SCENE_SIDE_M};

/// One extent is clearly smaller than another below this share of it.
const CLEARLY_SMALLER: f32 = 0.6;
/// A building higher than this, metres, is mentioned.
const TALLEST_M: f32 = 30.0;

/// The axis of a file that points up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Up {
    /// Y, as in glTF.
    Y,
    /// Z, as in scans of Matterport, Replica and Gibson.
    Z,
}

/// What a file's number 1 means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// 1 m.
    Metre,
    /// 0.01 m.
    Centimetre,
    /// 0.001 m.
    Millimetre,
}

/// What a caller knows better than the layout's convention; `None` leaves the choice to the importer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Options {
    /// The axis that points up.
    pub up: Option<Up>,
    /// The unit of length.
    pub unit: Option<Unit>,
}

impl Unit {
    /// Its length in metres.
    pub fn metres(self) -> f32 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
        }
    }

    fn option(self) -> &'static str {
        match self {
            Self::Metre => "--units m",
            Self::Centimetre => "--units cm",
            Self::Millimetre => "--units mm",
        }
    }
}

impl Up {
    fn axis(self) -> usize {
        match self {
            Self::Y => 1,
            Self::Z => 2,
        }
    }

    fn other(self) -> Self {
        match self {
            Self::Y => Self::Z,
            Self::Z => Self::Y,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// How sure a layout is of its up axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Convention {
    /// The format demands it: other evidence is only mentioned.
    Fixed(Up),
    /// It is usual: clear evidence for the other axis wins, and is mentioned.
    Usual(Up),
}

/// The way from a file's coordinates into the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Frame {
    up: Up,
    metres: f32,
}

impl Frame {
    /// Settles the frame of the surfaces of a file, still in its own coordinates.
    pub(crate) fn of(mesh: &Mesh, options: &Options, convention: Convention, report: &mut Report) -> Self {
        let (Convention::Fixed(usual) | Convention::Usual(usual)) = convention;
        let metres = options.unit.unwrap_or(Unit::Metre).metres();
        if let Some(up) = options.up {
            return Self { up, metres };
        }
        let (other, seems_turned) = (usual.other(), lies_on_its_side(mesh, usual));
        let up = match convention {
            Convention::Usual(_) if seems_turned => {
                report.warn(format!(
                    "its {other} axis is taken for up, by its extent and its level surfaces; if that is wrong, say --up {}",
                    usual.name(), other = other.name()
                ));
                other
            }
            Convention::Fixed(_) if seems_turned => {
                report.warn(format!(
                    "its {} axis is taken for up, as the format has it, but the building seems to lie on its side; if so, say --up {}",
                    usual.name(), other.name()
                ));
                usual
            }
            _ => usual,
        };
        Self { up, metres }
    }

    /// A point of the file in the world: Z up turns (x, y, z) into (x, z, -y).
    pub(crate) fn point(&self, [x, y, z]: [f32; 3]) -> Point3<f32> {
        let turned = match self.up {
            Up::Y => Point3::new(x, y, z),
            Up::Z => Point3::new(x, z, -y),
        };
        turned * self.metres
    }

    /// The box around two opposite corners of the file.
    pub(crate) fn bounds(&self, a: [f32; 3], b: [f32; 3]) -> Aabb {
        let (a, b) = (self.point(a), self.point(b));
        Aabb::new(a.inf(&b), a.sup(&b))
    }

    /// Turns and scales all positions.
    pub(crate) fn apply(&self, mesh: &mut Mesh) {
        mesh.positions.iter_mut().for_each(|position| *position = self.point((*position).into()));
    }
}

/// Whether a building whose `up` axis is that would be far higher than wide, while the other axis is short and has more level
/// surfaces.
fn lies_on_its_side(mesh: &Mesh, up: Up) -> bool {
    let Some(bounds) = Aabb::around(&mesh.positions) else { return false };
    let size = bounds.size();
    let (height, other) = (size[up.axis()], size[up.other().axis()]);
    other < CLEARLY_SMALLER * height && other < CLEARLY_SMALLER * size.x && {
        let area = area_by_axis(mesh);
        area[up.other().axis()] > area[up.axis()]
    }
}

/// Area of the surfaces seen along each axis, in the file's unit squared.
fn area_by_axis(mesh: &Mesh) -> [f32; 3] {
    let mut area = Vector3::zeros();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        area += (b - a).cross(&(c - a)).abs() / 2.0;
    }
    area.into()
}

/// Refuses a building whose size says that it is not in metres, and mentions one that is suspiciously high.
pub(crate) fn check_size(mesh: &Mesh, report: &mut Report) -> Checked<()> {
    let bounds = Aabb::around(&mesh.positions).ok_or("it holds no triangles; export the meshes with it")?;
    let size = bounds.size();
    let longest = size.max();
    if !(MIN_SCENE_SIDE_M..=MAX_SCENE_SIDE_M).contains(&longest) {
        return Err(format!(
            "it measures {} x {} x {} m, a building is {MIN_SCENE_SIDE_M} to {MAX_SCENE_SIDE_M} m long; {}",
            size.x,
            size.y,
            size.z,
            advice(longest)
        ));
    }
    if size.y > TALLEST_M {
        report.warn(format!(
            "it is {} m high; if its unit is not the metre, say --units cm or --units mm, if another axis points up, say --up",
            size.y
        ));
    }
    Ok(())
}

/// What to do with a building whose longest side is `longest_m`.
fn advice(longest_m: f32) -> String {
    let fitting = [Unit::Centimetre, Unit::Millimetre]
        .into_iter()
        .filter(|unit| (MIN_SCENE_SIDE_M..=MAX_SCENE_SIDE_M).contains(&(longest_m * unit.metres())));
    let options: Vec<&str> = fitting.map(Unit::option).collect();
    match options.is_empty() {
        true => "scale it in a 3D editor and export it in metres".to_owned(),
        false => format!(
            "import it with {}, or scale it in a 3D editor and export it in metres",
            options.join(" or ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Point2;
    use avln_scene::InstanceId;

    /// The outside of a box of that size, in the file's axes.
    fn box_of([x, y, z]: [f32; 3]) -> Mesh {
        let positions: Vec<Point3<f32>> = (0..8)
            .map(|corner| {
                Point3::new((corner & 1) as f32 * x, (corner >> 1 & 1) as f32 * y, (corner >> 2) as f32 * z)
            })
            .collect();
        let faces = [[0, 1, 3, 2], [4, 5, 7, 6], [0, 1, 5, 4], [2, 3, 7, 6], [0, 2, 6, 4], [1, 3, 7, 5]];
        let triangles: Vec<[u32; 3]> =
            faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        Mesh {
            uvs: vec![Point2::origin(); 8],
            colors: vec![[255; 3]; 8],
            material_of: vec![0; triangles.len()],
            instance_of: vec![InstanceId::NONE; triangles.len()],
            positions,
            triangles,
        }
    }

    fn settled(size: [f32; 3], options: Options, convention: Convention) -> (Frame, Vec<String>) {
        let mut report = Report::default();
        (Frame::of(&box_of(size), &options, convention, &mut report), report.warnings)
    }

    #[test]
    fn a_flat_house_on_its_side_is_turned_only_where_the_format_leaves_it_open() {
        let (frame, warnings) = settled([10.0, 9.0, 3.0], Options::default(), Convention::Usual(Up::Y));
        assert_eq!(frame.point([1.0, 2.0, 3.0]), Point3::new(1.0, 3.0, -2.0));
        assert!(warnings[0].contains("--up y"), "{warnings:?}");
        let (frame, warnings) = settled([10.0, 9.0, 3.0], Options::default(), Convention::Fixed(Up::Y));
        assert_eq!(frame.point([1.0, 2.0, 3.0]), Point3::new(1.0, 2.0, 3.0));
        assert!(warnings[0].contains("--up z"), "{warnings:?}");
        let (_, warnings) = settled([10.0, 3.0, 9.0], Options::default(), Convention::Usual(Up::Y));
        assert!(warnings.is_empty());
    }

    #[test]
    fn what_the_caller_says_wins() {
        let options = Options { up: Some(Up::Z), unit: Some(Unit::Centimetre) };
        let (frame, warnings) = settled([1000.0, 900.0, 300.0], options, Convention::Fixed(Up::Y));
        assert!(warnings.is_empty());
        assert!((frame.point([100.0, 200.0, 300.0]) - Point3::new(1.0, 3.0, -2.0)).norm() < 1e-6);
        let bounds = frame.bounds([0.0, 0.0, 0.0], [100.0, 200.0, 300.0]);
        assert!((bounds.min - Point3::new(0.0, 0.0, -2.0)).norm() < 1e-6, "{bounds:?}");
    }

    #[test]
    fn sizes_that_no_building_has_name_the_unit_that_would_fit() {
        let error = |size| check_size(&box_of(size), &mut Report::default()).unwrap_err();
        assert!(error([556.0, 549.0, 559.0]).contains("--units cm"), "{}", error([556.0, 549.0, 559.0]));
        assert!(error([12_000.0, 3_000.0, 9_000.0]).contains("--units cm or --units mm"));
        assert!(error([1.0e6, 1.0e6, 1.0e6]).contains("3D editor"));
        assert!(error([0.1, 0.1, 0.1]).contains("3D editor"));
        let mut report = Report::default();
        check_size(&box_of([250.0, 90.0, 200.0]), &mut report).unwrap();
        assert!(report.warnings[0].contains("90 m high"), "{report:?}");
    }
}
