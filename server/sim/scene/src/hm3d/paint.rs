//! From painted colours to instance numbers.

use super::annotations::Annotation;
use crate::describe::{inner_points, texel_at};
use crate::glb::Model;
use std::collections::BTreeMap;

/// The instance number of each triangle of the semantic mesh, 0 where its colour is not in the table.
///
/// Texels are taken as they are, without filters or conversion: only exact colours mean something. Where the points
/// looked at disagree (paint seams run across triangles), the most frequent number wins, the centre's in a tie.
pub(super) fn labels(semantic: &Model, annotations: &[Annotation]) -> Vec<u32> {
    let mut number_of: BTreeMap<[u8; 3], u32> = BTreeMap::new();
    for annotation in annotations {
        number_of.entry(annotation.color).or_insert(annotation.id);
    }
    (0..semantic.mesh.triangles.len())
        .map(|triangle| label(semantic, &number_of, triangle).unwrap_or(0))
        .collect()
}

fn label(semantic: &Model, number_of: &BTreeMap<[u8; 3], u32>, triangle: usize) -> Option<u32> {
    let material = &semantic.materials[usize::from(semantic.mesh.material_of[triangle])];
    let texture = &semantic.textures[usize::from(material.texture?)];
    let uvs = semantic.mesh.triangles[triangle].map(|corner| semantic.mesh.uvs[corner as usize]);
    let votes = inner_points(&uvs).map(|uv| {
        let [r, g, b, _] = texel_at(texture, &uv);
        number_of.get(&[r, g, b]).copied()
    });
    let count = |candidate: &u32| votes.iter().filter(|vote| **vote == Some(*candidate)).count();
    // The last of equal maxima wins, and the centre comes last in reverse order.
    votes.iter().rev().flatten().copied().max_by_key(count)
}
