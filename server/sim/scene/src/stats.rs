//! What a scene holds, in numbers, next to what real buildings hold.

use crate::{InstanceId, Scene};
use std::collections::{BTreeMap, BTreeSet};

/// Labelled instances per building of Matterport3D (90 buildings), by mpcat40 category, walls and the like left out.
/// Counted from the data set's category mapping.
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

/// Counts of what a scene holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Census {
    /// Rooms; a room of two storeys counts on both.
    pub rooms: usize,
    /// Storeys that rooms lie on; 1 where no room is known.
    pub storeys: usize,
    /// Labelled instances other than doors and windows.
    pub objects: usize,
    /// Triangles of the mesh.
    pub triangles: usize,
    /// Labelled instances by category.
    pub categories: BTreeMap<String, usize>,
}

/// Counts what `scene` holds.
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

/// Kullback-Leibler divergence of Matterport3D's shares of categories ([`MATTERPORT_PER_BUILDING`]) from those of
/// `counts`, nats: the sum of p ln(p / q), where p is Matterport3D's share and q that of `counts` with one half added to
/// each count. 0 for equal shares.
pub fn divergence_from_matterport(counts: &BTreeMap<String, usize>) -> f64 {
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
    fn a_building_like_matterports_does_not_diverge_and_one_of_chairs_does() {
        let like: BTreeMap<String, usize> = MATTERPORT_PER_BUILDING
            .iter()
            .map(|(category, count)| ((*category).to_owned(), (count * 1000.0) as usize))
            .collect();
        assert!(divergence_from_matterport(&like) < 1e-4);
        // Without any counts all shares are equal: the divergence is what entropy lacks to that of 26 equal shares.
        let even = divergence_from_matterport(&BTreeMap::new());
        let total: f64 = MATTERPORT_PER_BUILDING.iter().map(|(_, count)| count).sum();
        let entropy: f64 = MATTERPORT_PER_BUILDING.iter().map(|(_, c)| -c / total * (c / total).ln()).sum();
        assert!((even - (26.0_f64.ln() - entropy)).abs() < 1e-9, "{even}");
        let chairs = BTreeMap::from([("chair".to_owned(), 500)]);
        assert!(divergence_from_matterport(&chairs) > 3.0);
    }
}
