use crate::convert::{glam_from_point, glam_from_vector};
use nalgebra::{Point3, Vector3};
use parry3d::{
    bounding_volume::Aabb as ParryAabb,
    partitioning::{Bvh, BvhBuildStrategy},
    query::Ray,
};

/// Where a ray met a triangle.
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
    bvh: Bvh,
    triangles: Vec<Corners>,
}

/// A triangle as the intersection test wants it: a corner and the two edges that leave it.
struct Corners {
    origin: Vector3<f32>,
    edge_u: Vector3<f32>,
    edge_v: Vector3<f32>,
}

impl RayMesh {
    /// Builds the acceleration structure over `triangles`, each three indices into `positions`.
    ///
    /// # Panics
    /// When an index lies outside of `positions`.
    pub fn new(positions: &[Point3<f32>], triangles: &[[u32; 3]]) -> Self {
        let corners: Vec<_> = triangles.iter().map(|t| t.map(|i| positions[i as usize])).collect();
        let leaves: Vec<_> = corners.iter().map(leaf_box).collect();
        let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves);
        Self { bvh, triangles: corners.iter().map(Corners::new).collect() }
    }

    /// How many triangles there are.
    pub fn len(&self) -> usize {
        self.triangles.len()
    }

    /// Whether there is nothing to hit.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }

    /// The first triangle along `direction` from `origin`, no farther than `max_distance` lengths of `direction`.
    pub fn cast(&self, origin: &Point3<f32>, direction: &Vector3<f32>, max_distance: f32) -> Option<Hit> {
        if self.triangles.is_empty() {
            return None;
        }
        let ray = Ray::new(glam_from_point(origin), glam_from_vector(direction));
        let (triangle, distance) = self.bvh.cast_ray(&ray, max_distance, |index, best| {
            let (distance, ..) = self.triangles[index as usize].intersect(&origin.coords, direction)?;
            (distance < best).then_some(distance)
        })?;
        let (_, u, v) = self.triangles[triangle as usize].intersect(&origin.coords, direction)?;
        Some(Hit { triangle, distance, barycentric: [u, v] })
    }

    /// Whether nothing lies between `from` and `to`, both ends left out by a millimetre.
    pub fn is_clear(&self, from: &Point3<f32>, to: &Point3<f32>) -> bool {
        const END_GAP_M: f32 = 1e-3;
        let offset = to - from;
        let length_m = offset.norm();
        if length_m <= 2.0 * END_GAP_M {
            return true;
        }
        let direction = offset / length_m;
        let start = from + direction * END_GAP_M;
        self.cast(&start, &direction, length_m - 2.0 * END_GAP_M).is_none()
    }
}

fn leaf_box(corners: &[Point3<f32>; 3]) -> ParryAabb {
    let [a, b, c] = corners;
    ParryAabb::new(glam_from_point(&a.inf(b).inf(c)), glam_from_point(&a.sup(b).sup(c)))
}

impl Corners {
    fn new([a, b, c]: &[Point3<f32>; 3]) -> Self {
        Self { origin: a.coords, edge_u: b - a, edge_v: c - a }
    }

    /// Distance and barycentric weights of the hit (Möller and Trumbore 1997, both sides).
    fn intersect(&self, origin: &Vector3<f32>, direction: &Vector3<f32>) -> Option<(f32, f32, f32)> {
        let p = direction.cross(&self.edge_v);
        let determinant = self.edge_u.dot(&p);
        if determinant == 0.0 {
            return None;
        }
        let inverse = 1.0 / determinant;
        let to_origin = origin - self.origin;
        let u = to_origin.dot(&p) * inverse;
        let q = to_origin.cross(&self.edge_u);
        let v = direction.dot(&q) * inverse;
        let distance = self.edge_v.dot(&q) * inverse;
        (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && distance > 0.0).then_some((distance, u, v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rng;

    fn random_soup(rng: &mut Rng, count: usize) -> (Vec<Point3<f32>>, Vec<[u32; 3]>) {
        let mut point = || Point3::from(Vector3::from_fn(|_, _| rng.range(-3.0, 3.0)));
        let positions = (0..count * 3).map(|_| point()).collect();
        (positions, (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
    }

    #[test]
    fn the_tree_agrees_with_brute_force() {
        let mut rng = Rng::new(5);
        let (positions, triangles) = random_soup(&mut rng, 60);
        let mesh = RayMesh::new(&positions, &triangles);
        for _ in 0..500 {
            let mut point = || Vector3::from_fn(|_, _| rng.range(-4.0, 4.0));
            let (origin, direction) = (Point3::from(point()), point().normalize());
            let expected = mesh
                .triangles
                .iter()
                .filter_map(|t| t.intersect(&origin.coords, &direction))
                .map(|(distance, ..)| distance)
                .min_by(f32::total_cmp);
            assert_eq!(mesh.cast(&origin, &direction, 100.0).map(|hit| hit.distance), expected);
        }
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
}
