//! Stanford polygon files (PLY 1.0), text or binary, with vertex colours, texture coordinates and object numbers.

mod tables;

use crate::files::{self, Checked, ImportReport, refuse_if, scene_name};
use crate::images::ImageSet;
use crate::ply::tables::PlyTables;
use crate::world_frame::{FileFrame, ImportOptions, UpAxis, UpConvention, check_size};
use avln_scene::limits::{MAX_FILE_BYTES, MAX_TEXELS};
use avln_scene::{InstanceId, Lighting, Material, Mesh, Scene, SceneError, polygon};
use std::path::Path;

/// Surfaces in the file's frame, with object and segment numbers.
pub(crate) struct Ply {
    /// No instances yet.
    pub(crate) mesh: Mesh,
    pub(crate) is_coloured: bool,
    /// Object number per triangle: the face's `object_id`, or the vertices' majority.
    pub(crate) object_of: Option<Vec<i64>>,
    /// Segment number per triangle (`face_material` in Matterport files).
    pub(crate) segment_of: Option<Vec<i64>>,
    /// Image for the texture coordinates.
    texture: Option<String>,
}

/// Imports a file without instances, which have no names in PLY. Z is up, unless the building's shape contradicts it.
pub(crate) fn import(
    path: &Path,
    options: &ImportOptions,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    let mut ply = read(path, report)?;
    if ply.object_of.is_some() {
        report.warn(format!(
            "{} has numbers of objects but no names; add the .house file or info_semantic.json with the names",
            path.display()
        ));
    }
    let fail = |reason| files::malformed(path, reason);
    FileFrame::applied(&mut ply.mesh, options, UpConvention::Usual(UpAxis::Z), report);
    check_size(&ply.mesh, report).map_err(fail)?;
    let mut pictures = ImageSet::new(path.parent().unwrap_or(Path::new("")), MAX_TEXELS);
    let texture = ply.texture.as_ref().map(|name| pictures.number(name, report)).transpose().map_err(fail)?;
    Ok(Scene {
        name: scene_name(path),
        mesh: ply.mesh,
        materials: vec![material(texture)],
        textures: pictures.textures,
        regions: Vec::new(),
        objects: Vec::new(),
        lighting: Lighting::Painted,
    })
}

pub(crate) fn material(texture: Option<u16>) -> Material {
    Material { name: "scan".to_owned(), base_color: [255; 4], texture, alpha_cutoff: None }
}

pub(crate) fn read(path: &Path, report: &mut ImportReport) -> Result<Ply, SceneError> {
    let bytes = files::read(path, MAX_FILE_BYTES, report)?;
    parse(&bytes, report).map_err(|reason| files::malformed(path, reason))
}

pub(crate) fn parse(bytes: &[u8], report: &mut ImportReport) -> Checked<Ply> {
    let mut tables = PlyTables::read(bytes, report)?;
    let mut triangles = Vec::new();
    let mut face_of: Vec<u32> = Vec::new();
    for (face, corners) in tables.faces().enumerate() {
        polygon::triangulate(&tables.positions, corners, &mut triangles);
        face_of.resize(triangles.len(), face as u32);
    }
    refuse_if(triangles.is_empty(), || {
        "it has no faces; use the file with surfaces, not the point cloud".into()
    })?;
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
        texture: tables.texture.take().filter(|_| tables.has_uvs),
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

/// Three numbers' majority; the first if all differ.
fn most([a, b, c]: [i64; 3]) -> i64 {
    if b == c { b } else { a }
}
