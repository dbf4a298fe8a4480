//! Scans of Replica: `habitat/info_semantic.json` (things and classes), `habitat/mesh_semantic.ply` (the thing of each face)
//! and `mesh.ply` (the same surfaces, coloured); polygons have four corners, Z is up.

mod info;
#[cfg(test)]
mod tests;

use crate::frame::{Convention, Frame, Options, Up, check_size};
use crate::labelled::{self, Label, Surface};
use crate::ply::{self, Ply};
use crate::{Report, files, glb};
use avln_geom::Aabb;
use avln_scene::{InstanceId, Scene, SceneError};
use std::path::{Path, PathBuf};

/// What the table is called.
pub(crate) const TABLE: &str = "info_semantic.json";
/// What the labelled mesh is called.
pub(crate) const SEMANTIC_MESH: &str = "mesh_semantic.ply";
const RENDER_MESH: &str = "mesh.ply";
/// The folder inside a scene's that holds table and labelled mesh.
pub(crate) const SEMANTIC_FOLDER: &str = "habitat";
const MAX_TABLE_BYTES: u64 = 64 << 20;
/// Boxes of the two meshes of one scan differ by less than this, in the file's unit.
const SAME_FRAME: f32 = 0.5;

/// Imports the scene whose table is `table` (`…/habitat/info_semantic.json`). Things get their number in the table plus one,
/// since no instance has number 0; walls, floors, doors and the like are no objects. The scene is named after its folder.
///
/// # Errors
/// [`SceneError::Read`] for a file that cannot be read; [`SceneError::Malformed`], with line or byte, for one that does not
/// hold what it should.
pub fn import(table: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    import_as(table, &Options::default(), report)
}

/// [`import`] with axes and unit as the caller knows them.
///
/// # Errors
/// Those of [`import`].
pub fn import_as(table: &Path, options: &Options, report: &mut Report) -> Result<Scene, SceneError> {
    let bytes = files::read(table, MAX_TABLE_BYTES, report)?;
    let things =
        info::parse(&bytes, InstanceId::MAX - 1).map_err(|reason| files::malformed(table, reason))?;
    let semantic_path = table.with_file_name(SEMANTIC_MESH);
    let mut semantic = ply::read(&semantic_path, report)?;
    let objects = semantic.object_of.take().ok_or_else(|| {
        files::malformed(
            &semantic_path,
            "its faces have no object_id; take mesh_semantic.ply of the folder habitat",
        )
    })?;
    let labels: Vec<u32> = objects.iter().map(|&object| label_number(object)).collect();
    let mut render = render(table, &semantic, report)?;
    let frame = Frame::of(&semantic.mesh, options, Convention::Fixed(Up::Z), report);
    frame.apply(&mut semantic.mesh);
    let (mesh, label_of) = match &mut render {
        Some(render) => {
            frame.apply(&mut render.mesh);
            let label_of = labelled::carried(&semantic.mesh, &labels, &render.mesh, report);
            (std::mem::take(&mut render.mesh), label_of)
        }
        None => (semantic.mesh, labels),
    };
    check_size(&mesh, report).map_err(|reason| files::malformed(&semantic_path, reason))?;
    let surface = Surface { mesh, materials: vec![ply::material(None)], textures: Vec::new() };
    let labels: Vec<Label> = things.iter().map(|thing| Label::of_words(thing.id + 1, &thing.class)).collect();
    Ok(labelled::scene(name(table), surface, &label_of, &labels, Vec::new(), report))
}

/// The coloured mesh, where it is there, is coloured and lies where the labelled one does.
fn render(table: &Path, semantic: &Ply, report: &mut Report) -> Result<Option<Ply>, SceneError> {
    let folder = scene_folder(table);
    let path = folder.join(RENDER_MESH);
    if !path.is_file() {
        if !semantic.is_coloured {
            report.warn("mesh_semantic.ply has no colours and there is no mesh.ply: all is white");
        }
        return Ok(None);
    }
    let render = ply::read(&path, report)?;
    let boxes = Aabb::around(&render.mesh.positions).zip(Aabb::around(&semantic.mesh.positions));
    let is_same = boxes.is_some_and(|(a, b)| {
        (a.min - b.min).abs().max() < SAME_FRAME && (a.max - b.max).abs().max() < SAME_FRAME
    });
    if !is_same {
        report.warn("mesh.ply does not lie where mesh_semantic.ply does, and is left out");
    }
    Ok((is_same && render.is_coloured).then_some(render))
}

/// The folder of the scene: the table's, or the one above where the table lies in `habitat`.
fn scene_folder(table: &Path) -> PathBuf {
    let folder = table.parent().unwrap_or(Path::new(""));
    let is_inner = folder.file_name().is_some_and(|name| name == SEMANTIC_FOLDER);
    if is_inner { folder.join("..") } else { folder.to_owned() }
}

fn name(table: &Path) -> String {
    let folder = scene_folder(table);
    let whole = std::fs::canonicalize(&folder).unwrap_or(folder);
    glb::scene_name(&whole)
}

fn label_number(object: i64) -> u32 {
    let number = object.checked_add(1).and_then(|number| u32::try_from(number).ok());
    number.filter(|&number| number <= InstanceId::MAX).unwrap_or(0)
}
