//! From light on triangles to colours of their corners.

use super::gather::{LEAST, Sample};
use avln_geom::Vector3;
use avln_scene::Mesh;
use std::collections::BTreeMap;

/// Largest angle of a smooth transition, 50 degrees: the cosine.
const SMOOTH: f32 = 0.643;
/// Exposure before the tone curve.
const EXPOSURE: f32 = 2.8;
/// Exposed light that shows a surface in its own colour.
const WHITE: f32 = 6.0;
/// Iterations in which covered triangles borrow light from neighbours.
const ROUNDS: usize = 2;
/// Weight of a triangle with borrowed light.
const BORROWED: f32 = 1e-6;

/// A key that is the same for the same place.
type Place = [u32; 3];

/// Colours every corner of `mesh` from the triangle `samples`. Vertices at light discontinuities are split.
pub(super) fn spread(samples: Vec<Sample>, mesh: &mut Mesh) {
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

/// Creates a vertex per pair of old vertex and colour.
struct Painter {
    /// The newest copy of every old vertex, and for every copy the previous copy.
    newest: Vec<u32>,
    before: Vec<u32>,
    /// Old vertex and colour of every new vertex.
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

/// Three colours for each triangle.
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

/// Every triangle corner with its position.
fn placed_corners(mesh: &Mesh) -> Vec<(Place, u32)> {
    let key = |vertex: u32| {
        let place = mesh.positions[vertex as usize];
        // Adding 0 makes -0 and 0 the same.
        [place.x, place.y, place.z].map(|value| (value + 0.0).to_bits())
    };
    mesh.triangles.iter().flatten().zip(0..).map(|(&vertex, corner)| (key(vertex), corner)).collect()
}

/// Covered samples borrow light from their neighbours: part of the triangle may still be visible.
fn borrow(samples: &mut [Sample], corners: &[(Place, u32)]) {
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

/// The mean of those samples that go on smoothly from a surface with this normal; `None` without any.
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

/// The factor of a surface's sRGB colour, 0 to 255, for some light: Reinhard's extended curve (2002) up to the white point,
/// then a gamma of 2.
fn shown(light: f32) -> u8 {
    let exposed = EXPOSURE * light;
    let compressed = exposed * (1.0 + exposed / (WHITE * WHITE)) / (1.0 + exposed);
    (255.0 * compressed.sqrt()).round().clamp(0.0, 255.0) as u8
}
