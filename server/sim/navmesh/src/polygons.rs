use crate::plane::{Spot, nearest_on_segment, turn};
use crate::voxels::RawPolygon;
use std::ops::Range;

/// No edge, no polygon, no corner.
pub(crate) const NONE: u32 = u32::MAX;

/// Convex polygons in the ground plane, joined along shared edges.
///
/// Edges are numbered through: those of a polygon follow each other, counter-clockwise (inside on the left); edge `e`
/// leaves the corner `from[e]`. An edge with a twin is a portal, one without is a wall.
pub(crate) struct Polygons {
    first_edge: Vec<u32>,
    from: Vec<Spot>,
    twin: Vec<u32>,
    owner: Vec<u32>,
}

impl Polygons {
    /// Joins polygons whose edges coincide in the plane and differ by no more than `climb_levels` in height.
    pub(crate) fn new(raw: &[RawPolygon], climb_levels: u16) -> Self {
        let outlines: Vec<_> = raw.iter().map(outline).collect();
        let mut first_edge = vec![0];
        first_edge.extend(outlines.iter().scan(0, |count, outline| {
            *count += outline.len() as u32;
            Some(*count)
        }));
        let owner = outlines.iter().zip(0..).flat_map(|(outline, id)| vec![id; outline.len()]).collect();
        let corners = outlines.iter().flatten();
        let from = corners.map(|&[x, _, z]| Spot::new(f64::from(x), f64::from(z))).collect();
        Self { first_edge, from, twin: twins(&outlines, climb_levels), owner }
    }

    /// How many polygons there are.
    pub(crate) fn len(&self) -> u32 {
        self.first_edge.len() as u32 - 1
    }

    pub(crate) fn edges(&self, polygon: u32) -> Range<u32> {
        self.first_edge[polygon as usize]..self.first_edge[polygon as usize + 1]
    }

    pub(crate) fn corners(&self, polygon: u32) -> &[Spot] {
        let edges = self.edges(polygon);
        &self.from[edges.start as usize..edges.end as usize]
    }

    /// Where `edge` begins.
    pub(crate) fn from(&self, edge: u32) -> &Spot {
        &self.from[edge as usize]
    }

    /// Where `edge` ends.
    pub(crate) fn to(&self, edge: u32) -> &Spot {
        &self.from[self.next(edge) as usize]
    }

    /// The edge after `edge` around its polygon.
    pub(crate) fn next(&self, edge: u32) -> u32 {
        let edges = self.edges(self.owner[edge as usize]);
        if edge + 1 == edges.end { edges.start } else { edge + 1 }
    }

    /// The same edge as the neighbour sees it; `None` for a wall.
    pub(crate) fn twin(&self, edge: u32) -> Option<u32> {
        let twin = self.twin[edge as usize];
        (twin != NONE).then_some(twin)
    }

    pub(crate) fn owner(&self, edge: u32) -> u32 {
        self.owner[edge as usize]
    }

    /// The polygon behind `edge`.
    pub(crate) fn neighbour(&self, edge: u32) -> Option<u32> {
        self.twin(edge).map(|twin| self.owner(twin))
    }

    /// Area in the plane, cells squared.
    pub(crate) fn area(&self, polygon: u32) -> f64 {
        let corners = self.corners(polygon);
        (2..corners.len()).map(|i| 0.5 * turn(&corners[0], &corners[i - 1], &corners[i])).sum()
    }

    /// The spot of `polygon` nearest to `spot`; `spot` itself when it lies inside.
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

/// The corners of a polygon counter-clockwise, without repeated ones.
fn outline(raw: &RawPolygon) -> Vec<[u16; 3]> {
    let mut corners = raw.corners.clone();
    corners.dedup_by_key(|corner| (corner[0], corner[2]));
    while corners.len() > 1 && (corners[0][0], corners[0][2]) == (last(&corners)[0], last(&corners)[2]) {
        corners.pop();
    }
    let spot = |&[x, _, z]: &[u16; 3]| Spot::new(f64::from(x), f64::from(z));
    let area: f64 =
        corners.windows(2).map(|pair| turn(&spot(&corners[0]), &spot(&pair[0]), &spot(&pair[1]))).sum();
    if area < 0.0 {
        corners.reverse();
    }
    corners
}

fn last(corners: &[[u16; 3]]) -> &[u16; 3] {
    &corners[corners.len() - 1]
}

/// Pairs up edges that run along the same line in opposite directions: lowest edge first, each with the twin nearest in
/// height.
fn twins(outlines: &[Vec<[u16; 3]>], climb_levels: u16) -> Vec<u32> {
    let ends: Vec<_> = outlines
        .iter()
        .flat_map(|outline| (0..outline.len()).map(|i| (outline[i], outline[(i + 1) % outline.len()])))
        .collect();
    let plan = |corner: [u16; 3]| (corner[0], corner[2]);
    let mut by_plan: Vec<_> = ends.iter().zip(0_u32..).map(|(&(a, b), e)| (plan(a), plan(b), e)).collect();
    by_plan.sort_unstable();
    let mut twins = vec![NONE; ends.len()];
    for (edge, &(a, b)) in ends.iter().enumerate() {
        if twins[edge] != NONE {
            continue;
        }
        let key = (plan(b), plan(a));
        let begin = by_plan.partition_point(|entry| (entry.0, entry.1) < key);
        let alike =
            by_plan[begin..].iter().take_while(|entry| (entry.0, entry.1) == key).map(|entry| entry.2);
        let gap = |other: u32| {
            let (from, to) = ends[other as usize];
            from[1].abs_diff(b[1]).max(to[1].abs_diff(a[1]))
        };
        let free = alike.filter(|&other| twins[other as usize] == NONE && gap(other) <= climb_levels);
        if let Some(other) = free.min_by_key(|&other| (gap(other), other)) {
            twins[edge] = other;
            twins[other as usize] = edge as u32;
        }
    }
    twins
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// An L of three unit-10 squares (right of the origin, above the first, right of the first) and, 60 levels above
    /// the first, a square on its own; the second is given clockwise.
    pub(crate) fn letter_l() -> Polygons {
        let square = |x: u16, z: u16, level: u16| RawPolygon {
            corners: vec![[x, level, z], [x + 10, level, z], [x + 10, level, z + 10], [x, level, z + 10]],
            region: 1,
        };
        let mut second = square(0, 10, 2);
        second.corners.reverse();
        Polygons::new(&[square(0, 0, 0), second, square(10, 0, 0), square(0, 0, 60)], 4)
    }

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
    fn nearest_is_the_spot_inside_and_the_rim_outside() {
        let polygons = letter_l();
        let inside = Spot::new(3.0, 4.0);
        assert_eq!(polygons.nearest(0, &inside), inside);
        assert_eq!(polygons.nearest(0, &Spot::new(-2.0, 4.0)), Spot::new(0.0, 4.0));
        assert_eq!(polygons.nearest(0, &Spot::new(-2.0, -3.0)), Spot::new(0.0, 0.0));
    }
}
