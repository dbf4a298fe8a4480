//! Room outlines from rectangles: floor and walls; windows and the front door in outer walls.

use super::{CEILING_M, Room, RoomKind, WALL_M, Window, remainder};
use crate::model::about;
use crate::rect::{Rect, Side};
use avln_geom::Rng;

/// A straight wall face seen from inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Face {
    pub(crate) side: Side,
    /// Position on the perpendicular axis.
    pub(crate) line_m: f32,
    /// Range on the wall axis.
    pub(crate) along: [f32; 2],
}

impl Face {
    /// Floor distance between a position and this wall.
    pub(crate) fn distance_m(&self, place: [f32; 2]) -> f32 {
        let line = [self.line_m; 2];
        let flat =
            if self.side.runs_along_x() { Rect::new(self.along, line) } else { Rect::new(line, self.along) };
        flat.distance_m(place)
    }
}

/// A rectilinear shape: grid lines and inside cells.
pub(crate) struct Outline {
    x: Vec<f32>,
    z: Vec<f32>,
    /// Row by row, x fastest.
    inside: Vec<bool>,
}

impl Outline {
    /// Shrinks the union of `rects` by `margin_m` (grows it if negative). Parts must be wider than twice the
    /// margin.
    pub(crate) fn inset(rects: &[Rect], margin_m: f32) -> Self {
        let lines = |axis: fn(&Rect) -> [f32; 2]| {
            let both = rects.iter().flat_map(&axis).flat_map(|v| [v - margin_m, v + margin_m]);
            sorted_lines(both.collect())
        };
        let holds = |place: [f32; 2]| rects.iter().any(|rect| rect.distance_m(place) < 1e-4);
        Self::filled(lines(|rect| rect.x), lines(|rect| rect.z), |[x, z]| match margin_m > 0.0 {
            // Inside the shrunk union if all four corners of the margin square are inside the union.
            true => [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)]
                .iter()
                .all(|(i, k)| holds([x + i * margin_m, z + k * margin_m])),
            false => rects.iter().any(|rect| rect.inset(margin_m).distance_m([x, z]) == 0.0),
        })
    }

    pub(crate) fn without(rect: &Rect, holes: &[Rect]) -> Self {
        let lines = |axis: fn(&Rect) -> [f32; 2]| {
            let [low, high] = axis(rect);
            let cuts = holes.iter().flat_map(&axis).map(|value| value.clamp(low, high));
            sorted_lines(cuts.chain([low, high]).collect())
        };
        Self::filled(lines(|rect| rect.x), lines(|rect| rect.z), |place| {
            holes.iter().all(|hole| hole.distance_m(place) > 0.0)
        })
    }

    /// Returns the shape without `rect`; the edges must be on the grid.
    pub(crate) fn less(&self, rect: &Rect) -> Self {
        Self::filled(self.x.clone(), self.z.clone(), |place| {
            rect.distance_m(place) > 0.0 && self.contains(place)
        })
    }

    fn contains(&self, [x, z]: [f32; 2]) -> bool {
        let cell = |lines: &[f32], value: f32| lines.partition_point(|line| *line <= value) as isize - 1;
        self.holds(cell(&self.x, x), cell(&self.z, z))
    }

    fn filled(x: Vec<f32>, z: Vec<f32>, is_inside: impl Fn([f32; 2]) -> bool) -> Self {
        let middles = |lines: &[f32]| lines.windows(2).map(|w| (w[0] + w[1]) / 2.0).collect::<Vec<f32>>();
        let (columns, rows) = (middles(&x), middles(&z));
        let cells = rows.iter().flat_map(|&z| columns.iter().map(move |&x| [x, z]));
        let inside = cells.map(is_inside).collect();
        Self { x, z, inside }
    }

    fn holds(&self, column: isize, row: isize) -> bool {
        let (columns, rows) = (self.x.len() as isize - 1, self.z.len() as isize - 1);
        let on_grid = (0..columns).contains(&column) && (0..rows).contains(&row);
        on_grid && self.inside[(row * columns + column) as usize]
    }

    /// Disjoint rectangles that cover the shape, the largest first.
    pub(crate) fn rects(&self) -> Vec<Rect> {
        let mut rects: Vec<Rect> = Vec::new();
        for row in 0..self.z.len().saturating_sub(1) {
            let z = [self.z[row], self.z[row + 1]];
            for [from, to] in self.runs(row) {
                let x = [self.x[from], self.x[to]];
                match rects.iter_mut().find(|rect| rect.x == x && rect.z[1] == z[0]) {
                    Some(above) => above.z[1] = z[1],
                    None => rects.push(Rect::new(x, z)),
                }
            }
        }
        rects.sort_by(|a, b| b.area_m2().total_cmp(&a.area_m2()));
        rects
    }

    /// Inside columns in a row, as line ranges.
    fn runs(&self, row: usize) -> Vec<[usize; 2]> {
        let inside = |column: usize| self.holds(column as isize, row as isize);
        runs_of(&(0..self.x.len() - 1).map(inside).collect::<Vec<bool>>())
    }

    /// Largest rectangle inside the shape; `None` if empty.
    pub(crate) fn largest(&self) -> Option<Rect> {
        let mut best: Option<Rect> = None;
        for top in 0..self.z.len().saturating_sub(1) {
            let mut open: Vec<bool> = (0..self.x.len() - 1).map(|_| true).collect();
            for row in top..self.z.len() - 1 {
                let holds = |column: usize| self.holds(column as isize, row as isize);
                open.iter_mut().enumerate().for_each(|(column, free)| *free &= holds(column));
                for [from, to] in runs_of(&open) {
                    let rect = Rect::new([self.x[from], self.x[to]], [self.z[top], self.z[row + 1]]);
                    // Among nearly equal rectangles the first is taken, whatever the rounding.
                    if best.is_none_or(|best| rect.area_m2() > best.area_m2() + 1e-4) {
                        best = Some(rect);
                    }
                }
            }
        }
        best
    }

    /// Walls around the shape seen from inside, in the order of [`Side::ALL`].
    pub(crate) fn faces(&self) -> Vec<Face> {
        let mut faces: Vec<Face> = Vec::new();
        for side in Side::ALL {
            let (step_column, step_row) = match side {
                Side::North => (0, -1),
                Side::South => (0, 1),
                Side::West => (-1, 0),
                Side::East => (1, 0),
            };
            for cell in 0..self.inside.len() {
                let columns = self.x.len() - 1;
                let (column, row) = (cell % columns, cell / columns);
                let beyond = self.holds(column as isize + step_column, row as isize + step_row);
                if self.inside[cell] && !beyond {
                    let rect =
                        Rect::new([self.x[column], self.x[column + 1]], [self.z[row], self.z[row + 1]]);
                    join(&mut faces, side, &rect);
                }
            }
        }
        faces
    }
}

/// Adds a cell side to the faces; extends an existing face if possible.
fn join(faces: &mut Vec<Face>, side: Side, cell: &Rect) {
    let (line_m, along) = (side.line_m(cell), side.span(cell));
    let continued = |face: &&mut Face| {
        face.side == side && face.line_m == line_m && (face.along[1] - along[0]).abs() < 1e-4
    };
    match faces.iter_mut().find(continued) {
        Some(face) => face.along[1] = along[1],
        None => faces.push(Face { side, line_m, along }),
    }
}

fn runs_of(open: &[bool]) -> Vec<[usize; 2]> {
    let mut runs = Vec::new();
    let mut start = None;
    for (index, &free) in open.iter().chain([&false]).enumerate() {
        match (start, free) {
            (None, true) => start = Some(index),
            (Some(from), false) => {
                runs.push([from, index]);
                start = None;
            }
            _ => {}
        }
    }
    runs
}

fn sorted_lines(mut lines: Vec<f32>) -> Vec<f32> {
    lines.sort_by(f32::total_cmp);
    lines.dedup_by(|a, b| (*a - *b).abs() < 1e-3);
    lines
}

/// Front door width and frame height, metres.
const DOOR_M: [f32; 2] = [1.1, 2.1];

/// Positions the front door at the centre of the shortest outer wall: in the entryway, otherwise in the first
/// ground-floor room with an outer wall.
pub(super) fn entrance(rooms: &[Room]) -> Option<Window> {
    let first = rooms.iter().position(|room| room.kind == RoomKind::Entryway);
    let mut order: Vec<usize> = first.into_iter().chain(0..rooms.len()).collect();
    order.retain(|&room| rooms[room].storey == 0);
    order.into_iter().find_map(|room| {
        let mut walls = outer_walls(rooms, room);
        walls.retain(|wall| wall.along[1] - wall.along[0] >= DOOR_M[0] + 0.1);
        walls.sort_by(|a, b| (a.along[1] - a.along[0]).total_cmp(&(b.along[1] - b.along[0])));
        let wall = walls.first()?;
        let along = about((wall.along[0] + wall.along[1]) / 2.0, DOOR_M[0]);
        Some(Window { room, side: wall.side, line_m: wall.line_m, along, y: [0.0, DOOR_M[1]] })
    })
}

/// Draws the windows of all rooms.
pub(super) fn draw_windows(rng: &mut Rng, rooms: &[Room], entrance: Option<Window>) -> Vec<Window> {
    let mut windows = Vec::new();
    for (index, room) in rooms.iter().enumerate() {
        for wall in outer_walls(rooms, index) {
            let door = entrance.filter(|door| {
                door.room == index && door.side == wall.side && (door.line_m - wall.line_m).abs() < 1e-3
            });
            let walls = remainder(wall.along, door.iter().map(|door| door.along));
            for along in walls {
                windows.extend(row(rng, room, index, Face { along, ..wall }));
            }
        }
    }
    windows
}

/// Sill, head and largest width; `None` without windows.
fn kind_of_window(room: &Room) -> Option<[f32; 3]> {
    match room.kind {
        RoomKind::Closet => None,
        // The flights are in the way.
        RoomKind::Stairs if room.storey == 0 => None,
        // Small and high: sinks and machines fit below.
        RoomKind::Bathroom | RoomKind::Laundry | RoomKind::Utility => Some([1.45, 2.1, 0.7]),
        RoomKind::Garage => Some([1.5, 2.1, 0.9]),
        // Above the counters (0.9 m).
        RoomKind::Kitchen => Some([1.12, 2.1, 1.3]),
        _ => Some([0.92, 2.15, 1.8]),
    }
}

/// Draws one or two windows in an outer wall, if it is long enough.
fn row(rng: &mut Rng, of: &Room, room: usize, wall: Face) -> Vec<Window> {
    let Some([sill, head, widest]) = kind_of_window(of) else { return vec![] };
    let length = wall.along[1] - wall.along[0];
    let least = if of.kind.is_passage() { 1.0 } else { 1.6 };
    if length < least {
        return vec![];
    }
    let count = (length / 2.6).floor().clamp(1.0, 2.0) as usize;
    let slot = length / count as f32;
    let window = |i: usize| {
        let width = (rng.range(0.6, 0.95) * widest).min(slot - 0.7);
        let width = (width * 100.0).round() / 100.0;
        let along = about(wall.along[0] + slot * (i as f32 + 0.5), width);
        Window { room, side: wall.side, line_m: wall.line_m, along, y: [sill, head.min(CEILING_M)] }
    };
    let windows: Vec<Window> = (0..count).map(window).collect();
    windows.into_iter().filter(|window| window.along[1] - window.along[0] >= 0.3).collect()
}

/// Wall stretches without another room behind.
fn outer_walls(rooms: &[Room], index: usize) -> Vec<Face> {
    let room = &rooms[index];
    let others: Vec<&Rect> = rooms
        .iter()
        .enumerate()
        .filter(|(other, behind)| *other != index && behind.storey == room.storey)
        .flat_map(|(_, behind)| &behind.cells)
        .collect();
    let outer = |face: Face| {
        let line = face.line_m - face.side.inward() * WALL_M / 2.0;
        let behind = |rect: &&&Rect| (face.side.opposite().line_m(rect) - line).abs() < 1e-3;
        let grown = |rect: &&Rect| {
            let span = face.side.span(rect);
            [span[0] - WALL_M / 2.0, span[1] + WALL_M / 2.0]
        };
        let taken = others.iter().filter(behind).map(grown);
        remainder(face.along, taken).into_iter().map(move |along| Face { along, ..face })
    };
    room.faces().into_iter().flat_map(outer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::rect::Side;

    fn ell() -> Vec<Rect> {
        vec![Rect::new([0.0, 4.0], [0.0, 2.0]), Rect::new([0.0, 1.0], [2.0, 5.0])]
    }

    #[test]
    fn l_shape_has_six_walls() {
        let room = Outline::inset(&ell(), 0.25);
        let mut faces = room.faces();
        faces.sort_by(|a, b| a.line_m.total_cmp(&b.line_m));
        assert_eq!(faces.len(), 6);
        let south: Vec<&Face> = faces.iter().filter(|face| face.side == Side::South).collect();
        assert_eq!((south[0].line_m, south[0].along), (1.75, [0.75, 3.75]));
        assert_eq!((south[1].line_m, south[1].along), (4.75, [0.25, 0.75]));
        let area: f32 = room.rects().iter().map(Rect::area_m2).sum();
        assert!((area - (3.5 * 1.5 + 0.5 * 3.0)).abs() < 1e-4, "{area}");
        assert_eq!(room.largest(), Some(Rect::new([0.25, 3.75], [0.25, 1.75])));
        assert_eq!(Outline::inset(&ell(), -0.25).largest(), Some(Rect::new([-0.25, 4.25], [-0.25, 2.25])));
    }

    #[test]
    fn rectangle_without_a_corner_is_an_l() {
        let rest = Outline::without(&Rect::new([0.0, 4.0], [0.0, 5.0]), &[Rect::new([1.0, 4.0], [2.0, 5.0])]);
        assert_eq!(rest.rects(), ell());
        assert_eq!(rest.faces().len(), 6);
    }

    #[test]
    fn windows_are_apart_in_outer_walls() {
        for seed in 0..60 {
            let plan = Plan::draw(&Rng::new(seed), 5 + seed as usize % 12, 1);
            let door = plan.entrance.expect("a front door");
            let all: Vec<Window> = plan.windows.iter().copied().chain([door]).collect();
            assert!(plan.windows.len() >= 4, "seed {seed}: {} windows", plan.windows.len());
            for (index, window) in all.iter().enumerate() {
                let holds = |wall: &Face| {
                    let within = wall.along[0] <= window.along[0] && window.along[1] <= wall.along[1];
                    wall.side == window.side && wall.line_m == window.line_m && within
                };
                assert!(outer_walls(&plan.rooms, window.room).iter().any(holds), "seed {seed}: {window:?}");
                let same = |other: &&Window| {
                    other.room == window.room && other.side == window.side && other.line_m == window.line_m
                };
                for other in all[index + 1..].iter().filter(same) {
                    let apart = crate::rect::common(window.along, other.along) < 0.0;
                    assert!(apart, "seed {seed}: {window:?} {other:?}");
                }
            }
        }
    }

    #[test]
    fn wall_without_room_behind_is_outer() {
        let room = |x: [f32; 2], z: [f32; 2]| Room {
            kind: RoomKind::Office,
            storey: 0,
            cells: vec![Rect::new(x, z)],
            host: None,
        };
        let rooms = [room([0.0, 4.0], [0.0, 3.0]), room([4.0, 6.0], [0.0, 1.0])];
        let east: Vec<Face> =
            outer_walls(&rooms, 0).into_iter().filter(|wall| wall.side == Side::East).collect();
        assert_eq!(east.len(), 1);
        assert!((east[0].along[0] - 1.06).abs() < 1e-5 && (east[0].along[1] - 2.94).abs() < 1e-5);
    }
}
