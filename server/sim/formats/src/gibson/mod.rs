//! Buildings of Gibson: `X.scn` (things with class and box), `X.glb` or `X.obj` (textured, Z up) and, where it was made,
//! `X_semantic.ply` (the thing of each face).

mod table;
#[cfg(test)]
mod tests;

use crate::frame::{Convention, Frame, Options, Up, check_size};
use crate::labelled::{self, Label, Surface};
use crate::{Report, files, glb, obj, ply};
use avln_geom::{Aabb, Point3};
use avln_scene::{InstanceId, Mesh, Scene, SceneError};
use std::path::{Path, PathBuf};
use table::Thing;

/// What `X.scn` is called.
pub(crate) const TABLE: &str = ".scn";
const RENDER_MESHES: [&str; 3] = [".glb", ".obj", "_semantic.ply"];
const SEMANTIC_MESH: &str = "_semantic.ply";
const MAX_TABLE_BYTES: u64 = 64 << 20;
/// A thing may reach this far out of its box, metres.
const MARGIN_M: f32 = 0.02;

/// Imports the building whose table is `table` (`X.scn`). Without labels on faces a thing is what lies inside its box, the
/// smallest box first.
///
/// # Errors
/// [`SceneError::Read`] for a file that cannot be read; [`SceneError::Malformed`], with line or byte, for one that does not
/// hold what it should, and where there is no mesh.
pub fn import(table: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    import_as(table, &Options::default(), report)
}

/// [`import`] with axes and unit as the caller knows them.
///
/// # Errors
/// Those of [`import`].
pub fn import_as(table: &Path, options: &Options, report: &mut Report) -> Result<Scene, SceneError> {
    let bytes = files::read(table, MAX_TABLE_BYTES, report)?;
    let fail = |reason: String| files::malformed(table, reason);
    let things = table::parse(&bytes, InstanceId::MAX).map_err(fail)?;
    let render = RENDER_MESHES.iter().find_map(|suffix| beside(table, suffix)).ok_or_else(|| {
        fail("no X.glb or X.obj lies beside X.scn; put the mesh of the building into its folder".to_owned())
    })?;
    let mut surface = read_render(&render, report)?;
    let frame = Frame::of(&surface.mesh, options, Convention::Fixed(Up::Z), report);
    frame.apply(&mut surface.mesh);
    check_size(&surface.mesh, report).map_err(fail)?;
    let label_of = match beside(table, SEMANTIC_MESH) {
        Some(path) => labels_of_faces(&path, &frame, &surface.mesh, report)?,
        None => {
            report.warn("there is no X_semantic.ply beside X.scn: things are what lies inside their boxes");
            labels_of_boxes(&things, &frame, &surface.mesh)
        }
    };
    let labels: Vec<Label> = things.iter().map(|thing| Label::of_words(thing.id, &thing.class)).collect();
    Ok(labelled::scene(glb::scene_name(table), surface, &label_of, &labels, Vec::new(), report))
}

fn beside(table: &Path, suffix: &str) -> Option<PathBuf> {
    let stem = table.file_name()?.to_str()?.strip_suffix(TABLE)?;
    Some(table.with_file_name(format!("{stem}{suffix}"))).filter(|path| path.is_file())
}

fn read_render(path: &Path, report: &mut Report) -> Result<Surface, SceneError> {
    let is = |kind: &str| path.extension().is_some_and(|extension| extension == kind);
    if is("ply") {
        let mesh = ply::read(path, report)?.mesh;
        return Ok(Surface { mesh, materials: vec![ply::material(None)], textures: Vec::new() });
    }
    let model = if is("obj") {
        obj::read(path, report)?
    } else {
        glb::read_part(&files::resolve(path, report)?, report)?
    };
    Ok(Surface { mesh: model.mesh, materials: model.materials, textures: model.textures })
}

fn labels_of_faces(
    path: &Path,
    frame: &Frame,
    render: &Mesh,
    report: &mut Report,
) -> Result<Vec<u32>, SceneError> {
    let mut semantic = ply::read(path, report)?;
    frame.apply(&mut semantic.mesh);
    let objects = semantic.object_of.ok_or_else(|| {
        files::malformed(path, "its faces have no object_id; make it anew from the .ids file")
    })?;
    let number = |&object: &i64| u32::try_from(object).ok().filter(|&id| id <= InstanceId::MAX).unwrap_or(0);
    let labels: Vec<u32> = objects.iter().map(number).collect();
    Ok(labelled::carried(&semantic.mesh, &labels, render, report))
}

/// The smallest box that holds all corners of a triangle labels it.
fn labels_of_boxes(things: &[Thing], frame: &Frame, mesh: &Mesh) -> Vec<u32> {
    let volume = |bounds: &Aabb| bounds.size().product();
    let mut boxes: Vec<(u32, Aabb)> =
        things.iter().filter_map(|thing| Some((thing.id, world_box(thing, frame)?))).collect();
    boxes.sort_by(|(a_id, a), (b_id, b)| volume(a).total_cmp(&volume(b)).then(a_id.cmp(b_id)));
    let label = |triangle: &[u32; 3]| {
        let corners = triangle.map(|corner| mesh.positions[corner as usize]);
        boxes
            .iter()
            .find(|(_, bounds)| corners.iter().all(|corner| bounds.contains(corner)))
            .map_or(0, |(id, _)| *id)
    };
    mesh.triangles.iter().map(label).collect()
}

fn world_box(thing: &Thing, frame: &Frame) -> Option<Aabb> {
    let [center, size] = thing.place?;
    let corner = |sign: f32| std::array::from_fn(|axis| center[axis] + sign * size[axis] / 2.0);
    let bounds = frame.bounds(corner(-1.0), corner(1.0)).grown(MARGIN_M);
    let is_finite = |point: &Point3<f32>| point.iter().all(|coordinate| coordinate.is_finite());
    (is_finite(&bounds.min) && is_finite(&bounds.max)).then_some(bounds)
}
