//! Rooms, from the region column and where the instances lie.

use super::annotations::Annotation;
use crate::files::Checked;
use avln_geom::Aabb;
use avln_scene::Region;
use avln_scene::describe::storeys;
use std::collections::BTreeMap;

type Regions = (Vec<Region>, BTreeMap<i32, u16>);

/// The rooms in the order of their numbers in the file, and where each of those numbers is found.
/// A room is the box around its instances; rooms without any are left out.
pub(super) fn regions(annotations: &[Annotation], bounds_of: &BTreeMap<u32, Aabb>) -> Checked<Regions> {
    let mut boxes: BTreeMap<i32, Aabb> = BTreeMap::new();
    for annotation in annotations.iter().filter(|annotation| annotation.region >= 0) {
        let Some(bounds) = bounds_of.get(&annotation.id) else { continue };
        boxes.entry(annotation.region).and_modify(|room| *room = room.union(bounds)).or_insert(*bounds);
    }
    let storeys = storeys(&boxes.values().map(|room| room.min.y).collect::<Vec<_>>());
    let mut regions = Vec::new();
    let mut index_of = BTreeMap::new();
    for ((number, bounds), storey) in boxes.into_iter().zip(storeys) {
        let index = u16::try_from(regions.len()).map_err(|_| "it has more than 65536 regions".to_owned())?;
        index_of.insert(number, index);
        regions.push(Region { label: String::new(), bounds, storey });
    }
    Ok((regions, index_of))
}
