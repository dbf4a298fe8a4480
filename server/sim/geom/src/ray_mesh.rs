//! Ray tests against a triangle mesh.

mod tree;

use crate::{Aabb, Point3, Vector3};
pub use tree::Visitor;
use tree::{Node, Tree, WIDTH};

/// A hit of a ray on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Triangle index.
    pub triangle: u32,
    /// Distance from the origin, in direction lengths (metres for a unit direction).
    pub distance: f32,
    /// Barycentric weights of the triangle's second and third corner.
    pub barycentric: [f32; 2],
}

/// Two-sided triangles, indexed for ray queries. Degenerate triangles are never hit.
pub struct RayMesh {
    nodes: Vec<Node>,
    packets: Vec<Packet>,
    triangle_count: usize,
}

impl RayMesh {
    /// Builds the acceleration structure over `triangles`, given as three indices into `positions`.
    ///
    /// # Panics
    /// If an index is outside `positions`.
    pub fn new(positions: &[Point3<f32>], triangles: &[[u32; 3]]) -> Self {
        let corners = |index: u32| triangles[index as usize].map(|i| positions[i as usize]);
        let boxes: Vec<_> = (0..triangles.len() as u32).filter_map(|i| Aabb::around(&corners(i))).collect();
        let Tree { nodes, leaves } = Tree::new(&boxes);
        let packets = leaves.iter().map(|members| Packet::new(members, corners)).collect();
        Self { nodes, packets, triangle_count: triangles.len() }
    }

    /// Returns the triangle count.
    pub fn len(&self) -> usize {
        self.triangle_count
    }

    /// Returns the memory use in bytes.
    pub fn byte_count(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.packets.as_slice())
    }

    /// Returns true without triangles.
    pub fn is_empty(&self) -> bool {
        self.triangle_count == 0
    }

    /// Returns true if the segment is free, except for a millimetre at both ends.
    pub fn is_clear(&self, from: &Point3<f32>, to: &Point3<f32>) -> bool {
        const END_GAP_M: f32 = 1e-3;
        let offset = to - from;
        let length_m = offset.norm();
        if length_m <= 2.0 * END_GAP_M {
            return true;
        }
        let direction = offset / length_m;
        let start = from + direction * END_GAP_M;
        !self.is_hit(&start, &direction, length_m - 2.0 * END_GAP_M)
    }
}

type Lanes = [f32; WIDTH];

/// Up to four triangles: a corner and two edges each. Unused lanes are degenerate.
#[derive(Clone, Debug)]
struct Packet {
    origin: [Lanes; 3],
    edge_u: [Lanes; 3],
    edge_v: [Lanes; 3],
    triangles: [u32; WIDTH],
    /// Used lanes.
    len: u8,
}

/// Ray hits on four triangles; infinite distance for a miss.
struct PacketHits {
    distance: Lanes,
    u: Lanes,
    v: Lanes,
}

impl Packet {
    fn new(members: &[u32], corners: impl Fn(u32) -> [Point3<f32>; 3]) -> Self {
        let zero = [[0.0; WIDTH]; 3];
        let mut packet = Self {
            origin: zero,
            edge_u: zero,
            edge_v: zero,
            triangles: [u32::MAX; WIDTH],
            len: members.len() as u8,
        };
        for (lane, &triangle) in members.iter().enumerate() {
            let [a, b, c] = corners(triangle);
            for axis in 0..3 {
                packet.origin[axis][lane] = a[axis];
                packet.edge_u[axis][lane] = (b - a)[axis];
                packet.edge_v[axis][lane] = (c - a)[axis];
            }
            packet.triangles[lane] = triangle;
        }
        packet
    }

    /// Returns distances and barycentric weights (Möller and Trumbore 1997, both sides).
    #[inline]
    fn intersect(&self, origin: &[Lanes; 3], direction: &[Lanes; 3]) -> PacketHits {
        let p = cross(direction, &self.edge_v);
        let inverse = each(|i| 1.0 / dot(&self.edge_u, &p)[i]);
        let to_origin = difference(origin, &self.origin);
        let q = cross(&to_origin, &self.edge_u);
        let scaled = |lanes: Lanes| each(|i| lanes[i] * inverse[i]);
        let (u, v, t) =
            (scaled(dot(&to_origin, &p)), scaled(dot(direction, &q)), scaled(dot(&self.edge_v, &q)));
        // A degenerate triangle has infinite or undefined weights, which fail these comparisons.
        let meets = |i: usize| (u[i] >= 0.0) & (v[i] >= 0.0) & (u[i] + v[i] <= 1.0) & (t[i] > 0.0);
        PacketHits { distance: each(|i| if meets(i) { t[i] } else { f32::INFINITY }), u, v }
    }
}

/// Copies the vector into every lane.
fn splat(vector: &Vector3<f32>) -> [Lanes; 3] {
    [[vector.x; WIDTH], [vector.y; WIDTH], [vector.z; WIDTH]]
}

#[inline(always)]
fn each(value: impl Fn(usize) -> f32) -> Lanes {
    std::array::from_fn(value)
}

#[inline(always)]
fn dot(a: &[Lanes; 3], b: &[Lanes; 3]) -> Lanes {
    each(|i| a[0][i] * b[0][i] + a[1][i] * b[1][i] + a[2][i] * b[2][i])
}

#[inline(always)]
fn cross(a: &[Lanes; 3], b: &[Lanes; 3]) -> [Lanes; 3] {
    let component = |j: usize, k: usize| each(|i| a[j][i] * b[k][i] - a[k][i] * b[j][i]);
    [component(1, 2), component(2, 0), component(0, 1)]
}

#[inline(always)]
fn difference(a: &[Lanes; 3], b: &[Lanes; 3]) -> [Lanes; 3] {
    [0, 1, 2].map(|axis| each(|i| a[axis][i] - b[axis][i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    /// Reference: the formula by Möller and Trumbore for a single triangle.
    fn distance_to(
        [a, b, c]: [Point3<f32>; 3],
        origin: &Point3<f32>,
        direction: &Vector3<f32>,
    ) -> Option<f32> {
        let (edge_u, edge_v, to_origin) = (b - a, c - a, origin - a);
        let p = direction.cross(&edge_v);
        let inverse = 1.0 / edge_u.dot(&p);
        let u = to_origin.dot(&p) * inverse;
        let q = to_origin.cross(&edge_u);
        let v = direction.dot(&q) * inverse;
        let distance = edge_v.dot(&q) * inverse;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0).then_some(distance)
    }

    fn random_soup(rng: &mut Rng, count: usize) -> (Vec<Point3<f32>>, Vec<[u32; 3]>) {
        let mut point = || Point3::from(Vector3::from_fn(|_, _| rng.range(-3.0, 3.0)));
        let positions = (0..count * 3).map(|_| point()).collect();
        (positions, (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
    }

    #[test]
    fn tree_agrees_with_brute_force() {
        let mut rng = Rng::new(5);
        for count in [1, 2, 3, 4, 5, 9, 60, 300] {
            let (positions, triangles) = random_soup(&mut rng, count);
            let mesh = RayMesh::new(&positions, &triangles);
            for _ in 0..200 {
                let mut point = || Vector3::from_fn(|_, _| rng.range(-4.0, 4.0));
                let (origin, direction) = (Point3::from(point()), point().normalize());
                let expected = triangles
                    .iter()
                    .filter_map(|t| distance_to(t.map(|i| positions[i as usize]), &origin, &direction))
                    .min_by(f32::total_cmp);
                let hit = mesh.cast(&origin, &direction, 100.0);
                assert_eq!(hit.map(|hit| hit.distance), expected, "{count} triangles");
                let (reach, target) = (expected.unwrap_or(50.0), |t: f32| origin + direction * t);
                assert!(mesh.is_clear(&origin, &target(0.99 * reach)));
                assert_eq!(mesh.is_clear(&origin, &target(1.01 * reach + 0.01)), expected.is_none());
                assert_eq!(mesh.cast(&origin, &direction, 0.99 * reach), None);
            }
        }
    }

    #[test]
    fn barycentric_weights_lead_to_the_hit_point() {
        let mut rng = Rng::new(8);
        let (positions, triangles) = random_soup(&mut rng, 40);
        let mesh = RayMesh::new(&positions, &triangles);
        let mut hits = 0;
        for _ in 0..200 {
            let direction = Vector3::from_fn(|_, _| rng.range(-1.0, 1.0));
            let Some(hit) = mesh.cast(&Point3::origin(), &direction, 100.0) else { continue };
            let [a, b, c] = triangles[hit.triangle as usize].map(|i| positions[i as usize]);
            let weighted = a + (b - a) * hit.barycentric[0] + (c - a) * hit.barycentric[1];
            assert!((weighted.coords - direction * hit.distance).norm() < 1e-3);
            hits += 1;
        }
        assert!(hits > 50, "only {hits} rays hit");
    }

    #[test]
    fn wall_blocks_except_at_its_own_surface() {
        let positions = [(-1.0, -1.0), (1.0, -1.0), (0.0, 2.0)].map(|(x, y)| Point3::new(x, y, 0.0));
        let mesh = RayMesh::new(&positions, &[[0, 1, 2]]);
        let (front, back) = (Point3::new(0.0, 0.0, 1.0), Point3::new(0.0, 0.0, -1.0));
        assert!(!mesh.is_clear(&front, &back));
        assert!(mesh.is_clear(&front, &Point3::new(0.0, 0.0, 0.0)));
        let hit = mesh.cast(&front, &Vector3::new(0.0, 0.0, -1.0), 10.0).expect("straight ahead");
        assert_eq!((hit.triangle, hit.distance), (0, 1.0));
    }

    #[test]
    fn empty_mesh_is_never_hit() {
        assert!(RayMesh::new(&[], &[]).cast(&Point3::origin(), &Vector3::x(), 1.0).is_none());
    }

    #[test]
    fn copies_of_a_triangle_form_a_tree() {
        let positions = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(|(x, y)| Point3::new(x, y, 0.0));
        let mesh = RayMesh::new(&positions, &[[0, 1, 2]; 500]);
        let hit = mesh.cast(&Point3::new(0.2, 0.2, 1.0), &Vector3::new(0.0, 0.0, -1.0), 5.0);
        assert_eq!(hit.expect("in the middle").distance, 1.0);
    }

    /// A visitor that records the triangles in all boxes beyond x = 0.
    struct RightHalf(Vec<u32>);

    impl Visitor for RightHalf {
        fn distance(&self, bounds: &Aabb) -> f32 {
            bounds.min.x
        }

        fn enters(&mut self, bounds: &Aabb) -> bool {
            bounds.max.x > 0.0
        }

        fn triangle(&mut self, index: u32) {
            self.0.push(index);
        }
    }

    #[test]
    fn visitor_receives_triangles_in_entered_boxes_once() {
        let (positions, triangles) = random_soup(&mut Rng::new(2), 200);
        let mut visitor = RightHalf(Vec::new());
        RayMesh::new(&positions, &triangles).visit(&mut visitor);
        let mut seen = visitor.0;
        seen.sort_unstable();
        assert!(seen.windows(2).all(|pair| pair[0] < pair[1]), "a triangle was shown twice");
        for (index, triangle) in triangles.iter().enumerate() {
            let reaches = triangle.iter().any(|&i| positions[i as usize].x > 0.0);
            assert!(!reaches || seen.binary_search(&(index as u32)).is_ok());
        }
    }
}
