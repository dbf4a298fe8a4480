//! Convex polygons with neighbours, as in Habitat's navigation mesh, and connected parts of them.

use crate::plane::{Lattice, LatticePoint, Spot, nearest_on_segment, turn};
use avln_geom::Rng;
use std::ops::Range;

/// No edge, polygon or corner.
pub(crate) const NONE: u32 = u32::MAX;
/// Habitat drops polygons below this area, square metres.
pub(crate) const MIN_POLYGON_M2: f64 = 1e-5;

/// A convex polygon before joining, in either direction.
#[derive(Clone, Debug, Default)]
pub(crate) struct RawPolygon {
    pub(crate) corners: Vec<LatticePoint>,
    pub(crate) region: u16,
    /// Covering triangles with heights; empty with scene heights.
    pub(crate) detail: Vec<[LatticePoint; 3]>,
}

impl RawPolygon {
    /// Returns the triangles' area in space, square metres.
    pub(crate) fn detail_m2(&self, lattice: &Lattice) -> f64 {
        let cell_m = f64::from(lattice.cell_m);
        let area = |[a, b, c]: &[LatticePoint; 3]| {
            let side = |to: &LatticePoint| {
                let flat = (to.spot - a.spot) * cell_m;
                avln_geom::Vector3::new(flat.x, to.height_m - a.height_m, flat.y)
            };
            0.5 * side(b).cross(&side(c)).norm()
        };
        self.detail.iter().map(area).sum()
    }

    pub(crate) fn has_three_sides(&self) -> bool {
        let mut plan: Vec<_> = self.corners.iter().map(|corner| key(&corner.spot)).collect();
        plan.sort_unstable();
        plan.dedup();
        plan.len() >= 3
    }

    /// Returns counter-clockwise corners without duplicates.
    fn tidy(&self) -> Vec<LatticePoint> {
        let mut corners = self.corners.clone();
        corners.dedup_by_key(|corner| key(&corner.spot));
        while corners.len() > 1 && key(&corners[0].spot) == key(&corners[corners.len() - 1].spot) {
            corners.pop();
        }
        let first = corners[0].spot;
        let area: f64 = corners.windows(2).map(|pair| turn(&first, &pair[0].spot, &pair[1].spot)).sum();
        if area < 0.0 {
            corners.reverse();
        }
        corners
    }
}

fn key(spot: &Spot) -> (i64, i64) {
    let ordered = |value: f64| {
        // Adding 0 makes -0 and 0 equal; flipping the other bits of negative numbers sorts them.
        let bits = (value + 0.0).to_bits() as i64;
        bits ^ ((bits >> 63) & i64::MAX)
    };
    (ordered(spot.x), ordered(spot.y))
}

/// Convex polygons, joined at shared edges.
///
/// Edges have consecutive indices per polygon, counter-clockwise (inside on the left); edge `e` leaves the
/// corner `from[e]`. An edge with a twin is a portal, an edge without is a wall.
pub(crate) struct Polygons {
    first_edge: Vec<u32>,
    from: Vec<LatticePoint>,
    twin: Vec<u32>,
    owner: Vec<u32>,
}

impl Polygons {
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.first_edge.as_slice())
            + size_of_val(self.from.as_slice())
            + size_of_val(self.twin.as_slice())
            + size_of_val(self.owner.as_slice())
    }

    /// Joins polygons with coinciding edges and a height difference up to `max_gap_m`.
    pub(crate) fn new(raw: &[RawPolygon], max_gap_m: f64) -> Self {
        let outlines: Vec<_> = raw.iter().map(RawPolygon::tidy).collect();
        let mut first_edge = vec![0];
        first_edge.extend(outlines.iter().scan(0, |count, outline| {
            *count += outline.len() as u32;
            Some(*count)
        }));
        let owner = outlines.iter().zip(0..).flat_map(|(outline, id)| vec![id; outline.len()]).collect();
        let twin = twins(&outlines, max_gap_m);
        Self { first_edge, from: outlines.into_iter().flatten().collect(), twin, owner }
    }

    pub(crate) fn len(&self) -> u32 {
        self.first_edge.len() as u32 - 1
    }

    pub(crate) fn edges(&self, polygon: u32) -> Range<u32> {
        self.first_edge[polygon as usize]..self.first_edge[polygon as usize + 1]
    }

    pub(crate) fn corners(&self, polygon: u32) -> &[LatticePoint] {
        let edges = self.edges(polygon);
        &self.from[edges.start as usize..edges.end as usize]
    }

    pub(crate) fn from(&self, edge: u32) -> &Spot {
        &self.from[edge as usize].spot
    }

    pub(crate) fn corner(&self, edge: u32) -> LatticePoint {
        self.from[edge as usize]
    }

    pub(crate) fn to(&self, edge: u32) -> &Spot {
        &self.from[self.next(edge) as usize].spot
    }

    pub(crate) fn next(&self, edge: u32) -> u32 {
        let edges = self.edges(self.owner[edge as usize]);
        if edge + 1 == edges.end { edges.start } else { edge + 1 }
    }

    /// Returns the neighbour's edge; `None` for a wall.
    pub(crate) fn twin(&self, edge: u32) -> Option<u32> {
        let twin = self.twin[edge as usize];
        (twin != NONE).then_some(twin)
    }

    pub(crate) fn owner(&self, edge: u32) -> u32 {
        self.owner[edge as usize]
    }

    pub(crate) fn neighbour(&self, edge: u32) -> Option<u32> {
        self.twin(edge).map(|twin| self.owner(twin))
    }

    /// Area in the plane, cells squared.
    pub(crate) fn area(&self, polygon: u32) -> f64 {
        let corners = self.corners(polygon);
        (2..corners.len()).map(|i| 0.5 * turn(&corners[0].spot, &corners[i - 1].spot, &corners[i].spot)).sum()
    }

    /// Returns the nearest point on `polygon`: `spot` itself if inside.
    pub(crate) fn nearest(&self, polygon: u32, spot: &Spot) -> Spot {
        let mut best = (f64::INFINITY, *spot);
        for edge in self.edges(polygon) {
            let (a, b) = (self.from(edge), self.to(edge));
            if turn(a, b, spot) < 0.0 {
                let candidate = nearest_on_segment(spot, a, b);
                let distance = (candidate - spot).norm_squared();
                if distance < best.0 {
                    best = (distance, candidate);
                }
            }
        }
        best.1
    }
}

/// Pairs opposite edges on the same line: lowest edge first, with the nearest twin in height.
fn twins(outlines: &[Vec<LatticePoint>], max_gap_m: f64) -> Vec<u32> {
    let ends: Vec<_> = outlines
        .iter()
        .flat_map(|outline| (0..outline.len()).map(|i| (outline[i], outline[(i + 1) % outline.len()])))
        .collect();
    let plan = |corner: &LatticePoint| key(&corner.spot);
    let mut by_plan: Vec<_> = ends.iter().zip(0_u32..).map(|((a, b), e)| (plan(a), plan(b), e)).collect();
    by_plan.sort_unstable();
    let mut twins = vec![NONE; ends.len()];
    for (edge, (a, b)) in ends.iter().enumerate() {
        if twins[edge] != NONE {
            continue;
        }
        let key = (plan(b), plan(a));
        let begin = by_plan.partition_point(|entry| (entry.0, entry.1) < key);
        let alike =
            by_plan[begin..].iter().take_while(|entry| (entry.0, entry.1) == key).map(|entry| entry.2);
        let gap_m = |other: u32| {
            let (from, to) = &ends[other as usize];
            (from.height_m - b.height_m).abs().max((to.height_m - a.height_m).abs())
        };
        let free = alike.filter(|&other| twins[other as usize] == NONE && gap_m(other) <= max_gap_m);
        if let Some(other) = free.min_by(|&a, &b| gap_m(a).total_cmp(&gap_m(b)).then(a.cmp(&b))) {
            twins[edge] = other;
            twins[other as usize] = edge as u32;
        }
    }
    twins
}

/// Bin side, cells (0.5 m).
const BIN_CELLS: f64 = 10.0;
pub(crate) struct Bins {
    columns: i64,
    rows: i64,
    first: Vec<u32>,
    polygons: Vec<u32>,
}

impl Bins {
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.first.as_slice()) + size_of_val(self.polygons.as_slice())
    }

    /// Registers a polygon in every bin inside its bounding rectangle.
    pub(crate) fn new(polygons: &Polygons) -> Self {
        let boxes: Vec<_> = (0..polygons.len()).map(|polygon| bounds(polygons.corners(polygon))).collect();
        let reach = boxes.iter().fold((0, 0), |(x, y), b| (b.2.max(x), b.3.max(y)));
        let (columns, rows) = (reach.0 + 1, reach.1 + 1);
        let mut entries: Vec<(i64, u32)> = Vec::new();
        for (&(x0, y0, x1, y1), polygon) in boxes.iter().zip(0..) {
            entries.extend((y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (y * columns + x, polygon))));
        }
        entries.sort_unstable();
        let first = (0..=rows * columns).map(|bin| entries.partition_point(|entry| entry.0 < bin) as u32);
        Self {
            columns,
            rows,
            first: first.collect(),
            polygons: entries.iter().map(|entry| entry.1).collect(),
        }
    }

    /// Returns the polygons registered at `spot`, ascending.
    pub(crate) fn at(&self, spot: &Spot) -> &[u32] {
        self.bin((spot.x / BIN_CELLS).floor() as i64, (spot.y / BIN_CELLS).floor() as i64)
    }

    /// Visits the polygons within `reach` cells, roughly nearest first, with duplicates and some beyond the
    /// reach. `visit` returns the new reach.
    pub(crate) fn around(&self, spot: &Spot, mut reach: f64, mut visit: impl FnMut(u32) -> f64) {
        let clamp = |value: f64, count: i64| ((value / BIN_CELLS).floor() as i64).clamp(0, count - 1);
        let (x, y) = (clamp(spot.x, self.columns), clamp(spot.y, self.rows));
        for ring in 0..self.columns.max(self.rows) {
            if (ring - 1) as f64 * BIN_CELLS > reach {
                return;
            }
            for (dx, dy) in ring_around(ring) {
                for &polygon in self.bin(x + dx, y + dy) {
                    reach = visit(polygon);
                }
            }
        }
    }

    fn bin(&self, x: i64, y: i64) -> &[u32] {
        if !(0..self.columns).contains(&x) || !(0..self.rows).contains(&y) {
            return &[];
        }
        let bin = (y * self.columns + x) as usize;
        &self.polygons[self.first[bin] as usize..self.first[bin + 1] as usize]
    }
}
fn bounds(corners: &[LatticePoint]) -> (i64, i64, i64, i64) {
    let bin = |value: f64| (value / BIN_CELLS).floor() as i64;
    let (min, max) = extent(corners);
    (bin(min.x), bin(min.y), bin(max.x), bin(max.y))
}

pub(crate) fn extent(corners: &[LatticePoint]) -> (Spot, Spot) {
    let first = corners[0].spot;
    corners.iter().fold((first, first), |(min, max), c| (min.inf(&c.spot), max.sup(&c.spot)))
}

/// Returns the offsets at Chebyshev distance `ring`.
fn ring_around(ring: i64) -> impl Iterator<Item = (i64, i64)> {
    (-ring..=ring).flat_map(move |dy| {
        let step = if dy.abs() == ring { 1 } else { (2 * ring).max(1) as usize };
        (-ring..=ring).step_by(step).map(move |dx| (dx, dy))
    })
}

/// Connected mesh parts, the main island first.
pub(crate) struct Islands {
    pub(crate) of_polygon: Vec<u32>,
    pub(crate) parts: Vec<Island>,
}

pub(crate) struct Island {
    pub(crate) area_m2: f64,
    /// Triangles, with the cumulative area up to and including each, cells squared.
    triangles: Vec<(f64, Triangle)>,
}

#[derive(Clone, Copy)]
struct Triangle {
    polygon: u32,
    /// Second corner in the polygon; the first is corner 0, the third the next.
    corner: u32,
}

impl Islands {
    pub(crate) fn byte_count(&self) -> usize {
        let triangles = self.parts.iter().map(|part| size_of_val(part.triangles.as_slice()));
        size_of_val(self.of_polygon.as_slice()) + triangles.sum::<usize>()
    }

    /// Numbers the parts by decreasing area. Parts with mainly `is_roof` polygons come last.
    pub(crate) fn new(polygons: &Polygons, cell_m: f32, is_roof: impl Fn(u32) -> bool) -> Self {
        let square_cell_m2 = f64::from(cell_m) * f64::from(cell_m);
        let (mut of_polygon, members) = components(polygons);
        let mut ranked: Vec<_> =
            members.into_iter().map(|members| rank(polygons, members, &is_roof)).collect();
        ranked.sort_by(|a, b| (a.0.cmp(&b.0)).then(b.1.total_cmp(&a.1)).then(a.2.cmp(&b.2)));
        let mut parts = Vec::with_capacity(ranked.len());
        for ((_, area, members), number) in ranked.into_iter().zip(0..) {
            members.iter().for_each(|&polygon| of_polygon[polygon as usize] = number);
            parts.push(Island { area_m2: area * square_cell_m2, triangles: triangles(polygons, &members) });
        }
        Self { of_polygon, parts }
    }
    pub(crate) fn sample(&self, polygons: &Polygons, rng: &mut Rng, island: u32) -> (Spot, u32) {
        let triangles = &self.parts[island as usize].triangles;
        let total = triangles.last().map_or(0.0, |entry| entry.0);
        let draw = rng.unit() * total;
        let index = triangles.partition_point(|entry| entry.0 <= draw).min(triangles.len() - 1);
        let Triangle { polygon, corner } = triangles[index].1;
        let corners = polygons.corners(polygon);
        let [a, b, c] = [0, corner, corner + 1].map(|i| corners[i as usize].spot);
        let (mut u, mut v) = (rng.unit(), rng.unit());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        (a + (b - a) * u + (c - a) * v, polygon)
    }
}

/// Part index by polygon, and sorted members by part.
fn components(polygons: &Polygons) -> (Vec<u32>, Vec<Vec<u32>>) {
    let mut of_polygon = vec![NONE; polygons.len() as usize];
    let mut parts = Vec::new();
    for seed in 0..polygons.len() {
        if of_polygon[seed as usize] != NONE {
            continue;
        }
        let number = parts.len() as u32;
        let mut members = vec![seed];
        of_polygon[seed as usize] = number;
        let mut next = 0;
        while let Some(&polygon) = members.get(next) {
            next += 1;
            for neighbour in polygons.edges(polygon).filter_map(|edge| polygons.neighbour(edge)) {
                if of_polygon[neighbour as usize] == NONE {
                    of_polygon[neighbour as usize] = number;
                    members.push(neighbour);
                }
            }
        }
        members.sort_unstable();
        parts.push(members);
    }
    (of_polygon, parts)
}

fn rank(polygons: &Polygons, members: Vec<u32>, is_roof: impl Fn(u32) -> bool) -> (bool, f64, Vec<u32>) {
    let area_of = |chosen: &dyn Fn(u32) -> bool| -> f64 {
        members.iter().filter(|&&polygon| chosen(polygon)).map(|&polygon| polygons.area(polygon)).sum()
    };
    let area = area_of(&|_| true);
    (area_of(&is_roof) > 0.5 * area, area, members)
}

fn triangles(polygons: &Polygons, members: &[u32]) -> Vec<(f64, Triangle)> {
    let mut total = 0.0;
    let mut triangles = Vec::new();
    for &polygon in members {
        let corners = polygons.corners(polygon);
        for corner in 1..corners.len().saturating_sub(1) {
            total += 0.5 * turn(&corners[0].spot, &corners[corner].spot, &corners[corner + 1].spot);
            triangles.push((total, Triangle { polygon, corner: corner as u32 }));
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::letter_l;

    #[test]
    fn neighbours_share_edges_and_storeys_do_not() {
        let polygons = letter_l();
        let neighbours = |polygon| {
            let mut found: Vec<_> = polygons.edges(polygon).filter_map(|e| polygons.neighbour(e)).collect();
            found.sort_unstable();
            found
        };
        assert_eq!(neighbours(0), [1, 2]);
        assert_eq!((neighbours(1), neighbours(2), neighbours(3)), (vec![0], vec![0], vec![]));
        assert!((0..4).all(|polygon| polygons.area(polygon) == 100.0));
        for edge in 0..16 {
            let Some(twin) = polygons.twin(edge) else { continue };
            assert_eq!(polygons.twin(twin), Some(edge));
            assert_eq!((polygons.from(edge), polygons.to(edge)), (polygons.to(twin), polygons.from(twin)));
        }
    }

    #[test]
    fn nearest_is_itself_inside_and_the_rim_outside() {
        let polygons = letter_l();
        let inside = Spot::new(3.0, 4.0);
        assert_eq!(polygons.nearest(0, &inside), inside);
        assert_eq!(polygons.nearest(0, &Spot::new(-2.0, 4.0)), Spot::new(0.0, 4.0));
        assert_eq!(polygons.nearest(0, &Spot::new(-2.0, -3.0)), Spot::new(0.0, 0.0));
    }

    #[test]
    fn rings_have_eight_bins_a_step() {
        assert_eq!(ring_around(0).collect::<Vec<_>>(), [(0, 0)]);
        assert_eq!((ring_around(1).count(), ring_around(3).count()), (8, 24));
    }

    #[test]
    fn bins_list_their_polygons() {
        let bins = Bins::new(&letter_l());
        assert_eq!(bins.at(&Spot::new(15.0, 5.0)), [0, 2, 3].as_slice());
        assert!(bins.at(&Spot::new(-5.0, 5.0)).is_empty());
        let mut seen = Vec::new();
        bins.around(&Spot::new(1e6, -1e6), f64::INFINITY, |polygon| {
            seen.push(polygon);
            f64::INFINITY
        });
        assert!((0..4).all(|polygon| seen.contains(&polygon)));
    }
}
