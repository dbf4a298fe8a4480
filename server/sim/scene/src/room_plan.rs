//! Empty test rooms: a floor plan with straight walls, and a height.

use crate::polygon;
use crate::{InstanceId, Lighting, Material, Mesh, Region, Scene};
use avln_geom::{Aabb, Point2, Point3};
use std::ops::RangeInclusive;

/// Corner count; a curve needs no more.
const CORNERS: RangeInclusive<usize> = 3..=512;

/// Room length in an axis direction, metres.
const SIDES_M: RangeInclusive<f32> = 0.1..=200.0;

/// Greatest corner coordinate, metres.
const REACH_M: f32 = 1000.0;

/// Greatest distance between a corner on a straight wall and the line between the neighbours, metres.
const STRAIGHT_M: f64 = 1e-4;

/// A room with vertical walls on a floor plan; the floor is at y = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct RoomPlan {
    /// Corners (x, z), metres, without corners on straight walls; this order turns the floor's normal up.
    corners: Vec<[f32; 2]>,
    height_m: f32,
}

/// An invalid room plan.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RoomPlanError {
    /// Too few or too many corners.
    #[error("a plan of {0} corners: write {least} to {most}", least = CORNERS.start(), most = CORNERS.end())]
    Corners(usize),
    /// A corner without usable coordinates.
    #[error("corner {0} is at {1}, {2}: write metres within {REACH_M} of the origin")]
    Coordinates(usize, f32, f32),
    /// Too short or too long in an axis direction.
    #[error("the room measures {1} m in {0}: write {least} to {most} m", least = SIDES_M.start(), most = SIDES_M.end())]
    Size(char, f32),
    /// Two walls that cross, or touch without a common corner.
    #[error(
        "the walls from corner {0} and from corner {1} meet: write the corners once around the room, in order"
    )]
    Crossing(usize, usize),
}

impl RoomPlan {
    /// Creates a room from corners (x, z), metres, in order around the room in either direction.
    ///
    /// # Errors
    /// If there are fewer than 3 or more than 512 corners, a side is below 0.1 m or above 200 m, a number is not finite, or
    /// walls cross or touch.
    pub fn new(corners: &[[f32; 2]], height_m: f32) -> Result<Self, RoomPlanError> {
        if !CORNERS.contains(&corners.len()) {
            return Err(RoomPlanError::Corners(corners.len()));
        }
        let off = |[x, z]: [f32; 2]| !(x.abs() <= REACH_M && z.abs() <= REACH_M);
        if let Some(index) = corners.iter().position(|&corner| off(corner)) {
            return Err(RoomPlanError::Coordinates(index, corners[index][0], corners[index][1]));
        }
        let sides_m = [('x', span(corners, 0)), ('z', span(corners, 1)), ('y', height_m)];
        if let Some((axis, side_m)) = sides_m.into_iter().find(|(_, side_m)| !SIDES_M.contains(side_m)) {
            return Err(RoomPlanError::Size(axis, side_m));
        }
        check_walls(corners)?;
        let mut corners = without_straight_corners(corners);
        if doubled_area(&corners) > 0.0 {
            corners.reverse();
        }
        Ok(Self { corners, height_m })
    }

    /// Creates a box with a corner at the origin, metres in x, z and y.
    ///
    /// # Errors
    /// If a side is below 0.1 m or above 200 m.
    pub fn shoebox(x_m: f32, z_m: f32, height_m: f32) -> Result<Self, RoomPlanError> {
        Self::new(&[[0.0, 0.0], [0.0, z_m], [x_m, z_m], [x_m, 0.0]], height_m)
    }

    /// Returns whether `point`, metres, is inside.
    pub fn contains(&self, point: &Point3<f32>) -> bool {
        let passed = walls(&self.corners).filter(|(a, b)| {
            let crosses = (a[1] > point.z) != (b[1] > point.z);
            crosses && point.x < a[0] + (point.z - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        });
        0.0 < point.y && point.y < self.height_m && passed.count() % 2 == 1
    }

    /// Returns the air volume, cubic metres.
    pub fn volume_m3(&self) -> f32 {
        (doubled_area(&self.corners).abs() / 2.0) as f32 * self.height_m
    }

    /// Returns the room as a scene. Surfaces face inwards; materials are 0 for walls, 1 for the floor, 2 for the ceiling.
    pub fn scene(&self) -> Scene {
        let mesh = self.mesh();
        let bounds = Aabb::around(&mesh.positions);
        let regions = bounds.map(|bounds| Region { label: String::new(), bounds, storey: 0 });
        let material = |name: &str| Material {
            name: name.to_owned(),
            base_color: [255; 4],
            texture: None,
            alpha_cutoff: None,
        };
        Scene {
            name: "test-room".to_owned(),
            mesh,
            materials: ["wall", "floor", "ceiling"].map(material).to_vec(),
            textures: Vec::new(),
            regions: regions.into_iter().collect(),
            objects: Vec::new(),
            lighting: Lighting::Painted,
        }
    }

    fn mesh(&self) -> Mesh {
        let count = self.corners.len() as u32;
        let ring = |y: f32| self.corners.iter().map(move |&[x, z]| Point3::new(x, y, z));
        let positions: Vec<_> = ring(0.0).chain(ring(self.height_m)).collect();
        let mut triangles = Vec::new();
        let mut material_of = Vec::new();
        for low in 0..count {
            let next = (low + 1) % count;
            triangles.extend([[low, low + count, next + count], [low, next + count, next]]);
        }
        material_of.resize(triangles.len(), 0);
        let ceiling = (count..2 * count).rev().collect::<Vec<_>>();
        for (material, corners) in [(1, (0..count).collect::<Vec<_>>()), (2, ceiling)] {
            polygon::triangulate(&positions, &corners, &mut triangles);
            material_of.resize(triangles.len(), material);
        }
        Mesh {
            uvs: vec![Point2::origin(); positions.len()],
            colors: vec![[255; 3]; positions.len()],
            instance_of: vec![InstanceId::NONE; triangles.len()],
            positions,
            triangles,
            material_of,
        }
    }
}

fn span(corners: &[[f32; 2]], axis: usize) -> f32 {
    let along = || corners.iter().map(|corner| corner[axis]);
    along().fold(f32::MIN, f32::max) - along().fold(f32::MAX, f32::min)
}

/// Walls, as corner pairs.
fn walls(corners: &[[f32; 2]]) -> impl Iterator<Item = ([f32; 2], [f32; 2])> + '_ {
    corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| (*a, *b))
}

/// Twice the triangle's signed area; positive if it turns from x to z.
fn turn(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> f64 {
    let [abx, abz, acx, acz] = [b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]].map(f64::from);
    abx * acz - abz * acx
}

fn doubled_area(corners: &[[f32; 2]]) -> f64 {
    walls(corners).map(|(a, b)| turn(corners[0], a, b)).sum()
}

fn check_walls(corners: &[[f32; 2]]) -> Result<(), RoomPlanError> {
    let walls: Vec<_> = walls(corners).collect();
    for (first, one) in walls.iter().enumerate() {
        for (second, other) in walls.iter().enumerate().skip(first + 1) {
            let touch = match (second - first, walls.len() - second + first) {
                (1, _) => folds_back(one.0, one.1, other.1),
                (_, 1) => folds_back(other.0, other.1, one.1),
                _ => meet(*one, *other),
            };
            if touch {
                return Err(RoomPlanError::Crossing(first, second));
            }
        }
    }
    Ok(())
}

/// Returns whether the wall after `b` runs back over the wall before it, or either has no length.
fn folds_back(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> bool {
    let [abx, abz, bcx, bcz] = [b[0] - a[0], b[1] - a[1], c[0] - b[0], c[1] - b[1]].map(f64::from);
    turn(a, b, c) == 0.0 && abx * bcx + abz * bcz <= 0.0
}

/// Returns whether two walls without a common corner touch.
fn meet((a, b): ([f32; 2], [f32; 2]), (c, d): ([f32; 2], [f32; 2])) -> bool {
    let sides = [turn(a, b, c), turn(a, b, d), turn(c, d, a), turn(c, d, b)];
    let apart = |one: f64, other: f64| one * other > 0.0;
    let boxes_meet = (0..2).all(|axis| {
        a[axis].min(b[axis]) <= c[axis].max(d[axis]) && c[axis].min(d[axis]) <= a[axis].max(b[axis])
    });
    boxes_meet && !apart(sides[0], sides[1]) && !apart(sides[2], sides[3])
}

fn without_straight_corners(corners: &[[f32; 2]]) -> Vec<[f32; 2]> {
    let mut kept = corners.to_vec();
    let mut index = 0;
    while index < kept.len() && kept.len() > 3 {
        let (before, after) = ((index + kept.len() - 1) % kept.len(), (index + 1) % kept.len());
        let (a, b, c) = (kept[before], kept[index], kept[after]);
        let base = [0, 1].map(|axis| f64::from(c[axis] - a[axis]));
        // Not hypot: its bits depend on the platform.
        let base_m = (base[0] * base[0] + base[1] * base[1]).sqrt();
        if turn(a, b, c).abs() <= STRAIGHT_M * base_m {
            kept.remove(index);
        } else {
            index += 1;
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{RayMesh, Vector3};

    const L: [[f32; 2]; 6] = [[0.0, 0.0], [6.0, 0.0], [6.0, 2.0], [2.0, 2.0], [2.0, 5.0], [0.0, 5.0]];

    /// Area and volume of a closed surface with inward normals.
    fn area_and_volume(scene: &Scene) -> (f32, f32) {
        let parts = (0..scene.mesh.triangles.len()).map(|triangle| {
            let [a, b, c] = scene.corners(triangle);
            let normal = (b - a).cross(&(c - a));
            (normal.norm() / 2.0, -normal.dot(&a.coords) / 6.0)
        });
        parts.fold((0.0, 0.0), |sum, part| (sum.0 + part.0, sum.1 + part.1))
    }

    #[test]
    fn shoebox_is_closed_and_starts_at_origin() {
        let room = RoomPlan::shoebox(6.0, 5.0, 3.0).expect("a room");
        let scene = room.scene();
        let bounds = scene.bounds().expect("surfaces");
        assert_eq!((bounds.min, bounds.max), (Point3::origin(), Point3::new(6.0, 3.0, 5.0)));
        assert_eq!((scene.mesh.triangles.len(), area_and_volume(&scene)), (12, (126.0, 90.0)));
        assert!((room.volume_m3() - 90.0).abs() < 1e-4);
    }

    #[test]
    fn winding_and_extra_corners_change_no_room() {
        let room = RoomPlan::new(&L, 2.5).expect("a room");
        let (area, volume) = area_and_volume(&room.scene());
        assert!((area - (2.0 * 18.0 + 22.0 * 2.5)).abs() < 1e-3, "{area}");
        assert!((volume - 45.0).abs() < 1e-3 && (room.volume_m3() - 45.0).abs() < 1e-3, "{volume}");
        let reversed: Vec<_> = L.iter().rev().copied().collect();
        let mut with_more = L.to_vec();
        with_more.insert(1, [3.0, 0.0]);
        with_more.insert(6, [1.0, 5.0]);
        for corners in [reversed, with_more] {
            let other = RoomPlan::new(&corners, 2.5).expect("a room").scene();
            assert_eq!(other.mesh.triangles.len(), room.scene().mesh.triangles.len());
            assert!((area_and_volume(&other).1 - volume).abs() < 1e-3);
        }
    }

    #[test]
    fn surfaces_face_inwards() {
        let scene = RoomPlan::new(&L, 2.5).expect("a room").scene();
        let rays = RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles);
        for (x, y, z) in [(1.0, 0.2, 1.0), (0.3, 0.1, -0.9), (-0.7, -0.4, 0.2), (0.1, -1.0, 0.1)] {
            let direction = Vector3::new(x, y, z).normalize();
            let hit = rays.cast(&Point3::new(1.0, 1.0, 1.5), &direction, 100.0).expect("a wall");
            let [a, b, c] = scene.corners(hit.triangle as usize);
            assert!((b - a).cross(&(c - a)).dot(&direction) < 0.0, "{direction}");
        }
    }

    #[test]
    fn contains_separates_inside_from_outside() {
        let room = RoomPlan::new(&L, 2.5).expect("a room");
        for (point, inside) in [
            ([1.0, 1.0, 4.5], true),
            ([5.5, 2.4, 1.0], true),
            ([5.5, 1.0, 2.5], false),
            ([1.0, 2.6, 1.0], false),
            ([1.0, -0.1, 1.0], false),
            ([-0.1, 1.0, 1.0], false),
            ([f32::NAN, 1.0, 1.0], false),
        ] {
            assert_eq!(room.contains(&Point3::from(point)), inside, "{point:?}");
        }
    }

    #[test]
    fn curve_of_many_corners_preserves_volume() {
        let corner = |index: usize| {
            let (sin, cos) = avln_geom::angle::sin_cos(index as f32 / 300.0 * std::f32::consts::TAU);
            let radius_m = if index.is_multiple_of(2) { 4.0 } else { 3.0 };
            [radius_m * cos, radius_m * sin]
        };
        let room = RoomPlan::new(&(0..300).map(corner).collect::<Vec<_>>(), 3.0).expect("a star");
        let (_, volume) = area_and_volume(&room.scene());
        assert!((volume / room.volume_m3() - 1.0).abs() < 1e-4, "{volume}");
    }

    #[test]
    fn invalid_plans_are_refused_by_reason() {
        let crossed = [[0.0, 0.0], [4.0, 4.0], [4.0, 0.0], [0.0, 4.0]];
        assert_eq!(RoomPlan::new(&crossed, 2.0), Err(RoomPlanError::Crossing(0, 2)));
        let spike = [[0.0, 0.0], [4.0, 0.0], [2.0, 0.0], [2.0, 4.0]];
        assert_eq!(RoomPlan::new(&spike, 2.0), Err(RoomPlanError::Crossing(0, 1)));
        let touching = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 0.0], [0.0, 4.0]];
        assert!(matches!(RoomPlan::new(&touching, 2.0), Err(RoomPlanError::Crossing(0, _))));
        let twice = [[0.0, 0.0], [0.0, 0.0], [4.0, 0.0], [4.0, 4.0]];
        assert!(matches!(RoomPlan::new(&twice, 2.0), Err(RoomPlanError::Crossing(..))));
        assert_eq!(RoomPlan::new(&L[..2], 2.0), Err(RoomPlanError::Corners(2)));
        assert_eq!(RoomPlan::new(&[[0.0; 2]; 600], 2.0), Err(RoomPlanError::Corners(600)));
        assert_eq!(RoomPlan::new(&[[0.0; 2]; 3], 2.0), Err(RoomPlanError::Size('x', 0.0)));
        assert_eq!(RoomPlan::shoebox(3.0, 3.0, 1e3), Err(RoomPlanError::Size('y', 1e3)));
        let height = RoomPlan::shoebox(3.0, 3.0, f32::NAN);
        assert!(matches!(height, Err(RoomPlanError::Size('y', _))), "{height:?}");
        let infinite = RoomPlan::new(&[[0.0, 0.0], [f32::INFINITY, 0.0], [1.0, 1.0]], 2.0);
        assert_eq!(infinite, Err(RoomPlanError::Coordinates(1, f32::INFINITY, 0.0)));
        assert!(infinite.expect_err("no room").to_string().contains("within 1000 of the origin"));
    }
}
