//! Baked light for scenes with lamps, in the vertex colours of a finer mesh.
//!
//! A triangle of the finer mesh is a sample: indirect light with ambient occlusion from a fixed ray set, and
//! the visible lamps. A vertex has the mean of smoothly adjacent triangles.

#[cfg(test)]
mod tests;

use avln_geom::{Point3, RayMesh, Vector3, angle};
use avln_scene::{Lamp, Lighting, Mesh, Scene};
use std::collections::BTreeMap;

/// Returns the subdivided mesh with light factors as vertex colours: RGB, 0 to 255, multiplied with the sRGB
/// surface colour. `None` if surfaces contain their light. `rays` contains the scene triangles in order; the
/// result has a different order.
pub(crate) fn lit(scene: &Scene, rays: &RayMesh) -> Option<Mesh> {
    let Lighting::Lamps(lamps) = &scene.lighting else { return None };
    let mut mesh = cut(&scene.mesh);
    let samples = samples(&scene.mesh, rays, lamps, &mesh);
    spread(samples, &mut mesh);
    Some(mesh)
}

/// Longer edges are halved, metres.
const LONGEST_M: f32 = 0.5;
// Longer edges belong to no room, and halving them would multiply the triangles, metres.
const ENDLESS_M: f32 = 64.0;

/// Subdivides edges longer than 0.5 m.
fn cut(mesh: &Mesh) -> Mesh {
    let vertices = Mesh {
        positions: mesh.positions.clone(),
        uvs: mesh.uvs.clone(),
        colors: mesh.colors.clone(),
        ..Mesh::default()
    };
    let mut cutter = Cutter { mesh: vertices, middle_of: BTreeMap::new() };
    let mut open = Vec::new();
    for (index, &triangle) in mesh.triangles.iter().enumerate() {
        open.push(triangle);
        while let Some(triangle) = open.pop() {
            match cutter.halves(triangle) {
                Some(halves) => open.extend(halves),
                None => cutter.mesh.triangles.push(triangle),
            }
        }
        cutter.mesh.material_of.resize(cutter.mesh.triangles.len(), mesh.material_of[index]);
        cutter.mesh.instance_of.resize(cutter.mesh.triangles.len(), mesh.instance_of[index]);
    }
    cutter.mesh
}

struct Cutter {
    mesh: Mesh,
    /// Middle vertex by edge, the smaller end first.
    middle_of: BTreeMap<[u32; 2], u32>,
}

impl Cutter {
    /// Splits a triangle at its longest edge; `None` without a long edge.
    fn halves(&mut self, [a, b, c]: [u32; 3]) -> Option<[[u32; 3]; 2]> {
        let edges = [[a, b, c], [b, c, a], [c, a, b]];
        let lengths = edges.map(|[from, to, _]| self.length_to_cut(from, to));
        let longest = (0..3).max_by(|&i, &k| lengths[i].total_cmp(&lengths[k]))?;
        if lengths[longest] == 0.0 {
            return None;
        }
        let [from, to, apex] = edges[longest];
        let middle = self.middle(from, to);
        Some([[middle, to, apex], [from, middle, apex]])
    }

    /// Squared edge length, metres squared; 0 if it stays whole.
    fn length_to_cut(&self, from: u32, to: u32) -> f32 {
        let place = |vertex: u32| -> Point3<f32> { self.mesh.positions[vertex as usize] };
        let length = (place(from) - place(to)).norm_squared();
        let cuts = length > LONGEST_M * LONGEST_M && length < ENDLESS_M * ENDLESS_M;
        if cuts { length } else { 0.0 }
    }

    fn middle(&mut self, from: u32, to: u32) -> u32 {
        let mesh = &mut self.mesh;
        *self.middle_of.entry([from.min(to), from.max(to)]).or_insert_with(|| {
            let [from, to] = [from, to].map(|vertex| vertex as usize);
            // Depends only on the end points, so both neighbours of an edge split it alike and stay adjacent.
            let position = (mesh.positions[from].coords + mesh.positions[to].coords) * 0.5;
            let uv = (mesh.uvs[from].coords + mesh.uvs[to].coords) * 0.5;
            mesh.positions.push(position.into());
            mesh.uvs.push(uv.into());
            mesh.colors.push(mesh.colors[from]);
            mesh.positions.len() as u32 - 1
        })
    }
}

/// Cosine of the largest angle in a smooth transition, 50 degrees.
const SMOOTH: f32 = 0.643;
/// Exposure before the tone curve.
const EXPOSURE: f32 = 2.8;
/// Exposed light that shows the surface colour unchanged.
const WHITE: f32 = 6.0;
/// Iterations of borrowing light from neighbours.
const ROUNDS: usize = 2;
// Too small to change a mean with real samples, but enough to be used without one.
const BORROWED: f32 = 1e-6;

/// A position's bits.
type PositionKey = [u32; 3];

/// Colours the corners of `mesh`. Vertices at light discontinuities are split.
fn spread(samples: Vec<Sample>, mesh: &mut Mesh) {
    let colors = corner_colors(samples, mesh);
    let mut painter = Painter::new(mesh.positions.len());
    for (triangle, colors) in mesh.triangles.iter_mut().zip(colors.as_chunks::<3>().0) {
        for (corner, color) in triangle.iter_mut().zip(colors) {
            *corner = painter.vertex(*corner, *color);
        }
    }
    mesh.positions = painter.source.iter().map(|&vertex| mesh.positions[vertex as usize]).collect();
    mesh.uvs = painter.source.iter().map(|&vertex| mesh.uvs[vertex as usize]).collect();
    mesh.colors = painter.colors;
}

/// Vertices by original vertex and colour.
struct Painter {
    /// Newest copy by original vertex, and previous copy by copy.
    newest: Vec<u32>,
    before: Vec<u32>,
    /// Original vertex by copy.
    source: Vec<u32>,
    colors: Vec<[u8; 3]>,
}

const NONE: u32 = u32::MAX;

impl Painter {
    fn new(vertices: usize) -> Self {
        let with_room = || Vec::with_capacity(vertices + vertices / 4);
        Self { newest: vec![NONE; vertices], before: with_room(), source: with_room(), colors: Vec::new() }
    }

    fn vertex(&mut self, old: u32, color: [u8; 3]) -> u32 {
        let mut at = self.newest[old as usize];
        while at != NONE && self.colors[at as usize] != color {
            at = self.before[at as usize];
        }
        if at == NONE {
            at = self.source.len() as u32;
            self.before.push(self.newest[old as usize]);
            self.source.push(old);
            self.colors.push(color);
            self.newest[old as usize] = at;
        }
        at
    }
}

/// Returns three colours per triangle.
fn corner_colors(mut samples: Vec<Sample>, mesh: &Mesh) -> Vec<[u8; 3]> {
    let mut corners = placed_corners(mesh);
    corners.sort_unstable();
    (0..ROUNDS).for_each(|_| borrow(&mut samples, &corners));
    let mut colors = vec![[0; 3]; corners.len()];
    let mut around = Vec::new();
    for group in corners.chunk_by(|(a, _), (b, _)| a == b) {
        around.clear();
        around.extend(group.iter().map(|&(_, corner)| samples[corner as usize / 3]));
        for &(_, corner) in group {
            let light = mean_light(&around, &samples[corner as usize / 3].normal);
            colors[corner as usize] = light.unwrap_or([LEAST; 3]).map(shown);
        }
    }
    colors
}

/// Returns the triangle corners with their positions.
fn placed_corners(mesh: &Mesh) -> Vec<(PositionKey, u32)> {
    let key = |vertex: u32| {
        let place = mesh.positions[vertex as usize];
        // Adding 0 makes -0 and 0 equal.
        [place.x, place.y, place.z].map(|value| (value + 0.0).to_bits())
    };
    mesh.triangles.iter().flatten().zip(0..).map(|(&vertex, corner)| (key(vertex), corner)).collect()
}

/// Lets covered samples borrow light from neighbours.
fn borrow(samples: &mut [Sample], corners: &[(PositionKey, u32)]) {
    let mut found: BTreeMap<u32, Vec<Sample>> = BTreeMap::new();
    for group in corners.chunk_by(|(a, _), (b, _)| a == b) {
        let triangles = || group.iter().map(|(_, corner)| corner / 3);
        for covered in triangles().filter(|&triangle| samples[triangle as usize].weight == 0.0) {
            let known = triangles().map(|triangle| samples[triangle as usize]).filter(|s| s.weight > 0.0);
            found.entry(covered).or_default().extend(known);
        }
    }
    for (triangle, around) in found {
        let sample = &mut samples[triangle as usize];
        if let Some(light) = mean_light(&around, &sample.normal) {
            (sample.light, sample.weight) = (light, BORROWED);
        }
    }
}

/// Returns the mean over smoothly adjacent samples; `None` without any.
fn mean_light(around: &[Sample], normal: &Vector3<f32>) -> Option<[f32; 3]> {
    let (mut light, mut weight) = ([0.0; 3], 0.0);
    for sample in around.iter().filter(|sample| sample.normal.dot(normal) > SMOOTH) {
        weight += sample.weight;
        for (sum, channel) in light.iter_mut().zip(sample.light) {
            *sum += channel * sample.weight;
        }
    }
    (weight > 0.0).then(|| light.map(|channel| channel / weight))
}

/// Returns the factor on a surface's sRGB colour, 0 to 255: Reinhard's extended curve (2002) up to the white
/// point, then a gamma of 2.
fn shown(light: f32) -> u8 {
    let exposed = EXPOSURE * light;
    let compressed = exposed * (1.0 + exposed / (WHITE * WHITE)) / (1.0 + exposed);
    (255.0 * compressed.sqrt()).round().clamp(0.0, 255.0) as u8
}

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
const LEAST: f32 = 0.15;

/// A triangle's light.
#[derive(Clone, Copy, Debug)]
struct Sample {
    /// Unit normal; zero for degenerate triangles.
    normal: Vector3<f32>,
    /// Uncovered area, square metres.
    weight: f32,
    /// RGB; 1 is the indirect light in the open.
    light: [f32; 3],
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
fn samples(coarse: &Mesh, rays: &RayMesh, lamps: &[Lamp], fine: &Mesh) -> Vec<Sample> {
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
