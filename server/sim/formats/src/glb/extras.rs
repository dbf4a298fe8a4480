//! What exported files say beyond glTF, under `extras.avln` of nodes and of the scene.

use crate::files::Checked;
use avln_geom::{Aabb, Point3};
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{Attributes, InstanceId, Object, Region};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

const KEY: &str = "avln";

/// A node's instance; number 0 marks surfaces that belong to none.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(super) struct NodeExtras {
    pub(super) instance: u32,
    pub(super) category: String,
    pub(super) region: Option<u16>,
    noun: String,
    color: String,
    material: String,
    size: String,
    shape: String,
    min: [f32; 3],
    max: [f32; 3],
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct SceneExtras {
    regions: Vec<RegionExtras>,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct RegionExtras {
    label: String,
    storey: u16,
    min: [f32; 3],
    max: [f32; 3],
}

impl NodeExtras {
    /// What the `extras` of the node called `name` say; `None` when they are not ours.
    pub(super) fn read(extras: &Value, name: &str) -> Checked<Option<Self>> {
        let Some(ours) = extras.get(KEY) else { return Ok(None) };
        let fail = |reason: &str| format!("extras.{KEY} of node {name:?} {reason}; correct or remove it");
        let read = Self::deserialize(ours).map_err(|error| fail(&format!("cannot be read ({error})")))?;
        let words = [&read.category, &read.noun, &read.color, &read.material, &read.size, &read.shape];
        if words
            .iter()
            .any(|word| word.chars().count() > MAX_WORD_CHARS || word.chars().any(char::is_control))
        {
            return Err(fail(&format!(
                "holds a word of more than {MAX_WORD_CHARS} characters or with control characters"
            )));
        }
        if read.instance > InstanceId::MAX {
            return Err(fail(&format!(
                "names instance {}; the largest number is {}",
                read.instance,
                InstanceId::MAX
            )));
        }
        if read.instance != 0 && read.category.trim().is_empty() {
            return Err(fail("names an instance without a category"));
        }
        Ok(Some(read))
    }

    pub(super) fn attributes(&self) -> Attributes {
        Attributes {
            noun: self.noun.clone(),
            color: self.color.clone(),
            material: self.material.clone(),
            size: self.size.clone(),
            shape: self.shape.clone(),
        }
    }

    /// The stored box, for an instance without surfaces.
    pub(super) fn bounds(&self) -> Option<Aabb> {
        finite_box(self.min, self.max)
    }
}

/// `extras` of the node of `object`.
pub(super) fn of_object(object: &Object) -> Value {
    let Attributes { noun, color, material, size, shape } = object.attributes.clone();
    json!({ KEY: NodeExtras {
        instance: object.id.0,
        category: object.category.clone(),
        region: object.region,
        noun,
        color,
        material,
        size,
        shape,
        min: object.bounds.min.into(),
        max: object.bounds.max.into(),
    } })
}

/// `extras` of a node whose surfaces belong to no object.
pub(super) fn of_structure() -> Value {
    json!({ KEY: { "instance": InstanceId::NONE.0 } })
}

/// `extras` of the scene.
pub(super) fn of_regions(regions: &[Region]) -> Value {
    let region = |region: &Region| RegionExtras {
        label: region.label.clone(),
        storey: region.storey,
        min: region.bounds.min.into(),
        max: region.bounds.max.into(),
    };
    json!({ KEY: SceneExtras { regions: regions.iter().map(region).collect() } })
}

/// The regions that a scene's `extras` list; none when they are not ours.
pub(super) fn read_regions(extras: &Value) -> Checked<Vec<Region>> {
    let Some(ours) = extras.get(KEY) else { return Ok(Vec::new()) };
    let fail = |reason: &str| format!("extras.{KEY} of its scene {reason}; correct or remove it");
    let read = SceneExtras::deserialize(ours).map_err(|error| fail(&format!("cannot be read ({error})")))?;
    if read.regions.len() > usize::from(u16::MAX) {
        return Err(fail("lists more than 65535 regions"));
    }
    let region = |region: RegionExtras| {
        let bounds =
            finite_box(region.min, region.max).ok_or_else(|| fail("gives a region no finite box"))?;
        Ok(Region {
            label: region.label.chars().take(MAX_WORD_CHARS).collect(),
            bounds,
            storey: region.storey,
        })
    };
    read.regions.into_iter().map(region).collect()
}

fn finite_box(min: [f32; 3], max: [f32; 3]) -> Option<Aabb> {
    let finite = min.iter().chain(&max).all(|coordinate| coordinate.is_finite());
    finite.then(|| Aabb::new(Point3::from(min), Point3::from(max)))
}
