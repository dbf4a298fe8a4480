//! ProcTHOR houses: the JSON that AI2-THOR builds houses from, schema 1.0.0 (`rooms`, `walls`, `doors`, `windows`, `objects`).
//!
//! The file contains mesh names, but no meshes. Floors, ceilings, and walls with their openings are built from the
//! outlines; objects are boxes with the size in an asset database (`asset-database.json` next to the house, in `databases/`,
//! or one folder up), or a common size for the category. Negating Z converts Unity's left-handed frame (Y up, Z forward)
//! to the world frame.

mod house;
mod objects;
mod shell;
#[cfg(test)]
mod tests;

use crate::files::scene_name;
use crate::files::{malformed, read_limited, read_regular};
use crate::options::ImportReport;
use crate::procthor::house::{HouseMesh, ProcthorHouse};
use crate::world_frame::check_size;
use avln_scene::{Lighting, Region, Scene, SceneError};
use std::path::Path;

const MAX_HOUSE_BYTES: u64 = 64 << 20;
/// Greatest size for a JSON file that may be a house.
const MAX_CANDIDATE_BYTES: u64 = 64 << 20;

/// Returns whether `path` is a JSON file with rooms and walls.
pub(crate) fn is_procthor(path: &Path) -> bool {
    #[derive(serde::Deserialize)]
    struct HouseKeys {
        #[serde(rename = "rooms")]
        _rooms: serde::de::IgnoredAny,
        #[serde(rename = "walls")]
        _walls: serde::de::IgnoredAny,
    }
    let is_json = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json"));
    is_json
        && read_limited(path, MAX_CANDIDATE_BYTES)
            .is_ok_and(|bytes| serde_json::from_slice::<HouseKeys>(&bytes).is_ok())
}

/// Imports a house, with boxes instead of AI2-THOR's meshes.
///
/// # Errors
/// [`SceneError::Read`] if the file cannot be read; [`SceneError::Malformed`] if it is no house, a room has no usable outline,
/// or a position is not finite. Unknown sizes and openings without a wall are warnings.
pub fn import(path: &Path, report: &mut ImportReport) -> Result<Scene, SceneError> {
    let fail = |reason: String| malformed(path, reason);
    let bytes = read_regular(path, MAX_HOUSE_BYTES)?;
    let house: ProcthorHouse = serde_json::from_slice(&bytes)
        .map_err(|error| fail(format!("it is no ProcTHOR house ({error}); export it with schema 1.0.0")))?;
    let sizes = objects::AssetSizes::beside(path)?;
    let mut builder = HouseMesh::default();
    let rooms = shell::build(&house, &mut builder, report).map_err(fail)?;
    let objects = objects::build(&house, &sizes, &rooms, &mut builder, report).map_err(fail)?;
    check_size(&builder.mesh, report).map_err(fail)?;
    let region =
        |room: &shell::ProcthorRoom| Region { label: room.label.clone(), bounds: room.bounds, storey: 0 };
    Ok(Scene {
        name: scene_name(path),
        mesh: builder.mesh,
        materials: builder.materials,
        textures: Vec::new(),
        regions: rooms.iter().map(region).collect(),
        objects,
        lighting: Lighting::Painted,
    })
}
