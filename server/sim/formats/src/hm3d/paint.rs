//! From painted colours to instance numbers.

use super::annotations::Annotation;
use crate::Report;
use crate::glb::Model;
use avln_scene::describe::{inner_points, texel_at};
use std::collections::{BTreeMap, BTreeSet};

/// What triangles without an instance are painted in.
const BLACK: [u8; 3] = [0; 3];

/// The instance number of each triangle of the semantic mesh, 0 where its colour is not in the table; colours that are
/// not there, and numbers that no triangle has, are reported.
///
/// Texels are taken as they are, without filters or conversion: only exact colours mean something. Where the points
/// looked at disagree (paint seams run across triangles), the most frequent number wins, the centre's in a tie.
pub(super) fn labels(semantic: &Model, annotations: &[Annotation], report: &mut Report) -> Vec<u32> {
    let mut number_of: BTreeMap<[u8; 3], u32> = BTreeMap::new();
    for annotation in annotations {
        let first = *number_of.entry(annotation.color).or_insert(annotation.id);
        if first != annotation.id {
            report.warn(format!(
                "instances {first} and {} have the same colour; all of it is {first}",
                annotation.id
            ));
        }
    }
    let mut strange = BTreeSet::new();
    let labels: Vec<u32> = (0..semantic.mesh.triangles.len())
        .map(|triangle| {
            let colors = colors(semantic, triangle);
            let label = label(&colors, &number_of);
            if label.is_none() && colors[0] != BLACK {
                strange.insert(colors[0]);
            }
            label.unwrap_or(0)
        })
        .collect();
    if let Some([r, g, b]) = strange.first() {
        report.warn(format!(
            "{} painted colours are not in the table, {r:02X}{g:02X}{b:02X} for one; their surfaces have no label",
            strange.len()
        ));
    }
    let seen: BTreeSet<u32> = labels.iter().copied().collect();
    let absent = annotations.iter().filter(|annotation| !seen.contains(&annotation.id)).count();
    if absent > 0 {
        report.warn(format!("{absent} instances of the table have no surface; left out"));
    }
    labels
}

/// The colours at the centre of a triangle and towards its corners.
fn colors(semantic: &Model, triangle: usize) -> [[u8; 3]; 4] {
    let material = &semantic.materials[usize::from(semantic.mesh.material_of[triangle])];
    let Some(texture) = material.texture.map(|texture| &semantic.textures[usize::from(texture)]) else {
        let [r, g, b, _] = material.base_color;
        return [[r, g, b]; 4];
    };
    let uvs = semantic.mesh.triangles[triangle].map(|corner| semantic.mesh.uvs[corner as usize]);
    inner_points(&uvs).map(|uv| {
        let [r, g, b, _] = texel_at(texture, &uv);
        [r, g, b]
    })
}

fn label(colors: &[[u8; 3]; 4], number_of: &BTreeMap<[u8; 3], u32>) -> Option<u32> {
    let votes = colors.map(|color| number_of.get(&color).copied());
    let count = |candidate: &u32| votes.iter().filter(|vote| **vote == Some(*candidate)).count();
    // The last of equal maxima wins, and the centre comes last in reverse order.
    votes.iter().rev().flatten().copied().max_by_key(count)
}
