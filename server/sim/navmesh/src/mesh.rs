use crate::corners::Corners;
use crate::field::DistanceField;
use crate::islands::Islands;
use crate::locate::Bins;
use crate::plane::{CELL_M, LEVEL_M, Lattice, Offset, Spot};
use crate::polygons::Polygons;
use crate::sight::Eye;
use crate::surface::Surface;
use crate::voxels::{RawPolygon, Voxels, climb_levels, voxelise};
use crate::walk::walk;
use crate::{Body, NavMeshError};
use avln_geom::{Aabb, Point3, Rng, Vector3};
use avln_scene::Scene;

/// What rounding a position to f32 may do to it, cells (5 micrometres).
const ROUNDING_CELLS: f64 = 1e-4;

/// A point that stands on a [`NavMesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavPoint {
    position: Point3<f32>,
    polygon: u32,
}

impl NavPoint {
    /// Where it is, in the world frame; the height is that of the ground.
    pub fn position(&self) -> Point3<f32> {
        self.position
    }
}

/// How a step along the mesh went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide {
    /// Where it ended.
    pub end: NavPoint,
    /// Whether a wall took something of it.
    pub blocked: bool,
}

/// The floor that a body can walk in one scene; immutable.
///
/// The mesh falls into islands, connected parts: number 0 is the one to live on, then come the others by falling area;
/// flat roofs (surfaces less than a body's height under the top of the scene) come last.
///
/// Points given to a mesh must stem from it: methods panic or answer nonsense for those of another mesh.
pub struct NavMesh {
    lattice: Lattice,
    headroom_m: f32,
    pub(crate) polygons: Polygons,
    pub(crate) corners: Corners,
    corner_positions: Vec<Point3<f32>>,
    islands: Islands,
    bins: Bins,
    surface: Surface,
}

impl NavMesh {
    /// Builds the mesh of `scene` for `body`: a lattice of 5 cm, Habitat's settings otherwise. Triangles that face
    /// upwards are floor; parts below about 1 square metre are left out.
    ///
    /// # Errors
    /// When the body's measures are out of range, when the scene's mesh is empty, broken or too large, or when nobody
    /// can stand in it.
    pub fn build(scene: &Scene, body: &Body) -> Result<NavMesh, NavMeshError> {
        body.check()?;
        let Voxels { lattice, polygons: raw, floors } = voxelise(scene, body)?;
        let polygons = Polygons::new(&raw, climb_levels(body));
        let levels: Vec<_> = raw.iter().map(middle_level).collect();
        let top_m = scene.bounds().map_or(0.0, |bounds| bounds.max.y) - body.height_m;
        let islands = Islands::new(&polygons, |p| lattice.height_m(levels[p as usize]) > top_m);
        let patches = raw.iter().map(|polygon| polygon.region).zip(levels.iter().copied()).collect();
        let surface = Surface::new(lattice, floors, patches, scene);
        let corners = Corners::new(&polygons);
        let bins = Bins::new(&polygons);
        let place = |eye: &Eye| lattice.point(&eye.spot, surface.height_m(eye.polygon, &eye.spot));
        let corner_positions = (0..corners.len() as u32).map(|id| place(&corners.get(id).eye)).collect();
        let headroom_m = body.height_m;
        Ok(Self { lattice, headroom_m, polygons, corners, corner_positions, islands, bins, surface })
    }

    /// The point of the mesh nearest to `point`, if it is no farther than `max_distance_m` (in space).
    ///
    /// Polygons are compared by their point nearest in the plane, at its own height.
    pub fn snap(&self, point: &Point3<f32>, max_distance_m: f32) -> Option<NavPoint> {
        let spot = self.lattice.spot(point);
        let cell_m = f64::from(CELL_M);
        // Heights are compared by lattice level first: the limit is checked exactly at the end.
        let reach_m = f64::from(max_distance_m + 2.0 * LEVEL_M);
        let mut best = (reach_m * reach_m, None);
        self.bins.around(&spot, reach_m / cell_m, |polygon| {
            let nearest = self.polygons.nearest(polygon, &spot);
            let flat = (nearest - spot).norm_squared() * cell_m * cell_m;
            if flat < best.0 {
                let rise = self.surface.rough_height_m(polygon, &nearest) - 0.5 * LEVEL_M - point.y;
                let distance_squared = flat + f64::from(rise) * f64::from(rise);
                if distance_squared < best.0 {
                    best = (distance_squared, Some((nearest, polygon)));
                }
            }
            best.0.sqrt() / cell_m
        });
        let (nearest, polygon) = best.1?;
        let found = self.point(&nearest, polygon);
        ((found.position - point).norm() <= max_distance_m).then_some(found)
    }

    /// Number of the island that `point` stands on.
    pub fn island_of(&self, point: &NavPoint) -> u32 {
        self.islands.of(point.polygon)
    }

    /// How many islands there are, at least 1.
    pub fn island_count(&self) -> u32 {
        self.islands.count()
    }

    /// Area of an island in the ground plane, square metres.
    ///
    /// # Panics
    /// When there is no such island.
    pub fn island_area_m2(&self, island: u32) -> f64 {
        self.islands.area_m2(island)
    }

    /// The island to live on: the largest one that is not a roof.
    pub fn largest_island(&self) -> u32 {
        0
    }

    /// Area of all islands in the ground plane, square metres.
    pub fn area_m2(&self) -> f64 {
        self.islands.total_area_m2()
    }

    /// A random point of `island`, uniform by area in the ground plane.
    ///
    /// # Panics
    /// When there is no such island.
    pub fn sample(&self, rng: &mut Rng, island: u32) -> NavPoint {
        let (spot, polygon) = self.islands.sample(&self.polygons, rng, island);
        self.point(&spot, polygon)
    }

    /// All points of the mesh inside `bounds` whose x and z are whole multiples of `spacing_m`, on every storey; ordered
    /// by x, then z, then height. None for a spacing below a lattice cell (5 cm).
    pub fn grid(&self, bounds: &Aabb, spacing_m: f32) -> Vec<NavPoint> {
        if spacing_m.is_nan() || spacing_m < CELL_M {
            return Vec::new();
        }
        let Some(reach) = self.reach() else { return Vec::new() };
        let multiples = |axis: usize| {
            let low = bounds.min[axis].max(reach.min[axis]) / spacing_m;
            let high = bounds.max[axis].min(reach.max[axis]) / spacing_m;
            (low.ceil() as i64..=high.floor() as i64).map(move |index| index as f32 * spacing_m)
        };
        let mut points = Vec::new();
        for x in multiples(0) {
            for z in multiples(2) {
                points.extend(self.column(&Point3::new(x, 0.0, z)));
            }
        }
        points.retain(|point| bounds.contains(&point.position));
        points
    }

    /// Walks `displacement` from `from` along the surface; at walls the rest of the way goes on along the wall. Only the
    /// horizontal part of `displacement` counts, and no more than its length is walked in the plane.
    pub fn slide(&self, from: &NavPoint, displacement: &Vector3<f32>) -> Slide {
        let cells = |metres: f32| f64::from(metres) / f64::from(CELL_M);
        let offset = Offset::new(cells(displacement.x), cells(displacement.z));
        if !(offset.x.is_finite() && offset.y.is_finite()) {
            return Slide { end: *from, blocked: true };
        }
        let walked = walk(&self.polygons, &self.eye(from), &offset);
        Slide { end: self.point(&walked.end.spot, walked.end.polygon), blocked: walked.blocked }
    }

    /// Length of the shortest path from `a` to `b` over the mesh, measured in the ground plane, metres; `None` across
    /// islands. Exact for the polygons of the mesh, and the same to the bit both ways.
    pub fn distance_m(&self, a: &NavPoint, b: &NavPoint) -> Option<f64> {
        if self.island_of(a) != self.island_of(b) {
            return None;
        }
        let key = |point: &NavPoint| (point.polygon, point.position.x.to_bits(), point.position.z.to_bits());
        let (a, b) = if key(a) <= key(b) { (a, b) } else { (b, a) };
        self.field(&[(*b, 0.0)]).distance_m(self, a)
    }

    /// The shortest path from `a` to `b`: `a`, the corners where it bends, `b`; `None` across islands.
    pub fn path(&self, a: &NavPoint, b: &NavPoint) -> Option<Vec<Point3<f32>>> {
        self.field(&[(*b, 0.0)]).path(self, a)
    }

    /// Distances to the nearest of `seeds`, each with a weight in metres that is added to the way to it.
    ///
    /// Seeds whose weight is not finite are left out.
    pub fn field(&self, seeds: &[(NavPoint, f64)]) -> DistanceField {
        DistanceField::new(self, seeds)
    }

    /// The polygons of the mesh for maps: corners in order, in the world frame.
    pub fn polygons(&self) -> Vec<Vec<Point3<f32>>> {
        let corner = |polygon: u32, spot: &Spot| self.point(spot, polygon).position;
        let outline =
            |polygon: u32| self.polygons.corners(polygon).iter().map(|s| corner(polygon, s)).collect();
        (0..self.polygons.len()).map(outline).collect()
    }

    pub(crate) fn eye(&self, point: &NavPoint) -> Eye {
        // Rounding to f32 may have moved the point over the rim of its polygon or off a corner.
        let spot = self.polygons.nearest(point.polygon, &self.lattice.spot(&point.position));
        let is_here = |corner: &&Spot| (*corner - spot).norm_squared() < ROUNDING_CELLS * ROUNDING_CELLS;
        let corner = self.polygons.corners(point.polygon).iter().find(is_here);
        Eye { spot: corner.copied().unwrap_or(spot), polygon: point.polygon }
    }

    pub(crate) fn corner_position(&self, corner: u32) -> Point3<f32> {
        self.corner_positions[corner as usize]
    }

    fn point(&self, spot: &Spot, polygon: u32) -> NavPoint {
        let height_m = self.surface.height_m(polygon, spot);
        NavPoint { position: self.lattice.point(spot, height_m), polygon }
    }

    /// Box around the mesh in the plane; its heights mean nothing.
    fn reach(&self) -> Option<Aabb> {
        let spots = (0..self.polygons.len()).flat_map(|polygon| self.polygons.corners(polygon));
        let points: Vec<_> = spots.map(|spot| self.lattice.point(spot, 0.0)).collect();
        Aabb::around(&points)
    }

    /// The points of all storeys above and below `at`, lowest first. On a shared edge only one of its polygons counts.
    fn column(&self, at: &Point3<f32>) -> Vec<NavPoint> {
        let spot = self.lattice.spot(at);
        let above =
            self.bins.at(&spot).iter().filter(|&&polygon| self.polygons.nearest(polygon, &spot) == spot);
        let mut points: Vec<_> = above.map(|&polygon| self.point(&spot, polygon)).collect();
        points.sort_by(|a, b| a.position.y.total_cmp(&b.position.y));
        points.dedup_by(|upper, lower| upper.position.y - lower.position.y < 0.5 * self.headroom_m);
        points
    }
}

fn middle_level(polygon: &RawPolygon) -> u16 {
    let sum: u32 = polygon.corners.iter().map(|corner| u32::from(corner[1])).sum();
    (sum / polygon.corners.len() as u32) as u16
}
