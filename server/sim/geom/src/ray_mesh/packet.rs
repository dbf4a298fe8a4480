//! Four triangles that are tested against a ray at once.

use super::tree::WIDTH;
use crate::{Point3, Vector3};

/// A value for each of four triangles.
type Lanes = [f32; WIDTH];

/// Up to four triangles, each a corner and the two edges that leave it; unused lanes are degenerate.
#[derive(Clone, Debug)]
pub(super) struct Packet {
    origin: [Lanes; 3],
    edge_u: [Lanes; 3],
    edge_v: [Lanes; 3],
    /// Index of each triangle in the mesh.
    pub(super) triangles: [u32; WIDTH],
    /// Number of used lanes.
    pub(super) len: u8,
}

/// Hits of a ray on four triangles; infinite distance for a miss.
pub(super) struct PacketHits {
    pub(super) distance: Lanes,
    pub(super) u: Lanes,
    pub(super) v: Lanes,
}

impl Packet {
    /// Packs the triangles `members` with corners from `corners`.
    pub(super) fn new(members: &[u32], corners: impl Fn(u32) -> [Point3<f32>; 3]) -> Self {
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
            put(&mut packet.origin, lane, &a.coords);
            put(&mut packet.edge_u, lane, &(b - a));
            put(&mut packet.edge_v, lane, &(c - a));
            packet.triangles[lane] = triangle;
        }
        packet
    }

    /// Distances and barycentric weights of the hits (Möller and Trumbore 1997, both sides).
    #[inline]
    pub(super) fn intersect(&self, origin: &[Lanes; 3], direction: &[Lanes; 3]) -> PacketHits {
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

fn put(lanes: &mut [Lanes; 3], lane: usize, vector: &Vector3<f32>) {
    for axis in 0..3 {
        lanes[axis][lane] = vector[axis];
    }
}

/// Copies the vector into every lane.
pub(super) fn splat(vector: &Vector3<f32>) -> [Lanes; 3] {
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
