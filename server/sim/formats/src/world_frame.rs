//! Axes and units of files, and their transform to the world frame: Y up, metres.

use crate::files::{Checked, ImportReport, refuse_if};
use avln_geom::{Aabb, Point3, Vector3};
use avln_scene::Mesh;
use avln_scene::limits::{MAX_SCENE_SIDE_M, MIN_SCENE_SIDE_M};

/// A file's vertical axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpAxis {
    /// Y, as in glTF.
    Y = 1,
    /// Z, as in Matterport, Replica and Gibson scans.
    Z = 2,
}

/// A file's unit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LengthUnit {
    /// 1 m.
    Metre,
    /// 0.01 m.
    Centimetre,
    /// 0.001 m.
    Millimetre,
}

/// Axis and unit set by the caller; `None` leaves the choice to the importer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ImportOptions {
    /// The vertical axis.
    pub up: Option<UpAxis>,
    /// The unit.
    pub unit: Option<LengthUnit>,
}

impl LengthUnit {
    /// Returns the length in metres.
    pub fn metres(self) -> f32 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 0.01,
            Self::Millimetre => 0.001,
        }
    }
}

impl UpAxis {
    pub(crate) fn index(self) -> usize {
        self as usize
    }

    pub(crate) fn other(self) -> Self {
        match self {
            Self::Y => Self::Z,
            Self::Z => Self::Y,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Y => "y",
            Self::Z => "z",
        }
    }
}

/// An extent is clearly smaller than another below this ratio.
const CLEARLY_SMALLER: f32 = 0.6;
/// Building height that causes a warning, metres.
const TALLEST_M: f32 = 30.0;

/// Certainty about a layout's vertical axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UpConvention {
    /// Required by the format: contrary evidence causes a warning only.
    Fixed(UpAxis),
    /// Customary: clear evidence for the other axis wins, with a warning.
    Usual(UpAxis),
}

/// The transform from a file's coordinates to the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FileFrame {
    pub(crate) up: UpAxis,
    pub(crate) metres: f32,
}

impl FileFrame {
    /// Moves `mesh` to the world frame, with the transform of [`FileFrame::of`].
    pub(crate) fn applied(
        mesh: &mut Mesh,
        options: &ImportOptions,
        convention: UpConvention,
        report: &mut ImportReport,
    ) -> Self {
        let frame = Self::of(mesh, options, convention, report);
        frame.apply(mesh);
        frame
    }

    pub(crate) fn of(
        mesh: &Mesh,
        options: &ImportOptions,
        convention: UpConvention,
        report: &mut ImportReport,
    ) -> Self {
        let (UpConvention::Fixed(usual) | UpConvention::Usual(usual)) = convention;
        let metres = options.unit.unwrap_or(LengthUnit::Metre).metres();
        if let Some(up) = options.up {
            return Self { up, metres };
        }
        let (other, seems_turned) = (usual.other(), lies_on_its_side(mesh, usual));
        let up = match convention {
            UpConvention::Usual(_) if seems_turned => {
                report.warn(format!(
                    "its {other} axis is taken for up, by its extent and its level surfaces; if that is wrong, use --up {}",
                    usual.name(), other = other.name()
                ));
                other
            }
            UpConvention::Fixed(_) if seems_turned => {
                report.warn(format!(
                    "its {} axis is taken for up, as the format requires, but the building seems to lie on its side; if so, use --up {}",
                    usual.name(), other.name()
                ));
                usual
            }
            _ => usual,
        };
        Self { up, metres }
    }

    /// Converts a point to the world frame: for Z up, (x, y, z) becomes (x, z, -y).
    pub(crate) fn point(&self, [x, y, z]: [f32; 3]) -> Point3<f32> {
        let turned = match self.up {
            UpAxis::Y => Point3::new(x, y, z),
            UpAxis::Z => Point3::new(x, z, -y),
        };
        turned * self.metres
    }

    pub(crate) fn bounds(&self, a: [f32; 3], b: [f32; 3]) -> Aabb {
        let (a, b) = (self.point(a), self.point(b));
        Aabb::new(a.inf(&b), a.sup(&b))
    }

    pub(crate) fn apply(&self, mesh: &mut Mesh) {
        mesh.positions.iter_mut().for_each(|position| *position = self.point((*position).into()));
    }
}

/// True if the building would be much higher than wide, while the other axis is short and has more level surfaces.
fn lies_on_its_side(mesh: &Mesh, up: UpAxis) -> bool {
    let Some(bounds) = Aabb::around(&mesh.positions) else { return false };
    let size = bounds.size();
    let (height, other) = (size[up.index()], size[up.other().index()]);
    // Extent is not enough: a tower is higher than wide. Floors and ceilings decide.
    other < CLEARLY_SMALLER * height && other < CLEARLY_SMALLER * size.x && {
        let area = area_by_axis(mesh);
        area[up.other().index()] > area[up.index()]
    }
}

/// Projected surface area per axis, in squared file units.
fn area_by_axis(mesh: &Mesh) -> [f32; 3] {
    let mut area = Vector3::zeros();
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        area += (b - a).cross(&(c - a)).abs() / 2.0;
    }
    area.into()
}

/// Refuses a building with an impossible size in metres, and warns about a suspiciously high one.
pub(crate) fn check_size(mesh: &Mesh, report: &mut ImportReport) -> Checked<()> {
    let bounds = Aabb::around(&mesh.positions).ok_or("it has no triangles; export the meshes with it")?;
    let size = bounds.size();
    let longest = size.max();
    refuse_if(!(MIN_SCENE_SIDE_M..=MAX_SCENE_SIDE_M).contains(&longest), || {
        let ([x, y, z], advice): ([f32; 3], String) = (size.into(), advice(longest));
        format!(
            "it measures {x} x {y} x {z} m, a building is {MIN_SCENE_SIDE_M} to {MAX_SCENE_SIDE_M} m long; {advice}"
        )
    })?;
    if size.y > TALLEST_M {
        report.warn(format!(
            "it is {} m high; if its unit is not the metre, use --units cm or --units mm, if another axis points up, use --up",
            size.y
        ));
    }
    Ok(())
}

fn advice(longest_m: f32) -> String {
    let units = [(LengthUnit::Centimetre, "--units cm"), (LengthUnit::Millimetre, "--units mm")];
    let fits =
        |unit: LengthUnit| (MIN_SCENE_SIDE_M..=MAX_SCENE_SIDE_M).contains(&(longest_m * unit.metres()));
    let options: Vec<&str> =
        units.into_iter().filter(|(unit, _)| fits(*unit)).map(|(_, option)| option).collect();
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

    /// A box, in the file's axes.
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

    fn settled(size: [f32; 3], options: ImportOptions, convention: UpConvention) -> (FileFrame, Vec<String>) {
        let mut report = ImportReport::default();
        (FileFrame::of(&box_of(size), &options, convention, &mut report), report.warnings)
    }

    #[test]
    fn house_on_its_side_is_turned_unless_fixed() {
        let (frame, warnings) =
            settled([10.0, 9.0, 3.0], ImportOptions::default(), UpConvention::Usual(UpAxis::Y));
        assert_eq!(frame.point([1.0, 2.0, 3.0]), Point3::new(1.0, 3.0, -2.0));
        assert!(warnings[0].contains("--up y"), "{warnings:?}");
        let (frame, warnings) =
            settled([10.0, 9.0, 3.0], ImportOptions::default(), UpConvention::Fixed(UpAxis::Y));
        assert_eq!(frame.point([1.0, 2.0, 3.0]), Point3::new(1.0, 2.0, 3.0));
        assert!(warnings[0].contains("--up z"), "{warnings:?}");
        let (_, warnings) =
            settled([10.0, 3.0, 9.0], ImportOptions::default(), UpConvention::Usual(UpAxis::Y));
        assert!(warnings.is_empty());
    }

    #[test]
    fn options_of_the_caller_win() {
        let options = ImportOptions { up: Some(UpAxis::Z), unit: Some(LengthUnit::Centimetre) };
        let (frame, warnings) = settled([1000.0, 900.0, 300.0], options, UpConvention::Fixed(UpAxis::Y));
        assert!(warnings.is_empty());
        assert!((frame.point([100.0, 200.0, 300.0]) - Point3::new(1.0, 3.0, -2.0)).norm() < 1e-6);
        let bounds = frame.bounds([0.0, 0.0, 0.0], [100.0, 200.0, 300.0]);
        assert!((bounds.min - Point3::new(0.0, 0.0, -2.0)).norm() < 1e-6, "{bounds:?}");
    }

    #[test]
    fn impossible_sizes_suggest_a_unit() {
        let error = |size| check_size(&box_of(size), &mut ImportReport::default()).unwrap_err();
        assert!(error([556.0, 549.0, 559.0]).contains("--units cm"), "{}", error([556.0, 549.0, 559.0]));
        assert!(error([12_000.0, 3_000.0, 9_000.0]).contains("--units cm or --units mm"));
        assert!(error([1.0e6, 1.0e6, 1.0e6]).contains("3D editor"));
        assert!(error([0.1, 0.1, 0.1]).contains("3D editor"));
        let mut report = ImportReport::default();
        check_size(&box_of([250.0, 90.0, 200.0]), &mut report).unwrap();
        assert!(report.warnings[0].contains("90 m high"), "{report:?}");
    }
}
