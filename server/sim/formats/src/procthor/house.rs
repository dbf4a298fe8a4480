//! House JSON, and the house mesh. Names follow the JSON keys.

use crate::files::bounded;
use avln_geom::{Aabb, Point2, Point3};
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{InstanceId, Material, Mesh};
use serde::{Deserialize, Deserializer};
use std::collections::BTreeMap;

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct ProcthorHouse {
    #[serde(deserialize_with = "bounded")]
    pub(super) rooms: Vec<RoomEntry>,
    #[serde(deserialize_with = "bounded")]
    pub(super) walls: Vec<Wall>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) doors: Vec<Opening>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) windows: Vec<Opening>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) objects: Vec<ProcthorObject>,
    pub(super) procedural_parameters: Parameters,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Parameters {
    pub(super) ceiling_material: MaterialName,
}

/// Metres, or degrees; Unity's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(default)]
pub(super) struct UnityVector {
    pub(super) x: f32,
    pub(super) y: f32,
    pub(super) z: f32,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct RoomEntry {
    pub(super) id: String,
    pub(super) room_type: String,
    pub(super) floor_material: MaterialName,
    #[serde(deserialize_with = "bounded")]
    pub(super) floor_polygon: Vec<UnityVector>,
}

/// A material: a name, with or without a colour.
#[derive(Clone, Default)]
pub(super) struct MaterialName {
    pub(super) name: String,
    /// Red, green, blue, sRGB, 0 to 1.
    pub(super) color: Option<[f32; 3]>,
}

impl<'de> Deserialize<'de> for MaterialName {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Written {
            Name(String),
            Entry {
                #[serde(default)]
                name: String,
                #[serde(default)]
                color: Option<Color>,
            },
        }
        #[derive(Deserialize)]
        struct Color {
            r: f32,
            g: f32,
            b: f32,
        }
        Ok(match Written::deserialize(deserializer)? {
            Written::Name(name) => Self { name, color: None },
            Written::Entry { name, color } => Self { name, color: color.map(|Color { r, g, b }| [r, g, b]) },
        })
    }
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Wall {
    pub(super) id: String,
    pub(super) room_id: String,
    pub(super) material: MaterialName,
    /// Four corners: two lower and two upper ones, in either order.
    #[serde(deserialize_with = "bounded")]
    pub(super) polygon: Vec<UnityVector>,
}

/// A door or window.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Opening {
    pub(super) id: String,
    pub(super) wall0: String,
    pub(super) wall1: String,
    /// Two opposite corners on `wall0`: x from the lower edge's first point, y up.
    #[serde(deserialize_with = "bounded")]
    pub(super) hole_polygon: Vec<UnityVector>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct ProcthorObject {
    pub(super) id: String,
    pub(super) asset_id: String,
    pub(super) object_type: String,
    /// Box centre.
    pub(super) position: UnityVector,
    /// Unity's Euler angles, degrees.
    pub(super) rotation: Rotation,
    /// Size, if the file has it.
    pub(super) bounding_box: Option<UnityVector>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) children: Vec<ProcthorObject>,
}

/// Angles about the three axes, or about the vertical axis only.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
pub(super) enum Rotation {
    Angles(UnityVector),
    AboutY(f32),
}

impl Default for Rotation {
    fn default() -> Self {
        Self::AboutY(0.0)
    }
}

/// A list, or `null` for none.
fn maybe_bounded<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    struct Listed<T>(Vec<T>);
    impl<'de, T: Deserialize<'de>> Deserialize<'de> for Listed<T> {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            bounded(deserializer).map(Listed)
        }
    }
    Ok(Option::<Listed<T>>::deserialize(deserializer)?.map_or(Vec::new(), |listed| listed.0))
}

/// A house mesh under construction.
#[derive(Default)]
pub(super) struct HouseMesh {
    pub(super) mesh: Mesh,
    pub(super) materials: Vec<Material>,
    material_of: BTreeMap<(String, [u8; 3]), u16>,
}

impl HouseMesh {
    /// Returns a plain material's number; creates it at the first use.
    pub(super) fn material(&mut self, name: &str, color: [u8; 3]) -> u16 {
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

    /// Adds corners and triangles; indices count from the first new corner.
    pub(super) fn add(
        &mut self,
        corners: &[Point3<f32>],
        triangles: &[[u32; 3]],
        material: u16,
        instance: InstanceId,
    ) {
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

    /// Adds a quadrilateral; corners are in order.
    pub(super) fn add_quad(&mut self, corners: [Point3<f32>; 4], material: u16) {
        self.add(&corners, &[[0, 1, 2], [0, 2, 3]], material, InstanceId::NONE);
    }
}

/// Converts a point to the world frame.
pub(super) fn world(point: &UnityVector) -> Point3<f32> {
    Point3::new(point.x, point.y, -point.z)
}

/// Returns the points' box; `None` if a coordinate is not finite.
pub(super) fn finite_box(points: &[Point3<f32>]) -> Option<Aabb> {
    let finite = points.iter().flat_map(|point| point.iter()).all(|coordinate| coordinate.is_finite());
    Aabb::around(points).filter(|_| finite)
}
