//! Floors, walls, ceilings and thresholds: all geometry without an object.

pub(super) mod stairs;

use super::assembly::{Assembly, Piece, corner_light, facing_light};
use super::furniture::openings;
use super::model::{Corner, Model, about};
use super::paint::Paint;
use super::plan::{CEILING_M, Face, Opening, Outline, Plan, RoomKind, STOREY_M, WALL_M, Window};
use super::rect::{Rect, Side};
use super::texture::Pattern;
use avln_geom::{Aabb, Point3, Rng, Vector3};

#[derive(Clone, Copy, Debug)]
pub(super) struct Finish {
    floor: Paint,
    wall: Paint,
    /// An optional accent wall.
    accent: (Side, Paint),
    skirting: Paint,
    skirting_m: f32,
    ceiling: Paint,
}

const SKIRTING_M: f32 = 0.08;

impl Finish {
    /// Draws paints for a room kind.
    pub(super) fn choose(rng: &mut Rng, kind: RoomKind) -> Self {
        let wall = wall_paint(rng, kind);
        let accent = if rng.chance(0.35) { accent_paint(rng, kind) } else { wall };
        let side = Side::ALL[rng.below(4)];
        let wet = matches!(kind, RoomKind::Bathroom | RoomKind::Kitchen | RoomKind::Laundry);
        let skirting =
            if wet { Paint::plain("tile", [206, 208, 206]) } else { Paint::plain("wood", [232, 230, 224]) };
        let ceiling = Paint::plain("plaster", [244, 243, 238]);
        Self {
            floor: floor_paint(rng, kind),
            wall,
            accent: (side, accent),
            skirting,
            skirting_m: SKIRTING_M,
            ceiling,
        }
    }

    /// Paints for the upper storey of a stairwell, without skirting board.
    pub(super) fn above(&self) -> Self {
        Self { skirting_m: 0.0, ..*self }
    }

    fn wall_at(&self, side: Side, y_m: f32) -> Paint {
        match (y_m < self.skirting_m, side == self.accent.0) {
            (true, _) => self.skirting,
            (false, true) => self.accent.1,
            (false, false) => self.wall,
        }
    }
}

fn wall_paint(rng: &mut Rng, kind: RoomKind) -> Paint {
    const PASTELS: [[u8; 3]; 8] = [
        [228, 222, 208],
        [214, 222, 214],
        [206, 216, 226],
        [230, 214, 204],
        [222, 212, 226],
        [232, 226, 190],
        [210, 208, 204],
        [236, 234, 228],
    ];
    let rgb = *rng.choose(&PASTELS).expect("the list is not empty");
    match kind {
        RoomKind::Bathroom => Paint::plain("tile", rgb).with(Pattern::WallTiles),
        _ => Paint::plain("plaster", rgb).with(Pattern::Plaster),
    }
}

fn accent_paint(rng: &mut Rng, kind: RoomKind) -> Paint {
    const DEEP: [[u8; 3]; 6] = [
        [128, 152, 168],
        [150, 168, 140],
        [196, 150, 124],
        [168, 152, 178],
        [200, 176, 120],
        [122, 134, 140],
    ];
    let rgb = *rng.choose(&DEEP).expect("the list is not empty");
    match kind {
        RoomKind::LivingRoom | RoomKind::Gym if rng.chance(0.4) => {
            Paint::plain("brick", [176, 116, 96]).with(Pattern::Brick)
        }
        RoomKind::Bedroom | RoomKind::LivingRoom | RoomKind::DiningRoom if rng.chance(0.6) => {
            let papers = [Pattern::Stripes, Pattern::Damask, Pattern::Floral, Pattern::Trellis];
            Paint::plain("plaster", rgb).with(*rng.choose(&papers).expect("the list is not empty"))
        }
        RoomKind::Bathroom => Paint::plain("tile", rgb).with(Pattern::WallTiles),
        _ => Paint::plain("plaster", rgb).with(Pattern::Plaster),
    }
}

fn floor_paint(rng: &mut Rng, kind: RoomKind) -> Paint {
    const WOODS: [[u8; 3]; 4] = [[192, 150, 106], [158, 112, 74], [214, 180, 136], [176, 146, 122]];
    const TILES: [[u8; 3]; 4] = [[206, 204, 198], [178, 190, 196], [198, 182, 160], [168, 170, 172]];
    const PILES: [[u8; 3]; 4] = [[170, 160, 150], [146, 156, 166], [182, 170, 146], [166, 148, 152]];
    let pick = |rng: &mut Rng, colors: &[[u8; 3]; 4]| colors[rng.below(4)];
    match kind {
        RoomKind::Bathroom | RoomKind::Kitchen | RoomKind::Laundry => {
            let pattern = if rng.chance(0.3) { Pattern::Checker } else { Pattern::Tiles };
            Paint::plain("tile", pick(rng, &TILES)).with(pattern)
        }
        RoomKind::Garage | RoomKind::Utility => {
            Paint::plain("concrete", [168, 166, 162]).with(Pattern::Plaster)
        }
        RoomKind::Bedroom | RoomKind::Gym | RoomKind::Library if rng.chance(0.5) => {
            Paint::plain("carpet", pick(rng, &PILES)).with(Pattern::Carpet)
        }
        _ => {
            let pattern = if rng.chance(0.4) { Pattern::Parquet } else { Pattern::Planks };
            Paint::plain("wood", pick(rng, &WOODS)).with(pattern)
        }
    }
}

/// Adds a room's walls and ceiling, with holes for openings.
pub(super) fn add_room(assembly: &mut Assembly, plan: &Plan, index: usize, finish: &Finish) {
    let faces = plan.rooms[index].faces();
    let mut model = Model::new();
    for face in &faces {
        let holes: Vec<Hole> = plan.openings_in(index, *face).map(Hole::of).collect();
        wall(&mut model, face, [0.0, wall_top_m(plan, index)], &holes, |y| finish.wall_at(face.side, y));
    }
    for rect in ceiling_of(plan, index) {
        let lines = |span: [f32; 2]| grid_lines(span, &[span[0] + 0.4, span[1] - 0.4], 1.0);
        for x in lines(rect.x).windows(2) {
            for z in lines(rect.z).windows(2) {
                model.quad(flat([x[0], x[1]], [z[1], z[0]], CEILING_M), finish.ceiling);
            }
        }
    }
    assembly.add_shell(&model, |corner| room_light(corner, &faces));
}

/// Wall height; walls of lower stairs reach up to the floor above.
fn wall_top_m(plan: &Plan, index: usize) -> f32 {
    if plan.begins_stairs(index) { STOREY_M } else { CEILING_M }
}

/// Rectangles with a ceiling.
fn ceiling_of(plan: &Plan, index: usize) -> Vec<Rect> {
    match plan.begins_stairs(index) {
        true => stairs::landing(plan, index).into_iter().collect(),
        false => plan.rooms[index].floor(),
    }
}

/// Rectangles with a floor.
pub(super) fn floor_of(plan: &Plan, index: usize) -> Vec<Rect> {
    match plan.rooms[index].kind {
        RoomKind::Stairs => stairs::landing(plan, index).into_iter().collect(),
        _ => plan.rooms[index].floor(),
    }
}

/// Light on walls and ceiling: darker near adjacent surfaces.
fn room_light(corner: &Corner, faces: &[Face]) -> f32 {
    let base = if corner.normal.y < -0.5 { 0.95 } else { 0.08 + facing_light(&corner.normal) };
    base * corner_light(gap_m(corner, faces), 0.5, 0.82)
}

/// Distance from a corner to the nearest other floor, ceiling or wall.
fn gap_m(corner: &Corner, faces: &[Face]) -> f32 {
    let level = corner.normal.y.abs() > 0.5;
    let place = [corner.position.x, corner.position.z];
    let other = |face: &&Face| {
        let across = if face.side.runs_along_x() { corner.normal.z } else { corner.normal.x };
        level || across.abs() < 0.5
    };
    let walls = faces.iter().filter(other).map(|face| face.distance_m(place)).fold(f32::INFINITY, f32::min);
    if level { walls } else { walls.min(corner.position.y).min(CEILING_M - corner.position.y) }.max(0.0)
}

/// Adds a room's floor, darker at walls and under the furniture `covered`.
pub(super) fn add_floor(
    assembly: &mut Assembly,
    plan: &Plan,
    index: usize,
    finish: &Finish,
    covered: &[Rect],
) {
    const CELL_M: f32 = 0.3;
    let faces = plan.rooms[index].faces();
    let mut model = Model::new();
    for rect in floor_of(plan, index) {
        for x in grid_lines(rect.x, &[], CELL_M).windows(2) {
            for z in grid_lines(rect.z, &[], CELL_M).windows(2) {
                model.quad(flat([x[0], x[1]], [z[0], z[1]], 0.0), finish.floor);
            }
        }
    }
    assembly.add_shell(&model, |corner| {
        let place = [corner.position.x, corner.position.z];
        let furniture = covered.iter().map(|rect| rect.distance_m(place)).fold(f32::INFINITY, f32::min);
        corner_light(furniture, 0.35, 0.6).min(corner_light(gap_m(corner, &faces), 0.4, 0.8))
    });
}

/// An upward rectangle at height `y`; downward if z runs backwards.
fn flat(x: [f32; 2], z: [f32; 2], y: f32) -> [Point3<f32>; 4] {
    [(0, 1), (1, 1), (1, 0), (0, 0)].map(|(i, k)| Point3::new(x[i], y, z[k]))
}

/// Increasing values over `span`, including `extra` inside it, at most `step` apart.
fn grid_lines(span: [f32; 2], extra: &[f32], step: f32) -> Vec<f32> {
    let inside = extra.iter().copied().filter(|value| span[0] + 1e-3 < *value && *value < span[1] - 1e-3);
    let mut fixed: Vec<f32> = inside.chain(span).collect();
    fixed.sort_by(f32::total_cmp);
    fixed.dedup_by(|a, b| (*a - *b).abs() < 1e-3);
    let mut lines = vec![fixed[0]];
    for pair in fixed.windows(2) {
        let parts = ((pair[1] - pair[0]) / step).ceil().max(1.0) as usize;
        lines.extend((1..parts).map(|i| pair[0] + (pair[1] - pair[0]) * i as f32 / parts as f32));
        lines.push(pair[1]);
    }
    lines
}

fn wall_point(along_x: bool, line_m: f32, along: f32, y: f32) -> Point3<f32> {
    if along_x { Point3::new(along, y, line_m) } else { Point3::new(line_m, y, along) }
}

/// A vertical rectangle on a wall line, visible from inside.
fn upright(side: Side, line_m: f32, along: [f32; 2], y: [f32; 2]) -> [Point3<f32>; 4] {
    // Seen from inside, +x runs to the right on the north wall and +z to the right on the east wall.
    let forwards = matches!(side, Side::North | Side::East);
    let [left, right] = if forwards { along } else { [along[1], along[0]] };
    let point = |a: f32, y: f32| wall_point(side.runs_along_x(), line_m, a, y);
    [point(left, y[0]), point(right, y[0]), point(right, y[1]), point(left, y[1])]
}

/// A rectangular hole in a wall.
#[derive(Clone, Copy)]
struct Hole {
    along: [f32; 2],
    y: [f32; 2],
}

impl Hole {
    fn of(opening: &Opening) -> Self {
        Self { along: opening.along, y: [0.0, opening.height_m] }
    }

    fn holds(&self, along: f32, y: f32) -> bool {
        self.along[0] < along && along < self.along[1] && self.y[0] < y && y < self.y[1]
    }
}

/// Adds a wall with holes; `paint` returns the paint by height.
fn wall(model: &mut Model, face: &Face, y: [f32; 2], holes: &[Hole], paint: impl Fn(f32) -> Paint) {
    // Light is stored in vertices: extra lines near corners limit the dark margin to them.
    let edges = holes.iter().flat_map(|hole| hole.along).chain([face.along[0] + 0.3, face.along[1] - 0.3]);
    let columns = grid_lines(face.along, &edges.collect::<Vec<_>>(), 1.2);
    let levels = holes.iter().flat_map(|hole| hole.y).chain([SKIRTING_M, 0.4, CEILING_M - 0.3]);
    let rows = grid_lines(y, &levels.collect::<Vec<_>>(), 1.0);
    for along in columns.windows(2) {
        for y in rows.windows(2) {
            let middle = [(along[0] + along[1]) / 2.0, (y[0] + y[1]) / 2.0];
            if !holes.iter().any(|hole| hole.holds(middle[0], middle[1])) {
                let quad = upright(face.side, face.line_m, [along[0], along[1]], [y[0], y[1]]);
                model.quad(quad, paint(middle[1]));
            }
        }
    }
}

/// Adds a storey's outer faces.
pub(super) fn add_facade(assembly: &mut Assembly, plan: &Plan, storey: usize) {
    let paint = Paint::plain("plaster", [216, 208, 194]).with(Pattern::Plaster);
    let rooms = plan.rooms.iter().filter(|room| room.storey == storey);
    let cells: Vec<Rect> = rooms.flat_map(|room| room.cells.iter().copied()).collect();
    let mut model = Model::new();
    for face in Outline::inset(&cells, -WALL_M / 2.0).faces() {
        model.quad(upright(face.side.opposite(), face.line_m, face.along, [0.0, STOREY_M]), paint);
    }
    assembly.add_shell(&model, |corner| facing_light(&corner.normal));
}

/// Adds windows outside the walls of furnished [`super::plan::Room::parts`].
pub(super) fn add_far_windows(assembly: &mut Assembly, plan: &Plan, index: usize) {
    let parts = plan.rooms[index].parts();
    let near = |window: &Window| parts.iter().any(|part| window.is_on(part));
    for window in plan.windows.iter().filter(|window| window.room == index && !near(window)) {
        let [width, height] = [window.along, window.y].map(|span| span[1] - span[0]);
        // Windows on furnished parts are added by the furnishing, which reserves their wall.
        let piece = openings::window(width, height);
        let quarter = window.side.quarter();
        let bounds = piece.model.moved(quarter, Vector3::zeros()).bounds();
        let wall = match window.side.runs_along_x() {
            true => Rect::new(window.along, [window.line_m; 2]),
            false => Rect::new([window.line_m; 2], window.along),
        };
        let place =
            window.side.strip(&wall, about((window.along[0] + window.along[1]) / 2.0, piece.size().x), 0.01);
        let origin = [place.x[0] - bounds.min.x, window.y[0], place.z[0] - bounds.min.z];
        let model = piece.model.moved(quarter, wall_origin(window.side, origin, &bounds, window.line_m));
        assembly.add_object(&Piece { model, ..piece }, index);
    }
}

/// Model origin with the back at the wall.
fn wall_origin(side: Side, [x, y, z]: [f32; 3], bounds: &Aabb, line_m: f32) -> Vector3<f32> {
    const GAP_M: f32 = 0.002;
    match side {
        Side::North => Vector3::new(x, y, line_m + GAP_M - bounds.min.z),
        Side::South => Vector3::new(x, y, line_m - GAP_M - bounds.max.z),
        Side::West => Vector3::new(line_m + GAP_M - bounds.min.x, y, z),
        Side::East => Vector3::new(line_m - GAP_M - bounds.max.x, y, z),
    }
}

/// Adds an opening's jambs, lintel and threshold.
pub(super) fn add_opening(assembly: &mut Assembly, opening: &Opening, floor: &Finish) {
    let frame = Paint::plain("wood", [226, 222, 212]);
    let across = [opening.line_m - WALL_M / 2.0, opening.line_m + WALL_M / 2.0];
    let (low, high) = if opening.along_x { (Side::West, Side::East) } else { (Side::North, Side::South) };
    let mut model = Model::new();
    model.quad(upright(low, opening.along[0], across, [0.0, opening.height_m]), frame);
    model.quad(upright(high, opening.along[1], across, [0.0, opening.height_m]), frame);
    let (x, z) = if opening.along_x { (opening.along, across) } else { (across, opening.along) };
    model.quad(flat(x, [z[1], z[0]], opening.height_m), frame);
    model.quad(flat(x, z, 0.0), floor.floor);
    assembly.add_shell(&model, |corner| 0.9 * facing_light(&corner.normal) + 0.08);
}
