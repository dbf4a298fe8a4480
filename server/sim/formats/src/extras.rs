//! Instance data in exported files, under `extras.avln` in nodes and in the scene.

use crate::files::Checked;
use avln_geom::{Aabb, Point3};
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{Attributes, InstanceId, Object, Region};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

const KEY: &str = "avln";

/// A node's instance; number 0 marks structure.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct NodeExtras {
    pub(crate) instance: u32,
    pub(crate) category: String,
    pub(crate) region: Option<u16>,
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
    /// Reads the node's `extras`; `None` if another program wrote them.
    pub(crate) fn read(extras: &Value, name: &str) -> Checked<Option<Self>> {
        let Some(ours) = extras.get(KEY) else { return Ok(None) };
        let fail = |reason: &str| format!("extras.{KEY} of node {name:?} {reason}; correct or remove it");
        let read = Self::deserialize(ours).map_err(|error| fail(&format!("cannot be read ({error})")))?;
        let words = [&read.category, &read.noun, &read.color, &read.material, &read.size, &read.shape];
        if words
            .iter()
            .any(|word| word.chars().count() > MAX_WORD_CHARS || word.chars().any(char::is_control))
        {
            return Err(fail(&format!(
                "contains a word of more than {MAX_WORD_CHARS} characters or with control characters"
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

    pub(crate) fn attributes(&self) -> Attributes {
        Attributes {
            noun: self.noun.clone(),
            color: self.color.clone(),
            material: self.material.clone(),
            size: self.size.clone(),
            shape: self.shape.clone(),
        }
    }

    /// Returns the stored box, for an instance without surfaces.
    pub(crate) fn bounds(&self) -> Option<Aabb> {
        finite_box(self.min, self.max)
    }
}

/// Returns the `extras` for an object's node.
pub(crate) fn of_object(object: &Object) -> Value {
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

/// Returns the `extras` for the structure's node.
pub(crate) fn of_structure() -> Value {
    json!({ KEY: { "instance": InstanceId::NONE.0 } })
}

/// Returns the `extras` for the scene.
pub(crate) fn of_regions(regions: &[Region]) -> Value {
    let region = |region: &Region| RegionExtras {
        label: region.label.clone(),
        storey: region.storey,
        min: region.bounds.min.into(),
        max: region.bounds.max.into(),
    };
    json!({ KEY: SceneExtras { regions: regions.iter().map(region).collect() } })
}

/// Reads the regions in a scene's `extras`; none if another program wrote them.
pub(crate) fn read_regions(extras: &Value) -> Checked<Vec<Region>> {
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
