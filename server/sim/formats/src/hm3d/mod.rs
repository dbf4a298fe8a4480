//! HM3D scenes with semantics: `X.glb` (Z up), `X.semantic.glb` (instances painted in colours) and `X.semantic.txt`
//! (colour to category and region). The result has the triangles in `X.glb`, turned Y up.

mod export;
mod table;
#[cfg(test)]
mod tests;

use crate::files::scene_name;
use crate::files::{Checked, malformed, read_regular};
use crate::glb;
use crate::hm3d::table::InstanceAnnotation;
use crate::labels::transfer;
use crate::named_model::Model;
use crate::options::ImportReport;
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Meaning, Surfaces, inner_points, meaning, storeys, texel_at};
use avln_scene::{Attributes, InstanceId, Lighting, Mesh, Object, Region, Scene, SceneError};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub use export::{Exported, dataset_config, export};

const SEMANTIC_MESH: &str = ".semantic.glb";
const SEMANTIC_TABLE: &str = ".semantic.txt";
/// Render meshes, the preferred first; the second has `.basis` textures, in the archives for Habitat.
const RENDER_MESHES: [&str; 2] = [".glb", ".basis.glb"];
const MAX_TABLE_BYTES: u64 = 16 << 20;

/// A scene's files.
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
/// Instances have the table's numbers. Categories become mpcat40 names if possible; structure (walls, floors, doors,
/// windows …) is no object, but stays in the mesh.
///
/// # Errors
/// [`SceneError::Read`] if a file cannot be read; [`SceneError::Malformed`] if a file is damaged, or semantics are missing.
pub fn import(folder_or_glb: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let files = files(folder_or_glb).ok_or_else(|| {
        malformed(folder_or_glb, "X.glb, X.semantic.glb or X.semantic.txt is missing; add the semantic files of HM3D, or open the .glb without them")
    })?;
    let annotations = read_annotations(&files.table)?;
    let mut render = glb::read_model(&files.render, report)?;
    let semantic = glb::read_model(&files.semantic, report)?;
    turn_y_up(&mut render.mesh);
    let labels = painted_labels(&semantic, &annotations, report);
    let mut painted = semantic.mesh;
    turn_y_up(&mut painted);
    let labels = transfer(&painted, &labels, &render.mesh);
    scene(scene_name(&files.render), render, &labels, &annotations)
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
    table::parse(&String::from_utf8_lossy(&bytes)).map_err(|reason| malformed(table, reason))
}

/// Converts HM3D's frame, with gravity in direction -Z, to the world frame: (x, y, z) becomes (x, z, -y).
fn turn_y_up(mesh: &mut Mesh) {
    for position in &mut mesh.positions {
        *position = Point3::new(position.x, position.z, -position.y);
    }
}

/// Joins mesh and table; `labels` are instance numbers per triangle, 0 for none.
fn scene(name: String, render: Model, labels: &[u32], annotations: &[InstanceAnnotation]) -> Checked<Scene> {
    let Model { mut mesh, materials, textures, .. } = render;
    let mut triangles_of: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (triangle, &label) in labels.iter().enumerate() {
        triangles_of.entry(label).or_default().push(triangle as u32);
    }
    let bounds_of: BTreeMap<u32, Aabb> = triangles_of
        .iter()
        .filter_map(|(&label, triangles)| Some((label, bounds(&mesh, triangles)?)))
        .collect();
    let (regions, region_of) = regions(annotations, &bounds_of)?;
    let surfaces = Surfaces { mesh: &mesh, materials: &materials, textures: &textures };
    let mut objects = Vec::new();
    for annotation in annotations {
        let (Meaning::Object { category, noun }, Some(&bounds)) =
            (meaning(&annotation.category), bounds_of.get(&annotation.id))
        else {
            continue;
        };
        objects.push(Object {
            id: InstanceId(annotation.id),
            category,
            bounds,
            region: region_of.get(&annotation.region).copied(),
            attributes: Attributes { noun, ..surfaces.attributes(&triangles_of[&annotation.id], &bounds) },
        });
    }
    objects.sort_by_key(|object| object.id);
    for object in &objects {
        triangles_of[&object.id.0]
            .iter()
            .for_each(|&triangle| mesh.instance_of[triangle as usize] = object.id);
    }
    Ok(Scene { name, mesh, materials, textures, regions, objects, lighting: Lighting::Painted })
}

fn bounds(mesh: &Mesh, triangles: &[u32]) -> Option<Aabb> {
    let corners = triangles.iter().flat_map(|&triangle| mesh.triangles[triangle as usize]);
    let positions: Vec<Point3<f32>> = corners.map(|corner| mesh.positions[corner as usize]).collect();
    Aabb::around(&positions)
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

/// Colour for triangles without an instance.
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
