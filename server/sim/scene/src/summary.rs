//! What a scene holds, in numbers.

use crate::Scene;
use crate::digest::digest;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Counts and extents of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The scene's name.
    pub name: String,
    /// Its digest ([`digest`]).
    pub digest: String,
    /// Triangles.
    pub triangles: usize,
    /// Vertices.
    pub vertices: usize,
    /// Triangles that belong to an instance.
    pub labelled_triangles: usize,
    /// Materials.
    pub materials: usize,
    /// Textures.
    pub textures: usize,
    /// Texels of all textures.
    pub texels: u64,
    /// Instances.
    pub instances: usize,
    /// How many instances there are of each category.
    pub instances_by_category: BTreeMap<String, usize>,
    /// Regions.
    pub regions: usize,
    /// How many regions have each label; the empty one is unknown.
    pub regions_by_label: BTreeMap<String, usize>,
    /// Storeys that hold a region; 1 where there are no regions.
    pub storeys: usize,
    /// Lowest coordinates x, y, z, metres.
    pub min_m: [f32; 3],
    /// Highest coordinates x, y, z, metres.
    pub max_m: [f32; 3],
}

impl Summary {
    /// Counts what `scene` holds.
    pub fn of(scene: &Scene) -> Self {
        let bounds = scene.bounds();
        let storeys: BTreeSet<u16> = scene.regions.iter().map(|region| region.storey).collect();
        Self {
            name: scene.name.clone(),
            digest: digest(scene),
            triangles: scene.mesh.triangles.len(),
            vertices: scene.mesh.positions.len(),
            labelled_triangles: scene.mesh.instance_of.iter().filter(|id| id.0 != 0).count(),
            materials: scene.materials.len(),
            textures: scene.textures.len(),
            texels: scene
                .textures
                .iter()
                .map(|texture| u64::from(texture.width) * u64::from(texture.height))
                .sum(),
            instances: scene.objects.len(),
            instances_by_category: counted(scene.objects.iter().map(|object| object.category.as_str())),
            regions: scene.regions.len(),
            regions_by_label: counted(scene.regions.iter().map(|region| region.label.as_str())),
            storeys: storeys.len().max(1),
            min_m: bounds.map_or([0.0; 3], |bounds| bounds.min.into()),
            max_m: bounds.map_or([0.0; 3], |bounds| bounds.max.into()),
        }
    }
}

fn counted<'a>(words: impl Iterator<Item = &'a str>) -> BTreeMap<String, usize> {
    let mut counts = BTreeMap::new();
    words.for_each(|word| *counts.entry(word.to_owned()).or_default() += 1);
    counts
}
