mod packet;
mod tree;
mod walk;

use crate::{Aabb, Point3, Vector3};
use packet::Packet;
use tree::{Node, Tree};
pub use walk::Visitor;

/// A hit of a ray on a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index of the triangle.
    pub triangle: u32,
    /// Distance from the origin, in lengths of the ray's direction (metres for a unit direction).
    pub distance: f32,
    /// Barycentric weights of the triangle's second and third corner.
    pub barycentric: [f32; 2],
}

/// A triangle soup that answers rays. Triangles have two sides; degenerate ones are never hit.
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
        let boxes: Vec<_> = (0..triangles.len() as u32).map(|i| box_around(&corners(i))).collect();
        let Tree { nodes, leaves } = Tree::new(&boxes);
        let packets = leaves.iter().map(|members| Packet::new(members, corners)).collect();
        Self { nodes, packets, triangle_count: triangles.len() }
    }

    /// Triangle count.
    pub fn len(&self) -> usize {
        self.triangle_count
    }

    /// Bytes that it takes.
    pub fn byte_count(&self) -> usize {
        size_of_val(self.nodes.as_slice()) + size_of_val(self.packets.as_slice())
    }

    /// Returns true without triangles.
    pub fn is_empty(&self) -> bool {
        self.triangle_count == 0
    }

    /// Returns the first triangle in `direction` from `origin`, within `max_distance` lengths of `direction`.
    pub fn cast(&self, origin: &Point3<f32>, direction: &Vector3<f32>, max_distance: f32) -> Option<Hit> {
        walk::nearest(self, origin, direction, max_distance)
    }

    /// Returns true if the segment from `from` to `to` is free, except for a millimetre at both ends.
    pub fn is_clear(&self, from: &Point3<f32>, to: &Point3<f32>) -> bool {
        const END_GAP_M: f32 = 1e-3;
        let offset = to - from;
        let length_m = offset.norm();
        if length_m <= 2.0 * END_GAP_M {
            return true;
        }
        let direction = offset / length_m;
        let start = from + direction * END_GAP_M;
        !walk::any(self, &start, &direction, length_m - 2.0 * END_GAP_M)
    }

    /// Walks the tree of boxes, near ones first, and shows `visitor` every triangle of the boxes that it enters.
    pub fn visit(&self, visitor: &mut impl Visitor) {
        walk::visit(self, visitor);
    }
}

fn box_around([a, b, c]: &[Point3<f32>; 3]) -> Aabb {
    Aabb { min: a.inf(b).inf(c), max: a.sup(b).sup(c) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    /// Distance of the hit on a triangle, by the formula of Möller and Trumbore.
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
    fn the_tree_agrees_with_brute_force() {
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
    fn barycentric_weights_lead_to_the_point_that_was_hit() {
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
    fn a_wall_blocks_and_its_surface_does_not_block_itself() {
        let positions = [(-1.0, -1.0), (1.0, -1.0), (0.0, 2.0)].map(|(x, y)| Point3::new(x, y, 0.0));
        let mesh = RayMesh::new(&positions, &[[0, 1, 2]]);
        let (front, back) = (Point3::new(0.0, 0.0, 1.0), Point3::new(0.0, 0.0, -1.0));
        assert!(!mesh.is_clear(&front, &back));
        assert!(mesh.is_clear(&front, &Point3::new(0.0, 0.0, 0.0)));
        let hit = mesh.cast(&front, &Vector3::new(0.0, 0.0, -1.0), 10.0).expect("straight ahead");
        assert_eq!((hit.triangle, hit.distance), (0, 1.0));
    }

    #[test]
    fn nothing_is_never_hit() {
        assert!(RayMesh::new(&[], &[]).cast(&Point3::origin(), &Vector3::x(), 1.0).is_none());
    }

    #[test]
    fn many_copies_of_one_triangle_are_a_tree_too() {
        let positions = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)].map(|(x, y)| Point3::new(x, y, 0.0));
        let mesh = RayMesh::new(&positions, &[[0, 1, 2]; 500]);
        let hit = mesh.cast(&Point3::new(0.2, 0.2, 1.0), &Vector3::new(0.0, 0.0, -1.0), 5.0);
        assert_eq!(hit.expect("in the middle").distance, 1.0);
    }

    /// A visitor of all boxes beyond x = 0 that records their triangles.
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
    fn a_visitor_sees_every_triangle_of_the_boxes_it_enters_once() {
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
