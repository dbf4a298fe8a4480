//! The house's JSON, as far as it says where things are. Names follow its keys.

use crate::glb::bounded;
use serde::{Deserialize, Deserializer};

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct House {
    #[serde(deserialize_with = "bounded")]
    pub(super) rooms: Vec<RoomEntry>,
    #[serde(deserialize_with = "bounded")]
    pub(super) walls: Vec<Wall>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) doors: Vec<Opening>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) windows: Vec<Opening>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) objects: Vec<Thing>,
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
pub(super) struct Place {
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
    pub(super) floor_polygon: Vec<Place>,
}

/// A material by its name alone, or with a colour.
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
    /// Four corners: two below, two above, or the other way round.
    #[serde(deserialize_with = "bounded")]
    pub(super) polygon: Vec<Place>,
}

/// A door or window.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Opening {
    pub(super) id: String,
    pub(super) wall0: String,
    pub(super) wall1: String,
    /// Two opposite corners on `wall0`: x along its lower edge from the edge's first point, y up.
    #[serde(deserialize_with = "bounded")]
    pub(super) hole_polygon: Vec<Place>,
}

#[derive(Default, Deserialize)]
#[serde(default, rename_all = "camelCase")]
pub(super) struct Thing {
    pub(super) id: String,
    pub(super) asset_id: String,
    pub(super) object_type: String,
    /// Centre of the box.
    pub(super) position: Place,
    /// Unity's Euler angles, degrees.
    pub(super) rotation: Rotation,
    /// Size, where the file gives one.
    pub(super) bounding_box: Option<Place>,
    #[serde(deserialize_with = "maybe_bounded")]
    pub(super) children: Vec<Thing>,
}

/// Angles about the three axes, or one about the vertical.
#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
pub(super) enum Rotation {
    Angles(Place),
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
