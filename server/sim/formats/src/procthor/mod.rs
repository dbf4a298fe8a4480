//! ProcTHOR houses: the JSON that AI2-THOR builds houses from, schema 1.0.0 (`rooms`, `walls`, `doors`, `windows`, `objects`).
//!
//! The file holds no meshes, only their names. Floors, walls with their openings and ceilings are built from the outlines;
//! every object becomes a box of the size that an asset database gives (`asset-database.json` beside the house, in
//! `databases/`, or one folder up), else of a common size for its kind. Unity's left-handed frame (Y up, Z forward) becomes
//! the world's by turning Z around.

mod outline;
mod schema;
mod shell;
mod sizes;
mod things;

use crate::Report;
use crate::frame::check_size;
use crate::glb::{self, read_limited};
use avln_geom::{Aabb, Point2, Point3};
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{InstanceId, Lighting, Material, Mesh, Region, Scene, SceneError};
use schema::House;
use std::collections::BTreeMap;
use std::path::Path;

const MAX_HOUSE_BYTES: u64 = 64 << 20;
/// What a house file begins with is searched this far, bytes.
const GLANCE_BYTES: u64 = 64 << 20;

/// Whether `path` is a JSON file with rooms and walls.
pub(crate) fn is_procthor(path: &Path) -> bool {
    #[derive(serde::Deserialize)]
    struct Glance {
        #[serde(rename = "rooms")]
        _rooms: serde::de::IgnoredAny,
        #[serde(rename = "walls")]
        _walls: serde::de::IgnoredAny,
    }
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    is_json
        && read_limited(path, GLANCE_BYTES)
            .is_ok_and(|bytes| serde_json::from_slice::<Glance>(&bytes).is_ok())
}

/// Imports a house; its boxes stand in for the meshes that AI2-THOR would show.
///
/// # Errors
/// [`SceneError::Read`] for a file that cannot be read, [`SceneError::Malformed`] where it is no house, a room has no
/// usable outline, or something has no finite place. What is merely unknown (sizes, categories, holes without a wall) is
/// a warning.
pub fn import(path: &Path, report: &mut Report) -> Result<Scene, SceneError> {
    let fail = |reason: String| SceneError::Malformed { path: path.display().to_string(), reason };
    let bytes = read_limited(path, MAX_HOUSE_BYTES)
        .map_err(|source| SceneError::Read { path: path.display().to_string(), source })?;
    let house: House = serde_json::from_slice(&bytes)
        .map_err(|error| fail(format!("it is no ProcTHOR house ({error}); export it with schema 1.0.0")))?;
    let sizes = sizes::Sizes::beside(path)?;
    let mut builder = Builder::default();
    let rooms = shell::build(&house, &mut builder, report).map_err(fail)?;
    let objects = things::build(&house, &sizes, &rooms, &mut builder, report).map_err(fail)?;
    check_size(&builder.mesh, report).map_err(fail)?;
    let region = |room: &shell::Room| Region { label: room.label.clone(), bounds: room.bounds, storey: 0 };
    Ok(Scene {
        name: glb::scene_name(path),
        mesh: builder.mesh,
        materials: builder.materials,
        textures: Vec::new(),
        regions: rooms.iter().map(region).collect(),
        objects,
        lighting: Lighting::Painted,
    })
}

/// A mesh that grows by flat pieces.
#[derive(Default)]
struct Builder {
    mesh: Mesh,
    materials: Vec<Material>,
    material_of: BTreeMap<(String, [u8; 3]), u16>,
}

impl Builder {
    /// The number of a plain material.
    fn material(&mut self, name: &str, color: [u8; 3]) -> u16 {
        let name: String = name.chars().filter(|letter| !letter.is_control()).take(MAX_WORD_CHARS).collect();
        let next = self.materials.len().min(usize::from(u16::MAX)) as u16;
        let number = *self.material_of.entry((name.clone(), color)).or_insert(next);
        if usize::from(number) == self.materials.len() {
            let [r, g, b] = color;
            self.materials.push(Material {
                name,
                base_color: [r, g, b, 255],
                texture: None,
                alpha_cutoff: None,
            });
        }
        number
    }

    /// Adds corners and the triangles between them, counted from the first corner.
    fn add(&mut self, corners: &[Point3<f32>], triangles: &[[u32; 3]], material: u16, instance: InstanceId) {
        let first = self.mesh.positions.len() as u32;
        self.mesh.positions.extend(corners);
        self.mesh
            .uvs
            .extend(corners.iter().map(|corner| Point2::new(corner.x + corner.y, corner.z + corner.y)));
        self.mesh.colors.resize(self.mesh.positions.len(), [255; 3]);
        self.mesh.triangles.extend(triangles.iter().map(|triangle| triangle.map(|corner| corner + first)));
        self.mesh.material_of.resize(self.mesh.triangles.len(), material);
        self.mesh.instance_of.resize(self.mesh.triangles.len(), instance);
    }

    /// Adds a quadrilateral by its corners in turn.
    fn add_quad(&mut self, corners: [Point3<f32>; 4], material: u16) {
        self.add(&corners, &[[0, 1, 2], [0, 2, 3]], material, InstanceId::NONE);
    }
}

/// A point of the file in the world frame.
fn world(point: &schema::Place) -> Point3<f32> {
    Point3::new(point.x, point.y, -point.z)
}

/// Box around points that are all finite.
fn finite_box(points: &[Point3<f32>]) -> Option<Aabb> {
    let finite = points.iter().flat_map(|point| point.iter()).all(|coordinate| coordinate.is_finite());
    Aabb::around(points).filter(|_| finite)
}

#[cfg(test)]
mod tests;
