//! The navigation mesh: snapping, movement along walls, distances and paths. Steps slide as in
//! `dtNavMeshQuery::moveAlongSurface`: to the nearest reachable point to the target.

use crate::plane::{Lattice, LatticePoint, Spot, nearest_on_segment, turn};
use crate::polygons::{Bins, Islands, Polygons, RawPolygon};
use crate::settings::{Body, Cells, NavMeshError, NavMeshSettings};
use crate::sight::{Corners, Eye};
use crate::surface::{Detail, Ground, Surface};
use crate::voxels::{Voxels, voxelise};
use avln_geom::{Aabb, Point3, Rng, Vector3};
use avln_scene::Scene;
use std::collections::VecDeque;

// Rounding to f32 moves positions by less than this, cells (5 micrometres).
const ROUNDING_CELLS: f64 = 1e-4;
// Detour's wall search radius exceeds half the step length by this, metres.
const STEP_RIM_M: f64 = 0.001;
// Recast polygons share corners bit by bit; this is only slack, metres.
pub(crate) const SHARED_M: f64 = 1e-6;

/// A position on a [`NavMesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavPoint {
    pub(crate) position: Point3<f32>,
    pub(crate) polygon: u32,
}

impl NavPoint {
    /// Returns the position on the ground, world frame.
    pub fn position(&self) -> Point3<f32> {
        self.position
    }
}

/// The result of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide {
    /// End position.
    pub end: NavPoint,
    /// True if a wall shortened the step.
    pub blocked: bool,
}

/// A scene's walkable floor; immutable.
///
/// Islands are connected parts: number 0 is the main island, the others follow by decreasing area. Flat
/// roofs, less than a body height below the scene's top, come last.
///
/// With points from a different mesh, methods panic or return wrong results; they panic for an unknown island.
pub struct NavMesh {
    pub(crate) lattice: Lattice,
    headroom_m: f32,
    pub(crate) climb_m: f32,
    pub(crate) polygons: Polygons,
    pub(crate) corners: Corners,
    islands: Islands,
    pub(crate) bins: Bins,
    pub(crate) surface: Surface,
}

pub(crate) struct Parts {
    pub(crate) lattice: Lattice,
    pub(crate) headroom_m: f32,
    pub(crate) climb_m: f32,
    pub(crate) raw: Vec<RawPolygon>,
}

impl NavMesh {
    /// Returns the list sizes, bytes.
    pub fn byte_count(&self) -> usize {
        self.polygons.byte_count()
            + self.corners.byte_count()
            + self.islands.byte_count()
            + self.bins.byte_count()
            + self.surface.byte_count()
    }

    /// Builds the mesh of `scene` with the arena's settings: a 5 cm lattice and scene heights, otherwise
    /// Habitat's. Upward triangles are floor; parts below about 1 square metre are omitted.
    ///
    /// # Errors
    /// If the body or the scene mesh is invalid, the scene too large, or no floor walkable.
    pub fn build(scene: &Scene, body: &Body) -> Result<NavMesh, NavMeshError> {
        Self::build_with(scene, &NavMeshSettings::from(body))
    }

    /// Builds the mesh of `scene` with `settings`; the default is Habitat's.
    ///
    /// # Errors
    /// If a setting or the scene mesh is invalid, the scene too large, or no floor walkable.
    pub fn build_with(scene: &Scene, settings: &NavMeshSettings) -> Result<NavMesh, NavMeshError> {
        settings.check()?;
        let body = &settings.body;
        let Voxels { lattice, polygons: raw, floors } = voxelise(scene, settings)?;
        let top_m = scene.bounds().map_or(0.0, |bounds| bounds.max.y) - body.height_m;
        let climb_m = f32::from(Cells::new(settings).climb) * settings.level_m;
        let (surface, max_gap_m) = match floors {
            Some(floors) => {
                let patches = raw.iter().map(|polygon| (polygon.region, middle_m(polygon) as f32)).collect();
                let ground = Ground::new(lattice, floors, patches, scene);
                (Surface::Scene(Box::new(ground)), f64::from(climb_m) + SHARED_M)
            }
            None => (Surface::Detail(Detail::new(&raw)), SHARED_M),
        };
        let parts = Parts { lattice, headroom_m: body.height_m, climb_m: body.climb_m, raw };
        Ok(Self::assemble(parts, surface, max_gap_m, top_m))
    }

    /// Joins polygons with a height difference up to `max_gap_m`; polygons above `top_m` are roofs.
    pub(crate) fn assemble(parts: Parts, surface: Surface, max_gap_m: f64, top_m: f32) -> Self {
        let Parts { lattice, headroom_m, climb_m, raw } = parts;
        let polygons = Polygons::new(&raw, max_gap_m);
        let middles_m: Vec<_> = raw.iter().map(middle_m).collect();
        let is_roof = |polygon: u32| middles_m[polygon as usize] > f64::from(top_m);
        let islands = Islands::new(&polygons, lattice.cell_m, is_roof);
        let corners = Corners::new(&polygons, lattice, |edge| match &surface {
            Surface::Scene(_) => f64::from(surface.height_m(polygons.owner(edge), polygons.from(edge))),
            Surface::Detail(_) => polygons.corner(edge).height_m,
        });
        let bins = Bins::new(&polygons);
        Self { lattice, headroom_m, climb_m, polygons, corners, islands, bins, surface }
    }

    /// Returns the nearest mesh point within `max_distance_m` in space.
    ///
    /// Polygons are compared by their nearest point in the plane, with height.
    pub fn snap(&self, point: &Point3<f32>, max_distance_m: f32) -> Option<NavPoint> {
        let spot = self.lattice.spot(point);
        let cell_m = f64::from(self.lattice.cell_m);
        let mut best = (f64::from(max_distance_m).powi(2), None);
        let rise_m = |height_m: f32| f64::from((height_m - point.y).abs());
        self.bins.around(&spot, f64::from(max_distance_m) / cell_m, |polygon| {
            let nearest = self.polygons.nearest(polygon, &spot);
            let flat = (nearest - spot).norm_squared() * cell_m * cell_m;
            // The exact height casts a ray; the rough height rules most polygons out.
            let rough_m = self.surface.rough_height_m(polygon, &nearest);
            let least_m = (rise_m(rough_m) - 2.0 * f64::from(self.lattice.level_m)).max(0.0);
            if flat + least_m * least_m <= best.0 {
                let rise_m = rise_m(self.surface.height_m(polygon, &nearest));
                let distance_squared = flat + rise_m * rise_m;
                if distance_squared < best.0 || best.1.is_none() && distance_squared == best.0 {
                    best = (distance_squared, Some((nearest, polygon)));
                }
            }
            best.0.sqrt() / cell_m
        });
        let (nearest, polygon) = best.1?;
        Some(self.point(&nearest, polygon))
    }

    /// Returns the island index.
    pub fn island_of(&self, point: &NavPoint) -> u32 {
        self.islands.of_polygon[point.polygon as usize]
    }

    /// Returns the island count, at least 1.
    pub fn island_count(&self) -> u32 {
        self.islands.parts.len() as u32
    }

    /// Returns an island's area in the plane, square metres.
    pub fn island_area_m2(&self, island: u32) -> f64 {
        self.islands.parts[island as usize].area_m2
    }

    /// Returns the main island: the largest except roofs.
    pub fn largest_island(&self) -> u32 {
        0
    }

    /// Returns the total area in the plane, square metres.
    pub fn area_m2(&self) -> f64 {
        self.islands.parts.iter().map(|part| part.area_m2).sum()
    }

    /// Samples a point, uniform by area in the plane.
    pub fn sample(&self, rng: &mut Rng, island: u32) -> NavPoint {
        let (spot, polygon) = self.islands.sample(&self.polygons, rng, island);
        self.point(&spot, polygon)
    }

    /// Returns mesh points inside `bounds` on every storey, with x and z at multiples of `spacing_m`, sorted
    /// by x, z, height. Empty if the spacing is below a lattice cell.
    pub fn grid(&self, bounds: &Aabb, spacing_m: f32) -> Vec<NavPoint> {
        if spacing_m.is_nan() || spacing_m < self.lattice.cell_m {
            return Vec::new();
        }
        let Some(reach) = self.reach() else { return Vec::new() };
        let multiples = |axis: usize| {
            let low = bounds.min[axis].max(reach.min[axis]) / spacing_m;
            let high = bounds.max[axis].min(reach.max[axis]) / spacing_m;
            (low.ceil() as i64..=high.floor() as i64).map(move |index| index as f32 * spacing_m)
        };
        let mut points = Vec::new();
        for x in multiples(0) {
            for z in multiples(2) {
                points.extend(self.column(&Point3::new(x, 0.0, z)));
            }
        }
        points.retain(|point| bounds.contains(&point.position));
        points
    }

    /// Moves horizontally with sliding, like Habitat: at a wall the step ends at the nearest reachable point
    /// to the target.
    pub fn slide(&self, from: &NavPoint, displacement: &Vector3<f32>) -> Slide {
        let start = self.eye(from).place.spot;
        let cells = |metres: f32| self.lattice.cells(f64::from(metres));
        let target = Spot::new(start.x + cells(displacement.x), start.y + cells(displacement.z));
        let length_m = f64::from(displacement.xz().norm());
        let step = Step {
            start,
            polygon: from.polygon,
            target,
            reach_cells: self.step_reach(length_m),
            slides: true,
        };
        self.step(&step).unwrap_or(Slide { end: *from, blocked: true })
    }

    /// Takes a step; `None` without an end on the mesh.
    pub(crate) fn step(&self, step: &Step) -> Option<Slide> {
        if !(step.target.x.is_finite() && step.target.y.is_finite()) {
            return None;
        }
        let walked = walk(&self.polygons, step)?;
        Some(Slide { end: self.point(&walked.end, walked.polygon), blocked: walked.blocked })
    }

    pub(crate) fn step_reach(&self, length_m: f64) -> f64 {
        self.lattice.cells(0.5 * length_m + STEP_RIM_M)
    }

    /// Returns the polygons for maps: corners in order, world frame.
    pub fn polygons(&self) -> Vec<Vec<Point3<f32>>> {
        let outline = |polygon: u32| {
            let corners = self.polygons.corners(polygon).iter();
            corners.map(|corner| self.point(&corner.spot, polygon).position).collect()
        };
        (0..self.polygons.len()).map(outline).collect()
    }

    pub(crate) fn eye(&self, point: &NavPoint) -> Eye {
        // Rounding to f32 may have moved the point across the polygon's rim, or off a corner.
        let spot = self.polygons.nearest(point.polygon, &self.lattice.spot(&point.position));
        let is_here =
            |corner: &&LatticePoint| (corner.spot - spot).norm_squared() < ROUNDING_CELLS * ROUNDING_CELLS;
        let corner = self.polygons.corners(point.polygon).iter().find(is_here);
        let spot = corner.map_or(spot, |corner| corner.spot);
        Eye { place: LatticePoint { spot, height_m: f64::from(point.position.y) }, polygon: point.polygon }
    }

    pub(crate) fn corner_position(&self, corner: u32) -> Point3<f32> {
        let place = &self.corners.get(corner).eye.place;
        self.lattice.point(&place.spot, place.height_m as f32)
    }

    pub(crate) fn point(&self, spot: &Spot, polygon: u32) -> NavPoint {
        let height_m = self.surface.height_m(polygon, spot);
        NavPoint { position: self.lattice.point(spot, height_m), polygon }
    }

    /// Bounds in the plane; heights are undefined.
    fn reach(&self) -> Option<Aabb> {
        let corners = (0..self.polygons.len()).flat_map(|polygon| self.polygons.corners(polygon));
        let points: Vec<_> = corners.map(|corner| self.lattice.point(&corner.spot, 0.0)).collect();
        Aabb::around(&points)
    }

    /// Points on all storeys at `at`, lowest first. On a shared edge a single polygon counts.
    fn column(&self, at: &Point3<f32>) -> Vec<NavPoint> {
        let spot = self.lattice.spot(at);
        let above =
            self.bins.at(&spot).iter().filter(|&&polygon| self.polygons.nearest(polygon, &spot) == spot);
        let mut points: Vec<_> = above.map(|&polygon| self.point(&spot, polygon)).collect();
        points.sort_by(|a, b| a.position.y.total_cmp(&b.position.y));
        points.dedup_by(|upper, lower| upper.position.y - lower.position.y < 0.5 * self.headroom_m);
        points
    }
}

/// Mean corner height, metres.
fn middle_m(polygon: &RawPolygon) -> f64 {
    let sum: f64 = polygon.corners.iter().map(|corner| corner.height_m).sum();
    sum / polygon.corners.len() as f64
}

// Rounding moves ends by less than this, cells (5 micrometres).
const SAME_CELLS: f64 = 1e-4;
// Directions with a smaller cross product are parallel, cells squared.
const PARALLEL: f64 = 1e-9;

pub(crate) struct Step {
    pub(crate) start: Spot,
    pub(crate) polygon: u32,
    pub(crate) target: Spot,
    /// Portal search radius around the step centre, cells.
    pub(crate) reach_cells: f64,
    /// False ends the step at the first wall.
    pub(crate) slides: bool,
}

struct Walked {
    pub(crate) end: Spot,
    pub(crate) polygon: u32,
    pub(crate) blocked: bool,
}

/// Takes a step; `None` without a reachable end.
fn walk(polygons: &Polygons, step: &Step) -> Option<Walked> {
    let middle = step.start + (step.target - step.start) * 0.5;
    let mut seen = vec![step.polygon];
    let mut queue = VecDeque::from([step.polygon]);
    let mut best = None;
    let mut least = f64::INFINITY;
    while let Some(polygon) = queue.pop_front() {
        if holds(polygons, polygon, &step.target) {
            return Some(Walked { end: step.target, polygon, blocked: false });
        }
        // Outlines have the opposite direction in Detour; among equal points the first counts.
        for edge in polygons.edges(polygon).rev() {
            let (from, to) = (polygons.from(edge), polygons.to(edge));
            if let Some(neighbour) = polygons.neighbour(edge) {
                let gap = (nearest_on_segment(&middle, from, to) - middle).norm();
                let passes = step.slides || crossing(step, from, to).is_some();
                if gap <= step.reach_cells && passes && !seen.contains(&neighbour) {
                    seen.push(neighbour);
                    queue.push_back(neighbour);
                }
                continue;
            }
            let end = if step.slides {
                Some(nearest_on_segment(&step.target, from, to))
            } else {
                crossing(step, from, to)
            };
            if let Some(end) = end {
                let gap = (end - step.target).norm_squared();
                if best.is_none() || gap < least {
                    least = gap;
                    best = Some(Walked { end, polygon, blocked: gap > SAME_CELLS * SAME_CELLS });
                }
            }
        }
    }
    best
}

/// Returns the step's intersection with a segment.
fn crossing(step: &Step, from: &Spot, to: &Spot) -> Option<Spot> {
    let (along, way) = (to - from, step.target - step.start);
    let cross = along.perp(&way);
    if cross.abs() < PARALLEL {
        return None;
    }
    let offset = step.start - from;
    let (share, passed) = (offset.perp(&way) / cross, offset.perp(&along) / cross);
    let meets = (0.0..=1.0).contains(&share) && (0.0..=1.0).contains(&passed);
    meets.then(|| from + along * share)
}

fn holds(polygons: &Polygons, polygon: u32, spot: &Spot) -> bool {
    polygons.edges(polygon).all(|edge| turn(polygons.from(edge), polygons.to(edge), spot) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::letter_l;
    use avln_geom::Vector2;

    fn step(from: (f64, f64, u32), by: (f64, f64), slides: bool) -> Option<Walked> {
        let (start, polygon) = (Spot::new(from.0, from.1), from.2);
        let offset = Vector2::new(by.0, by.1);
        let reach_cells = 0.5 * offset.norm() + 0.02;
        walk(&letter_l(), &Step { start, polygon, target: start + offset, reach_cells, slides })
    }

    fn assert_step(from: (f64, f64, u32), by: (f64, f64), to: (f64, f64, u32), blocked: bool) {
        let walked = step(from, by, true).expect("an end");
        let spot = walked.end;
        assert!((spot - Spot::new(to.0, to.1)).norm() < 1e-12, "{from:?} by {by:?} ends at {spot}");
        assert_eq!((walked.polygon, walked.blocked), (to.2, blocked), "{from:?} by {by:?}");
    }

    #[test]
    fn free_steps_cross_portals() {
        assert_step((5.0, 5.0, 0), (10.0, 2.0), (15.0, 7.0, 2), false);
        assert_step((5.0, 5.0, 3), (1.0, 2.0), (6.0, 7.0, 3), false);
    }

    #[test]
    fn walls_deflect_steps_sideways() {
        assert_step((5.0, 5.0, 0), (3.0, -9.0), (8.0, 0.0, 0), true);
        // Two walls in a row: the step ends in the room corner.
        assert_step((15.0, 5.0, 2), (9.0, -9.0), (20.0, 0.0, 2), true);
        // Past the end of a wall, the inner corner of the L.
        assert_step((18.0, 9.0, 2), (-12.0, 3.0), (6.0, 12.0, 1), false);
    }

    #[test]
    fn steps_from_a_wall_follow_or_leave_it() {
        assert_step((3.0, 0.0, 0), (15.0, 0.0), (18.0, 0.0, 2), false);
        assert_step((3.0, 0.0, 0), (0.0, 4.0), (3.0, 4.0, 0), false);
        assert_step((0.0, 0.0, 0), (-1.0, -1.0), (0.0, 0.0, 0), true);
        assert_step((3.0, 3.0, 0), (0.0, 0.0), (3.0, 3.0, 0), false);
    }

    #[test]
    fn steps_without_sliding_end_at_the_wall() {
        let at_wall = step((5.0, 5.0, 0), (4.0, -8.0), false).expect("an end");
        assert!((at_wall.end - Spot::new(7.5, 0.0)).norm() < 1e-12 && at_wall.blocked);
        let free = step((5.0, 5.0, 0), (10.0, 2.0), false).expect("an end");
        assert!(free.end == Spot::new(15.0, 7.0) && !free.blocked);
        // Out through a wall and in through another is not a path.
        let out = step((18.0, 9.0, 2), (-12.0, 5.0), false).expect("an end");
        assert!((out.end - Spot::new(15.6, 10.0)).norm() < 1e-12 && out.blocked);
    }

    #[test]
    fn steps_off_the_mesh_have_no_end() {
        let (start, target) = (Spot::new(5.0, -5.0), Spot::new(5.0, -6.0));
        let step = Step { start, polygon: 0, target, reach_cells: 1.0, slides: false };
        assert!(walk(&letter_l(), &step).is_none());
    }
}
