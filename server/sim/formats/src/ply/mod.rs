//! Polygon files of Stanford (PLY 1.0), in text or binary, with vertex colours, texture coordinates and object numbers.

mod body;
mod header;
mod tables;
#[cfg(test)]
mod tests;

use crate::files::Checked;
use crate::frame::{Convention, Frame, Options, Up, check_size};
use crate::glb::scene_name;
use crate::pictures::Pictures;
use crate::{Report, files};
use avln_scene::limits::{MAX_FILE_BYTES, MAX_TEXELS};
use avln_scene::{InstanceId, Lighting, Material, Mesh, Scene, SceneError, polygon};
use std::path::Path;
use tables::Tables;

/// Surfaces in the file's own frame, with what it says of each triangle.
pub(crate) struct Ply {
    /// No instances yet.
    pub(crate) mesh: Mesh,
    /// Whether vertices bring colours.
    pub(crate) is_coloured: bool,
    /// The number of each triangle's object (`object_id` of its face, else the one that most of its vertices have).
    pub(crate) object_of: Option<Vec<i64>>,
    /// The number of each triangle's segment (`face_material` in files of Matterport).
    pub(crate) segment_of: Option<Vec<i64>>,
    /// The picture that its texture coordinates refer to.
    texture: Option<String>,
}

/// Imports a file as a scene without instances: a PLY file has no names for them. Z is taken for up unless the shape says
/// otherwise.
///
/// # Errors
/// [`SceneError::Read`] when the file cannot be read; [`SceneError::Malformed`], with line or byte, when it is damaged, holds
/// no surfaces, or cannot be in metres.
pub fn import(path: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    import_as(path, &Options::default(), report)
}

/// [`import`] with axes and unit as the caller knows them.
///
/// # Errors
/// Those of [`import`].
pub fn import_as(path: &Path, options: &Options, report: &mut Report) -> Result<Scene, SceneError> {
    let mut ply = read(path, report)?;
    if ply.object_of.is_some() {
        report.warn(format!(
            "{} numbers its objects but does not name them; add the .house file or info_semantic.json that does",
            path.display()
        ));
    }
    Frame::of(&ply.mesh, options, Convention::Usual(Up::Z), report).apply(&mut ply.mesh);
    check_size(&ply.mesh, report).map_err(|reason| files::malformed(path, reason))?;
    let mut pictures = Pictures::new(path.parent().unwrap_or(Path::new("")), MAX_TEXELS);
    let texture = match &ply.texture {
        Some(name) => Some(pictures.number(name, report).map_err(|reason| files::malformed(path, reason))?),
        None => None,
    };
    Ok(Scene {
        name: scene_name(path),
        mesh: ply.mesh,
        materials: vec![material(texture)],
        textures: pictures.into_textures(),
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    })
}

/// The one material of a PLY file.
pub(crate) fn material(texture: Option<u16>) -> Material {
    Material { name: "scan".to_owned(), base_color: [255; 4], texture, alpha_cutoff: None }
}

/// Reads a file in its own frame.
pub(crate) fn read(path: &Path, report: &mut Report) -> Result<Ply, SceneError> {
    let bytes = files::read(path, MAX_FILE_BYTES, report)?;
    parse(&bytes, report).map_err(|reason| files::malformed(path, reason))
}

/// Reads the bytes of a file in its own frame.
pub(crate) fn parse(bytes: &[u8], report: &mut Report) -> Checked<Ply> {
    let header = header::parse(bytes)?;
    let mut tables = Tables::read(bytes, &header, report)?;
    let mut triangles = Vec::new();
    let mut face_of: Vec<u32> = Vec::new();
    for (face, corners) in tables.faces().enumerate() {
        polygon::triangulate(&tables.positions, corners, &mut triangles);
        face_of.resize(triangles.len(), face as u32);
    }
    if triangles.is_empty() {
        return Err("it holds no faces; take the file with surfaces, not the cloud of points".to_owned());
    }
    let by_face = |labels: Vec<i64>| face_of.iter().map(|&face| labels[face as usize]).collect::<Vec<_>>();
    let by_vertex = |labels: Vec<i64>| {
        triangles.iter().map(|corners| most(corners.map(|at| labels[at as usize]))).collect()
    };
    let segment_of = tables.face_segments.take().map(by_face);
    let object_of = match (tables.face_objects.take(), tables.vertex_objects.take()) {
        (Some(labels), _) => Some(by_face(labels)),
        (None, vertex_labels) => vertex_labels.map(by_vertex),
    };
    let count = triangles.len();
    let is_coloured = tables.is_coloured;
    Ok(Ply {
        is_coloured,
        object_of,
        segment_of,
        texture: if tables.has_uvs { header.texture } else { None },
        mesh: Mesh {
            positions: tables.positions,
            uvs: tables.uvs,
            colors: tables.colors,
            triangles,
            material_of: vec![0; count],
            instance_of: vec![InstanceId::NONE; count],
        },
    })
}

/// The number that two of three have; the first where all differ.
fn most([a, b, c]: [i64; 3]) -> i64 {
    if b == c { b } else { a }
}
