//! Light at triangle centres.

use avln_geom::{Point3, RayMesh, Vector3, angle};
use avln_scene::{Lamp, Mesh};

// Rays start off the surface, so that they do not hit it, metres.
const OFF_M: f32 = 0.002;
/// Nearer surfaces cover the sample, metres.
const COVER_M: f32 = 0.03;
/// Farther surfaces do not reduce indirect light, metres.
const OPEN_M: f32 = 1.8;
/// Lamp range, metres; light fades to zero there.
const REACH_M: f32 = 5.0;
// Less light is invisible and not worth a ray.
const FAINT: f32 = 0.03;
/// Rays for large and for small triangles.
const RAYS: [usize; 2] = [8, 4];
/// Largest area of a small triangle, square metres.
const SMALL_M2: f32 = 0.004;
// Neighbouring triangles alternate between ray sets, so that their errors differ.
const SETS: usize = 4;
/// Indirect light in the narrowest corner.
pub(super) const LEAST: f32 = 0.15;

/// A triangle's light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sample {
    /// Unit normal; zero for degenerate triangles.
    pub(super) normal: Vector3<f32>,
    /// Uncovered area, square metres.
    pub(super) weight: f32,
    /// RGB; 1 is the indirect light in the open.
    pub(super) light: [f32; 3],
}

struct Gatherer<'a> {
    rays: &'a RayMesh,
    /// By triangle in `rays`.
    normals: Vec<Vector3<f32>>,
    lamps: &'a [Lamp],
    /// For large and for small triangles: directions on the hemisphere around +Z.
    directions: [[Vec<Vector3<f32>>; SETS]; 2],
}

/// Samples the triangles of `fine`, a subdivision of `coarse`; `rays` contains the coarse triangles.
pub(super) fn samples(coarse: &Mesh, rays: &RayMesh, lamps: &[Lamp], fine: &Mesh) -> Vec<Sample> {
    let normals = coarse.triangles.iter().map(|triangle| area_and_normal(coarse, triangle).1).collect();
    let directions = RAYS.map(|count| std::array::from_fn(|set| hemisphere(count, set)));
    let gatherer = Gatherer { rays, normals, lamps, directions };
    let each = fine.triangles.iter().enumerate();
    each.map(|(index, triangle)| gatherer.sample(fine, index, triangle)).collect()
}

/// Returns the area, square metres, and the unit normal; zero for a degenerate triangle.
fn area_and_normal(mesh: &Mesh, triangle: &[u32; 3]) -> (f32, Vector3<f32>) {
    let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
    let cross = (b - a).cross(&(c - a));
    let length = cross.norm();
    if length > 1e-12 { (0.5 * length, cross / length) } else { (0.0, Vector3::zeros()) }
}

/// Cosine-distributed directions around +Z: disc points by the golden angle (Vogel 1979), lifted to the
/// hemisphere (Malley's method).
fn hemisphere(count: usize, set: usize) -> Vec<Vector3<f32>> {
    const GOLDEN_RAD: f32 = 2.399_963;
    let direction = |index: usize| {
        let height2 = 1.0 - (index as f32 + 0.5) / count as f32;
        let turns = index as f32 + set as f32 / SETS as f32;
        let (sin, cos) = angle::sin_cos(turns * GOLDEN_RAD);
        let radius = (1.0 - height2).sqrt();
        Vector3::new(radius * cos, radius * sin, height2.sqrt())
    };
    (0..count).map(direction).collect()
}

impl Gatherer<'_> {
    fn sample(&self, mesh: &Mesh, index: usize, triangle: &[u32; 3]) -> Sample {
        let (area_m2, normal) = area_and_normal(mesh, triangle);
        if area_m2 == 0.0 {
            return Sample { normal, weight: 0.0, light: [0.0; 3] };
        }
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize].coords);
        let origin = Point3::from((a + b + c) / 3.0 + normal * OFF_M);
        let size = usize::from(area_m2 <= SMALL_M2);
        let (open, seen) = self.openness(&origin, &normal, &self.directions[size][index % SETS]);
        let mut light = [indirect(open, &normal); 3];
        if seen > 0.0 {
            self.add_lamps(&origin, &normal, &mut light);
        }
        Sample { normal, weight: area_m2 * seen, light }
    }

    /// Returns the openness in front of a surface, 0 to 1, and the uncovered share.
    fn openness(&self, origin: &Point3<f32>, normal: &Vector3<f32>, set: &[Vector3<f32>]) -> (f32, f32) {
        let (right, up) = axes(normal);
        let (mut open, mut seen) = (0.0, 0.0);
        for local in set {
            let direction = right * local.x + up * local.y + normal * local.z;
            match self.rays.cast(origin, &direction, OPEN_M) {
                None => (open, seen) = (open + 1.0, seen + 1.0),
                Some(hit) => {
                    let from_behind = self.normals[hit.triangle as usize].dot(&direction) > 0.0;
                    if !from_behind && hit.distance * local.z > COVER_M {
                        (open, seen) = (open + hit.distance / OPEN_M, seen + 1.0);
                    }
                }
            }
        }
        (if seen > 0.0 { open / seen } else { 0.0 }, seen / set.len() as f32)
    }

    fn add_lamps(&self, origin: &Point3<f32>, normal: &Vector3<f32>, light: &mut [f32; 3]) {
        for lamp in self.lamps {
            let Some(share) = falling(lamp, origin, normal) else { continue };
            let arriving = lamp.strength.map(|channel| channel * share);
            if arriving.iter().all(|channel| *channel < FAINT) || !self.sees(origin, lamp) {
                continue;
            }
            for (sum, channel) in light.iter_mut().zip(arriving) {
                *sum += channel;
            }
        }
    }

    /// Returns true if the lamp is visible, ignoring the lamp's body.
    fn sees(&self, origin: &Point3<f32>, lamp: &Lamp) -> bool {
        let offset = lamp.position - origin;
        let distance_m = offset.norm();
        distance_m <= lamp.radius_m
            || self.rays.is_clear(origin, &(origin + offset * (1.0 - lamp.radius_m / distance_m)))
    }
}

/// Indirect light: 1 in the open, less near surfaces, slightly less on surfaces facing down.
fn indirect(open: f32, normal: &Vector3<f32>) -> f32 {
    (0.9 + 0.1 * normal.y) * (LEAST + (1.0 - LEAST) * open * open)
}

/// Unoccluded share of a lamp's strength: inverse square, with the cosines at the surface and at a flat lamp.
/// `None` if either has its back to the other.
fn falling(lamp: &Lamp, origin: &Point3<f32>, normal: &Vector3<f32>) -> Option<f32> {
    let offset = lamp.position - origin;
    let distance2 = offset.norm_squared();
    let along = normal.dot(&offset);
    if along <= 0.0 || distance2 >= REACH_M * REACH_M {
        return None;
    }
    let inverse = 1.0 / distance2.sqrt();
    let leaving = lamp.facing.map_or(1.0, |facing| -facing.dot(&offset) * inverse);
    let nearness = distance2 / (REACH_M * REACH_M);
    let fading = 1.0 - nearness * nearness;
    let near = distance2 + lamp.radius_m * lamp.radius_m;
    (leaving > 0.0).then(|| along * inverse * leaving * fading * fading / near)
}

/// Returns two unit vectors for a right-handed frame with `z` (Duff and others 2017).
fn axes(z: &Vector3<f32>) -> (Vector3<f32>, Vector3<f32>) {
    let sign = 1.0_f32.copysign(z.z);
    let a = -1.0 / (sign + z.z);
    let b = z.x * z.y * a;
    (
        Vector3::new(1.0 + sign * z.x * z.x * a, sign * b, -sign * z.x),
        Vector3::new(b, sign + z.y * z.y * a, -z.y),
    )
}
