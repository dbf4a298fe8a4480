//! The objects of a house, as boxes.

use super::schema::{House, Place, Rotation, Thing};
use super::shell::Room;
use super::sizes::{Sizes, common, usable};
use super::{Builder, finite_box, world};
use crate::Report;
use crate::files::Checked;
use crate::glb::category_of_name;
use avln_geom::{Aabb, Point3, Vector3};
use avln_scene::colors::PALETTE;
use avln_scene::describe::{Meaning, Surfaces, meaning};
use avln_scene::{Attributes, InstanceId, Object};
use nalgebra::Matrix3;
use std::f32::consts::PI;

/// Objects of a house, those on others included.
const MAX_OBJECTS: usize = 1 << 16;
/// Kinds of AI2-THOR whose names do not say what people call them.
const KINDS: [(&str, &str); 14] = [
    ("ArmChair", "armchair"),
    ("TVStand", "tv stand"),
    ("GarbageCan", "trash can"),
    ("GarbageBag", "garbage bag"),
    ("DogBed", "dog basket"),
    ("Desktop", "desktop computer"),
    ("Footstool", "footstool"),
    ("RoomDecor", "decoration"),
    ("TableTopDecor", "decoration"),
    ("SideTable", "side table"),
    ("HandTowel", "towel"),
    ("TeddyBear", "toy"),
    ("Box", "box"),
    ("Safe", "safe"),
];
/// Triangles of a box whose corner number has bit 0 for x, bit 1 for y and bit 2 for z, seen from outside.
const SIDES: [[u32; 4]; 6] =
    [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Adds a box for every object, children after their parents, and describes those with a category.
pub(super) fn build(
    house: &House,
    sizes: &Sizes,
    rooms: &[Room],
    builder: &mut Builder,
    report: &mut Report,
) -> Checked<Vec<Object>> {
    let mut objects = Vec::new();
    let mut open: Vec<&Thing> = house.objects.iter().rev().collect();
    let mut seen = 0;
    while let Some(thing) = open.pop() {
        seen += 1;
        if seen > MAX_OBJECTS {
            return Err(format!("it has more than {MAX_OBJECTS} objects; split the house"));
        }
        open.extend(thing.children.iter().rev());
        let words = words(thing, sizes);
        let id = InstanceId(objects.len() as u32 + 1);
        match meaning(&words) {
            Meaning::Object { category, noun } => {
                let size = size(thing, sizes, &category, report);
                let (bounds, triangles) = add_box(thing, size, id, builder)?;
                let surfaces = Surfaces { mesh: &builder.mesh, materials: &builder.materials, textures: &[] };
                let attributes = Attributes { noun, ..surfaces.attributes(&triangles, &bounds) };
                let region =
                    rooms.iter().position(|room| room.holds(&bounds.center())).map(|index| index as u16);
                objects.push(Object { id, category, bounds, region, attributes });
            }
            Meaning::Structure | Meaning::Nothing => {
                let size = size(thing, sizes, "", report);
                add_box(thing, size, InstanceId::NONE, builder)?;
            }
        }
    }
    Ok(objects)
}

/// What the thing is called: by its type, the database, or the front of its id (`Dresser|2|0`).
fn words(thing: &Thing, sizes: &Sizes) -> String {
    let front = thing.id.split('|').next().unwrap_or_default();
    let told = Some(thing.object_type.as_str())
        .filter(|kind| !kind.is_empty())
        .or_else(|| sizes.kind(&thing.asset_id));
    let kind = told.unwrap_or(front);
    let listed = KINDS.iter().find(|(name, _)| *name == kind).map(|(_, words)| (*words).to_owned());
    let by_asset =
        || category_of_name(&thing.asset_id).filter(|_| told.is_none() && category_of_name(kind).is_none());
    listed.unwrap_or_else(|| by_asset().map_or_else(|| spaced(kind), str::to_owned))
}

/// `CoffeeTable_3` as `coffee table`.
fn spaced(name: &str) -> String {
    let name = name.trim_end_matches(|letter: char| letter.is_ascii_digit() || letter == '_');
    let mut words = String::new();
    let mut before = ' ';
    for letter in name.chars() {
        if letter.is_uppercase() && before.is_lowercase() {
            words.push(' ');
        }
        words.extend(if letter == '_' { ' ' } else { letter }.to_lowercase());
        before = letter;
    }
    words
}

fn size(thing: &Thing, sizes: &Sizes, category: &str, report: &mut Report) -> [f32; 3] {
    let known = sizes.of(&thing.asset_id).or_else(|| thing.bounding_box.as_ref().and_then(usable));
    known.unwrap_or_else(|| {
        report.warn(format!(
            "the size of asset {:?} is not known; a common size is used (put asset-database.json of ProcTHOR beside the house)",
            thing.asset_id
        ));
        common(category)
    })
}

fn add_box(
    thing: &Thing,
    size: [f32; 3],
    id: InstanceId,
    builder: &mut Builder,
) -> Checked<(Aabb, Vec<u32>)> {
    let center = world(&thing.position);
    let turn = turn(thing.rotation);
    let corner = |number: u32| {
        let side = |axis: usize| if number >> axis & 1 == 0 { -size[axis] / 2.0 } else { size[axis] / 2.0 };
        center + turn * Vector3::new(side(0), side(1), side(2))
    };
    let corners: Vec<Point3<f32>> = (0..8).map(corner).collect();
    let bounds = finite_box(&corners).ok_or_else(|| {
        format!("object {:?} has no finite place; correct its position and rotation", thing.id)
    })?;
    let [first, ..] = *blake3::hash(thing.asset_id.as_bytes()).as_bytes();
    let (_, color) = PALETTE[usize::from(first) % PALETTE.len()];
    let material = builder.material("stand-in", color);
    let start = builder.mesh.triangles.len() as u32;
    for side in SIDES {
        let quad = side.map(|corner| corners[corner as usize]);
        builder.add(&quad, &[[0, 1, 2], [0, 2, 3]], material, id);
    }
    Ok((bounds, (start..builder.mesh.triangles.len() as u32).collect()))
}

/// Unity turns about Z, then X, then Y, in a left-handed frame; the world's Z points the other way.
fn turn(rotation: Rotation) -> Matrix3<f32> {
    let Place { x, y, z } = match rotation {
        Rotation::Angles(angles) => angles,
        Rotation::AboutY(y) => Place { x: 0.0, y, z: 0.0 },
    };
    let [x, y, z] =
        [x, y, z].map(|degrees| degrees % 360.0 * PI / 180.0).map(|rad| (libm::sinf(rad), libm::cosf(rad)));
    let about_x = Matrix3::new(1.0, 0.0, 0.0, 0.0, x.1, -x.0, 0.0, x.0, x.1);
    let about_y = Matrix3::new(y.1, 0.0, y.0, 0.0, 1.0, 0.0, -y.0, 0.0, y.1);
    let about_z = Matrix3::new(z.1, -z.0, 0.0, z.0, z.1, 0.0, 0.0, 0.0, 1.0);
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
    mirror * (about_y * about_x * about_z) * mirror
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_of_unity_is_a_turn_to_the_right() {
        // Unity's forward, +Z, is -Z here, and turns towards +X.
        let turned = turn(Rotation::AboutY(90.0)) * Vector3::new(0.0, 0.0, -1.0);
        assert!((turned - Vector3::new(1.0, 0.0, 0.0)).norm() < 1e-6, "{turned}");
        let tipped = turn(Rotation::Angles(Place { x: 90.0, y: 0.0, z: 0.0 })) * Vector3::new(0.0, 0.0, -1.0);
        assert!(
            (tipped - Vector3::new(0.0, -1.0, 0.0)).norm() < 1e-6,
            "a positive pitch looks down: {tipped}"
        );
    }

    #[test]
    fn kinds_are_called_what_people_call_them() {
        for (kind, expected) in
            [("TVStand", "tv stand"), ("CoffeeTable", "coffee table"), ("Sink_26", "sink"), ("Book", "book")]
        {
            let thing = Thing { object_type: kind.to_owned(), ..Thing::default() };
            assert_eq!(words(&thing, &Sizes::default()), expected);
        }
    }
}
