//! A house's objects, as boxes.

use crate::files::{Checked, ImportReport, malformed, read_regular, refuse_if};
use crate::named_model::category_of_name;
use crate::procthor::shell::ProcthorRoom;
use crate::procthor::{HouseMesh, ProcthorHouse, ProcthorObject, Rotation, UnityVector, finite_box, world};
use avln_geom::{Aabb, Point3, Vector3};
use avln_scene::colors::PALETTE;
use avln_scene::describe::{Meaning, Surfaces, meaning};
use avln_scene::{Attributes, InstanceId, Object, SceneError};
use nalgebra::Matrix3;
use serde::Deserialize;
use std::{collections::BTreeMap, f32::consts::PI, path::Path};

/// Objects in a house, including children.
const MAX_OBJECTS: usize = 1 << 16;
/// Everyday words for AI2-THOR types with other names.
const KINDS: [(&str, &str); 14] = [
    ("ArmChair", "armchair"),
    ("TVStand", "tv stand"),
    ("GarbageCan", "trash can"),
    ("GarbageBag", "garbage bag"),
    ("DogBed", "dog basket"),
    ("Desktop", "desktop computer"),
    ("Footstool", "footstool"),
    ("RoomDecor", "decoration"),
    ("TableTopDecor", "decoration"),
    ("SideTable", "side table"),
    ("HandTowel", "towel"),
    ("TeddyBear", "toy"),
    ("Box", "box"),
    ("Safe", "safe"),
];
/// A box's outward sides; a corner number's bits 0, 1 and 2 are x, y and z.
const SIDES: [[u32; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Adds a box per object, children after their parents, and describes the objects with a category.
pub(super) fn build(
    house: &ProcthorHouse,
    sizes: &AssetSizes,
    rooms: &[ProcthorRoom],
    builder: &mut HouseMesh,
    report: &mut ImportReport,
) -> Checked<Vec<Object>> {
    let mut objects = Vec::new();
    let mut open: Vec<&ProcthorObject> = house.objects.iter().rev().collect();
    let mut count = 0;
    while let Some(thing) = open.pop() {
        count += 1;
        refuse_if(count > MAX_OBJECTS, || {
            format!("it has more than {MAX_OBJECTS} objects; split the house")
        })?;
        // An explicit stack: children can nest to any depth in a hostile file.
        open.extend(thing.children.iter().rev());
        let words = words(thing, sizes);
        let id = InstanceId(objects.len() as u32 + 1);
        match meaning(&words) {
            Meaning::Object { category, noun } => {
                let size = size(thing, sizes, &category, report);
                let (bounds, triangles) = add_box(thing, size, id, builder)?;
                let surfaces = Surfaces { mesh: &builder.mesh, materials: &builder.materials, textures: &[] };
                let attributes = Attributes { noun, ..surfaces.attributes(&triangles, &bounds) };
                let region =
                    rooms.iter().position(|room| room.contains(&bounds.center())).map(|index| index as u16);
                objects.push(Object { id, category, bounds, region, attributes });
            }
            Meaning::Structure | Meaning::Unknown => {
                let size = size(thing, sizes, "", report);
                add_box(thing, size, InstanceId::NONE, builder)?;
            }
        }
    }
    Ok(objects)
}

/// Words for an object: by type, database, or id prefix (`Dresser|2|0`).
fn words(thing: &ProcthorObject, sizes: &AssetSizes) -> String {
    let front = thing.id.split('|').next().unwrap_or_default();
    let given = Some(thing.object_type.as_str())
        .filter(|kind| !kind.is_empty())
        .or_else(|| sizes.kind(&thing.asset_id));
    let kind = given.unwrap_or(front);
    let listed = KINDS.iter().find(|(name, _)| *name == kind).map(|(_, words)| (*words).to_owned());
    let by_asset =
        || category_of_name(&thing.asset_id).filter(|_| given.is_none() && category_of_name(kind).is_none());
    listed.unwrap_or_else(|| by_asset().map_or_else(|| spaced(kind), str::to_owned))
}

/// Converts `CoffeeTable_3` to `coffee table`.
fn spaced(name: &str) -> String {
    let name = name.trim_end_matches(|letter: char| letter.is_ascii_digit() || letter == '_');
    let mut words = String::new();
    let mut before = ' ';
    for letter in name.chars() {
        if letter.is_uppercase() && before.is_lowercase() {
            words.push(' ');
        }
        words.extend(if letter == '_' { ' ' } else { letter }.to_lowercase());
        before = letter;
    }
    words
}

fn size(thing: &ProcthorObject, sizes: &AssetSizes, category: &str, report: &mut ImportReport) -> [f32; 3] {
    let known = sizes.of(&thing.asset_id).or_else(|| thing.bounding_box.as_ref().and_then(usable));
    known.unwrap_or_else(|| {
        report.warn(format!(
            "the size of asset {:?} is unknown; a common size is used (put ProcTHOR's asset-database.json next to the house)",
            thing.asset_id
        ));
        common(category)
    })
}

fn add_box(
    thing: &ProcthorObject,
    size: [f32; 3],
    id: InstanceId,
    builder: &mut HouseMesh,
) -> Checked<(Aabb, Vec<u32>)> {
    let center = world(&thing.position);
    let turn = turn(thing.rotation);
    let corner = |number: u32| {
        let side = |axis: usize| if number >> axis & 1 == 0 { -size[axis] / 2.0 } else { size[axis] / 2.0 };
        center + turn * Vector3::new(side(0), side(1), side(2))
    };
    let corners: Vec<Point3<f32>> = (0..8).map(corner).collect();
    let bounds = finite_box(&corners).ok_or_else(|| {
        format!("object {:?} has no finite position; correct its position and rotation", thing.id)
    })?;
    let [first, ..] = *blake3::hash(thing.asset_id.as_bytes()).as_bytes();
    let (_, color) = PALETTE[usize::from(first) % PALETTE.len()];
    let material = builder.material("stand-in", color);
    let start = builder.mesh.triangles.len() as u32;
    for side in SIDES {
        let quad = side.map(|corner| corners[corner as usize]);
        builder.add(&quad, &[[0, 1, 2], [0, 2, 3]], material, id);
    }
    Ok((bounds, (start..builder.mesh.triangles.len() as u32).collect()))
}

/// The rotation in the world frame. Unity rotates about Z, X and Y, in this order, in a left-handed frame with the opposite Z.
fn turn(rotation: Rotation) -> Matrix3<f32> {
    let UnityVector { x, y, z } = match rotation {
        Rotation::Angles(angles) => angles,
        Rotation::AboutY(y) => UnityVector { x: 0.0, y, z: 0.0 },
    };
    let [x, y, z] =
        [x, y, z].map(|degrees| degrees % 360.0 * PI / 180.0).map(|rad| (libm::sinf(rad), libm::cosf(rad)));
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, x.1, -x.0, 0.0, x.0, x.1);
    let about_y = Matrix3::new(y.1, 0.0, y.0, 0.0, 1.0, 0.0, -y.0, 0.0, y.1);
    let about_z = Matrix3::new(z.1, -z.0, 0.0, z.0, z.1, 0.0, 0.0, 0.0, 1.0);
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    mirror * (about_y * about_x * about_z) * mirror
}

const DATABASE: &str = "asset-database.json";
/// Database folders, relative to the house.
const FOLDERS: [&str; 4] = ["", "databases", "..", "../databases"];
const MAX_DATABASE_BYTES: u64 = 256 << 20;
/// Least and greatest box side, metres; other sides are clamped.
const SIDES_M: (f32, f32) = (0.005, 10.0);

#[derive(Default)]
pub(super) struct AssetSizes {
    assets: BTreeMap<String, DatabaseAsset>,
}

#[derive(Clone, Deserialize)]
#[serde(rename_all = "camelCase")]
struct DatabaseAsset {
    asset_id: String,
    #[serde(default)]
    object_type: String,
    bounding_box: UnityVector,
}

impl AssetSizes {
    /// Reads the database near the house, if it exists.
    pub(super) fn beside(house: &Path) -> Result<Self, SceneError> {
        let folder = house.parent().unwrap_or(Path::new(""));
        let candidates = FOLDERS.iter().map(|relative| folder.join(relative).join(DATABASE));
        let Some(path) = candidates.into_iter().find(|path| path.is_file()) else {
            return Ok(Self::default());
        };
        let bytes = read_regular(&path, MAX_DATABASE_BYTES)?;
        let kinds: BTreeMap<String, Vec<DatabaseAsset>> =
            serde_json::from_slice(&bytes).map_err(|error| {
                let reason = format!("it is no asset database of ProcTHOR ({error}); correct or remove it");
                malformed(&path, reason)
            })?;
        let assets = kinds.into_iter().flat_map(|(kind, assets)| {
            assets.into_iter().map(move |asset| {
                let object_type =
                    if asset.object_type.is_empty() { kind.clone() } else { asset.object_type.clone() };
                (asset.asset_id.clone(), DatabaseAsset { object_type, ..asset })
            })
        });
        Ok(Self { assets: assets.collect() })
    }

    /// Returns an asset's type (`Dresser`, `TVStand` …).
    pub(super) fn kind(&self, asset: &str) -> Option<&str> {
        self.assets.get(asset).map(|asset| asset.object_type.as_str())
    }

    /// Returns an asset's width, height and depth, metres.
    pub(super) fn of(&self, asset: &str) -> Option<[f32; 3]> {
        self.assets.get(asset).and_then(|asset| usable(&asset.bounding_box))
    }
}

/// Returns a box's sides, if all are positive numbers.
pub(super) fn usable(size: &UnityVector) -> Option<[f32; 3]> {
    let sides = [size.x, size.y, size.z];
    let are_positive = sides.iter().all(|side| side.is_finite() && *side > 0.0);
    are_positive.then(|| sides.map(|side| side.clamp(SIDES_M.0, SIDES_M.1)))
}

/// Common size in an mpcat40 category: medians over ProcTHOR's assets.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unity_quarter_turn_is_a_right_turn() {
        // Unity's forward, +Z, is -Z here, and turns towards +X.
        let turned = turn(Rotation::AboutY(90.0)) * Vector3::new(0.0, 0.0, -1.0);
        assert!((turned - Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-6, "{turned}");
        let tipped =
            turn(Rotation::Angles(UnityVector { x: 90.0, y: 0.0, z: 0.0 })) * Vector3::new(0.0, 0.0, -1.0);
        assert!(
            (tipped - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-6,
            "a positive pitch looks down: {tipped}"
        );
    }

    #[test]
    fn object_types_have_common_names() {
        for (kind, expected) in
            [("TVStand", "tv stand"), ("CoffeeTable", "coffee table"), ("Sink_26", "sink"), ("Book", "book")]
        {
            let thing = ProcthorObject { object_type: kind.to_owned(), ..ProcthorObject::default() };
            assert_eq!(words(&thing, &AssetSizes::default()), expected);
        }
    }
}
