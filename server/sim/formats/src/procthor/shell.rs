//! Floors, ceilings, and walls with holes for doors and windows.

use crate::files::{Checked, ImportReport, refuse_if};
use crate::procthor::{HouseMesh, MaterialName, Opening, ProcthorHouse, RoomEntry, Wall, finite_box, world};
use avln_geom::{Aabb, Point2, Point3, Vector3};
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{InstanceId, polygon};

/// Distance between wall surface and wall line, towards the visible side, metres. It separates a wall's two sides.
const HALF_WALL_M: f32 = 0.01;
/// Room height without wall heights, metres.
const COMMON_HEIGHT_M: f32 = 2.5;
/// Greatest distance between corners and two walls' common line, metres.
const SAME_LINE_M: f32 = 0.02;
/// Mark on outward walls.
const EXTERIOR: &str = "exterior";
const GLASS: [u8; 3] = [196, 216, 226];
const DOOR: [u8; 3] = [120, 84, 54];
/// Words in Unity material names, with a material name for the acoustics and a colour.
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

pub(super) struct ProcthorRoom {
    pub(super) label: String,
    pub(super) bounds: Aabb,
    /// Outline in world (x, z).
    outline: Vec<Point2<f32>>,
}

impl ProcthorRoom {
    pub(super) fn contains(&self, point: &Point3<f32>) -> bool {
        (self.bounds.min.y..=self.bounds.max.y).contains(&point.y)
            && outline_contains(&self.outline, &Point2::new(point.x, point.z))
    }
}

/// A wall as a rectangle above a lower edge.
struct WallPanel<'a> {
    wall: &'a Wall,
    start: Point3<f32>,
    /// Unit vector in edge direction.
    along: Vector3<f32>,
    length_m: f32,
    height_m: f32,
    /// Unit vector to the visible side.
    facing: Vector3<f32>,
}

/// A rectangle on a panel: horizontal and vertical positions, metres.
#[derive(Clone, Copy)]
struct WallHole {
    from: [f32; 2],
    to: [f32; 2],
}

/// Adds floors, ceilings and walls; returns the rooms in file order.
pub(super) fn build(
    house: &ProcthorHouse,
    builder: &mut HouseMesh,
    report: &mut ImportReport,
) -> Checked<Vec<ProcthorRoom>> {
    let rooms = rooms(house)?;
    for (room, entry) in rooms.iter().zip(&house.rooms) {
        add_level(room, &entry.floor_material, room.bounds.min.y, true, builder)?;
        add_level(room, &house.procedural_parameters.ceiling_material, room.bounds.max.y, false, builder)?;
    }
    let panels: Checked<Vec<Option<WallPanel<'_>>>> =
        house.walls.iter().map(|wall| panel(wall, house, &rooms, report)).collect();
    let panels: Vec<WallPanel<'_>> = panels?.into_iter().flatten().collect();
    let mut holes: Vec<Vec<WallHole>> = panels.iter().map(|_| Vec::new()).collect();
    let openings =
        house.doors.iter().map(|door| (door, true)).chain(house.windows.iter().map(|window| (window, false)));
    for (opening, is_door) in openings {
        let Some(index) = panels.iter().position(|panel| panel.wall.id == opening.wall0) else {
            report.warn(format!("{:?} has no wall; it is left out", opening.id));
            continue;
        };
        let hole = hole(opening, &panels[index])?;
        // A door has a hole in the walls of both rooms, and the file mentions only one of them with its position.
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

fn rooms(house: &ProcthorHouse) -> Checked<Vec<ProcthorRoom>> {
    refuse_if(house.rooms.is_empty() || house.rooms.len() > usize::from(u16::MAX), || {
        format!("it has {} rooms, 1 to 65535 are read", house.rooms.len())
    })?;
    let room = |entry: &RoomEntry| {
        refuse_if(entry.floor_polygon.len() < 3 || entry.floor_polygon.len() > MAX_CORNERS, || {
            format!(
                "room {:?} has an outline of {} corners, 3 to {MAX_CORNERS} are read; correct floorPolygon",
                entry.id,
                entry.floor_polygon.len()
            )
        })?;
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
        Ok(ProcthorRoom { label: label(&entry.room_type), bounds, outline })
    };
    house.rooms.iter().map(room).collect()
}

/// Converts `LivingRoom` to `living room`.
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

/// Adds a floor, visible from above, or a ceiling, visible from below.
fn add_level(
    room: &ProcthorRoom,
    material: &MaterialName,
    height_m: f32,
    is_floor: bool,
    builder: &mut HouseMesh,
) -> Checked<()> {
    let mut found = triangles(&room.outline).ok_or_else(|| {
        format!("a {} has an outline that crosses itself; correct floorPolygon", room.label)
    })?;
    // An outline that turns from x to z is clockwise from above: the triangles face down.
    let faces_down = signed_area_m2(&room.outline) > 0.0;
    if faces_down == is_floor {
        found.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    }
    let corners: Vec<Point3<f32>> = room.outline.iter().map(|at| Point3::new(at.x, height_m, at.y)).collect();
    let material = look(material, builder);
    builder.add(&corners, &found, material, InstanceId::NONE);
    Ok(())
}

fn look(material: &MaterialName, builder: &mut HouseMesh) -> u16 {
    let name = material.name.to_lowercase();
    let known = LOOKS.iter().find(|(word, ..)| name.contains(word));
    let (plain, color) = known.map_or(("plaster", [224; 3]), |&(_, plain, color)| (plain, color));
    let given = material.color.map(|color| color.map(|share| (share.clamp(0.0, 1.0) * 255.0).round() as u8));
    builder.material(plain, given.unwrap_or(color))
}

/// Returns a wall's panel; `None` for a wall without extent, with a warning.
fn panel<'a>(
    wall: &'a Wall,
    house: &ProcthorHouse,
    rooms: &[ProcthorRoom],
    report: &mut ImportReport,
) -> Checked<Option<WallPanel<'a>>> {
    let corners: Vec<Point3<f32>> = wall.polygon.iter().map(world).collect();
    let bounds = finite_box(&corners).filter(|_| corners.len() == 4);
    let bounds = bounds.ok_or_else(|| {
        format!("wall {:?} is not made of four finite corners; correct its polygon", wall.id)
    })?;
    let middle_m = (bounds.min.y + bounds.max.y) / 2.0;
    let lower: Vec<Point3<f32>> = corners.into_iter().filter(|corner| corner.y < middle_m).collect();
    let &[start, end] = lower.as_slice() else {
        report.warn(format!("wall {:?} has no lower and upper edge; it is left out", wall.id));
        return Ok(None);
    };
    let edge = Vector3::new(end.x - start.x, 0.0, end.z - start.z);
    let Some(along) = edge.try_normalize(SAME_LINE_M) else {
        report.warn(format!("wall {:?} has no length; it is left out", wall.id));
        return Ok(None);
    };
    let side = Vector3::new(along.z, 0.0, -along.x);
    let probe = start + edge / 2.0 + side * (5.0 * HALF_WALL_M);
    let room = house.rooms.iter().position(|room| room.id == wall.room_id);
    let is_inward =
        room.is_some_and(|room| outline_contains(&rooms[room].outline, &Point2::new(probe.x, probe.z)));
    let is_outside = wall.id.contains(EXTERIOR);
    let facing = if is_inward == is_outside { -side } else { side };
    Ok(Some(WallPanel {
        wall,
        start,
        along,
        length_m: edge.norm(),
        height_m: bounds.max.y - bounds.min.y,
        facing,
    }))
}

fn hole(opening: &Opening, panel: &WallPanel<'_>) -> Checked<WallHole> {
    let corners: Vec<[f32; 2]> = opening.hole_polygon.iter().map(|corner| [corner.x, corner.y]).collect();
    let bound =
        |axis: usize, pick: fn(f32, f32) -> f32| corners.iter().map(|corner| corner[axis]).reduce(pick);
    let sides = [bound(0, f32::min), bound(1, f32::min), bound(0, f32::max), bound(1, f32::max)];
    let [Some(left), Some(bottom), Some(right), Some(top)] = sides else {
        return Err(format!("{:?} has no holePolygon; export the house with schema 1.0.0", opening.id));
    };
    refuse_if(!sides.iter().flatten().all(|side| side.is_finite()), || {
        format!("{:?} has no finite holePolygon; correct it", opening.id)
    })?;
    Ok(clamped(WallHole { from: [left, bottom], to: [right, top] }, panel))
}

fn clamped(hole: WallHole, panel: &WallPanel<'_>) -> WallHole {
    let within = |[along, up]: [f32; 2]| [along.clamp(0.0, panel.length_m), up.clamp(0.0, panel.height_m)];
    WallHole { from: within(hole.from), to: within(hole.to) }
}

/// The part through `panel` for a hole in another panel, if both panels are on the same line.
fn hole_through(panel: &WallPanel<'_>, of: &WallPanel<'_>, hole: &WallHole) -> Option<WallHole> {
    let ends = [hole.from[0], hole.to[0]].map(|along| of.start + of.along * along);
    let across = Vector3::new(panel.along.z, 0.0, -panel.along.x);
    if ends.iter().any(|end| (end - panel.start).dot(&across).abs() > SAME_LINE_M) {
        return None;
    }
    let [a, b] = ends.map(|end| (end - panel.start).dot(&panel.along));
    let lift_m = of.start.y - panel.start.y;
    let moved = WallHole { from: [a.min(b), hole.from[1] + lift_m], to: [a.max(b), hole.to[1] + lift_m] };
    let opened = clamped(moved, panel);
    (opened.from[0] < opened.to[0] && opened.from[1] < opened.to[1]).then_some(opened)
}

impl WallPanel<'_> {
    /// Returns a point on the panel, `share` half walls towards the visible side.
    fn at(&self, [along, up]: [f32; 2], share: f32) -> Point3<f32> {
        self.start + self.along * along + Vector3::y() * up + self.facing * (share * HALF_WALL_M)
    }

    /// Adds the rectangle between two corners, with the panel's visible side.
    fn add_rectangle(
        &self,
        [left, bottom]: [f32; 2],
        [right, top]: [f32; 2],
        share: f32,
        material: u16,
        builder: &mut HouseMesh,
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

/// Adds a panel without holes, in vertical strips between hole edges, and the holes' reveals.
fn add_panel(panel: &WallPanel<'_>, holes: &[WallHole], builder: &mut HouseMesh) {
    let material = look(&panel.wall.material, builder);
    let mut cuts: Vec<f32> = holes.iter().flat_map(|hole| [hole.from[0], hole.to[0]]).collect();
    cuts.extend([0.0, panel.length_m]);
    cuts.sort_by(f32::total_cmp);
    for strip in cuts.windows(2) {
        let middle = (strip[0] + strip[1]) / 2.0;
        let mut open: Vec<&WallHole> =
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

/// Closes openings to the outside: a leaf in doors, a pane in windows. Doors between rooms stay open.
fn fill(opening: &Opening, is_door: bool, panel: &WallPanel<'_>, hole: &WallHole, builder: &mut HouseMesh) {
    if is_door && !opening.wall1.contains(EXTERIOR) {
        return;
    }
    let material = if is_door { builder.material("wood", DOOR) } else { builder.material("glass", GLASS) };
    panel.add_rectangle(hole.from, hole.to, 0.0, material, builder);
}

pub(super) const MAX_CORNERS: usize = 256;

/// Triangles for a simple outline, with the same winding; `None` if the outline crosses itself.
pub(super) fn triangles(outline: &[Point2<f32>]) -> Option<Vec<[u32; 3]>> {
    // The fan of a convex outline starts at the last corner, its last triangle one corner later. This is the order of the
    // first version: it preserves the digests of imported houses.
    let mut points: Vec<[f64; 2]> = outline.iter().map(|point| point.cast::<f64>().into()).collect();
    let count = points.len() as u32;
    points.rotate_right(usize::from(count > 0));
    let mut found = polygon::triangulate_outline(&points);
    if !polygon::fills_outline(&points, &found) {
        return None;
    }
    found.iter_mut().flatten().for_each(|corner| *corner = (*corner + count - 1) % count);
    found.last_mut()?.rotate_left(1);
    Some(found)
}

/// Signed area, positive if the outline turns from the first axis to the second.
pub(super) fn signed_area_m2(outline: &[Point2<f32>]) -> f32 {
    let edges = (0..outline.len()).map(|at| (outline[at], outline[(at + 1) % outline.len()]));
    edges.map(|(a, b)| a.x * b.y - a.y * b.x).sum::<f32>() / 2.0
}

/// Returns whether a point is inside (even-odd rule).
pub(super) fn outline_contains(outline: &[Point2<f32>], point: &Point2<f32>) -> bool {
    let edges = (0..outline.len()).map(|at| (outline[at], outline[(at + 1) % outline.len()]));
    let crossed = edges.filter(|(a, b)| {
        (a.y > point.y) != (b.y > point.y) && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x)
    });
    crossed.count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(outline: &[Point2<f32>], triangles: &[[u32; 3]]) -> f32 {
        triangles
            .iter()
            .map(|triangle| signed_area_m2(&triangle.map(|corner| outline[corner as usize])))
            .sum()
    }

    #[test]
    fn l_shape_is_filled_in_both_windings() {
        // 4 x 4 less the 2 x 2 corner, with a corner in the middle of an edge.
        let mut outline: Vec<Point2<f32>> =
            [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 2.0], [2.0, 4.0], [0.0, 4.0]]
                .map(Point2::from)
                .to_vec();
        for sign in [1.0, -1.0] {
            let found = triangles(&outline).unwrap();
            assert_eq!(area(&outline, &found), sign * 12.0);
            assert_eq!(signed_area_m2(&outline), sign * 12.0);
            assert!(
                outline_contains(&outline, &Point2::new(1.0, 3.0))
                    && !outline_contains(&outline, &Point2::new(3.0, 3.0))
            );
            outline.reverse();
        }
    }

    #[test]
    fn convex_outline_has_a_fixed_triangle_order() {
        let square = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]].map(Point2::from);
        assert_eq!(triangles(&square).unwrap(), [[3, 0, 1], [1, 2, 3]]);
    }

    #[test]
    fn invalid_outlines_have_no_triangles() {
        assert_eq!(triangles(&[]), None);
        assert_eq!(triangles(&[Point2::origin(); 2]), None);
        let bow_tie = [[0.0, 0.0], [3.0, 2.0], [3.0, 0.0], [0.0, 2.0]].map(Point2::from);
        assert_eq!(triangles(&bow_tie), None);
    }
}
