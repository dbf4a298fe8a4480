//! Large planar building parts, which mirror sound: directions with large surface area, and the surface
//! offsets in them. Exact planes are found first, then the bumpy planes in scans.

use avln_geom::{Point3, Vector3};
use avln_scene::Scene;
use nalgebra::{Matrix3, SymmetricEigen};

/// Plane number in a building; the largest plane is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PlaneId(pub(crate) u16);

/// A building's planes, independent of the triangulation.
#[derive(Debug)]
pub(crate) struct Planes {
    planes: Vec<Plane>,
    /// Plane per triangle, [`NO_PLANE`] for small or curved parts.
    plane_of: Vec<u16>,
}

const NO_PLANE: u16 = u16::MAX;

/// All points with `normal` product `offset_m`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plane {
    /// Unit length, to either side.
    pub(crate) normal: Vector3<f32>,
    /// Signed distance from the origin, metres.
    pub(crate) offset_m: f32,
    /// Largest triangle distance from the plane, metres.
    pub(crate) slack_m: f32,
}

impl Plane {
    /// Signed distance, metres; positive on the normal's side.
    pub(crate) fn height_m(&self, point: &Point3<f32>) -> f32 {
        self.normal.dot(&point.coords) - self.offset_m
    }

    pub(crate) fn mirrored(&self, point: &Point3<f32>) -> Point3<f32> {
        point - self.normal * (2.0 * self.height_m(point))
    }

    pub(crate) fn reflected(&self, direction: &Vector3<f32>) -> Vector3<f32> {
        direction - self.normal * (2.0 * self.normal.dot(direction))
    }
}

impl Planes {
    pub(crate) fn new(scene: &Scene) -> Self {
        let mut fitter = Fitter::new(scene);
        fitter.search(&EXACT);
        fitter.search(&BUMPY);
        fitter.ranked()
    }

    /// Returns a triangle's plane; `None` for small or curved parts.
    pub(crate) fn of(&self, triangle: u32) -> Option<PlaneId> {
        let plane = self.plane_of[triangle as usize];
        (plane != NO_PLANE).then_some(PlaneId(plane))
    }

    pub(crate) fn plane(&self, id: PlaneId) -> &Plane {
        &self.planes[usize::from(id.0)]
    }

    pub(crate) fn len(&self) -> usize {
        self.planes.len()
    }

    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.planes.as_slice()) + size_of_val(self.plane_of.as_slice())
    }
}

struct Tolerance {
    cosine: f32,
    /// The angle in direction cells, rounded up.
    reach: i32,
    distance_m: f32,
    min_m2: f32,
}

/// Half a degree and 4 mm.
const EXACT: Tolerance = Tolerance { cosine: 0.999_96, reach: 1, distance_m: 0.004, min_m2: 0.25 };

/// Eighteen degrees and 4 cm: bumps of a few millimetres tilt small triangles.
const BUMPY: Tolerance = Tolerance { cosine: 0.951, reach: 11, distance_m: 0.04, min_m2: 0.5 };

/// Direction cells per half axis.
const HALF: i32 = 32;

/// A triangle with an area.
struct Facet {
    triangle: u32,
    cell: u32,
    normal: Vector3<f32>,
    area_m2: f32,
    center: Point3<f32>,
}

struct Fitter<'a> {
    scene: &'a Scene,
    tolerance: &'static Tolerance,
    /// Sorted by cell.
    facets: Vec<Facet>,
    /// First facet per direction cell, with a final sentinel.
    first_of: Vec<u32>,
    /// Plane per facet, in order of detection.
    taken_by: Vec<Option<u32>>,
    found: Vec<(f32, Plane)>,
}

fn facet(scene: &Scene, triangle: usize) -> Option<Facet> {
    let [a, b, c] = scene.corners(triangle);
    let cross = (b - a).cross(&(c - a));
    let length = cross.norm();
    let center = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let sound = length.is_finite() && length > 1e-12 && center.iter().all(|at| at.is_finite());
    let normal = cross / length;
    let cell = cell_of(&normal);
    let area_m2 = 0.5 * length;
    sound.then_some(Facet { triangle: triangle as u32, cell, normal, area_m2, center })
}

fn cell_of(normal: &Vector3<f32>) -> u32 {
    let place = |value: f32| (((value + 1.0) * HALF as f32) as i32).clamp(0, 2 * HALF - 1);
    index([place(normal.x), place(normal.y), place(normal.z)])
}

fn index([x, y, z]: [i32; 3]) -> u32 {
    ((z * 2 * HALF + y) * 2 * HALF + x) as u32
}

/// Cells within `reach` cells around `normal`.
fn cells_around(normal: &Vector3<f32>, reach: i32) -> impl Iterator<Item = u32> + use<> {
    let cell = cell_of(normal) as i32;
    let around = move |middle: i32| (middle - reach).max(0)..=(middle + reach).min(2 * HALF - 1);
    let (xs, ys, zs) = (cell % (2 * HALF), cell / (2 * HALF) % (2 * HALF), cell / (4 * HALF * HALF));
    let rows = around(zs).flat_map(move |z| around(ys).map(move |y| (y, z)));
    rows.flat_map(move |(y, z)| around(xs).map(move |x| index([x, y, z])))
}

impl<'a> Fitter<'a> {
    fn new(scene: &'a Scene) -> Self {
        let mut facets: Vec<_> = (0..scene.mesh.triangles.len()).filter_map(|t| facet(scene, t)).collect();
        facets.sort_unstable_by_key(|facet| (facet.cell, facet.triangle));
        let mut first_of = vec![0; (8 * HALF * HALF * HALF + 1) as usize];
        facets.iter().for_each(|facet| first_of[facet.cell as usize + 1] += 1);
        for cell in 1..first_of.len() {
            first_of[cell] += first_of[cell - 1];
        }
        Self {
            scene,
            tolerance: &EXACT,
            taken_by: vec![None; facets.len()],
            facets,
            first_of,
            found: Vec::new(),
        }
    }

    /// Examines every direction with enough free surface, largest first.
    fn search(&mut self, tolerance: &'static Tolerance) {
        self.tolerance = tolerance;
        let min_m2 = 0.25 * tolerance.min_m2;
        let cells = 0..self.first_of.len() as u32 - 1;
        let mut cells: Vec<_> = cells.map(|cell| (self.free_m2(cell), cell)).collect();
        cells.retain(|(area_m2, _)| *area_m2 >= min_m2);
        cells.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut searched = vec![false; self.first_of.len()];
        for (_, cell) in cells {
            while !searched[cell as usize] && self.free_m2(cell) >= min_m2 {
                let direction = self.direction(cell);
                searched[cell as usize] = !self.extract_planes(&direction);
                let sides = [direction, -direction];
                let near = sides.iter().flat_map(|side| cells_around(side, tolerance.reach / 2));
                near.for_each(|near| searched[near as usize] |= near != cell);
            }
        }
    }

    fn free(&self, cell: u32) -> impl Iterator<Item = usize> + '_ {
        let range = self.first_of[cell as usize]..self.first_of[cell as usize + 1];
        range.map(|facet| facet as usize).filter(|facet| self.taken_by[*facet].is_none())
    }

    fn free_m2(&self, cell: u32) -> f32 {
        self.free(cell).map(|facet| self.facets[facet].area_m2).sum()
    }

    /// Mean direction around the cell's largest free facet.
    fn direction(&self, cell: u32) -> Vector3<f32> {
        let larger = |a: &usize, b: &usize| self.facets[*a].area_m2.total_cmp(&self.facets[*b].area_m2);
        let Some(largest) = self.free(cell).max_by(larger) else { return Vector3::y() };
        let middle = self.facets[largest].normal;
        self.mean_normal(&self.facing(&middle), &middle)
    }

    /// Free facets that face `direction` or its opposite.
    fn facing(&self, direction: &Vector3<f32>) -> Vec<usize> {
        let sides = [*direction, -direction];
        let cells = sides.iter().flat_map(|side| cells_around(side, self.tolerance.reach));
        let near = cells.flat_map(|cell| self.free(cell));
        near.filter(|facet| self.facets[*facet].normal.dot(direction).abs() >= self.tolerance.cosine)
            .collect()
    }

    /// Mean normal by area, on the side of `direction`.
    fn mean_normal(&self, facets: &[usize], direction: &Vector3<f32>) -> Vector3<f32> {
        // The mean area vector of a bumpy wall is the outline's normal, because bumps cancel.
        let mut sum = Vector3::<f64>::zeros();
        for facet in facets.iter().map(|facet| &self.facets[*facet]) {
            let area_m2 = facet.area_m2.copysign(facet.normal.dot(direction));
            sum += (facet.normal * area_m2).cast::<f64>();
        }
        sum.try_normalize(0.0).map_or(*direction, |mean| mean.cast::<f32>())
    }

    /// Extracts the planes perpendicular to `direction`. Returns true if there were any.
    fn extract_planes(&mut self, direction: &Vector3<f32>) -> bool {
        let mut row: Vec<_> = self
            .facing(direction)
            .into_iter()
            .map(|facet| (self.facets[facet].center.coords.dot(direction), facet))
            .collect();
        row.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let layer = |at: f32| (at / self.tolerance.distance_m).floor();
        let mut layers: Vec<_> = row
            .chunk_by(|a, b| layer(a.0) == layer(b.0))
            .map(|layer| (layer.iter().map(|(_, facet)| self.facets[*facet].area_m2).sum::<f32>(), layer))
            .filter(|(area_m2, _)| *area_m2 >= 0.25 * self.tolerance.min_m2)
            .collect();
        layers.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1[0].0.total_cmp(&b.1[0].0)));
        let mut any = false;
        for (_, layer) in layers {
            any |= self.take_plane(&row, layer, direction);
        }
        any
    }

    /// Fits a plane to the free facets in `layer` and takes all matching facets in the row.
    fn take_plane(&mut self, row: &[(f32, usize)], layer: &[(f32, usize)], direction: &Vector3<f32>) -> bool {
        const WIDE: f32 = 8.0;
        let free = |part: &[(f32, usize)]| -> Vec<usize> {
            part.iter().map(|(_, facet)| *facet).filter(|facet| self.taken_by[*facet].is_none()).collect()
        };
        let first = self.estimated(&free(layer), direction);
        let low = layer[0].0 - WIDE * self.tolerance.distance_m;
        let high = layer[layer.len() - 1].0 + WIDE * self.tolerance.distance_m;
        let from = row.partition_point(|entry| entry.0 < low);
        let near = free(&row[from..row.partition_point(|entry| entry.0 <= high)]);
        let inside = |plane: &Plane| -> Vec<usize> {
            near.iter().copied().filter(|facet| self.lies_in(*facet, plane)).collect()
        };
        let plane = self.fitted(&inside(&first), &first.normal);
        let members = inside(&plane);
        let area_m2 = members.iter().map(|facet| self.facets[*facet].area_m2).sum::<f32>();
        if area_m2 < self.tolerance.min_m2 {
            return false;
        }
        let number = self.found.len() as u32;
        let slack_m = members.iter().map(|facet| self.distance_m(*facet, &plane)).fold(0.0, f32::max);
        members.iter().for_each(|facet| self.taken_by[*facet] = Some(number));
        self.found.push((area_m2, Plane { slack_m, ..plane }));
        true
    }

    /// Plane with the mean normal: a strip of a bumpy wall has no reliable least-squares normal.
    fn estimated(&self, facets: &[usize], direction: &Vector3<f32>) -> Plane {
        let normal = self.mean_normal(facets, direction);
        self.fit_of(facets).plane(normal)
    }

    /// Least-squares plane; with the mean normal for facets along a line.
    fn fitted(&self, facets: &[usize], direction: &Vector3<f32>) -> Plane {
        let fit = self.fit_of(facets);
        let corners = |facet: usize| self.scene.corners(self.facets[facet].triangle as usize);
        let triangles = facets.iter().map(|&facet| (self.facets[facet].area_m2, corners(facet)));
        let normal = fit.normal(triangles, direction);
        fit.plane(normal.unwrap_or_else(|| self.mean_normal(facets, direction)))
    }

    fn fit_of(&self, facets: &[usize]) -> PlaneFit {
        let facets = facets.iter().map(|facet| &self.facets[*facet]);
        PlaneFit::new(facets.map(|facet| (facet.area_m2, facet.center)))
    }

    fn lies_in(&self, facet: usize, plane: &Plane) -> bool {
        self.facets[facet].normal.dot(&plane.normal).abs() >= self.tolerance.cosine
            && self.distance_m(facet, plane) <= self.tolerance.distance_m
    }

    /// Largest corner distance from a plane, metres.
    fn distance_m(&self, facet: usize, plane: &Plane) -> f32 {
        let corners = self.scene.corners(self.facets[facet].triangle as usize);
        corners.iter().map(|corner| plane.height_m(corner).abs()).fold(0.0, f32::max)
    }

    /// Returns the planes by decreasing area.
    fn ranked(self) -> Planes {
        let mut order: Vec<_> = (0..self.found.len()).collect();
        order.sort_by(|a, b| self.found[*b].0.total_cmp(&self.found[*a].0).then(a.cmp(b)));
        order.truncate(usize::from(NO_PLANE));
        let mut rank_of = vec![NO_PLANE; self.found.len()];
        for (rank, number) in order.iter().enumerate() {
            rank_of[*number] = rank as u16;
        }
        let mut plane_of = vec![NO_PLANE; self.scene.mesh.triangles.len()];
        for (facet, taken_by) in self.facets.iter().zip(&self.taken_by) {
            plane_of[facet.triangle as usize] = taken_by.map_or(NO_PLANE, |number| rank_of[number as usize]);
        }
        Planes { planes: order.iter().map(|number| self.found[*number].1).collect(), plane_of }
    }
}

/// The area's centroid, through which the least-squares plane passes.
struct PlaneFit {
    center: Option<Point3<f64>>,
}

impl PlaneFit {
    /// Least ratio between the spread along the plane and the spread across it, in variances.
    const FLATNESS: f64 = 16.0;

    /// Computes the centroid from areas with their centres.
    fn new(parts: impl Iterator<Item = (f32, Point3<f32>)>) -> Self {
        let (mut moment, mut total_m2) = (Vector3::<f64>::zeros(), 0.0);
        for (area_m2, center) in parts {
            moment += center.coords.cast::<f64>() * f64::from(area_m2);
            total_m2 += f64::from(area_m2);
        }
        Self { center: (total_m2 > 0.0).then(|| Point3::from(moment / total_m2)) }
    }

    /// Returns the plane with a normal through the centroid; infinitely far without area.
    fn plane(&self, normal: Vector3<f32>) -> Plane {
        let offset_m = self.center.map_or(f64::INFINITY, |center| normal.cast::<f64>().dot(&center.coords));
        Plane { normal, offset_m: offset_m as f32, slack_m: 0.0 }
    }

    /// Returns the direction of least spread, on the side of `direction`; `None` without area, or if the triangles are
    /// spread nearly as much across the plane as along it.
    fn normal(
        &self,
        triangles: impl Iterator<Item = (f32, [Point3<f32>; 3])>,
        direction: &Vector3<f32>,
    ) -> Option<Vector3<f32>> {
        let center = self.center?;
        let spread: Matrix3<f64> = triangles.map(|triangle| second_moment(triangle, &center)).sum();
        let eigen = SymmetricEigen::new(spread);
        let mut axes = [0, 1, 2];
        axes.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let [across, along] = [0, 1].map(|axis| eigen.eigenvalues[axes[axis]].max(0.0));
        let normal = eigen.eigenvectors.column(axes[0]).into_owned();
        let side = normal.dot(&direction.cast::<f64>()).signum();
        (along > Self::FLATNESS * across).then(|| (normal * side).cast::<f32>())
    }
}

/// Integral of the outer product of offsets from `center` over a triangle.
fn second_moment((area_m2, corners): (f32, [Point3<f32>; 3]), center: &Point3<f64>) -> Matrix3<f64> {
    let offsets = corners.map(|corner| corner.cast::<f64>() - center);
    let sum: Vector3<f64> = offsets.iter().sum();
    let squares: Matrix3<f64> = offsets.iter().map(|offset| offset * offset.transpose()).sum();
    (squares + sum * sum.transpose()) * (f64::from(area_m2) / 12.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{Soup, scene};
    use avln_geom::Rng;

    fn planes_of(soup: &Soup) -> Planes {
        Planes::new(&scene(soup))
    }

    #[test]
    fn triangulation_does_not_change_the_planes() {
        for pieces in [1, 7, 40] {
            let planes = planes_of(&Soup::room([6.0, 3.0, 5.0], pieces));
            assert_eq!(planes.planes.len(), 6, "{pieces}");
            assert!(planes.plane_of.iter().all(|plane| *plane != NO_PLANE));
            let largest = planes.planes[0];
            assert!(largest.normal.y.abs() > 0.999_999, "floor and ceiling are the largest: {largest:?}");
        }
    }

    #[test]
    fn triangles_are_within_their_plane() {
        let soup = Soup::room([6.0, 3.0, 5.0], 5).rotated(0.3);
        let (planes, scene) = (planes_of(&soup), scene(&soup));
        for triangle in 0..scene.mesh.triangles.len() {
            let plane = planes.plane(planes.of(triangle as u32).expect("walls are large"));
            assert!(scene.corners(triangle).iter().all(|corner| plane.height_m(corner).abs() < 1e-4));
        }
    }

    #[test]
    fn scan_bumps_do_not_split_walls() {
        let mut rng = Rng::new(3);
        let mut soup = Soup::room([6.0, 3.0, 5.0], 30);
        soup.shake(|| rng.range(-0.008, 0.008));
        let planes = planes_of(&soup);
        let in_six = planes.plane_of.iter().filter(|plane| **plane < 6).count();
        assert!(in_six * 10 > planes.plane_of.len() * 9, "{in_six} of {}", planes.plane_of.len());
        for plane in &planes.planes[..6] {
            let largest = plane.normal.abs().max();
            assert!(largest > 0.999_9, "{plane:?}");
        }
    }

    #[test]
    fn skirtings_are_separate_planes_and_small_parts_none() {
        let mut soup = Soup::room([6.0, 3.0, 5.0], 1);
        soup.quad([[0.0, 0.0, 0.012], [6.0, 0.0, 0.012], [6.0, 0.1, 0.012], [0.0, 0.1, 0.012]]);
        soup.quad([[2.0, 1.0, 1.0], [2.1, 1.0, 1.0], [2.1, 1.1, 1.3], [2.0, 1.1, 1.3]]);
        let planes = planes_of(&soup);
        assert_eq!(planes.planes.len(), 7);
        assert_eq!(planes.of(12), planes.of(13));
        assert!(
            (planes.plane(planes.of(12).expect("0.6 m2")).height_m(&[1.0, 1.0, 0.012].into())).abs() < 1e-5
        );
        assert_eq!(planes.of(14), None);
    }

    #[test]
    fn degenerate_triangles_belong_to_no_plane() {
        let mut soup = Soup::room([2.0, 2.0, 2.0], 1);
        soup.quad([[f32::NAN, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, f32::INFINITY]]);
        soup.quad([[1.0; 3]; 4]);
        let planes = planes_of(&soup);
        assert_eq!(planes.planes.len(), 6);
        assert!((12..16).all(|triangle| planes.of(triangle).is_none()));
    }

    fn fitted(corners: &[[Point3<f32>; 3]]) -> (PlaneFit, Option<Vector3<f32>>) {
        let area_m2 = |[a, b, c]: &[Point3<f32>; 3]| 0.5 * (b - a).cross(&(c - a)).norm();
        let center = |[a, b, c]: &[Point3<f32>; 3]| Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let fit = PlaneFit::new(corners.iter().map(|corners| (area_m2(corners), center(corners))));
        let normal = fit.normal(corners.iter().map(|corners| (area_m2(corners), *corners)), &Vector3::y());
        (fit, normal)
    }

    /// A rectangle of triangles in the plane y = x / 2 + 1, with bumps.
    fn slope(width_m: f32, bump_m: f32) -> Vec<[Point3<f32>; 3]> {
        let mut rng = Rng::new(2);
        let mut at =
            |x: f32, z: f32| Point3::new(4.0 * x, 2.0 * x + 1.0 + rng.range(-bump_m, bump_m), width_m * z);
        let cells = (0..400).map(|cell| ((cell / 20) as f32 / 20.0, (cell % 20) as f32 / 20.0));
        cells.map(|(x, z)| [at(x, z), at(x, z + 0.05), at(x + 0.05, z)]).collect()
    }

    #[test]
    fn least_squares_normals_survive_bumps() {
        let wanted = Vector3::new(-0.5, 1.0, 0.0).normalize();
        let (fit, exact) = fitted(&slope(3.0, 0.0));
        let exact = exact.expect("flat");
        assert!((exact - wanted).norm() < 1e-6, "{exact}");
        assert!((fit.plane(exact).offset_m - wanted.y).abs() < 1e-5);
        let (_, bumpy) = fitted(&slope(3.0, 0.02));
        assert!((bumpy.expect("flat") - wanted).norm() < 0.01, "{bumpy:?}");
    }

    #[test]
    fn bumpy_strips_have_no_reliable_normal() {
        assert!(fitted(&slope(0.05, 0.0)).1.is_some());
        assert_eq!(fitted(&slope(0.05, 0.04)).1, None);
        let (fit, normal) = fitted(&[]);
        assert!(normal.is_none() && fit.plane(Vector3::y()).offset_m.is_infinite());
    }
}
