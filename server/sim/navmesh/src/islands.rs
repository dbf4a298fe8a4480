//! Connected parts of the mesh.

use crate::plane::{Spot, turn};
use crate::polygons::{NONE, Polygons};
use avln_geom::Rng;

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
