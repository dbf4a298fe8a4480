//! Rooms and storeys of a Matterport3D house.

use super::house::{House, Room};
use crate::Report;
use crate::files::Checked;
use crate::frame::Frame;
use avln_geom::{Aabb, Point3};
use avln_scene::Region;
use std::collections::BTreeMap;

/// What the letters of rooms mean (Matterport3D's data organisation).
const LABELS: [(&str, &str); 30] = [
    ("a", "bathroom"),
    ("b", "bedroom"),
    ("c", "closet"),
    ("d", "dining_room"),
    ("e", "entryway"),
    ("f", "family_room"),
    ("g", "garage"),
    ("h", "hallway"),
    ("i", "library"),
    ("j", "laundry_room"),
    ("k", "kitchen"),
    ("l", "living_room"),
    ("m", "meeting_room"),
    ("n", "lounge"),
    ("o", "office"),
    ("p", "porch"),
    ("r", "rec_room"),
    ("s", "stairs"),
    ("t", "toilet"),
    ("u", "utility_room"),
    ("v", "tv_room"),
    ("w", "gym"),
    ("x", "outdoor"),
    ("y", "balcony"),
    ("z", "other_room"),
    ("B", "bar"),
    ("C", "classroom"),
    ("D", "dining_booth"),
    ("S", "spa"),
    ("Z", "junk"),
];

/// The rooms of the table in its order, and the place of each by its number there. Rooms without surfaces keep their place
/// as a box without extent.
pub(super) fn regions(
    house: &House,
    frame: &Frame,
    report: &mut Report,
) -> Checked<(Vec<Region>, BTreeMap<u32, u16>)> {
    let storey_of = storeys(house);
    let mut regions = Vec::with_capacity(house.regions.len());
    let mut index_of = BTreeMap::new();
    for room in &house.regions {
        let index = u16::try_from(regions.len()).map_err(|_| "it has more than 65536 regions".to_owned())?;
        index_of.insert(room.index, index);
        let storey = room.level.and_then(|level| storey_of.get(&level).copied());
        if storey.is_none() && !storey_of.is_empty() {
            report.warn(format!("region {} is on no level; it counts to the lowest", room.index));
        }
        regions.push(Region {
            label: label(room, report),
            bounds: bounds(room, frame),
            storey: storey.unwrap_or(0),
        });
    }
    Ok((regions, index_of))
}

/// The storey of each level by its number: levels in the order of their floors.
fn storeys(house: &House) -> BTreeMap<u32, u16> {
    let mut levels: Vec<_> = house.levels.iter().collect();
    levels.sort_by(|a, b| a.floor_m.total_cmp(&b.floor_m).then(a.index.cmp(&b.index)));
    (0_u16..).zip(levels).map(|(storey, level)| (level.index, storey)).collect()
}

fn label(room: &Room, report: &mut Report) -> String {
    let found = LABELS.iter().find(|(letter, _)| *letter == room.label);
    if found.is_none() && room.label != "-" {
        let start: String = room.label.chars().take(20).collect();
        report.warn(format!("the label {start:?} of region {} is not known; it has none", room.index));
    }
    found.map_or_else(String::new, |(_, name)| (*name).to_owned())
}

fn bounds(room: &Room, frame: &Frame) -> Aabb {
    match room.bounds {
        Some([low, high]) => frame.bounds(low, high),
        None => Aabb::new(Point3::origin(), Point3::origin()),
    }
}
