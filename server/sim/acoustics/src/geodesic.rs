//! Shortest any-angle paths through the air from a source to every cell.
//!
//! Source: Nash, Koenig and Tovey (2010), "Lazy Theta*", without a goal: cells expand by increasing distance.

use crate::air::Air;
use crate::building::{Reader, Writer};
use avln_geom::{Point3, RayMesh};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Paths with last bends closer than this count as one, metres; beyond twice this, as two.
pub(crate) const APART_M: f32 = 0.5;

/// Longest excess over the shortest path for a second path, metres.
pub(crate) const LONGER_M: f32 = 3.0;

pub(crate) struct GeodesicField {
    /// Path corners, source first.
    corners: Vec<Corner>,
    /// Last path corner per cell, [`UNREACHED`] without a path.
    last_corner: Vec<u32>,
}

const UNREACHED: u32 = u32::MAX;

#[derive(Clone, Copy, Debug)]
struct Corner {
    point: Point3<f32>,
    distance_m: f32,
    /// Previous corner; the source points to itself.
    before: u32,
}

/// A path through the air: listener, corners, source.
pub(crate) type AirPath = Vec<Point3<f32>>;

pub(crate) fn length_m(path: &[Point3<f32>]) -> f32 {
    path.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum()
}

pub(crate) fn horizontal_m(one: &Point3<f32>, other: &Point3<f32>) -> f32 {
    let offset = one - other;
    (offset.x * offset.x + offset.z * offset.z).sqrt()
}

impl GeodesicField {
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.corners.as_slice()) + size_of_val(self.last_corner.as_slice())
    }

    pub(crate) fn write(&self, writer: &mut Writer) {
        let words = |corner: &Corner| {
            let [x, y, z] = [0, 1, 2].map(|axis| corner.point[axis].to_bits());
            [x, y, z, corner.distance_m.to_bits(), corner.before]
        };
        writer.words(self.corners.iter().map(words).collect::<Vec<_>>().as_flattened());
        writer.words(&self.last_corner);
    }

    /// Reads the output of [`GeodesicField::write`]; `None` if it does not fit the air.
    pub(crate) fn read(reader: &mut Reader, air: &Air) -> Option<Self> {
        let (words, last_corner) = (reader.words()?, reader.words()?);
        let corner = |[x, y, z, distance_m, before]: [u32; 5]| Corner {
            point: [x, y, z].map(f32::from_bits).into(),
            distance_m: f32::from_bits(distance_m),
            before,
        };
        let corners: Vec<_> = words.as_chunks().0.iter().map(|words| corner(*words)).collect();
        // Every corner chain must end at the source.
        let is_chained = |(index, corner): (usize, &Corner)| corner.before < (index as u32).max(1);
        let is_known = |last: &u32| *last == UNREACHED || (*last as usize) < corners.len();
        let fits = last_corner.len() == air.grid.len() && last_corner.iter().all(is_known);
        (fits && corners.iter().enumerate().all(is_chained)).then_some(Self { corners, last_corner })
    }

    /// Explores the air around `source` from cells visible from it.
    pub(crate) fn new(air: &Air, source: &Point3<f32>, seeds: &[usize]) -> Self {
        let mut search = Search::new(air, source);
        for seed in seeds {
            search.offer(*seed, SOURCE, true);
        }
        search.run();
        Self { corners: search.corners, last_corner: search.parent }
    }

    /// Returns the shortest path from `listener`, tight to 1 or 2 cm; `None` if unreachable. `near_cells`
    /// must be visible from the listener.
    pub(crate) fn path(&self, air: &Air, listener: &Point3<f32>, near_cells: &[usize]) -> Option<AirPath> {
        let options = near_cells.iter().filter_map(|cell| self.path_through(air, listener, *cell));
        let (_, mut path) = options.min_by(|a, b| a.0.total_cmp(&b.0))?;
        tighten(&air.rays, &mut path);
        Some(path)
    }

    /// Returns the shortest tight path on the other side of an obstacle than `first`, from a different
    /// direction and at most a few metres longer.
    pub(crate) fn second_path(&self, air: &Air, first: &[Point3<f32>]) -> Option<AirPath> {
        const MAX_TRIED: usize = 32;
        const MAX_TIGHTENED: usize = 3;
        // Only the first few are tried, so a heap is faster than a sorted list. Positive floats sort like their bits.
        let by_length = |(length_m, bend): (f32, u32)| Reverse((length_m.to_bits(), bend));
        let mut bends: BinaryHeap<_> = self.other_bends(first).map(by_length).collect();
        let mut tried: Vec<u32> = Vec::new();
        let mut tightened = 0;
        while let Some(Reverse((_, bend))) = bends.pop() {
            let known = tried.iter().any(|other| self.are_in_line(bend, *other));
            if known || !self.chain(bend).all(|point| horizontal_m(point, &first[1]) > APART_M) {
                continue;
            }
            if tried.len() == MAX_TRIED || tightened == MAX_TIGHTENED {
                break;
            }
            tried.push(bend);
            if self.is_other(&air.rays, first, bend) {
                tightened += 1;
                let mut path: AirPath = std::iter::once(first[0]).chain(self.chain(bend).copied()).collect();
                tighten(&air.rays, &mut path);
                if path.len() > 2 && horizontal_m(&path[1], &first[1]) > APART_M {
                    return Some(path);
                }
            }
        }
        None
    }

    /// Returns true if two corners are on a vertical line.
    fn are_in_line(&self, one: u32, other: u32) -> bool {
        let [one, other] = [one, other].map(|corner| &self.corners[corner as usize].point);
        one.x == other.x && one.z == other.z
    }

    /// Returns true if the path by `bend` is free and bent, and an obstacle separates it from `first`.
    fn is_other(&self, rays: &RayMesh, first: &[Point3<f32>], bend: u32) -> bool {
        let (listener, near) = (&first[0], &first[1]);
        let corner = &self.corners[bend as usize];
        let before = &self.corners[corner.before as usize].point;
        let middle = corner.point + (near - corner.point) * 0.5;
        let nothing_between = || {
            rays.is_clear(&corner.point, near)
                && rays.is_clear(before, &middle)
                && rays.is_clear(listener, &middle)
        };
        rays.is_clear(listener, &corner.point)
            && is_taut(rays, [listener, &corner.point, before])
            && !nothing_between()
    }

    /// Corners off the path `first`, with path lengths in metres.
    fn other_bends<'a>(&'a self, first: &'a [Point3<f32>]) -> impl Iterator<Item = (f32, u32)> + 'a {
        let (listener, shortest_m) = (first[0], length_m(first));
        let ahead = (first[1] - listener).normalize();
        self.corners.iter().enumerate().skip(1).filter_map(move |(index, corner)| {
            let leg = corner.point - listener;
            let leg_m = leg.norm();
            let length_m = corner.distance_m + leg_m;
            let aside =
                leg.dot(&ahead) < COS_ASIDE * leg_m && horizontal_m(&corner.point, &first[1]) > APART_M;
            (aside && length_m < shortest_m + LONGER_M).then_some((length_m, index as u32))
        })
    }

    /// Points from corner `last` back to the source.
    fn chain(&self, last: u32) -> impl Iterator<Item = &Point3<f32>> {
        let before = |corner: &u32| (*corner != SOURCE).then(|| self.corners[*corner as usize].before);
        std::iter::successors(Some(last), before).map(|corner| &self.corners[corner as usize].point)
    }

    /// Length in metres and path through a cell.
    fn path_through(&self, air: &Air, listener: &Point3<f32>, cell: usize) -> Option<(f32, AirPath)> {
        let last = self.last_corner[cell];
        let corner = *self.corners.get(last as usize)?;
        let mut path = vec![*listener];
        if !air.rays.is_clear(listener, &corner.point) {
            path.push(air.grid.center(cell));
        }
        path.extend(self.chain(last));
        Some((length_m(&path), path))
    }
}

/// Smallest angle between first and second path: 4 degrees, as a cosine.
const COS_ASIDE: f32 = 0.997_6;

/// Returns true if the path bends around an edge: pulling it straight by more than a cell is blocked.
fn is_taut(rays: &RayMesh, [before, corner, after]: [&Point3<f32>; 3]) -> bool {
    const PULL_M: f32 = 0.3;
    let leg = after - before;
    let along = (corner - before).dot(&leg) / leg.norm_squared().max(f32::MIN_POSITIVE);
    let offset = before + leg * along.clamp(0.0, 1.0) - corner;
    let pulled = corner + offset * (PULL_M / offset.norm().max(PULL_M));
    !(rays.is_clear(before, &pulled) && rays.is_clear(&pulled, after))
}

const SOURCE: u32 = 0;

struct Search<'a> {
    air: &'a Air,
    corners: Vec<Corner>,
    /// Corner index per cell, once a path bends there.
    corner_of: Vec<u32>,
    distance_m: Vec<f32>,
    parent: Vec<u32>,
    /// Per cell: the last corner found to be invisible.
    rejected: Vec<u32>,
    /// Per cell: true if the parent is known to be visible.
    verified: Vec<bool>,
    closed: Vec<bool>,
    // Positive floats sort like their bits; equal distances sort by cell.
    queue: BinaryHeap<Reverse<(u32, usize)>>,
}

impl<'a> Search<'a> {
    fn new(air: &'a Air, source: &Point3<f32>) -> Self {
        let cells = air.grid.len();
        Self {
            air,
            corners: vec![Corner { point: *source, distance_m: 0.0, before: SOURCE }],
            corner_of: vec![UNREACHED; cells],
            distance_m: vec![f32::INFINITY; cells],
            parent: vec![UNREACHED; cells],
            rejected: vec![UNREACHED; cells],
            verified: vec![false; cells],
            closed: vec![false; cells],
            queue: BinaryHeap::new(),
        }
    }

    fn run(&mut self) {
        while let Some(Reverse((bits, cell))) = self.queue.pop() {
            if self.closed[cell] || bits != self.distance_m[cell].to_bits() {
                continue;
            }
            if self.verified[cell] || self.sees(cell, self.parent[cell]) {
                self.close(cell);
            } else {
                self.fall_back(cell);
            }
        }
    }

    fn sees(&self, cell: usize, corner: u32) -> bool {
        self.air.rays.is_clear(&self.corners[corner as usize].point, &self.air.grid.center(cell))
    }

    fn distance_by(&self, cell: usize, corner: u32) -> f32 {
        let corner = &self.corners[corner as usize];
        corner.distance_m + (self.air.grid.center(cell) - corner.point).norm()
    }

    fn offer(&mut self, cell: usize, corner: u32, verified: bool) {
        let distance_m = self.distance_by(cell, corner);
        if distance_m < self.distance_m[cell] {
            self.distance_m[cell] = distance_m;
            self.parent[cell] = corner;
            self.verified[cell] = verified;
            self.queue.push(Reverse((distance_m.to_bits(), cell)));
        }
    }

    fn close(&mut self, cell: usize) {
        self.closed[cell] = true;
        self.verified[cell] = true;
        let (air, parent) = (self.air, self.parent[cell]);
        for next in air.neighbours(cell) {
            if !self.closed[next] && self.rejected[next] != parent {
                self.offer(next, parent, false);
            }
        }
    }

    /// Replaces an invisible parent by the best reached neighbour, where the path then bends.
    fn fall_back(&mut self, cell: usize) {
        self.rejected[cell] = self.parent[cell];
        self.distance_m[cell] = f32::INFINITY;
        let air = self.air;
        let reached = air.neighbours(cell).filter(|next| self.closed[*next]);
        let best = reached.min_by(|a, b| self.distance_m[*a].total_cmp(&self.distance_m[*b]));
        if let Some(neighbour) = best {
            let corner = self.corner_at(neighbour);
            self.offer(cell, corner, true);
        }
    }

    fn corner_at(&mut self, cell: usize) -> u32 {
        if self.corner_of[cell] == UNREACHED {
            self.corner_of[cell] = self.corners.len() as u32;
            self.corners.push(Corner {
                point: self.air.grid.center(cell),
                distance_m: self.distance_m[cell],
                before: self.parent[cell],
            });
        }
        self.corner_of[cell]
    }
}

/// Shortens `path` in place until it touches the edges, to 1 or 2 cm; both ends stay.
fn tighten(rays: &RayMesh, path: &mut Vec<Point3<f32>>) {
    sweep(rays, path);
    let mut corner = 1;
    while corner + 1 < path.len() {
        let pair = cut(rays, [path[corner - 1], path[corner], path[corner + 1]]);
        path.splice(corner..=corner, pair);
        corner += 2;
    }
    sweep(rays, path);
    sweep(rays, path);
}

fn sweep(rays: &RayMesh, path: &mut Vec<Point3<f32>>) {
    let mut corner = 1;
    while corner + 1 < path.len() {
        if rays.is_clear(&path[corner - 1], &path[corner + 1]) {
            path.remove(corner);
        } else {
            pull(rays, path, corner);
            slide(rays, path, corner);
            corner += 1;
        }
    }
}

/// Moves a corner towards the next while the previous corner sees it.
fn slide(rays: &RayMesh, path: &mut [Point3<f32>], corner: usize) {
    // The path then leaves the previous corner exactly past the hiding edge.
    let (before, from) = (path[corner - 1], path[corner]);
    let leg = path[corner + 1] - from;
    path[corner] = from + leg * largest_share(|share| rays.is_clear(&before, &(from + leg * share)));
}

/// Moves a corner towards the line between the neighbours, first vertically, then freely.
fn pull(rays: &RayMesh, path: &mut [Point3<f32>], corner: usize) {
    let (before, after) = (path[corner - 1], path[corner + 1]);
    let leg = after - before;
    for level_only in [true, false] {
        let from = path[corner];
        let along = (from - before).dot(&leg) / leg.norm_squared().max(f32::MIN_POSITIVE);
        let mut offset = before + leg * along.clamp(0.0, 1.0) - from;
        if level_only {
            (offset.x, offset.z) = (0.0, 0.0);
        }
        let fits = |share: f32| {
            let point = from + offset * share;
            rays.is_clear(&before, &point) && rays.is_clear(&point, &after)
        };
        path[corner] = from + offset * largest_share(fits);
    }
}

/// The outermost mutually visible points on the legs before and after a corner.
fn cut(rays: &RayMesh, [before, corner, after]: [Point3<f32>; 3]) -> [Point3<f32>; 2] {
    let shorter_m = (before - corner).norm().min((after - corner).norm());
    let towards = |end: &Point3<f32>, share: f32| {
        let leg = end - corner;
        corner + leg * (0.9 * share * shorter_m / leg.norm().max(f32::MIN_POSITIVE))
    };
    let ends = |share: f32| [towards(&before, share), towards(&after, share)];
    let share = largest_share(|share| {
        let [one, other] = ends(share);
        rays.is_clear(&one, &other)
    });
    ends(share)
}

/// Largest share that `fits`, to one part in 64; 0 is assumed to fit.
fn largest_share(fits: impl Fn(f32) -> bool) -> f32 {
    if fits(1.0) {
        return 1.0;
    }
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..6 {
        let middle = 0.5 * (low + high);
        if fits(middle) { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A wall from y = 0 up, 10 m high and wide, `thick_m` deep behind x = 0, that ends at z = 0.
    fn wall(thick_m: f32) -> RayMesh {
        let sheet = |x: f32| [(x, 0.0, 0.0), (x, 10.0, 0.0), (x, 10.0, 10.0), (x, 0.0, 10.0)];
        let end = [(0.0, 0.0, 0.0), (thick_m, 0.0, 0.0), (thick_m, 10.0, 0.0), (0.0, 10.0, 0.0)];
        let corners: Vec<_> = [sheet(0.0), sheet(thick_m), end].concat();
        let corners: Vec<_> = corners.into_iter().map(|(x, y, z)| Point3::new(x, y, z)).collect();
        let triangles: Vec<_> =
            [0, 4, 8].iter().flat_map(|i| [[*i, i + 1, i + 2], [*i, i + 2, i + 3]]).collect();
        RayMesh::new(&corners, &triangles)
    }

    fn length_m(path: &[Point3<f32>]) -> f32 {
        path.windows(2).map(|leg| (leg[1] - leg[0]).norm()).sum()
    }

    #[test]
    fn slack_paths_tighten_around_one_or_two_edges() {
        let (from, to) = (Point3::new(-2.0, 4.0, 1.5), Point3::new(2.5, 4.0, 2.0));
        // Around the edge at x = 0, then around another edge at x = 0.5.
        for (thick_m, taut_m) in [(0.001, 2.5 + 3.2016), (0.5, 2.5 + 0.5 + 2.8284)] {
            let mut path = vec![from, Point3::new(0.1, 4.3, -0.3), to];
            tighten(&wall(thick_m), &mut path);
            assert!(
                (-0.002..0.03).contains(&(length_m(&path) - taut_m)),
                "{} m of {taut_m} m",
                length_m(&path)
            );
        }
    }

    #[test]
    fn bends_without_an_obstacle_are_straightened() {
        let mut path =
            vec![Point3::new(-2.0, 1.0, -1.0), Point3::new(0.0, 3.0, -4.0), Point3::new(2.0, 1.0, -1.0)];
        tighten(&wall(0.2), &mut path);
        assert_eq!(path.len(), 2);
    }
}
