//! Rooms, from the region column and where the instances lie.

use super::annotations::Annotation;
use crate::Region;
use crate::glb::Checked;
use avln_geom::Aabb;
use std::collections::BTreeMap;

/// Room floors that differ by more than this belong to different storeys, metres.
const STOREY_STEP_M: f32 = 1.8;

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

/// The storey of each floor height: a new one begins where the sorted heights jump.
fn storeys(floors_m: &[f32]) -> Vec<u16> {
    let mut order: Vec<usize> = (0..floors_m.len()).collect();
    order.sort_by(|&a, &b| floors_m[a].total_cmp(&floors_m[b]));
    let mut storeys = vec![0; floors_m.len()];
    let mut storey = 0;
    let mut base_m = order.first().map_or(0.0, |&lowest| floors_m[lowest]);
    for index in order {
        if floors_m[index] - base_m > STOREY_STEP_M {
            storey += 1;
            base_m = floors_m[index];
        }
        storeys[index] = storey;
    }
    storeys
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_storey_begins_where_floors_jump() {
        assert_eq!(storeys(&[2.9, 0.0, 0.3, 6.0, -0.1]), [1, 0, 0, 2, 0]);
        assert!(storeys(&[]).is_empty());
    }
}
