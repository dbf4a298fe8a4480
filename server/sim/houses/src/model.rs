//! Furniture shapes in the furniture's own frame: base at y = 0, front towards +z.

use super::paint::Paint;
use super::rect::turned;
use avln_geom::{Aabb, Point2, Point3, Vector3, angle};
use avln_scene::Lamp;

mod shapes;

#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub(super) position: Point3<f32>,
    pub(super) normal: Vector3<f32>,
    pub(super) uv: Point2<f32>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Model {
    pub(super) corners: Vec<Corner>,
    pub(super) triangles: Vec<([u32; 3], Paint)>,
    /// Solid boxes; faces inside are invisible.
    solids: Vec<Aabb>,
    pub(super) lamps: Vec<Lamp>,
}

/// A range on an axis, metres.
pub(super) type Span = [f32; 2];

/// Returns the range with `length` around `center`.
pub(super) fn about(center: f32, length: f32) -> Span {
    [center - length / 2.0, center + length / 2.0]
}

impl Model {
    pub(super) fn new() -> Self {
        Self::default()
    }

    /// Returns the box around all corners.
    ///
    /// # Panics
    /// If the model is empty.
    pub(super) fn bounds(&self) -> Aabb {
        Aabb::around(self.corners.iter().map(|corner| &corner.position)).expect("the model has corners")
    }

    /// Adds a box with sharp edges.
    pub(super) fn block(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        self.slab(x, y, z, paint);
        let p = |i: usize, k: usize| Point3::new(x[i], y[0], z[k]);
        self.quad([p(0, 0), p(1, 0), p(1, 1), p(0, 1)], paint);
    }

    fn solid(&mut self, x: Span, y: Span, z: Span) {
        let corner = |end: usize| Point3::new(x[end], y[end], z[end]);
        self.solids.push(Aabb::new(corner(0), corner(1)));
    }

    /// Adds the box and a mirror image in -x.
    pub(super) fn pair(&mut self, x: Span, y: Span, z: Span, paint: Paint) {
        self.block(x, y, z, paint);
        self.block([-x[1], -x[0]], y, z, paint);
    }

    /// Adds a flat face with corners counter-clockwise from the visible side.
    pub(super) fn quad(&mut self, points: [Point3<f32>; 4], paint: Paint) {
        let normal = (points[1] - points[0]).cross(&(points[3] - points[0]));
        let normal = normal.try_normalize(1e-12).unwrap_or_else(Vector3::y);
        let corner =
            |point: &Point3<f32>| Corner { position: *point, normal, uv: flat_uv(point, &normal, paint) };
        let corners = points.each_ref().map(corner);
        self.face(corners, paint);
    }

    /// Adds a flat face with a stretched picture, first corner at the bottom left.
    pub(super) fn picture(&mut self, points: [Point3<f32>; 4], paint: Paint) {
        let normal = (points[1] - points[0]).cross(&(points[3] - points[0])).normalize();
        let uvs = [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)];
        let corner = |i: usize| Corner { position: points[i], normal, uv: Point2::new(uvs[i].0, uvs[i].1) };
        self.face([corner(0), corner(1), corner(2), corner(3)], paint);
    }

    /// Adds a face with explicit corners.
    pub(super) fn face(&mut self, corners: [Corner; 4], paint: Paint) {
        let first = self.corners.len() as u32;
        self.corners.extend(corners);
        self.triangles.push(([first, first + 1, first + 2], paint));
        self.triangles.push(([first, first + 2, first + 3], paint));
    }

    /// Adds `other` after `quarter` quarter turns about +Y and a move by `offset`.
    pub(super) fn add(&mut self, other: &Model, quarter: u8, offset: Vector3<f32>) {
        let first = self.corners.len() as u32;
        let moved = other.moved(quarter, offset);
        self.corners.extend(moved.corners);
        self.solids.extend(moved.solids);
        self.lamps.extend(moved.lamps);
        let triangles = moved.triangles.iter();
        self.triangles
            .extend(triangles.map(|&(corners, paint)| (corners.map(|corner| corner + first), paint)));
    }

    /// Returns the model after `quarter` quarter turns about +Y and a move by `offset`.
    pub(super) fn moved(&self, quarter: u8, offset: Vector3<f32>) -> Model {
        let turn = |v: Vector3<f32>| {
            let [x, z] = turned(quarter, [v.x, v.z]);
            Vector3::new(x, v.y, z)
        };
        let corner = |c: &Corner| Corner {
            position: Point3::from(turn(c.position.coords) + offset),
            normal: turn(c.normal),
            uv: c.uv,
        };
        let place = |point: &Point3<f32>| Point3::from(turn(point.coords) + offset);
        let solid = |solid: &Aabb| {
            let (a, b) = (place(&solid.min), place(&solid.max));
            Aabb::new(a.inf(&b), a.sup(&b))
        };
        let lamp =
            |lamp: &Lamp| Lamp { position: place(&lamp.position), facing: lamp.facing.map(turn), ..*lamp };
        Model {
            corners: self.corners.iter().map(corner).collect(),
            triangles: self.triangles.clone(),
            solids: self.solids.iter().map(solid).collect(),
            lamps: self.lamps.iter().map(lamp).collect(),
        }
    }

    /// Returns the model tilted back by 70 degrees onto the front edge.
    pub(super) fn leaning(&self) -> Model {
        let (sin, cos) = angle::sin_cos(1.22);
        let lean = |v: Vector3<f32>| Vector3::new(v.x, v.y * cos - v.z * sin, v.y * sin + v.z * cos);
        let corner = |c: &Corner| Corner {
            position: Point3::from(lean(c.position.coords)),
            normal: lean(c.normal),
            uv: c.uv,
        };
        Model {
            corners: self.corners.iter().map(corner).collect(),
            triangles: self.triangles.clone(),
            solids: vec![],
            lamps: vec![],
        }
    }
}

/// Texture coordinates on a flat face: metres on the face axes, in tiles.
pub(super) fn flat_uv(point: &Point3<f32>, normal: &Vector3<f32>, paint: Paint) -> Point2<f32> {
    let tile_m = paint.pattern.and_then(|pattern| pattern.tile_m()).unwrap_or(1.0);
    let size = normal.abs();
    let (u, v) = if size.y >= size.x && size.y >= size.z {
        (point.x, point.z)
    } else if size.x >= size.z {
        (point.z, -point.y)
    } else {
        (point.x, -point.y)
    };
    Point2::new(u / tile_m, v / tile_m)
}

/// Solid distance in front of a hidden face, metres.
const BEFORE_M: f32 = 0.002;

impl Model {
    /// Returns the model without faces inside solid boxes.
    pub(crate) fn seen(&self) -> Model {
        // Invisible faces cost rendering time, and scans of real furniture have none.
        let boxes: Vec<Aabb> = self.solids.iter().map(|solid| solid.grown(1e-4)).collect();
        self.without(|face| {
            let before = face.moved(BEFORE_M);
            boxes.iter().any(|solid| before.iter().all(|point| solid.contains(point)))
        })
    }

    /// Returns the model without `hidden` triangles.
    pub(crate) fn without(&self, hidden: impl Fn(&Facet) -> bool) -> Model {
        let mut model = Model { solids: self.solids.clone(), lamps: self.lamps.clone(), ..Model::default() };
        let mut moved: Vec<Option<u32>> = vec![None; self.corners.len()];
        for &(corners, paint) in &self.triangles {
            let points = corners.map(|corner| self.corners[corner as usize].position);
            if Facet::of(points).is_some_and(|facet| !hidden(&facet)) {
                let kept = corners.map(|corner| {
                    *moved[corner as usize].get_or_insert_with(|| push(&mut model.corners, self, corner))
                });
                model.triangles.push((kept, paint));
            }
        }
        model
    }
}

pub(crate) struct Facet {
    points: [Point3<f32>; 3],
    normal: Vector3<f32>,
}

impl Facet {
    /// `None` for a triangle without area.
    fn of(points: [Point3<f32>; 3]) -> Option<Self> {
        let [a, b, c] = points;
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-12)?;
        Some(Self { points, normal })
    }

    /// Returns the corners after a move by `distance_m` towards the visible side.
    pub(crate) fn moved(&self, distance_m: f32) -> [Point3<f32>; 3] {
        self.points.map(|point| point + self.normal * distance_m)
    }

    /// Returns true if the face points straight down below `height_m`.
    pub(crate) fn is_underside(&self, height_m: f32) -> bool {
        self.normal.y < -0.99 && self.points.iter().all(|point| point.y < height_m)
    }
}

fn push(corners: &mut Vec<Corner>, from: &Model, corner: u32) -> u32 {
    corners.push(from.corners[corner as usize]);
    corners.len() as u32 - 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::paint::Paint;
    use std::f32::consts::{FRAC_PI_2, PI, TAU};

    const PAINT: Paint = Paint::CHROME;

    /// Enclosed volume; negative if the triangles face inwards.
    fn volume_m3(model: &Model) -> f32 {
        let corner = |index: u32| model.corners[index as usize].position.coords;
        let wedge = |&([a, b, c], _): &([u32; 3], Paint)| corner(a).dot(&corner(b).cross(&corner(c))) / 6.0;
        model.triangles.iter().map(wedge).sum()
    }

    /// Checks the volume, outward faces and normals of a convex shape.
    fn check(name: &str, draw: impl Fn(&mut Model), expected_m3: f32, tolerance_m3: f32) {
        let mut model = Model::new();
        draw(&mut model);
        let (volume, middle) = (volume_m3(&model), model.bounds().center());
        assert!((volume - expected_m3).abs() < tolerance_m3, "{name}: {volume} instead of {expected_m3}");
        for ([a, b, c], _) in &model.triangles {
            let [a, b, c] = [a, b, c].map(|&index| model.corners[index as usize]);
            let facing = (b.position - a.position).cross(&(c.position - a.position));
            let outwards = (a.position - middle) + (b.position - middle) + (c.position - middle);
            assert!(facing.dot(&outwards) >= -1e-6, "{name}: a face looks inwards");
            assert!(facing.dot(&(a.normal + b.normal + c.normal)) >= -1e-6, "{name}: a normal looks inwards");
        }
    }

    #[test]
    fn shapes_are_closed_and_face_outwards() {
        let (x, y, z) = ([-1.0, 1.0], [0.5, 1.0], [2.0, 5.0]);
        check("block", |m| m.block(x, y, z, PAINT), 3.0, 1e-4);
        check("soft", |m| m.soft(x, y, z, 0.05, PAINT), 3.0, 0.05);
        check("cylinder", |m| m.cylinder([1.0, 2.0], [1.0, 3.0], 0.5, 64, PAINT), FRAC_PI_2, 0.01);
        check("cone", |m| m.lathe([0.0, 0.0], &[[1.0, 0.0], [0.0, 3.0]], 64, PAINT), PI, 0.02);
        check("oval", |m| m.oval([0.0, 0.0], [2.0, 1.0], &[[1.0, 0.0], [1.0, 1.0]], 64, PAINT), TAU, 0.02);
        // On every axis the mean height over five cells is 0.7729 times the full height.
        check("pillow", |m| m.pillow(x, y, z, PAINT), 3.0 * 0.7729 * 0.7729, 0.02);
        let square = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        check("prism along z", |m| m.prism_z(&square, [0.0, 3.0], PAINT), 12.0, 1e-4);
        check("prism along y", |m| m.prism_y(&square, [0.0, 3.0], PAINT), 12.0, 1e-4);
        check("prism along x", |m| m.prism_x(&square, [0.0, 3.0], PAINT), 12.0, 1e-4);
    }

    #[test]
    fn quarter_turn_moves_front_to_plus_x() {
        let mut model = Model::new();
        model.block([-1.0, 1.0], [0.0, 1.0], [0.0, 3.0], PAINT);
        let bounds = model.moved(1, Vector3::new(10.0, 0.0, 0.0)).bounds();
        assert_eq!((bounds.min, bounds.max), (Point3::new(10.0, 0.0, -1.0), Point3::new(13.0, 1.0, 1.0)));
        let turned = model.moved(3, Vector3::zeros());
        assert!(volume_m3(&turned) > 0.0);
    }

    #[test]
    fn only_faces_inside_boxes_are_removed() {
        let mut model = Model::new();
        model.block([-1.0, 1.0], [1.0, 1.1], [-1.0, 1.0], Paint::CHROME);
        model.block([0.0, 0.1], [0.0, 1.0], [0.0, 0.1], Paint::CHROME);
        let seen = model.seen();
        assert_eq!((model.triangles.len(), seen.triangles.len()), (24, 22), "the top of the leg");
        assert_eq!(seen.bounds(), model.bounds());
        let turned = model.moved(1, Vector3::new(3.0, 0.0, 0.0)).seen();
        assert_eq!(turned.triangles.len(), 22);
    }
}
