//! Floors, ceilings, and walls with holes for doors and windows.

use super::outline::{MAX_CORNERS, holds, triangles};
use super::schema::{House, MaterialName, Opening, Wall};
use super::{Builder, finite_box, world};
use crate::Report;
use crate::files::Checked;
use avln_geom::{Aabb, Point2, Point3, Vector3};
use avln_scene::InstanceId;
use avln_scene::limits::MAX_WORD_CHARS;

/// A wall is drawn this far from its line, towards the side it is seen from, so that the two sides of a wall differ; metres.
const HALF_WALL_M: f32 = 0.01;
/// Height of a room whose walls say none, metres.
const COMMON_HEIGHT_M: f32 = 2.5;
/// Two walls lie on one line when their corners are at most this far from it, metres.
const SAME_LINE_M: f32 = 0.02;
/// The mark of walls that are seen from outside.
const EXTERIOR: &str = "exterior";
const GLASS: [u8; 3] = [196, 216, 226];
const DOOR: [u8; 3] = [120, 84, 54];
/// Words in the names of Unity materials, with the name that acoustics knows and a colour.
const LOOKS: [(&str, &str, [u8; 3]); 9] = [
    ("wood", "wood", [156, 112, 70]),
    ("carpet", "carpet", [150, 140, 130]),
    ("brick", "brick", [150, 76, 60]),
    ("marble", "tile", [214, 210, 204]),
    ("tile", "tile", [206, 204, 198]),
    ("concrete", "concrete", [160, 160, 158]),
    ("drywall", "plaster", [226, 220, 204]),
    ("wallpaper", "plaster", [216, 208, 190]),
    ("orange", "plaster", [222, 170, 110]),
];

/// A room of the house.
pub(super) struct Room {
    pub(super) label: String,
    pub(super) bounds: Aabb,
    /// Seen from above, in (x, z) of the world.
    outline: Vec<Point2<f32>>,
}

impl Room {
    pub(super) fn holds(&self, point: &Point3<f32>) -> bool {
        (self.bounds.min.y..=self.bounds.max.y).contains(&point.y)
            && holds(&self.outline, &Point2::new(point.x, point.z))
    }
}

/// A wall as a rectangle that stands on its lower edge.
struct Panel<'a> {
    wall: &'a Wall,
    start: Point3<f32>,
    /// Unit vector along the lower edge.
    along: Vector3<f32>,
    length_m: f32,
    height_m: f32,
    /// Unit vector to the side it is seen from.
    facing: Vector3<f32>,
}

/// A rectangle on a panel: along its edge and up, metres.
#[derive(Clone, Copy)]
struct Hole {
    from: [f32; 2],
    to: [f32; 2],
}

/// Adds the building itself; the rooms in the order of the file.
pub(super) fn build(house: &House, builder: &mut Builder, report: &mut Report) -> Checked<Vec<Room>> {
    let rooms = rooms(house)?;
    for (room, entry) in rooms.iter().zip(&house.rooms) {
        add_level(room, &entry.floor_material, room.bounds.min.y, true, builder)?;
        add_level(room, &house.procedural_parameters.ceiling_material, room.bounds.max.y, false, builder)?;
    }
    let panels: Checked<Vec<Option<Panel<'_>>>> =
        house.walls.iter().map(|wall| panel(wall, house, &rooms, report)).collect();
    let panels: Vec<Panel<'_>> = panels?.into_iter().flatten().collect();
    let mut holes: Vec<Vec<Hole>> = panels.iter().map(|_| Vec::new()).collect();
    let openings =
        house.doors.iter().map(|door| (door, true)).chain(house.windows.iter().map(|window| (window, false)));
    for (opening, is_door) in openings {
        let Some(index) = panels.iter().position(|panel| panel.wall.id == opening.wall0) else {
            report.warn(format!("{:?} is in no wall; left out", opening.id));
            continue;
        };
        let hole = hole(opening, &panels[index])?;
        for (panel, holes) in panels.iter().zip(&mut holes) {
            holes.extend(hole_through(panel, &panels[index], &hole));
        }
        fill(opening, is_door, &panels[index], &hole, builder);
    }
    for (panel, holes) in panels.iter().zip(&holes) {
        add_panel(panel, holes, builder);
    }
    Ok(rooms)
}

fn rooms(house: &House) -> Checked<Vec<Room>> {
    if house.rooms.is_empty() || house.rooms.len() > usize::from(u16::MAX) {
        return Err(format!("it has {} rooms, 1 to 65535 are read", house.rooms.len()));
    }
    let room = |entry: &super::schema::RoomEntry| {
        if entry.floor_polygon.len() < 3 || entry.floor_polygon.len() > MAX_CORNERS {
            return Err(format!(
                "room {:?} has an outline of {} corners, 3 to {MAX_CORNERS} are read; correct floorPolygon",
                entry.id,
                entry.floor_polygon.len()
            ));
        }
        let mut corners: Vec<Point3<f32>> = entry.floor_polygon.iter().map(world).collect();
        let outline = corners.iter().map(|corner| Point2::new(corner.x, corner.z)).collect();
        let floor_m = corners.iter().map(|corner| corner.y).fold(f32::INFINITY, f32::min);
        let walls = house.walls.iter().filter(|wall| wall.room_id == entry.id);
        let tops = walls.flat_map(|wall| &wall.polygon).map(|corner| corner.y);
        let top_m = tops.fold(floor_m, f32::max);
        let top_m = if top_m > floor_m { top_m } else { floor_m + COMMON_HEIGHT_M };
        corners.push(Point3::new(corners[0].x, top_m, corners[0].z));
        let bounds = finite_box(&corners)
            .ok_or_else(|| format!("room {:?} has no finite outline; correct floorPolygon", entry.id))?;
        Ok(Room { label: label(&entry.room_type), bounds, outline })
    };
    house.rooms.iter().map(room).collect()
}

/// `LivingRoom` as `living room`.
fn label(room_type: &str) -> String {
    let mut words = String::new();
    for letter in room_type.chars().filter(|letter| !letter.is_control()).take(MAX_WORD_CHARS) {
        if letter.is_uppercase() && !words.is_empty() {
            words.push(' ');
        }
        words.extend(letter.to_lowercase());
    }
    words
}

/// A floor, seen from above, or a ceiling, seen from below.
fn add_level(
    room: &Room,
    material: &MaterialName,
    height_m: f32,
    is_floor: bool,
    builder: &mut Builder,
) -> Checked<()> {
    let mut found = triangles(&room.outline).ok_or_else(|| {
        format!("a {} has an outline that crosses itself; correct floorPolygon", room.label)
    })?;
    // An outline that turns from x to z, seen from above, runs clockwise: its triangles face down.
    let faces_down = super::outline::signed_area_m2(&room.outline) > 0.0;
    if faces_down == is_floor {
        found.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    let corners: Vec<Point3<f32>> = room.outline.iter().map(|at| Point3::new(at.x, height_m, at.y)).collect();
    let material = look(material, builder);
    builder.add(&corners, &found, material, InstanceId::NONE);
    Ok(())
}

fn look(material: &MaterialName, builder: &mut Builder) -> u16 {
    let name = material.name.to_lowercase();
    let known = LOOKS.iter().find(|(word, ..)| name.contains(word));
    let (plain, color) = known.map_or(("plaster", [224; 3]), |&(_, plain, color)| (plain, color));
    let given = material.color.map(|color| color.map(|share| (share.clamp(0.0, 1.0) * 255.0).round() as u8));
    builder.material(plain, given.unwrap_or(color))
}

/// The wall as a panel; one without extent is left out.
fn panel<'a>(
    wall: &'a Wall,
    house: &House,
    rooms: &[Room],
    report: &mut Report,
) -> Checked<Option<Panel<'a>>> {
    let corners: Vec<Point3<f32>> = wall.polygon.iter().map(world).collect();
    let bounds = finite_box(&corners).filter(|_| corners.len() == 4);
    let bounds = bounds.ok_or_else(|| {
        format!("wall {:?} is not made of four finite corners; correct its polygon", wall.id)
    })?;
    let middle_m = (bounds.min.y + bounds.max.y) / 2.0;
    let lower: Vec<Point3<f32>> = corners.into_iter().filter(|corner| corner.y < middle_m).collect();
    let &[start, end] = lower.as_slice() else {
        report.warn(format!("wall {:?} has no lower and upper edge; left out", wall.id));
        return Ok(None);
    };
    let edge = Vector3::new(end.x - start.x, 0.0, end.z - start.z);
    let Some(along) = edge.try_normalize(SAME_LINE_M) else {
        report.warn(format!("wall {:?} has no length; left out", wall.id));
        return Ok(None);
    };
    let side = Vector3::new(along.z, 0.0, -along.x);
    let probe = start + edge / 2.0 + side * (5.0 * HALF_WALL_M);
    let room = house.rooms.iter().position(|room| room.id == wall.room_id);
    let is_inward = room.is_some_and(|room| holds(&rooms[room].outline, &Point2::new(probe.x, probe.z)));
    let is_outside = wall.id.contains(EXTERIOR);
    let facing = if is_inward == is_outside { -side } else { side };
    Ok(Some(Panel {
        wall,
        start,
        along,
        length_m: edge.norm(),
        height_m: bounds.max.y - bounds.min.y,
        facing,
    }))
}

fn hole(opening: &Opening, panel: &Panel<'_>) -> Checked<Hole> {
    let corners: Vec<[f32; 2]> = opening.hole_polygon.iter().map(|corner| [corner.x, corner.y]).collect();
    let bound =
        |axis: usize, pick: fn(f32, f32) -> f32| corners.iter().map(|corner| corner[axis]).reduce(pick);
    let sides = [bound(0, f32::min), bound(1, f32::min), bound(0, f32::max), bound(1, f32::max)];
    let [Some(left), Some(bottom), Some(right), Some(top)] = sides else {
        return Err(format!("{:?} has no holePolygon; export the house with schema 1.0.0", opening.id));
    };
    if !sides.iter().flatten().all(|side| side.is_finite()) {
        return Err(format!("{:?} has no finite holePolygon; correct it", opening.id));
    }
    Ok(clamped(Hole { from: [left, bottom], to: [right, top] }, panel))
}

fn clamped(hole: Hole, panel: &Panel<'_>) -> Hole {
    let within = |[along, up]: [f32; 2]| [along.clamp(0.0, panel.length_m), up.clamp(0.0, panel.height_m)];
    Hole { from: within(hole.from), to: within(hole.to) }
}

/// The part of a hole in `of` that also opens `panel`: where both stand on one line.
fn hole_through(panel: &Panel<'_>, of: &Panel<'_>, hole: &Hole) -> Option<Hole> {
    let ends = [hole.from[0], hole.to[0]].map(|along| of.start + of.along * along);
    let across = Vector3::new(panel.along.z, 0.0, -panel.along.x);
    if ends.iter().any(|end| (end - panel.start).dot(&across).abs() > SAME_LINE_M) {
        return None;
    }
    let [a, b] = ends.map(|end| (end - panel.start).dot(&panel.along));
    let lift_m = of.start.y - panel.start.y;
    let moved = Hole { from: [a.min(b), hole.from[1] + lift_m], to: [a.max(b), hole.to[1] + lift_m] };
    let opened = clamped(moved, panel);
    (opened.from[0] < opened.to[0] && opened.from[1] < opened.to[1]).then_some(opened)
}

impl Panel<'_> {
    /// A point on the panel, `share` half walls towards the side it is seen from.
    fn at(&self, [along, up]: [f32; 2], share: f32) -> Point3<f32> {
        self.start + self.along * along + Vector3::y() * up + self.facing * (share * HALF_WALL_M)
    }

    /// Adds the rectangle between two corners, seen from the panel's side.
    fn add_rectangle(
        &self,
        [left, bottom]: [f32; 2],
        [right, top]: [f32; 2],
        share: f32,
        material: u16,
        builder: &mut Builder,
    ) {
        if right <= left || top <= bottom {
            return;
        }
        let mut corners =
            [[left, bottom], [right, bottom], [right, top], [left, top]].map(|corner| self.at(corner, share));
        if self.along.cross(&Vector3::y()).dot(&self.facing) < 0.0 {
            corners.swap(1, 3);
        }
        builder.add_quad(corners, material);
    }
}

/// The panel without its holes, in upright strips between all their edges, and the reveals of the holes.
fn add_panel(panel: &Panel<'_>, holes: &[Hole], builder: &mut Builder) {
    let material = look(&panel.wall.material, builder);
    let mut cuts: Vec<f32> = holes.iter().flat_map(|hole| [hole.from[0], hole.to[0]]).collect();
    cuts.extend([0.0, panel.length_m]);
    cuts.sort_by(f32::total_cmp);
    for strip in cuts.windows(2) {
        let middle = (strip[0] + strip[1]) / 2.0;
        let mut open: Vec<&Hole> =
            holes.iter().filter(|hole| hole.from[0] < middle && middle < hole.to[0]).collect();
        open.sort_by(|a, b| a.from[1].total_cmp(&b.from[1]));
        let mut from = 0.0_f32;
        for hole in open {
            panel.add_rectangle([strip[0], from], [strip[1], hole.from[1]], 1.0, material, builder);
            from = from.max(hole.to[1]);
        }
        panel.add_rectangle([strip[0], from], [strip[1], panel.height_m], 1.0, material, builder);
    }
    for hole in holes {
        let ([left, bottom], [right, top]) = (hole.from, hole.to);
        for (a, b) in [
            ([left, bottom], [left, top]),
            ([left, top], [right, top]),
            ([right, top], [right, bottom]),
            ([right, bottom], [left, bottom]),
        ] {
            builder
                .add_quad([panel.at(a, 1.0), panel.at(b, 1.0), panel.at(b, 0.0), panel.at(a, 0.0)], material);
        }
    }
}

/// Closes what leads outside: a leaf in doors, a pane in windows. Doors between rooms stay open.
fn fill(opening: &Opening, is_door: bool, panel: &Panel<'_>, hole: &Hole, builder: &mut Builder) {
    if is_door && !opening.wall1.contains(EXTERIOR) {
        return;
    }
    let material = if is_door { builder.material("wood", DOOR) } else { builder.material("glass", GLASS) };
    panel.add_rectangle(hole.from, hole.to, 0.0, material, builder);
}
