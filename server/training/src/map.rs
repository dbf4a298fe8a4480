//! The senses `lidar` and `map`: distances around the camera, and the explored part of the storey.

use avln_geom::angle;
use avln_world::{Point3, Pose, SceneAssets, Vector3};
use std::sync::Arc;

/// Rays around the camera.
pub(crate) const RAYS: usize = 72;

/// Angle between two rays, degrees. Turns by a multiple see the same rays.
pub(crate) const STEP_DEG: u32 = 360 / RAYS as u32;

/// Horizontal rays at camera height. Their directions are fixed for the episode, so that a turn casts no new ray.
pub(crate) struct Lidar {
    height_m: f32,
    reach_m: f32,
    start_heading_rad: f32,
    /// Unit vectors, the first ahead at the start, left positive.
    directions: [Vector3<f32>; RAYS],
    eye: Option<Point3<f32>>,
    /// Distance by direction, metres; 0 without a surface within reach.
    distances_m: [f32; RAYS],
}

impl Lidar {
    /// Creates the sense for an episode that starts with this heading.
    pub(crate) fn new(start_heading_rad: f32, height_m: f32, reach_m: f32) -> Self {
        let direction = |ray: usize| {
            let turned_rad = ((ray as u32 * STEP_DEG) as f32).to_radians();
            let (sin, cos) = angle::sin_cos(start_heading_rad + turned_rad);
            Vector3::new(-sin, 0.0, -cos)
        };
        let directions = std::array::from_fn(direction);
        Self { height_m, reach_m, start_heading_rad, directions, eye: None, distances_m: [0.0; RAYS] }
    }

    /// Looks from a pose; returns true if its position is new.
    pub(crate) fn look(&mut self, assets: &SceneAssets, pose: &Pose) -> bool {
        let eye = pose.position + Vector3::y() * self.height_m;
        if self.eye.replace(eye) == Some(eye) {
            return false;
        }
        for (distance_m, direction) in self.distances_m.iter_mut().zip(&self.directions) {
            *distance_m = assets.cast(&eye, direction, self.reach_m).map_or(0.0, |hit| hit.distance_m);
        }
        true
    }

    /// Returns the distances from straight ahead to the left.
    pub(crate) fn distances_m(&self, heading_rad: f32) -> [f32; RAYS] {
        let turned_deg = (heading_rad - self.start_heading_rad).to_degrees();
        let turned = (turned_deg / STEP_DEG as f32).round() as i32;
        let first = turned.rem_euclid(RAYS as i32) as usize;
        std::array::from_fn(|ray| self.distances_m[(first + ray) % RAYS])
    }

    /// Returns the rays: direction, free length in metres, and whether a surface ends it.
    pub(crate) fn rays(&self) -> impl Iterator<Item = (&Vector3<f32>, f32, bool)> {
        let reach_m = self.reach_m;
        let ray = move |(direction, distance_m): (_, &f32)| match *distance_m {
            0.0 => (direction, reach_m, false),
            distance_m => (direction, distance_m, true),
        };
        self.directions.iter().zip(&self.distances_m).map(ray)
    }
}

/// Cells per side of the crop.
pub(crate) const SIDE: usize = 32;
/// Cell side, metres.
pub(crate) const CELL_M: f32 = 0.25;
/// Floor within this height of a storey belongs to it, metres.
const STOREY_M: f32 = 1.5;
/// Depth at which a ray enters a surface, metres.
const INSIDE_M: f32 = 0.05;

const WALKABLE: u8 = 1;
const SEEN: u8 = 2;

/// Cell values by flags: unknown, unknown, occupied, free.
const VALUES: [u8; 4] = [0, 0, 2, 1];

/// Walkable points of a scene on a lattice with [`CELL_M`].
pub(crate) struct Floor {
    /// Lattice index of the first cell in x and z.
    first: [i32; 2],
    /// Cells in x and z.
    size: [usize; 2],
    /// Cell and height in metres.
    points: Vec<(usize, f32)>,
}

impl Floor {
    pub(crate) fn new(assets: &SceneAssets) -> Self {
        let Some(bounds) = assets.scene.bounds() else {
            return Self { first: [0; 2], size: [0; 2], points: Vec::new() };
        };
        let index = |metres: f32| (metres / CELL_M).round() as i32;
        let first = [index(bounds.min.x), index(bounds.min.z)];
        let size = [index(bounds.max.x) - first[0] + 1, index(bounds.max.z) - first[1] + 1];
        let mut floor = Self { first, size: size.map(|cells| cells.max(0) as usize), points: Vec::new() };
        for point in assets.navmesh.grid(&bounds, CELL_M) {
            let place = point.position();
            if let Some(cell) = floor.cell(place.x, place.z) {
                floor.points.push((cell, place.y));
            }
        }
        floor
    }

    /// Returns the cell at x and z, metres; `None` outside the building.
    fn cell(&self, x_m: f32, z_m: f32) -> Option<usize> {
        // Cells are around the lattice points.
        let column = x_m * (1.0 / CELL_M) - (self.first[0] as f32 - 0.5);
        let row = z_m * (1.0 / CELL_M) - (self.first[1] as f32 - 0.5);
        let is_inside =
            column >= 0.0 && row >= 0.0 && (column as usize) < self.size[0] && (row as usize) < self.size[1];
        is_inside.then(|| row as usize * self.size[0] + column as usize)
    }
}

/// Explored cells of all visited storeys.
pub(crate) struct ExploredMap {
    floor: Arc<Floor>,
    storeys: Vec<Storey>,
    current: usize,
}

struct Storey {
    height_m: f32,
    /// Flags by cell.
    cells: Vec<u8>,
}

impl ExploredMap {
    pub(crate) fn new(floor: Arc<Floor>) -> Self {
        Self { floor, storeys: Vec::new(), current: 0 }
    }

    /// Adds the cells that the rays from a pose cross or end in.
    pub(crate) fn add(&mut self, lidar: &Lidar, pose: &Pose) {
        self.current = self.storey_at(pose.position.y);
        let Self { floor, storeys, current } = self;
        let cells = &mut storeys[*current].cells;
        let mut see = |x_m: f32, z_m: f32| {
            if let Some(cell) = floor.cell(x_m, z_m) {
                cells[cell] |= SEEN;
            }
        };
        let (x_m, z_m) = (pose.position.x, pose.position.z);
        for (direction, free_m, is_hit) in lidar.rays() {
            let samples = (free_m * (2.0 / CELL_M)) as usize;
            for sample in 0..=samples {
                let along_m = sample as f32 * (0.5 * CELL_M);
                see(x_m + along_m * direction.x, z_m + along_m * direction.z);
            }
            if is_hit {
                let along_m = free_m + INSIDE_M;
                see(x_m + along_m * direction.x, z_m + along_m * direction.z);
            }
        }
    }

    /// Returns the storey for a body at this height, new if none is near.
    fn storey_at(&mut self, height_m: f32) -> usize {
        let near = |storey: &Storey| (storey.height_m - height_m).abs() <= STOREY_M;
        if let Some(known) = self.storeys.iter().position(near) {
            return known;
        }
        let mut cells = vec![0; self.floor.size.iter().product()];
        for (cell, point_m) in &self.floor.points {
            if (point_m - height_m).abs() <= STOREY_M {
                cells[*cell] = WALKABLE;
            }
        }
        self.storeys.push(Storey { height_m, cells });
        self.storeys.len() - 1
    }

    /// Writes the cells around a pose, straight ahead up: 0 unknown, 1 free, 2 occupied.
    pub(crate) fn crop(&self, pose: &Pose, to: &mut [u8]) {
        let Some(storey) = self.storeys.get(self.current) else { return to.fill(0) };
        let (ahead, right) = (pose.forward(), pose.right());
        let middle = 0.5 * (SIDE - 1) as f32;
        for (row, cells) in to.chunks_exact_mut(SIDE).enumerate() {
            let ahead_m = CELL_M * (middle - row as f32);
            let (x_m, z_m) = (pose.position.x + ahead_m * ahead.x, pose.position.z + ahead_m * ahead.z);
            for (column, value) in cells.iter_mut().enumerate() {
                let right_m = CELL_M * (column as f32 - middle);
                let cell = self.floor.cell(x_m + right_m * right.x, z_m + right_m * right.z);
                *value = cell.map_or(0, |cell| VALUES[usize::from(storey.cells[cell])]);
            }
        }
    }
}
