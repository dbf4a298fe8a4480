use avln_geom::{Point3, RayMesh, Rng, Vector3, angle};
use avln_scene::{InstanceId, Scene};
use std::collections::BTreeMap;

/// Sampled points per instance.
const POINTS: usize = 64;
// A ray may end this much before or behind its target point and still hit it, metres.
const TOLERANCE_M: f32 = 0.01;

/// Surface points by instance, evenly spread over the area.
pub(crate) struct Surfaces {
    points: BTreeMap<InstanceId, Vec<Point3<f32>>>,
}

impl Surfaces {
    pub(crate) fn byte_count(&self) -> usize {
        self.points.values().map(|points| size_of_val(points.as_slice())).sum()
    }

    pub(crate) fn new(scene: &Scene) -> Self {
        let mut triangles = BTreeMap::<InstanceId, Vec<_>>::new();
        for (triangle, &id) in scene.mesh.instance_of.iter().enumerate() {
            if id != InstanceId::NONE {
                triangles.entry(id).or_default().push(scene.corners(triangle));
            }
        }
        let points = triangles.iter().map(|(&id, triangles)| (id, spread(triangles, u64::from(id.0))));
        Self { points: points.collect() }
    }

    /// Returns true if a ray from `eye` to a point of `instance` first hits a triangle with `is_own`.
    pub(crate) fn any_visible(
        &self,
        rays: &RayMesh,
        eye: &Point3<f32>,
        instance: InstanceId,
        half_vfov_rad: f32,
        is_own: impl Fn(u32) -> bool,
    ) -> bool {
        let (sin, cos) = angle::sin_cos(half_vfov_rad.clamp(0.0, std::f32::consts::FRAC_PI_2));
        let points = self.points.get(&instance).map_or(&[][..], Vec::as_slice);
        points.iter().map(|point| point - eye).any(|offset| {
            let across_m = (offset.x * offset.x + offset.z * offset.z).sqrt();
            if offset.y.abs() * cos > across_m * sin {
                return false;
            }
            let distance_m = offset.norm();
            let reach = 1.0 + TOLERANCE_M / distance_m.max(TOLERANCE_M);
            distance_m == 0.0 || rays.cast(eye, &offset, reach).is_some_and(|hit| is_own(hit.triangle))
        })
    }
}

/// Returns [`POINTS`] points, one per equal area share; none without area.
fn spread(triangles: &[[Point3<f32>; 3]], seed: u64) -> Vec<Point3<f32>> {
    let mut rng = Rng::new(seed);
    let area = |[a, b, c]: &[Point3<f32>; 3]| f64::from((b - a).cross(&(c - a)).norm());
    let total: f64 = triangles.iter().map(area).sum();
    let mut points = Vec::new();
    let mut passed = 0.0;
    for triangle in triangles {
        passed += area(triangle);
        while points.len() < POINTS && passed > total * (points.len() as f64 + 0.5) / POINTS as f64 {
            points.push(inside(triangle, &mut rng));
        }
    }
    points
}

/// Returns a random point, uniform over the area.
fn inside([a, b, c]: &[Point3<f32>; 3], rng: &mut Rng) -> Point3<f32> {
    let (u, v) = (rng.range(0.0, 1.0), rng.range(0.0, 1.0));
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    let offset: Vector3<f32> = (b - a) * u + (c - a) * v;
    a + offset
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_shared_out_by_area() {
        let triangle = |size: f32, x: f32| {
            [Point3::new(x, 0.0, 0.0), Point3::new(x + size, 0.0, 0.0), Point3::new(x, size, 0.0)]
        };
        // Areas in a ratio of 9 to 1.
        let points = spread(&[triangle(3.0, 0.0), triangle(1.0, 10.0)], 1);
        assert_eq!(points.len(), POINTS);
        let on_small = points.iter().filter(|point| point.x >= 10.0).count();
        assert!((5..=8).contains(&on_small), "{on_small} of {POINTS} points on a tenth of the area");
        assert!(points.iter().all(|p| p.y >= 0.0 && (p.x % 10.0) + p.y <= 3.0 + 1e-5));
        assert!(spread(&[[Point3::origin(); 3]], 1).is_empty(), "a point has no area");
    }
}
