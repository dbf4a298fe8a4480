//! How large the objects of a house are.

use super::schema::Place;
use crate::glb::read_limited;
use avln_scene::SceneError;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

const DATABASE: &str = "asset-database.json";
/// Where the database may lie, from the house's folder.
const FOLDERS: [&str; 4] = ["", "databases", "..", "../databases"];
const MAX_DATABASE_BYTES: u64 = 256 << 20;
/// Sides of a box, metres: what is no size is held within.
const SIDES_M: (f32, f32) = (0.005, 10.0);

/// Sizes and kinds of assets.
#[derive(Default)]
pub(super) struct Sizes {
    assets: BTreeMap<String, Asset>,
}

#[derive(Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
struct Asset {
    asset_id: String,
    #[serde(default)]
    object_type: String,
    bounding_box: Place,
}

impl Sizes {
    /// Reads the database that lies near the house; there may be none.
    pub(super) fn beside(house: &Path) -> Result<Self, SceneError> {
        let folder = house.parent().unwrap_or(Path::new(""));
        let candidates = FOLDERS.iter().map(|relative| folder.join(relative).join(DATABASE));
        let Some(path) = candidates.into_iter().find(|path| path.is_file()) else {
            return Ok(Self::default());
        };
        let bytes = read_limited(&path, MAX_DATABASE_BYTES)
            .map_err(|source| SceneError::Read { path: path.display().to_string(), source })?;
        let kinds: BTreeMap<String, Vec<Asset>> = serde_json::from_slice(&bytes).map_err(|error| {
            let reason = format!("it is no asset database of ProcTHOR ({error}); correct it or move it away");
            SceneError::Malformed { path: path.display().to_string(), reason }
        })?;
        let assets = kinds.into_iter().flat_map(|(kind, assets)| {
            assets.into_iter().map(move |asset| {
                let object_type =
                    if asset.object_type.is_empty() { kind.clone() } else { asset.object_type.clone() };
                (asset.asset_id.clone(), Asset { object_type, ..asset })
            })
        });
        Ok(Self { assets: assets.collect() })
    }

    /// The kind of an asset (`Dresser`, `TVStand` …), where it is known.
    pub(super) fn kind(&self, asset: &str) -> Option<&str> {
        self.assets.get(asset).map(|asset| asset.object_type.as_str())
    }

    /// Width, height and depth of an asset, metres.
    pub(super) fn of(&self, asset: &str) -> Option<[f32; 3]> {
        self.assets.get(asset).and_then(|asset| usable(&asset.bounding_box))
    }
}

/// The sides of a box, if all are numbers above zero.
pub(super) fn usable(size: &Place) -> Option<[f32; 3]> {
    let sides = [size.x, size.y, size.z];
    sides
        .iter()
        .all(|side| side.is_finite() && *side > 0.0)
        .then(|| sides.map(|side| side.clamp(SIDES_M.0, SIDES_M.1)))
}

/// A common size of things of an mpcat40 category: medians of ProcTHOR's own assets.
pub(super) fn common(category: &str) -> [f32; 3] {
    match category {
        "chair" => [0.48, 0.88, 0.54],
        "table" => [1.39, 0.78, 0.80],
        "sofa" => [2.40, 0.92, 0.93],
        "bed" => [1.37, 0.91, 2.24],
        "chest_of_drawers" => [1.20, 0.97, 0.51],
        "cabinet" => [1.20, 0.71, 0.60],
        "shelving" => [0.91, 1.44, 0.34],
        "tv_monitor" => [1.14, 0.81, 0.31],
        "toilet" => [0.53, 0.99, 0.92],
        "sink" => [0.66, 0.15, 0.46],
        "appliances" => [0.68, 1.05, 0.69],
        "plant" => [0.36, 0.65, 0.39],
        "lighting" => [0.52, 1.87, 0.51],
        "picture" => [0.81, 0.61, 0.03],
        "stool" => [0.41, 0.67, 0.32],
        "cushion" => [0.43, 0.14, 0.35],
        "counter" => [2.44, 0.94, 1.83],
        _ => [0.3, 0.3, 0.3],
    }
}
