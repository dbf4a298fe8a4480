//! Cuts large triangles, so that light can change across them.

use avln_geom::Point3;
use avln_scene::Mesh;
use std::collections::BTreeMap;

/// Longer edges are halved, metres.
const LONGEST_M: f32 = 0.5;
/// Edges that are longer still belong to no room and stay whole, metres.
const ENDLESS_M: f32 = 64.0;

/// Subdivides edges longer than 0.4 m. The split depends only on the end points, so adjacent triangles stay
/// adjacent.
pub(super) fn cut(mesh: &Mesh) -> Mesh {
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
    /// The vertex in the middle of an edge, by the ends of the edge, the smaller first.
    middle_of: BTreeMap<[u32; 2], u32>,
}

impl Cutter {
    /// Splits a triangle at its longest edge; `None` if no edge is split.
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

    /// Squared length of an edge, metres squared; 0 if it is not split.
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
            let position = (mesh.positions[from].coords + mesh.positions[to].coords) * 0.5;
            let uv = (mesh.uvs[from].coords + mesh.uvs[to].coords) * 0.5;
            mesh.positions.push(position.into());
            mesh.uvs.push(uv.into());
            mesh.colors.push(mesh.colors[from]);
            mesh.positions.len() as u32 - 1
        })
    }
}
