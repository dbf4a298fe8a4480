use avln_geom::Point3;
use avln_scene::{Mesh, Scene};
use std::collections::BTreeMap;

/// The scene with edges halved until it has at least `least` triangles. Shared edges are halved in both
/// triangles, so the surface stays closed.
pub(crate) fn refined(scene: Scene, least: usize) -> Scene {
    let mut longest_m = 1.0;
    loop {
        let mesh = halved(&scene.mesh, longest_m);
        if mesh.triangles.len() >= least {
            return Scene { mesh, ..scene };
        }
        longest_m *= 0.95;
    }
}

/// The mesh without edges longer than `longest_m`, by repeated halving of the longest edge.
fn halved(mesh: &Mesh, longest_m: f32) -> Mesh {
    let mut fine = Mesh { triangles: vec![], material_of: vec![], instance_of: vec![], ..mesh.clone() };
    let mut middles: BTreeMap<[u32; 2], u32> = BTreeMap::new();
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let mut waiting = vec![*triangle];
        while let Some(triangle) = waiting.pop() {
            let length = |i: usize| {
                let at = |corner: u32| fine.positions[corner as usize];
                (at(triangle[i]) - at(triangle[(i + 1) % 3])).norm()
            };
            let edge = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
            if length(edge) <= longest_m {
                fine.triangles.push(triangle);
                fine.material_of.push(mesh.material_of[index]);
                fine.instance_of.push(mesh.instance_of[index]);
                continue;
            }
            let [a, b, c] = [0, 1, 2].map(|i| triangle[(edge + i) % 3]);
            let key = [a.min(b), a.max(b)];
            let middle = *middles.entry(key).or_insert_with(|| add_middle(&mut fine, key));
            waiting.extend([[a, middle, c], [middle, b, c]]);
        }
    }
    fine
}

fn add_middle(mesh: &mut Mesh, [a, b]: [u32; 2]) -> u32 {
    let (a, b) = (a as usize, b as usize);
    let half = |p: u8, q: u8| ((u16::from(p) + u16::from(q)) / 2) as u8;
    let position = Point3::from((mesh.positions[a].coords + mesh.positions[b].coords) * 0.5);
    let uv = mesh.uvs[a] + (mesh.uvs[b] - mesh.uvs[a]) * 0.5;
    let color = std::array::from_fn(|i| half(mesh.colors[a][i], mesh.colors[b][i]));
    mesh.positions.push(position);
    mesh.uvs.push(uv);
    mesh.colors.push(color);
    mesh.positions.len() as u32 - 1
}
