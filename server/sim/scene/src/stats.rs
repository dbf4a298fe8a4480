//! Scene counts, and a comparison with Matterport3D.

use crate::digest::digest;
use crate::{InstanceId, Scene};
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};

/// Scene counts and extents.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Scene name.
    pub name: String,
    /// Scene [`digest`].
    pub digest: String,
    /// Triangle count.
    pub triangles: usize,
    /// Vertex count.
    pub vertices: usize,
    /// Labelled triangle count.
    pub labelled_triangles: usize,
    /// Material count.
    pub materials: usize,
    /// Texture count.
    pub textures: usize,
    /// Total texels.
    pub texels: u64,
    /// Instance count.
    pub instances: usize,
    /// Instances by category.
    pub instances_by_category: BTreeMap<String, usize>,
    /// Region count.
    pub regions: usize,
    /// Regions by label; the empty label is unknown.
    pub regions_by_label: BTreeMap<String, usize>,
    /// Storeys with a region; 1 for a scene without regions.
    pub storeys: usize,
    /// Lowest coordinates x, y, z, metres.
    pub min_m: [f32; 3],
    /// Highest coordinates x, y, z, metres.
    pub max_m: [f32; 3],
}

impl Summary {
    /// Counts everything in `scene`.
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

/// Mean labelled instances per Matterport3D building (90 buildings), by mpcat40 category, without walls and other
/// structure. Counted from the data set's category mapping.
pub const MATTERPORT_PER_BUILDING: [(&str, f64); 26] = [
    ("chair", 32.8),
    ("picture", 30.0),
    ("lighting", 19.3),
    ("cushion", 17.5),
    ("table", 17.1),
    ("cabinet", 13.9),
    ("curtain", 9.4),
    ("plant", 8.6),
    ("shelving", 7.7),
    ("sink", 5.9),
    ("mirror", 5.8),
    ("chest_of_drawers", 5.6),
    ("towel", 5.4),
    ("counter", 4.2),
    ("bed", 4.1),
    ("stool", 4.1),
    ("sofa", 4.0),
    ("shower", 3.8),
    ("appliances", 3.5),
    ("toilet", 3.2),
    ("tv_monitor", 3.2),
    ("seating", 2.8),
    ("clothes", 2.0),
    ("fireplace", 1.5),
    ("bathtub", 1.4),
    ("gym_equipment", 0.9),
];

/// Room, object and category counts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Census {
    /// Room count; a room on two storeys counts twice.
    pub rooms: usize,
    /// Storeys with rooms; 1 for a scene without rooms.
    pub storeys: usize,
    /// Labelled instances other than doors and windows.
    pub objects: usize,
    /// Triangle count.
    pub triangles: usize,
    /// Labelled instances by category.
    pub categories: BTreeMap<String, usize>,
}

/// Counts rooms, objects and categories in `scene`.
pub fn census(scene: &Scene) -> Census {
    let mut categories = BTreeMap::new();
    for object in scene.objects.iter().filter(|object| object.id != InstanceId::NONE) {
        *categories.entry(object.category.clone()).or_default() += 1;
    }
    let storeys: BTreeSet<u16> = scene.regions.iter().map(|region| region.storey).collect();
    let placed = categories.iter().filter(|(category, _)| !matches!(category.as_str(), "door" | "window"));
    Census {
        rooms: scene.regions.len(),
        storeys: storeys.len().max(1),
        objects: placed.map(|(_, count)| count).sum(),
        triangles: scene.mesh.triangles.len(),
        categories,
    }
}

/// Returns the Kullback-Leibler divergence, in nats, between the category shares of Matterport3D
/// ([`MATTERPORT_PER_BUILDING`]) and those of `counts`: the sum of p ln(p / q) with Matterport3D's share p and the share q
/// of `counts`. 0 for equal shares.
pub fn divergence_from_matterport(counts: &BTreeMap<String, usize>) -> f64 {
    // Half a count more per category: the logarithm stays finite for missing ones.
    let ours = |category: &str| 0.5 + counts.get(category).copied().unwrap_or(0) as f64;
    let total: f64 = MATTERPORT_PER_BUILDING.iter().map(|(_, count)| count).sum();
    let our_total: f64 = MATTERPORT_PER_BUILDING.iter().map(|(category, _)| ours(category)).sum();
    let term = |(category, count): &(&str, f64)| {
        let (p, q) = (count / total, ours(category) / our_total);
        p * libm::log(p / q)
    };
    MATTERPORT_PER_BUILDING.iter().map(term).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn divergence_is_zero_for_matterports_shares_only() {
        let like: BTreeMap<String, usize> = MATTERPORT_PER_BUILDING
            .iter()
            .map(|(category, count)| ((*category).to_owned(), (count * 1000.0) as usize))
            .collect();
        assert!(divergence_from_matterport(&like) < 1e-4);
        // Without counts all shares are equal: the divergence is the entropy of 26 equal shares less that of Matterport3D.
        let even = divergence_from_matterport(&BTreeMap::new());
        let total: f64 = MATTERPORT_PER_BUILDING.iter().map(|(_, count)| count).sum();
        let entropy: f64 = MATTERPORT_PER_BUILDING.iter().map(|(_, c)| -c / total * (c / total).ln()).sum();
        assert!((even - (26.0_f64.ln() - entropy)).abs() < 1e-9, "{even}");
        let chairs = BTreeMap::from([("chair".to_owned(), 500)]);
        assert!(divergence_from_matterport(&chairs) > 3.0);
    }
}
