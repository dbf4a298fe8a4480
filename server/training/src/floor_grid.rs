//! A grid of places on a building's walkable floor, for maps of explored floor.

use avln_world::{NavMesh, NavPoint, Places, Point3, Scene, Vector3};
use std::collections::BTreeMap;

/// Distance between neighbouring places along x and z, metres.
pub(crate) const SPACING_M: f32 = 0.25;
/// Largest distance between the end of a straight way and a place, metres.
const SAME_PLACE_M: f32 = 0.02;

/// Places on all storeys, with links between neighbours in straight reach.
pub(crate) struct FloorGrid {
    /// The places.
    pub(crate) places: Vec<NavPoint>,
    /// Index of the places by visibility.
    pub(crate) index: Places,
    /// Per place: neighbours, ascending.
    links: Vec<Vec<u32>>,
}

impl FloorGrid {
    /// Lays a grid on the floor.
    pub(crate) fn new(scene: &Scene, navmesh: &NavMesh) -> Self {
        let bounds = scene.bounds().map(|bounds| bounds.grown(1.0));
        let points = bounds.map(|bounds| navmesh.grid(&bounds, SPACING_M)).unwrap_or_default();
        let mut links = vec![Vec::new(); points.len()];
        let columns = columns(&points);
        for (from, point) in (0u32..).zip(&points) {
            for to in neighbours(navmesh, &points, &columns, point) {
                links[from as usize].push(to);
                links[to as usize].push(from);
            }
        }
        links.iter_mut().for_each(|links| links.sort_unstable());
        let index = Places::new(navmesh, &points);
        Self { places: points, index, links }
    }

    /// Returns the neighbours of a place, with their distances in metres.
    pub(crate) fn neighbours(&self, place: u32) -> impl Iterator<Item = (u32, f64)> {
        let from = self.places[place as usize].position();
        let distance_m = move |to: u32| f64::from((self.places[to as usize].position() - from).norm());
        self.links[place as usize].iter().map(move |&to| (to, distance_m(to)))
    }
}

/// Numbers of the places per column of the grid.
type Columns = BTreeMap<[i32; 2], Vec<u32>>;

fn column(place: &Point3<f32>) -> [i32; 2] {
    [place.x, place.z].map(|along| (along / SPACING_M).round() as i32)
}

fn columns(points: &[NavPoint]) -> Columns {
    let mut columns = Columns::new();
    for (number, point) in (0..).zip(points) {
        columns.entry(column(&point.position())).or_default().push(number);
    }
    columns
}

/// Returns the neighbours towards +x and +z in straight reach: one of each pair.
fn neighbours(navmesh: &NavMesh, points: &[NavPoint], columns: &Columns, from: &NavPoint) -> Vec<u32> {
    let [x, z] = column(&from.position());
    let steps = [[1, -1], [1, 0], [1, 1], [0, 1]];
    let reached = steps.iter().filter_map(|[dx, dz]| {
        let there = columns.get(&[x + dx, z + dz])?;
        let offset = Vector3::new(*dx as f32 * SPACING_M, 0.0, *dz as f32 * SPACING_M);
        let slide = navmesh.slide(from, &offset);
        let is_there =
            |to: &&u32| (points[**to as usize].position() - slide.end.position()).norm() < SAME_PLACE_M;
        there.iter().find(is_there).copied().filter(|_| !slide.blocked)
    });
    reached.collect()
}
