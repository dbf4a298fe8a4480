//! Simplification of triangle meshes: edge collapses, each within an error.
//!
//! A collapse moves all corners at one point to a neighbour point. Triangles at the edge disappear; no new
//! triangles appear, so every remaining triangle has its original number. The surface moves by less than the
//! edge, or less along flat surfaces and straight borders.

use avln_geom::convert::glam_from_point;
use avln_geom::{Point3, Vector3};
use avln_scene::Mesh;
use parry3d::{query::PointQuery, shape::Segment};
use std::ops::Range;

/// Error of a colour change from black to white, metres.
const COLOR_M: f32 = 1.0;
/// Cosine of the largest rotation of a triangle in a collapse along a flat surface.
const LEAST_COSINE: f32 = 0.5;
/// Pass limit per call.
const PASSES: usize = 16;
/// Triangle limit at a collapsed point: borders are found by comparing all pairs of corners.
const MOST_WEDGES: usize = 256;
/// The last pass collapses fewer than this share of all points.
const LEAST_SHARE: usize = 64;

/// A mesh with collapsed edges.
pub(super) struct Simplification {
    /// Corners as vertices; triangles with original numbers, meaningless ones included.
    pub(super) mesh: Mesh,
    /// Numbers of the remaining triangles, ascending.
    pub(super) remaining: Vec<u32>,
    /// By vertex.
    point_of: Vec<u32>,
    points: Vec<Point3<f32>>,
    /// Sum of moves to a point that changed the surface by an edge, metres.
    moved_m: Vec<f32>,
    /// Points with a collapse nearby in the current pass.
    is_locked: Vec<bool>,
    /// Points without a possible collapse.
    is_settled: Vec<bool>,
}

/// Triangles by point.
struct Stars {
    first: Vec<u32>,
    triangles: Vec<u32>,
}

/// A triangle's corner at a point.
#[derive(Clone, Copy)]
struct Wedge {
    /// Region and vertex: wedges of a surface have equal keys.
    key: [u32; 2],
    triangle: u32,
    /// Vertices at the other corners.
    others: [u32; 2],
}

/// Adjacent wedges with equal keys.
struct Side {
    wedges: Range<usize>,
    border: Border,
}

/// Border of a side at its point.
#[derive(Clone, Copy)]
enum Border {
    /// No border.
    Inner,
    /// Ends of a border line through the point.
    Line([u32; 2]),
    /// Any other form.
    Irregular,
}

/// All wedges at a point.
#[derive(Default)]
struct Star {
    wedges: Vec<Wedge>,
    sides: Vec<Side>,
    /// Neighbour points, ascending.
    neighbours: Vec<u32>,
}

/// A move of all corners at a point.
struct Collapse {
    to: u32,
    error_m: f32,
    length_m: f32,
    moved_m: f32,
}

impl Simplification {
    /// Creates the unchanged mesh; vertices at equal positions are adjacent in order.
    pub(super) fn new(mesh: Mesh) -> Self {
        let mut points: Vec<Point3<f32>> = Vec::new();
        let point = |position: &Point3<f32>| {
            if points.last() != Some(position) {
                points.push(*position);
            }
            points.len() as u32 - 1
        };
        let point_of = mesh.positions.iter().map(point).collect();
        let count = points.len();
        Self {
            remaining: (0..mesh.triangles.len() as u32).collect(),
            mesh,
            point_of,
            points,
            moved_m: vec![0.0; count],
            is_locked: vec![false; count],
            is_settled: vec![false; count],
        }
    }

    /// Collapses edges while the error is at most `limit_m`. Lines between regions are borders.
    pub(super) fn simplify(&mut self, region_of: &[u32], limit_m: f32) {
        self.is_settled.fill(false);
        for _ in 0..PASSES {
            let collapses = self.pass(region_of, limit_m);
            if collapses <= self.remaining.len() / LEAST_SHARE {
                break;
            }
        }
    }

    /// Collapses edges at points that are not adjacent; returns their count.
    fn pass(&mut self, region_of: &[u32], limit_m: f32) -> usize {
        let stars = self.stars();
        self.is_locked.fill(false);
        let (mut star, mut collapses) = (Star::default(), 0);
        for point in 0..self.points.len() as u32 {
            let at = point as usize;
            if self.is_locked[at] || self.is_settled[at] {
                continue;
            }
            let triangles = stars.of(point);
            if triangles.len() > MOST_WEDGES {
                self.is_settled[at] = true;
                continue;
            }
            self.gather(&mut star, point, triangles, region_of);
            match self.best(&star, point, limit_m) {
                Some(collapse) => {
                    self.apply(&star, &collapse);
                    collapses += 1;
                }
                None => self.is_settled[at] = true,
            }
        }
        let Self { remaining, mesh, point_of, .. } = self;
        remaining.retain(|&triangle| {
            let [a, b, c] = mesh.triangles[triangle as usize].map(|vertex| point_of[vertex as usize]);
            a != b && b != c && c != a
        });
        collapses
    }

    fn stars(&self) -> Stars {
        let mut first = vec![0; self.points.len() + 2];
        let points = |&triangle: &u32| {
            self.mesh.triangles[triangle as usize].map(|vertex| self.point_of[vertex as usize])
        };
        self.remaining.iter().flat_map(points).for_each(|point| first[point as usize + 2] += 1);
        (2..first.len()).for_each(|at| first[at] += first[at - 1]);
        let mut triangles = vec![0; 3 * self.remaining.len()];
        for triangle in &self.remaining {
            for point in points(triangle) {
                let next = &mut first[point as usize + 1];
                triangles[*next as usize] = *triangle;
                *next += 1;
            }
        }
        Stars { first, triangles }
    }

    /// Collects the wedges at a point.
    fn gather(&self, star: &mut Star, point: u32, triangles: &[u32], region_of: &[u32]) {
        star.wedges.clear();
        star.sides.clear();
        star.neighbours.clear();
        for &triangle in triangles {
            let vertices = self.mesh.triangles[triangle as usize];
            let points = vertices.map(|vertex| self.point_of[vertex as usize]);
            let Some(corner) = points.iter().position(|&corner| corner == point) else { continue };
            let others = [1, 2].map(|step| vertices[(corner + step) % 3]);
            let [b, c] = [1, 2].map(|step| points[(corner + step) % 3]);
            if b == c || b == point || c == point {
                continue;
            }
            let key = [region_of[triangle as usize], vertices[corner]];
            star.wedges.push(Wedge { key, triangle, others });
            star.neighbours.extend([b, c]);
        }
        star.wedges.sort_unstable_by_key(|wedge| (wedge.key, wedge.triangle));
        star.neighbours.sort_unstable();
        star.neighbours.dedup();
        let mut first = 0;
        for wedges in star.wedges.chunk_by(|a, b| a.key == b.key) {
            let range = first..first + wedges.len();
            first = range.end;
            star.sides.push(Side { wedges: range, border: self.border(wedges) });
        }
    }

    fn border(&self, wedges: &[Wedge]) -> Border {
        let points =
            || wedges.iter().flat_map(|wedge| wedge.others).map(|vertex| self.point_of[vertex as usize]);
        let mut ends = [0; 2];
        let mut count = 0;
        for point in points() {
            match points().filter(|&other| other == point).count() {
                1 if count < 2 => {
                    ends[count] = point;
                    count += 1;
                }
                2 => {}
                _ => return Border::Irregular,
            }
        }
        match count {
            0 => Border::Inner,
            2 => Border::Line(ends),
            _ => Border::Irregular,
        }
    }

    /// Returns the collapse with the smallest error.
    fn best(&self, star: &Star, point: u32, limit_m: f32) -> Option<Collapse> {
        let from = &self.points[point as usize];
        let moved_m = self.moved_m[point as usize];
        let mut best: Option<Collapse> = None;
        for &to in &star.neighbours {
            let length_m = (self.points[to as usize] - from).norm();
            let longest_m = moved_m + length_m;
            let most_m = best.as_ref().map_or(limit_m, |best| best.error_m).min(longest_m);
            let deviation_m = self.error(star, point, to, most_m);
            let error_m = deviation_m.unwrap_or(longest_m);
            let is_better = match &best {
                Some(best) => (error_m, length_m) < (best.error_m, best.length_m),
                None => error_m <= limit_m,
            };
            if is_better {
                let moved_m = if deviation_m.is_some() { moved_m } else { longest_m };
                best = Some(Collapse { to, error_m, length_m, moved_m });
            }
        }
        best
    }

    /// Returns the deviation of all sides; `None` above `most_m`.
    fn error(&self, star: &Star, point: u32, to: u32, most_m: f32) -> Option<f32> {
        let mut error_m = 0.0_f32;
        for side in &star.sides {
            let wedges = &star.wedges[side.wedges.clone()];
            error_m = error_m.max(self.side_error(wedges, side.border, point, to, most_m)?);
        }
        Some(error_m)
    }

    fn side_error(&self, wedges: &[Wedge], border: Border, point: u32, to: u32, most_m: f32) -> Option<f32> {
        let end = self.vertex_at(wedges, to)?;
        let place = |vertex: u32| &self.mesh.positions[vertex as usize];
        let (old, new) = (&self.points[point as usize], &self.points[to as usize]);
        let mut error_m = match border {
            Border::Inner => 0.0,
            Border::Line([a, b]) if a == to || b == to => {
                let other = if a == to { b } else { a };
                let [from, to, old] = [new, &self.points[other as usize], old].map(glam_from_point);
                Segment::new(from, to).distance_to_local_point(old, true)
            }
            _ => return None,
        };
        let mut nearest: Option<(f32, [u32; 3], [f32; 3])> = None;
        for wedge in wedges {
            let [b, c] = wedge.others;
            if [b, c].into_iter().any(|vertex| self.point_of[vertex as usize] == to) {
                continue;
            }
            let (b_at, c_at) = (place(b), place(c));
            let edge = c_at - b_at;
            let (before, after) = ((b_at - old).cross(&edge), (b_at - new).cross(&edge));
            let length = after.norm();
            // False for NaN, in case the product of huge edges is infinite.
            let is_flat = before.dot(&after) > LEAST_COSINE * before.norm() * length;
            if !is_flat {
                return None;
            }
            error_m = error_m.max((b_at - old).dot(&after).abs() / length);
            if error_m > most_m {
                return None;
            }
            let weights = barycentric(old, [new, b_at, c_at], &after);
            let inside = weights.into_iter().fold(f32::INFINITY, f32::min);
            if nearest.as_ref().is_none_or(|(most, ..)| inside > *most) {
                nearest = Some((inside, [end, b, c], weights));
            }
        }
        if let Some((_, vertices, weights)) = nearest {
            error_m = error_m.max(self.attribute_error(wedges[0].key[1], vertices, weights));
        }
        (error_m <= most_m).then_some(error_m)
    }

    /// Returns the side's vertex at a point.
    fn vertex_at(&self, wedges: &[Wedge], point: u32) -> Option<u32> {
        wedges.iter().flat_map(|wedge| wedge.others).find(|&vertex| self.point_of[vertex as usize] == point)
    }

    /// Returns the difference between a vertex and the interpolation of others: colour and texture position, metres.
    fn attribute_error(&self, vertex: u32, others: [u32; 3], weights: [f32; 3]) -> f32 {
        let Mesh { colors, uvs, positions, .. } = &self.mesh;
        let color = |channel: usize| {
            let mixed: f32 =
                (0..3).map(|at| weights[at] * f32::from(colors[others[at] as usize][channel])).sum();
            (mixed - f32::from(colors[vertex as usize][channel])).abs()
        };
        let color_m = COLOR_M / 255.0 * color(0).max(color(1)).max(color(2));
        let [a, b, c] = others.map(|vertex| uvs[vertex as usize]);
        let mixed = a.coords * weights[0] + b.coords * weights[1] + c.coords * weights[2];
        let texture = (mixed - uvs[vertex as usize].coords).norm();
        if texture == 0.0 {
            return color_m;
        }
        let texture_area = ((b - a).x * (c - a).y - (b - a).y * (c - a).x).abs();
        let [a, b, c] = others.map(|vertex| positions[vertex as usize]);
        let area = (b - a).cross(&(c - a)).norm();
        let metres_per_unit = if texture_area > 0.0 { (area / texture_area).sqrt() } else { 0.0 };
        color_m.max(texture * metres_per_unit)
    }

    fn apply(&mut self, star: &Star, collapse: &Collapse) {
        let to = collapse.to;
        for side in &star.sides {
            let wedges = &star.wedges[side.wedges.clone()];
            let old = wedges[0].key[1];
            let new = self.vertex_at(wedges, to).unwrap_or_else(|| self.moved(old, to));
            for wedge in wedges {
                for vertex in &mut self.mesh.triangles[wedge.triangle as usize] {
                    if *vertex == old {
                        *vertex = new;
                    }
                }
            }
        }
        let to = to as usize;
        self.moved_m[to] = self.moved_m[to].max(collapse.moved_m);
        for &neighbour in &star.neighbours {
            self.is_locked[neighbour as usize] = true;
            self.is_settled[neighbour as usize] = false;
        }
    }

    /// Adds a copy of a vertex at another point.
    fn moved(&mut self, vertex: u32, to: u32) -> u32 {
        let vertex = vertex as usize;
        self.mesh.positions.push(self.points[to as usize]);
        self.mesh.uvs.push(self.mesh.uvs[vertex]);
        self.mesh.colors.push(self.mesh.colors[vertex]);
        self.point_of.push(to);
        self.point_of.len() as u32 - 1
    }
}

impl Stars {
    fn of(&self, point: u32) -> &[u32] {
        let [first, end] = [0, 1].map(|next| self.first[point as usize + next] as usize);
        &self.triangles[first..end]
    }
}

/// Returns the weights of the corners at a point projected onto a triangle with this normal.
fn barycentric(point: &Point3<f32>, [a, b, c]: [&Point3<f32>; 3], normal: &Vector3<f32>) -> [f32; 3] {
    let area = (b - a).cross(&(c - a));
    let sign = if area.dot(normal) < 0.0 { -1.0 } else { 1.0 };
    let scale = sign / normal.norm_squared();
    let share =
        |from: &Point3<f32>, to: &Point3<f32>| (from - point).cross(&(to - point)).dot(normal) * scale;
    [share(b, c), share(c, a), share(a, b)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Point2;

    const CELLS: u32 = 8;

    /// A grid with heights by column, rows and columns 10 cm apart.
    fn grid(height_m: impl Fn(u32) -> f32) -> Simplification {
        let at = |column: u32, row: u32| column * (CELLS + 1) + row;
        let mut mesh = Mesh::default();
        for (column, row) in (0..=CELLS).flat_map(|column| (0..=CELLS).map(move |row| (column, row))) {
            let place = Point2::new(column as f32, row as f32) * 0.1;
            mesh.positions.push(Point3::new(place.x, height_m(column), place.y));
            mesh.uvs.push(place * 3.0);
            mesh.colors.push([20 * column as u8, 7, 10 * row as u8]);
            if column < CELLS && row < CELLS {
                let next = at(column + 1, row + 1);
                mesh.triangles.push([at(column, row), at(column + 1, row), next]);
                mesh.triangles.push([at(column, row), next, at(column, row + 1)]);
            }
        }
        Simplification::new(mesh)
    }

    fn count(mut simplification: Simplification, regions: u32, limit_m: f32) -> usize {
        let region_of: Vec<u32> =
            (0..2 * CELLS * CELLS).map(|at| at * regions / (2 * CELLS * CELLS)).collect();
        simplification.simplify(&region_of, limit_m);
        simplification.remaining.len()
    }

    #[test]
    fn flat_surfaces_keep_their_outline() {
        assert_eq!(count(grid(|_| 0.0), 1, 0.01), 2);
        assert_eq!(count(grid(|_| 0.0), 2, 0.01), 4, "a line between regions is a border");
        assert_eq!(
            count(grid(|column| if column < 4 { 0.0 } else { 0.1 * (column - 4) as f32 }), 1, 0.01),
            4
        );
    }

    #[test]
    fn details_above_the_limit_stay() {
        let waves = || grid(|column| if column % 2 == 0 { 0.0 } else { 0.05 });
        assert!(count(waves(), 1, 0.01) >= 2 * CELLS as usize);
        assert!(count(waves(), 1, 0.2) <= 4);
    }
}
