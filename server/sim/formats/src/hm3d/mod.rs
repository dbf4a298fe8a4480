//! HM3D scenes with semantics: `X.glb` (Z up), `X.semantic.glb` (instances painted in colours) and `X.semantic.txt`
//! (colour to category and region). The result has the triangles of `X.glb`, turned Y up.

mod annotations;
mod export;
mod paint;
mod regions;

use crate::files::Checked;
use crate::glb::{self, Model, read_limited};
use crate::{Report, bake};
use annotations::Annotation;
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Meaning, Surfaces, meaning};
use avln_scene::{Attributes, InstanceId, Lighting, Mesh, Object, Scene, SceneError};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

pub use export::{Exported, dataset_config, export};

const SEMANTIC_MESH: &str = ".semantic.glb";
const SEMANTIC_TABLE: &str = ".semantic.txt";
/// Render meshes in order of preference: the second holds `.basis` textures in the archives made for Habitat.
const RENDER_MESHES: [&str; 2] = [".glb", ".basis.glb"];
const MAX_TABLE_BYTES: u64 = 16 << 20;

/// The three files of a scene.
struct Files {
    render: PathBuf,
    semantic: PathBuf,
    table: PathBuf,
}

/// Whether `path` is an HM3D scene with semantics: a folder that holds one, or one of its meshes.
pub(crate) fn is_hm3d(path: &Path) -> bool {
    files(path).is_some()
}

/// Imports a folder (`00800-TEEsavR23oF`), or a `.glb` with its semantic files beside it.
///
/// Instances keep their numbers from the table. Categories become mpcat40 names where one is known; what belongs to the
/// building itself (walls, floors, doors, windows …) is no object, but stays in the mesh.
///
/// # Errors
/// [`SceneError::Read`] for a file that cannot be read, [`SceneError::Malformed`] for one that does not hold what it
/// should, and where there are no semantics.
pub fn import(folder_or_glb: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    let files = files(folder_or_glb).ok_or_else(|| {
        malformed(folder_or_glb, "no X.glb with X.semantic.glb and X.semantic.txt is there; add the semantic files of HM3D, or open the .glb without them")
    })?;
    let annotations = read_annotations(&files.table)?;
    let mut render = glb::read_model(&files.render, report)?;
    let semantic = glb::read_model(&files.semantic, report)?;
    turn_y_up(&mut render.mesh);
    let labels = paint::labels(&semantic, &annotations, report);
    let mut painted = semantic.mesh;
    turn_y_up(&mut painted);
    let labels = bake::transfer(&painted, &labels, &render.mesh);
    scene(glb::scene_name(&files.render), render, &labels, &annotations)
        .map_err(|reason| malformed(&files.table, &reason))
}

fn malformed(path: &Path, reason: &str) -> SceneError {
    SceneError::Malformed { path: path.display().to_string(), reason: reason.to_owned() }
}

/// The scene's files, if `path` is one of its meshes or a folder with a semantic mesh; the first by name of several.
fn files(path: &Path) -> Option<Files> {
    let (folder, stem) =
        if path.is_dir() { (path, first_stem(path)?) } else { (path.parent()?, stem_of_mesh(path)?) };
    let file = |suffix: &str| folder.join(format!("{stem}{suffix}"));
    let render = RENDER_MESHES.iter().map(|suffix| file(suffix)).find(|render| render.is_file())?;
    let found = Files { render, semantic: file(SEMANTIC_MESH), table: file(SEMANTIC_TABLE) };
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

fn read_annotations(table: &Path) -> Result<Vec<Annotation>, SceneError> {
    let bytes = read_limited(table, MAX_TABLE_BYTES)
        .map_err(|source| SceneError::Read { path: table.display().to_string(), source })?;
    annotations::parse(&String::from_utf8_lossy(&bytes)).map_err(|reason| malformed(table, &reason))
}

/// HM3D has gravity along -Z, the world frame along -Y: (x, y, z) becomes (x, z, -y).
fn turn_y_up(mesh: &mut Mesh) {
    for position in &mut mesh.positions {
        *position = Point3::new(position.x, position.z, -position.y);
    }
}

/// Joins mesh and table; `labels` holds an instance number for each triangle, 0 for none.
fn scene(name: String, render: Model, labels: &[u32], annotations: &[Annotation]) -> Checked<Scene> {
    let Model { mut mesh, materials, textures, .. } = render;
    let mut triangles_of: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (triangle, &label) in labels.iter().enumerate() {
        triangles_of.entry(label).or_default().push(triangle as u32);
    }
    let bounds_of: BTreeMap<u32, Aabb> = triangles_of
        .iter()
        .filter_map(|(&label, triangles)| Some((label, bounds(&mesh, triangles)?)))
        .collect();
    let (regions, region_of) = regions::regions(annotations, &bounds_of)?;
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

#[cfg(test)]
mod tests;
