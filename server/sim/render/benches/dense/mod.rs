//! A scan-like scene: a procedural house cut into small triangles with 3 mm noise, under an atlas with
//! sixteen textures, 1024 by 1024 texels, a centimetre per texel.

use avln_geom::{Point2, Point3, Rng, Vector3};
use avln_houses::{HouseOptions, house};
use avln_scene::{Lighting, Material, Mesh, Scene, Texture};
use std::collections::BTreeMap;

const NOISE_M: f32 = 0.003;
const TEXTURES: u16 = 16;
const TEXTURE_SIDE: u32 = 1024;
const TEXELS_PER_M: f32 = 100.0;

/// A house with at least `triangles` triangles.
pub(crate) fn scan(triangles: usize) -> Scene {
    let mut scene = house("bench", 7, &HouseOptions::default());
    let mut longest_m = 1.0;
    let mut mesh = cut(&scene.mesh, longest_m);
    while mesh.triangles.len() < triangles {
        longest_m *= 0.93;
        mesh = cut(&scene.mesh, longest_m);
    }
    scene.mesh = mesh;
    scene.lighting = Lighting::Painted;
    paint(&mut scene);
    scene
}

/// The mesh with edges no longer than `longest_m`.
fn cut(mesh: &Mesh, longest_m: f32) -> Mesh {
    let mut out = Mesh::default();
    let mut number_of = BTreeMap::new();
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let mut open = vec![triangle.map(|corner| mesh.positions[corner as usize])];
        while let Some([a, b, c]) = open.pop() {
            let lengths = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
            let most = lengths.iter().copied().fold(0.0, f32::max);
            if most > longest_m {
                let [a, b, c] = if most == lengths[0] {
                    [a, b, c]
                } else if most == lengths[1] {
                    [b, c, a]
                } else {
                    [c, a, b]
                };
                let middle = Point3::from((a.coords + b.coords) / 2.0);
                open.extend([[a, middle, c], [middle, b, c]]);
                continue;
            }
            let normal = (b - a).cross(&(c - a));
            let corners = [a, b, c].map(|point| corner(&mut out, &mut number_of, point, &normal));
            out.triangles.push(corners);
            out.material_of.push(material_at(&a));
            out.instance_of.push(mesh.instance_of[index]);
        }
    }
    out
}

fn material_at(point: &Point3<f32>) -> u16 {
    (((point.x / 5.0).floor() * 7.0 + (point.z / 5.0).floor() * 3.0) as i32).rem_euclid(i32::from(TEXTURES))
        as u16
}

fn corner(
    out: &mut Mesh,
    number_of: &mut BTreeMap<([u32; 3], usize), u32>,
    point: Point3<f32>,
    normal: &Vector3<f32>,
) -> u32 {
    let axis = normal.iamax();
    *number_of.entry(([point.x, point.y, point.z].map(f32::to_bits), axis)).or_insert_with(|| {
        let [u, v] = [[2, 1], [0, 2], [0, 1]][axis].map(|axis: usize| point[axis]);
        let bits = point.iter().fold(1_u64, |seed, value| seed * 31 + u64::from(value.to_bits()));
        let mut rng = Rng::new(bits);
        let noise = Vector3::from_fn(|_, _| rng.range(-NOISE_M, NOISE_M));
        out.positions.push(point + noise);
        out.uvs.push(Point2::new(u, v) * (TEXELS_PER_M / TEXTURE_SIDE as f32));
        out.colors.push([255; 3]);
        out.positions.len() as u32 - 1
    })
}

fn paint(scene: &mut Scene) {
    let mut rng = Rng::new(5);
    scene.textures = (0..TEXTURES)
        .map(|_| {
            let pixels = (0..TEXTURE_SIDE * TEXTURE_SIDE)
                .flat_map(|_| (rng.range(0.0, 16_777_216.0) as u32 | 0xff00_0000).to_le_bytes())
                .collect();
            Texture { width: TEXTURE_SIDE, height: TEXTURE_SIDE, pixels }
        })
        .collect();
    scene.materials = (0..TEXTURES)
        .map(|index| Material {
            name: "scan".into(),
            base_color: [255; 4],
            texture: Some(index),
            alpha_cutoff: None,
        })
        .collect();
}
