//! Habitat-compatible projection, steps and path lengths, as in habitat-sim's `PathFinder`. Sources:
//! habitat-sim `src/esp/nav/PathFinder.cpp`, Detour `findNearestPoly` and `findStraightPath`.

use crate::corridor::corridor_m;
use crate::mesh::{NavMesh, NavPoint, Slide};
use crate::plane::{LatticePoint, Spot, nearest_height_m};
use crate::polygons::extent;
use crate::sight::Eye;
use crate::surface::Surface;
use crate::walk::Step;
use avln_geom::Point3;

/// Half extents of the polygon search box: horizontal and vertical, metres.
const BOX_M: (f64, f64) = (2.0, 4.0);
/// Relative distance of equal end points.
const SAME: f32 = 1e-5;
// On a crack between two islands the next projection could select the other island; this shift into the
// polygon prevents that, metres.
const NUDGE_M: f32 = 1e-4;

impl NavMesh {
    /// Projects `point` to the mesh like Habitat; `None` if the surrounding box of 4 x 8 x 4 m is empty.
    ///
    /// A polygon above or below within the body's climb has priority over nearer lateral polygons.
    pub fn project(&self, point: &Point3<f32>) -> Option<NavPoint> {
        let (spot, height_m) = (self.lattice.spot(point), f64::from(point.y));
        let reach_cells = self.lattice.cells(BOX_M.0);
        let mut best: Option<(f64, u32, Spot)> = None;
        self.bins.around(&spot, reach_cells, |polygon| {
            if self.is_in_box(polygon, &spot, height_m) {
                let nearest = self.polygons.nearest(polygon, &spot);
                let cost = self.nearness(polygon, &spot, &nearest, height_m);
                if best.is_none_or(|(least, first, _)| cost < least || cost == least && polygon < first) {
                    best = Some((cost, polygon, nearest));
                }
            }
            reach_cells
        });
        best.map(|(_, polygon, nearest)| self.point(&nearest, polygon))
    }

    /// Returns the end of a step, like Habitat's `try_step` or, without `slides`, `try_step_no_sliding`:
    /// `start` if either point is off the mesh or `end` is nearest to a different island.
    pub fn try_step(&self, start: &Point3<f32>, end: &Point3<f32>, slides: bool) -> Point3<f32> {
        self.stepped(start, end, slides).unwrap_or(*start)
    }

    fn stepped(&self, start: &Point3<f32>, end: &Point3<f32>, slides: bool) -> Option<Point3<f32>> {
        let from = self.project(start)?;
        let towards = self.project(end)?;
        if self.island_of(&from) != self.island_of(&towards) {
            return None;
        }
        let (start, target) = (self.lattice.spot(&from.position), self.lattice.spot(end));
        let reach_cells = self.step_reach(f64::from((end - from.position).norm()));
        let step = Step { start, polygon: from.polygon, target, reach_cells, slides };
        let Slide { end: reached, blocked } = self.step(&step)?;
        // Habitat's own meshes must reproduce Habitat's bits; with scene heights the result is only a position.
        let exact = matches!(self.surface, Surface::Detail(_)) && blocked && slides;
        let stopped = exact.then(|| stop(self, reached.polygon, end)).flatten();
        let place = stopped.unwrap_or(reached.position);
        let again = self.project(&place)?;
        if self.island_of(&again) == self.island_of(&from) {
            return Some(place);
        }
        let inwards = self.middle(reached.polygon) - place;
        Some(place + inwards * (NUDGE_M / inwards.norm().max(NUDGE_M)))
    }

    /// Returns Habitat's path length, metres; `None` without a path. Both points are projected but retain
    /// their heights; the path is tightened in the best polygon chain, which is not always shortest.
    pub fn geodesic_m(&self, a: &Point3<f32>, b: &Point3<f32>) -> Option<f64> {
        let (on_a, on_b) = (self.project(a)?, self.project(b)?);
        if self.island_of(&on_a) != self.island_of(&on_b) {
            return None;
        }
        if are_same(&on_a, &on_b) {
            return Some(0.0);
        }
        let ends = [&on_a, &on_b].map(|on| Eye { place: self.place(on), polygon: on.polygon });
        let drawn = [self.place(&self.end_of_path(a, &on_a)), self.place(&self.end_of_path(b, &on_b))];
        corridor_m(&self.polygons, &self.lattice, ends, drawn)
    }

    /// Returns the shortest path length between the points of [`NavMesh::geodesic_m`]; never longer.
    pub fn shortest_m(&self, a: &Point3<f32>, b: &Point3<f32>) -> Option<f64> {
        let (on_a, on_b) = (self.project(a)?, self.project(b)?);
        if are_same(&on_a, &on_b) {
            return Some(0.0);
        }
        self.distance_m(&self.end_of_path(a, &on_a), &self.end_of_path(b, &on_b))
    }

    fn place(&self, point: &NavPoint) -> LatticePoint {
        let position = point.position;
        LatticePoint { spot: self.lattice.spot(&position), height_m: f64::from(position.y) }
    }

    /// Returns `point` itself above its polygon, otherwise the nearest rim point at rim height.
    fn end_of_path(&self, point: &Point3<f32>, on: &NavPoint) -> NavPoint {
        let spot = self.lattice.spot(point);
        let nearest = self.polygons.nearest(on.polygon, &spot);
        let height_m = if nearest == spot { point.y } else { self.rim_m(on.polygon, &nearest) as f32 };
        NavPoint { position: self.lattice.point(&nearest, height_m), polygon: on.polygon }
    }

    fn rim_m(&self, polygon: u32, spot: &Spot) -> f64 {
        let side = |edge| [edge, self.polygons.next(edge)].map(|edge| self.polygons.corner(edge));
        nearest_height_m(spot, self.polygons.edges(polygon).map(side))
    }

    fn is_in_box(&self, polygon: u32, spot: &Spot, height_m: f64) -> bool {
        let corners = self.polygons.corners(polygon);
        let (low, high) = extent(corners);
        let reach = self.lattice.cells(BOX_M.0);
        let beside = low.x <= spot.x + reach
            && high.x >= spot.x - reach
            && low.y <= spot.y + reach
            && high.y >= spot.y - reach;
        let (bottom_m, top_m) = match &self.surface {
            Surface::Detail(detail) => detail.reach_m(polygon),
            Surface::Scene(_) => {
                let heights = corners.iter().map(|corner| corner.height_m);
                heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), y| (l.min(y), h.max(y)))
            }
        };
        beside && bottom_m <= height_m + BOX_M.1 && top_m >= height_m - BOX_M.1
    }

    /// Habitat's polygon ranking, square metres: the rise beyond a climb above or below a polygon, otherwise
    /// the distance in space.
    fn nearness(&self, polygon: u32, spot: &Spot, nearest: &Spot, height_m: f64) -> f64 {
        let rise_m = f64::from(self.surface.height_m(polygon, nearest)) - height_m;
        if nearest == spot {
            (rise_m.abs() - f64::from(self.climb_m)).max(0.0).powi(2)
        } else {
            let flat_m = (nearest - spot).norm() * f64::from(self.lattice.cell_m);
            flat_m * flat_m + rise_m * rise_m
        }
    }

    fn middle(&self, polygon: u32) -> Point3<f32> {
        let corners = self.polygons.corners(polygon);
        let count = corners.len() as f64;
        let sum = corners.iter().fold(Spot::origin(), |sum, corner| sum + corner.spot.coords);
        let height_m = corners.iter().map(|corner| corner.height_m).sum::<f64>() / count;
        self.lattice.point(&(sum / count), height_m as f32)
    }
}

/// Returns true if Habitat treats two mesh points as equal.
fn are_same(a: &NavPoint, b: &NavPoint) -> bool {
    let least = a.position.coords.norm_squared().min(b.position.coords.norm_squared());
    (a.position - b.position).norm_squared() <= SAME * SAME * least
}

/// A wall in Detour's direction.
#[derive(Clone, Copy)]
struct Wall {
    begin: Point3<f32>,
    end: Point3<f32>,
}

impl Wall {
    /// Returns the parameter (0 to 1) of the wall point nearest to `target` in the plane, and the squared
    /// distance.
    fn nearest(&self, target: &Point3<f32>) -> (f32, f32) {
        let (along, to) = (self.end - self.begin, target - self.begin);
        let length_squared = along.x * along.x + along.z * along.z;
        let mut share = along.x * to.x + along.z * to.z;
        if length_squared > 0.0 {
            share /= length_squared;
        }
        let share = share.clamp(0.0, 1.0);
        let (x, z) = (self.begin.x + share * along.x - target.x, self.begin.z + share * along.z - target.z);
        (share, x * x + z * z)
    }

    /// Returns true if a ray in x crosses the wall.
    fn crosses(&self, place: &Point3<f32>) -> bool {
        let (a, b) = (&self.end, &self.begin);
        (a.z > place.z) != (b.z > place.z) && place.x < (b.x - a.x) * (place.z - a.z) / (b.z - a.z) + a.x
    }
}

/// Returns the end of a step to `target` against a wall of `polygon`; `None` without walls.
fn stop(mesh: &NavMesh, polygon: u32, target: &Point3<f32>) -> Option<Point3<f32>> {
    let polygons = &mesh.polygons;
    let wall = |edge: u32| {
        let place = |edge: u32| {
            let LatticePoint { spot, height_m } = polygons.corner(edge);
            mesh.lattice.corner(&spot, height_m as f32)
        };
        Wall { begin: place(polygons.next(edge)), end: place(edge) }
    };
    let mut best: Option<(f32, f32, Wall)> = None;
    for edge in polygons.edges(polygon).rev().filter(|&edge| polygons.twin(edge).is_none()) {
        let (share, gap) = wall(edge).nearest(target);
        if best.is_none_or(|(least, ..)| gap < least) {
            best = Some((gap, share, wall(edge)));
        }
    }
    let (_, share, Wall { begin, end }) = best?;
    // f32 rounding puts the point inside or outside the polygon. Detour then takes the detail mesh height or
    // the straight rim (`moveAlongSurface`, `getPolyHeight`).
    let mut place = begin + (end - begin) * share;
    let crossed = polygons.edges(polygon).filter(|&edge| wall(edge).crosses(&place)).count();
    if crossed % 2 == 1 {
        place.y = mesh.surface.height_m(polygon, &mesh.lattice.spot(&place));
    }
    Some(place)
}
