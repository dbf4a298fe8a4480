//! HM3D scenes with semantics: `X.glb` (Z up), `X.semantic.glb` (instances painted in colours) and `X.semantic.txt`
//! (colour to category and region). The result has the triangles in `X.glb`, turned Y up.

mod layout;
#[cfg(test)]
mod tests;

use crate::files::{Checked, ImportReport, malformed, read_regular, scene_name};
use crate::glb;
use crate::hm3d::layout::{InstanceAnnotation, parse};
use crate::labels::{self, ObjectLabel, UnlabelledSurfaces, transfer};
use crate::named_model::Model;
use crate::world_frame::{FileFrame, UpAxis};
use avln_geom::Aabb;
use avln_scene::describe::{inner_points, storeys, texel_at};
use avln_scene::{Region, Scene, SceneError};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub use layout::{Exported, dataset_config, export};

const SEMANTIC_MESH: &str = ".semantic.glb";
const SEMANTIC_TABLE: &str = ".semantic.txt";
/// Render meshes, the preferred first; the second has `.basis` textures, in the archives for Habitat.
const RENDER_MESHES: [&str; 2] = [".glb", ".basis.glb"];
const MAX_TABLE_BYTES: u64 = 16 << 20;

struct Hm3dFiles {
    render: PathBuf,
    semantic: PathBuf,
    table: PathBuf,
}

/// Returns whether `path` is an HM3D scene folder with semantics, or a mesh in it.
pub(crate) fn is_hm3d(path: &Path) -> bool {
    files(path).is_some()
}

/// Imports a folder (`00800-TEEsavR23oF`), or a `.glb` with semantic files next to it.
///
/// Instances have the table's numbers; structure (walls, floors, doors, windows …) is no object, but stays in the mesh.
pub(crate) fn import(folder_or_glb: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let files = files(folder_or_glb).ok_or_else(|| {
        malformed(folder_or_glb, "X.glb, X.semantic.glb or X.semantic.txt is missing; add the semantic files of HM3D, or open the .glb without them")
    })?;
    let annotations = read_annotations(&files.table)?;
    let mut render = glb::read_model(&files.render, report)?;
    let mut semantic = glb::read_model(&files.semantic, report)?;
    let frame = FileFrame { up: UpAxis::Z, metres: 1.0 };
    frame.apply(&mut render.mesh);
    let painted = painted_labels(&semantic, &annotations, report);
    frame.apply(&mut semantic.mesh);
    let label_of = transfer(&semantic.mesh, &painted, &render.mesh);
    let surfaces =
        UnlabelledSurfaces { mesh: render.mesh, materials: render.materials, textures: render.textures };
    scene(scene_name(&files.render), surfaces, &label_of, &annotations, report)
        .map_err(|reason| malformed(&files.table, reason))
}

/// Scene files for a mesh or folder; for several scenes in a folder, the first by name.
fn files(path: &Path) -> Option<Hm3dFiles> {
    let (folder, stem) =
        if path.is_dir() { (path, first_stem(path)?) } else { (path.parent()?, stem_of_mesh(path)?) };
    let file = |suffix: &str| folder.join(format!("{stem}{suffix}"));
    let render = RENDER_MESHES.iter().map(|suffix| file(suffix)).find(|render| render.is_file())?;
    let found = Hm3dFiles { render, semantic: file(SEMANTIC_MESH), table: file(SEMANTIC_TABLE) };
    (found.semantic.is_file() || found.table.is_file()).then_some(found)
}

fn first_stem(folder: &Path) -> Option<String> {
    let names =
        std::fs::read_dir(folder).ok()?.filter_map(|entry| entry.ok()?.file_name().into_string().ok());
    names.filter_map(|name| name.strip_suffix(SEMANTIC_MESH).map(str::to_owned)).min()
}

fn stem_of_mesh(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    let suffixes = [SEMANTIC_MESH, ".basis.glb", ".glb"];
    suffixes.iter().find_map(|suffix| name.strip_suffix(suffix)).map(str::to_owned)
}

fn read_annotations(table: &Path) -> Result<Vec<InstanceAnnotation>, SceneError> {
    let bytes = read_regular(table, MAX_TABLE_BYTES)?;
    parse(&String::from_utf8_lossy(&bytes)).map_err(|reason| malformed(table, reason))
}

/// Joins mesh and table; `label_of` are instance numbers per triangle, 0 for none.
fn scene(
    name: String,
    surfaces: UnlabelledSurfaces,
    label_of: &[u32],
    annotations: &[InstanceAnnotation],
    report: &mut ImportReport,
) -> Checked<Scene> {
    let bounds_of = labels::bounds_of(&surfaces.mesh, label_of);
    let (regions, index_of) = regions(annotations, &bounds_of)?;
    // Instances without a surface are left out here: `painted_labels` has counted them in its warning.
    let listed = annotations.iter().filter(|annotation| bounds_of.contains_key(&annotation.id));
    let label = |annotation: &InstanceAnnotation| ObjectLabel {
        region: index_of.get(&annotation.region).copied(),
        ..ObjectLabel::of_words(annotation.id, &annotation.category)
    };
    let labels: Vec<ObjectLabel> = listed.map(label).collect();
    Ok(labels::scene(name, surfaces, label_of, &labels, regions, report))
}

/// Rooms in number order, and their indices by number. A room is the box around the instances; rooms without
/// instances are left out.
fn regions(
    annotations: &[InstanceAnnotation],
    bounds_of: &BTreeMap<u32, Aabb>,
) -> Checked<(Vec<Region>, BTreeMap<i32, u16>)> {
    let mut boxes: BTreeMap<i32, Aabb> = BTreeMap::new();
    for annotation in annotations.iter().filter(|annotation| annotation.region >= 0) {
        let Some(bounds) = bounds_of.get(&annotation.id) else { continue };
        boxes.entry(annotation.region).and_modify(|room| *room = room.union(bounds)).or_insert(*bounds);
    }
    let storeys = storeys(&boxes.values().map(|room| room.min.y).collect::<Vec<_>>());
    let mut regions = Vec::new();
    let mut index_of = BTreeMap::new();
    for ((number, bounds), storey) in boxes.into_iter().zip(storeys) {
        let index = u16::try_from(regions.len()).map_err(|_| "it has more than 65536 regions".to_owned())?;
        index_of.insert(number, index);
        regions.push(Region { label: String::new(), bounds, storey });
    }
    Ok((regions, index_of))
}

const BLACK: [u8; 3] = [0; 3];

/// Returns instance numbers per semantic triangle, 0 for colours outside the table; warns about unknown colours,
/// and about numbers without triangles.
fn painted_labels(
    semantic: &Model,
    annotations: &[InstanceAnnotation],
    report: &mut ImportReport,
) -> Vec<u32> {
    let mut number_of: BTreeMap<[u8; 3], u32> = BTreeMap::new();
    for annotation in annotations {
        let first = *number_of.entry(annotation.color).or_insert(annotation.id);
        if first != annotation.id {
            report.warn(format!(
                "instances {first} and {} have the same colour; all of it is instance {first}",
                annotation.id
            ));
        }
    }
    let mut unknown = BTreeSet::new();
    let labels: Vec<u32> = (0..semantic.mesh.triangles.len())
        .map(|triangle| {
            let colors = painted_colors(semantic, triangle);
            let label = most_frequent(&colors, &number_of);
            if label.is_none() && colors[0] != BLACK {
                unknown.insert(colors[0]);
            }
            label.unwrap_or(0)
        })
        .collect();
    if let Some([r, g, b]) = unknown.first() {
        report.warn(format!(
            "{} painted colours are not in the table, for example {r:02X}{g:02X}{b:02X}; their surfaces have no label",
            unknown.len()
        ));
    }
    let seen: BTreeSet<u32> = labels.iter().copied().collect();
    let absent = annotations.iter().filter(|annotation| !seen.contains(&annotation.id)).count();
    if absent > 0 {
        report.warn(format!("{absent} instances of the table have no surface; left out"));
    }
    labels
}

/// Colours at a triangle's centre, and half-way to the corners.
fn painted_colors(semantic: &Model, triangle: usize) -> [[u8; 3]; 4] {
    let material = &semantic.materials[usize::from(semantic.mesh.material_of[triangle])];
    let Some(texture) = material.texture.map(|texture| &semantic.textures[usize::from(texture)]) else {
        let [r, g, b, _] = material.base_color;
        return [[r, g, b]; 4];
    };
    let uvs = semantic.mesh.triangles[triangle].map(|corner| semantic.mesh.uvs[corner as usize]);
    // Without filters or colour conversion: only exact colours have a meaning.
    inner_points(&uvs).map(|uv| {
        let [r, g, b, _] = texel_at(texture, &uv);
        [r, g, b]
    })
}

fn most_frequent(colors: &[[u8; 3]; 4], number_of: &BTreeMap<[u8; 3], u32>) -> Option<u32> {
    let votes = colors.map(|color| number_of.get(&color).copied());
    let count = |candidate: &u32| votes.iter().filter(|vote| **vote == Some(*candidate)).count();
    // Paint seams run across triangles: the most frequent number wins, the centre's in a tie. `max_by_key` returns the last
    // maximum, and the centre is the last in reverse order.
    votes.iter().rev().flatten().copied().max_by_key(count)
}
