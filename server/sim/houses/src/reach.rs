//! Room reachability on a lattice, without a navmesh.

use super::plan::{Opening, Plan, RoomKind, WALL_M, around};
use super::rect::{CELL_M, Lattice, Rect};
use super::{floor_m, shell};
use avln_scene::Object;

/// Height range of obstacles above the floor, metres.
// The body climbs 0.2 m and is 1.5 m high.
const BODY_M: [f32; 2] = [0.2, 1.5];

/// Connected parts of a body's standing area.
pub(super) struct Reach {
    /// Cells by room.
    rooms: Vec<Vec<Cell>>,
    lattice: Lattice,
    /// Part per cell; `None` for blocked cells.
    piece_of: Vec<Option<usize>>,
    /// Cell count per part.
    sizes: Vec<usize>,
}

type Cell = usize;

impl Reach {
    pub(super) fn of(plan: &Plan, objects: &[Object], radius_m: f32) -> Self {
        let cells: Vec<Rect> = plan.rooms.iter().flat_map(|room| room.cells.iter().copied()).collect();
        let lattice = Lattice::over(&around(&cells), 1, plan.storeys());
        let mut free = vec![false; lattice.count()];
        let mut rooms = Vec::new();
        for index in 0..plan.rooms.len() {
            let obstacles = obstacles(plan, objects, index);
            let cells = standing(plan, &lattice, index, &obstacles, radius_m);
            cells.iter().for_each(|&cell| free[cell] = true);
            rooms.push(cells);
        }
        for opening in &plan.openings {
            let storey = plan.rooms[opening.rooms[0]].storey;
            lattice.cells_in(storey, through(opening, radius_m)).for_each(|cell| free[cell] = true);
        }
        let stairs: Vec<&[Cell]> = (0..rooms.len())
            .filter(|&room| plan.rooms[room].kind == RoomKind::Stairs)
            .map(|room| rooms[room].as_slice())
            .collect();
        let (piece_of, sizes) = pieces(&lattice, &free, &stairs);
        Self { rooms, lattice, piece_of, sizes }
    }

    fn largest(&self) -> Option<usize> {
        // The first of equally large parts, for a stable result.
        (0..self.sizes.len()).max_by_key(|&piece| (self.sizes[piece], usize::MAX - piece))
    }

    /// Largest part's share of the free floor, 0 to 1.
    pub(super) fn share(&self) -> f32 {
        let most = self.sizes.iter().max().copied().unwrap_or(0);
        most as f32 / self.sizes.iter().sum::<usize>().max(1) as f32
    }

    /// Rooms not reachable from the largest part.
    pub(super) fn sealed(&self) -> Vec<usize> {
        let largest = self.largest();
        let entered = |cells: &Vec<Cell>| cells.iter().any(|&cell| self.piece_of[cell] == largest);
        (0..self.rooms.len()).filter(|&room| largest.is_none() || !entered(&self.rooms[room])).collect()
    }

    /// Openings that the largest part does not pass.
    pub(super) fn blocked<'a>(&self, plan: &'a Plan, radius_m: f32) -> Vec<&'a Opening> {
        let largest = self.largest();
        let passable = |opening: &Opening| {
            let storey = plan.rooms[opening.rooms[0]].storey;
            let mut cells = self.lattice.cells_in(storey, through(opening, radius_m));
            cells.any(|cell| self.piece_of[cell] == largest)
        };
        plan.openings.iter().filter(|opening| largest.is_none() || !passable(opening)).collect()
    }
}

/// Passable floor inside an opening, slightly beyond the wall on both sides.
fn through(opening: &Opening, radius_m: f32) -> Rect {
    let beyond = WALL_M / 2.0 + radius_m + CELL_M;
    let across = [opening.line_m - beyond, opening.line_m + beyond];
    let along = [opening.along[0] + radius_m, opening.along[1] - radius_m];
    opening.rect(along, across)
}

/// Floor in front of an opening, on both sides.
pub(super) fn doorstep(opening: &Opening, depth_m: f32) -> Rect {
    let across = [opening.line_m - depth_m, opening.line_m + depth_m];
    opening.rect(opening.along, across)
}

/// Obstacle footprints in a room.
fn obstacles(plan: &Plan, objects: &[Object], index: usize) -> Vec<Rect> {
    let floor_m = floor_m(plan.rooms[index].storey);
    let in_room = objects.iter().filter(|object| object.region == Some(index as u16));
    let solid = in_room.filter(|object| {
        object.bounds.max.y - floor_m > BODY_M[0] && object.bounds.min.y - floor_m < BODY_M[1]
    });
    solid.map(|object| Rect::of(&object.bounds)).collect()
}

/// Standing cells in a room.
fn standing(plan: &Plan, lattice: &Lattice, index: usize, obstacles: &[Rect], radius_m: f32) -> Vec<Cell> {
    let room = &plan.rooms[index];
    let walls = room.faces();
    let floor = shell::floor_of(plan, index);
    let clear = |cell: &Cell| {
        let place = lattice.center(*cell);
        obstacles.iter().all(|solid| solid.distance_m(place) >= radius_m)
            && walls.iter().all(|wall| wall.distance_m(place) >= radius_m)
    };
    floor.into_iter().flat_map(|rect| lattice.cells_in(room.storey, rect)).filter(clear).collect()
}

/// Returns the part per cell and the part sizes. Cells in a `joined` group (stairs) count as neighbours.
fn pieces(lattice: &Lattice, free: &[bool], joined: &[&[Cell]]) -> (Vec<Option<usize>>, Vec<usize>) {
    let mut is_joined = vec![false; free.len()];
    joined.iter().flat_map(|group| group.iter()).for_each(|&cell| is_joined[cell] = true);
    let mut piece_of = vec![None; free.len()];
    let mut sizes = Vec::new();
    for start in 0..free.len() {
        let mut open = vec![start];
        let piece = sizes.len();
        let mut size = 0;
        while let Some(cell) = open.pop() {
            if !free[cell] || piece_of[cell].is_some() {
                continue;
            }
            piece_of[cell] = Some(piece);
            size += 1;
            open.extend(lattice.neighbours(cell));
            // The lattice has no heights: all stairwell cells together connect the storeys.
            if is_joined[cell] {
                open.extend(joined.iter().flat_map(|group| group.iter()));
            }
        }
        if size > 0 {
            sizes.push(size);
        }
    }
    (piece_of, sizes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{Aabb, Point3, Rng};
    use avln_scene::{Attributes, InstanceId};

    fn crate_on(opening: &Opening, room: usize) -> Object {
        let step = doorstep(opening, 0.3);
        Object {
            id: InstanceId(1),
            category: "chest_of_drawers".into(),
            bounds: Aabb::new(Point3::new(step.x[0], 0.0, step.z[0]), Point3::new(step.x[1], 0.9, step.z[1])),
            region: Some(room as u16),
            attributes: Attributes::default(),
        }
    }

    #[test]
    fn empty_houses_are_walkable_everywhere() {
        // Ten plans for each number of rooms and storeys.
        for seed in 0..380 {
            let plan = Plan::draw(&Rng::new(seed), 6 + seed as usize % 19, 1 + seed as usize / 19 % 2);
            let reach = Reach::of(&plan, &[], 0.25);
            assert_eq!(reach.sealed(), Vec::<usize>::new(), "seed {seed}");
            assert!(reach.blocked(&plan, 0.25).is_empty(), "seed {seed}");
            assert!(reach.share() > 0.99, "seed {seed}: {}", reach.share());
        }
    }

    #[test]
    fn crate_in_only_door_blocks_room() {
        let plan = Plan::draw(&Rng::new(5), 9, 1);
        let doors = |room: usize| plan.openings.iter().filter(move |door| door.rooms.contains(&room));
        let room = (0..9).find(|&room| doors(room).count() == 1).expect("a room with one door");
        let crates: Vec<Object> = doors(room).map(|door| crate_on(door, room)).collect();
        assert_eq!(Reach::of(&plan, &crates, 0.25).sealed(), [room]);
    }
}
