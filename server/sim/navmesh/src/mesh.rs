use crate::corners::Corners;
use crate::islands::Islands;
use crate::plane::{Lattice, Spot};
use crate::polygons::{Bins, Polygons, RawPolygon};
use crate::settings::{Body, Cells, NavMeshError, NavMeshSettings};
use crate::sight::Eye;
use crate::surface::{Detail, Ground, Surface};
use crate::voxels::{Voxels, voxelise};
use crate::walk::{Step, walk};
use avln_geom::{Aabb, Point3, Rng, Vector3};
use avln_scene::Scene;

/// Rounding error of an f32 position, cells (5 micrometres).
const ROUNDING_CELLS: f64 = 1e-4;
/// Margin of the wall search around the centre of a step, besides half of its length, metres (Detour's).
const STEP_RIM_M: f64 = 0.001;
/// Corners that Recast shares between polygons are the same to the bit.
pub(crate) const SHARED_M: f64 = 1e-6;

/// A point on a [`NavMesh`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavPoint {
    pub(crate) position: Point3<f32>,
    pub(crate) polygon: u32,
}

impl NavPoint {
    /// Position in the world frame, at ground height.
    pub fn position(&self) -> Point3<f32> {
        self.position
    }
}

/// Result of a step on the mesh.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slide {
    /// End of the step.
    pub end: NavPoint,
    /// True if a wall shortened the step.
    pub blocked: bool,
}

/// The walkable floor of a scene; immutable.
///
/// Islands are connected parts: number 0 is the main island, the others follow by decreasing area; flat roofs
/// (surfaces less than a body height below the top of the scene) come last.
///
/// Points must belong to the mesh: with points of a different mesh, methods panic or return wrong results.
pub struct NavMesh {
    lattice: Lattice,
    headroom_m: f32,
    climb_m: f32,
    pub(crate) polygons: Polygons,
    pub(crate) corners: Corners,
    islands: Islands,
    pub(crate) bins: Bins,
    pub(crate) surface: Surface,
}

/// A mesh before its polygons are joined.
pub(crate) struct Parts {
    pub(crate) lattice: Lattice,
    pub(crate) headroom_m: f32,
    pub(crate) climb_m: f32,
    pub(crate) raw: Vec<RawPolygon>,
}

impl NavMesh {
    /// Size of the lists in bytes.
    pub fn byte_count(&self) -> usize {
        self.polygons.byte_count()
            + self.corners.byte_count()
            + self.islands.byte_count()
            + self.bins.byte_count()
            + self.surface.byte_count()
    }

    /// Builds the mesh of `scene` for `body` with the arena's settings: a 5 cm lattice, heights of the scene,
    /// otherwise Habitat's settings. Upward triangles are floor; parts below about 1 square metre are
    /// omitted.
    ///
    /// # Errors
    /// If the body is out of range, if the scene mesh is empty, invalid or too large, or if no floor is
    /// walkable.
    pub fn build(scene: &Scene, body: &Body) -> Result<NavMesh, NavMeshError> {
        Self::build_with(scene, &NavMeshSettings::from(body))
    }

    /// Builds the mesh of `scene` with `settings`; the default is Habitat's.
    ///
    /// # Errors
    /// If a setting is out of range, if the scene mesh is empty, invalid or too large, or if no floor is
    /// walkable.
    pub fn build_with(scene: &Scene, settings: &NavMeshSettings) -> Result<NavMesh, NavMeshError> {
        settings.check()?;
        let body = &settings.body;
        let Voxels { lattice, polygons: raw, floors } = voxelise(scene, settings)?;
        let top_m = scene.bounds().map_or(0.0, |bounds| bounds.max.y) - body.height_m;
        let climb_m = f32::from(Cells::new(settings).climb) * settings.level_m;
        let (surface, max_gap_m) = match floors {
            Some(floors) => {
                let patches = raw.iter().map(|polygon| (polygon.region, middle_m(polygon) as f32)).collect();
                let ground = Ground::new(lattice, floors, patches, scene);
                (Surface::Scene(Box::new(ground)), f64::from(climb_m) + SHARED_M)
            }
            None => (Surface::Detail(Detail::new(&raw)), SHARED_M),
        };
        let parts = Parts { lattice, headroom_m: body.height_m, climb_m: body.climb_m, raw };
        Ok(Self::assemble(parts, surface, max_gap_m, top_m))
    }

    /// Joins polygons with a height difference of at most `max_gap_m` at the edge; those above `top_m` are
    /// roofs.
    pub(crate) fn assemble(parts: Parts, surface: Surface, max_gap_m: f64, top_m: f32) -> Self {
        let Parts { lattice, headroom_m, climb_m, raw } = parts;
        let polygons = Polygons::new(&raw, max_gap_m);
        let middles_m: Vec<_> = raw.iter().map(middle_m).collect();
        let is_roof = |polygon: u32| middles_m[polygon as usize] > f64::from(top_m);
        let islands = Islands::new(&polygons, lattice.cell_m, is_roof);
        let corners = Corners::new(&polygons, lattice, |edge| match &surface {
            Surface::Scene(_) => f64::from(surface.height_m(polygons.owner(edge), polygons.from(edge))),
            Surface::Detail(_) => polygons.height_m(edge),
        });
        let bins = Bins::new(&polygons);
        Self { lattice, headroom_m, climb_m, polygons, corners, islands, bins, surface }
    }

    /// Returns the mesh point nearest to `point` within `max_distance_m` (in space).
    ///
    /// Polygons are compared by their nearest point in the plane, at its height.
    pub fn snap(&self, point: &Point3<f32>, max_distance_m: f32) -> Option<NavPoint> {
        let spot = self.lattice.spot(point);
        let cell_m = f64::from(self.lattice.cell_m);
        let mut best = (f64::from(max_distance_m).powi(2), None);
        let rise_m = |height_m: f32| f64::from((height_m - point.y).abs());
        self.bins.around(&spot, f64::from(max_distance_m) / cell_m, |polygon| {
            let nearest = self.polygons.nearest(polygon, &spot);
            let flat = (nearest - spot).norm_squared() * cell_m * cell_m;
            // The exact height is expensive: it is computed only if the rough height is inconclusive.
            let rough_m = self.surface.rough_height_m(polygon, &nearest);
            let least_m = (rise_m(rough_m) - 2.0 * f64::from(self.lattice.level_m)).max(0.0);
            if flat + least_m * least_m <= best.0 {
                let rise_m = rise_m(self.surface.height_m(polygon, &nearest));
                let distance_squared = flat + rise_m * rise_m;
                if distance_squared < best.0 || best.1.is_none() && distance_squared == best.0 {
                    best = (distance_squared, Some((nearest, polygon)));
                }
            }
            best.0.sqrt() / cell_m
        });
        let (nearest, polygon) = best.1?;
        Some(self.point(&nearest, polygon))
    }

    /// Island index of `point`.
    pub fn island_of(&self, point: &NavPoint) -> u32 {
        self.islands.of(point.polygon)
    }

    /// Island count, at least 1.
    pub fn island_count(&self) -> u32 {
        self.islands.count()
    }

    /// Area of an island in the ground plane, square metres.
    ///
    /// # Panics
    /// If `island` is out of range.
    pub fn island_area_m2(&self, island: u32) -> f64 {
        self.islands.area_m2(island)
    }

    /// The main island: the largest island except roofs.
    pub fn largest_island(&self) -> u32 {
        0
    }

    /// Area of all islands in the ground plane, square metres.
    pub fn area_m2(&self) -> f64 {
        self.islands.total_area_m2()
    }

    /// Samples a point of `island`, uniform by area in the ground plane.
    ///
    /// # Panics
    /// If `island` is out of range.
    pub fn sample(&self, rng: &mut Rng, island: u32) -> NavPoint {
        let (spot, polygon) = self.islands.sample(&self.polygons, rng, island);
        self.point(&spot, polygon)
    }

    /// Mesh points inside `bounds` with x and z at multiples of `spacing_m`, on every storey; sorted by x, z,
    /// height. Empty if the spacing is below a lattice cell.
    pub fn grid(&self, bounds: &Aabb, spacing_m: f32) -> Vec<NavPoint> {
        if spacing_m.is_nan() || spacing_m < self.lattice.cell_m {
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

    /// Moves by `displacement` from `from` with sliding, like Habitat: at a wall the step ends at the nearest
    /// reachable point to its target. Only the horizontal part of `displacement` counts.
    pub fn slide(&self, from: &NavPoint, displacement: &Vector3<f32>) -> Slide {
        let start = self.eye(from);
        let cells = |metres: f32| self.lattice.cells(f64::from(metres));
        let target = Spot::new(start.spot.x + cells(displacement.x), start.spot.y + cells(displacement.z));
        let length_m = f64::from(displacement.xz().norm());
        self.step(start, target, length_m, true).unwrap_or(Slide { end: *from, blocked: true })
    }

    /// A step to `target` that measures `length_m`; `None` when it ends nowhere.
    pub(crate) fn step(&self, start: Eye, target: Spot, length_m: f64, slides: bool) -> Option<Slide> {
        if !(target.x.is_finite() && target.y.is_finite()) {
            return None;
        }
        let reach_cells = self.lattice.cells(0.5 * length_m + STEP_RIM_M);
        let walked = walk(&self.polygons, &Step { start, target, reach_cells, slides })?;
        Some(Slide { end: self.point(&walked.end.spot, walked.end.polygon), blocked: walked.blocked })
    }

    /// The polygons of the mesh for maps: corners in order, in the world frame.
    pub fn polygons(&self) -> Vec<Vec<Point3<f32>>> {
        let corner = |polygon: u32, spot: &Spot| self.point(spot, polygon).position;
        let outline =
            |polygon: u32| self.polygons.corners(polygon).iter().map(|s| corner(polygon, s)).collect();
        (0..self.polygons.len()).map(outline).collect()
    }

    pub(crate) fn eye(&self, point: &NavPoint) -> Eye {
        // Rounding to f32 may have moved the point across the rim of its polygon or off a corner.
        let spot = self.polygons.nearest(point.polygon, &self.lattice.spot(&point.position));
        let is_here = |corner: &&Spot| (*corner - spot).norm_squared() < ROUNDING_CELLS * ROUNDING_CELLS;
        let corner = self.polygons.corners(point.polygon).iter().find(is_here);
        Eye { spot: corner.copied().unwrap_or(spot), polygon: point.polygon }
    }

    pub(crate) fn corner_position(&self, corner: u32) -> Point3<f32> {
        let corner = self.corners.get(corner);
        self.lattice.point(&corner.eye.spot, corner.height_m as f32)
    }

    pub(crate) fn lattice(&self) -> &Lattice {
        &self.lattice
    }

    /// The highest step that the body walks, metres.
    pub(crate) fn climb_m(&self) -> f32 {
        self.climb_m
    }

    pub(crate) fn point(&self, spot: &Spot, polygon: u32) -> NavPoint {
        let height_m = self.surface.height_m(polygon, spot);
        NavPoint { position: self.lattice.point(spot, height_m), polygon }
    }

    /// Bounds of the mesh in the plane; heights are undefined.
    fn reach(&self) -> Option<Aabb> {
        let spots = (0..self.polygons.len()).flat_map(|polygon| self.polygons.corners(polygon));
        let points: Vec<_> = spots.map(|spot| self.lattice.point(spot, 0.0)).collect();
        Aabb::around(&points)
    }

    /// The points of all storeys at `at`, lowest first. On a shared edge a single polygon counts.
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

/// Mean height of the corners, metres.
fn middle_m(polygon: &RawPolygon) -> f64 {
    let sum: f64 = polygon.corners.iter().map(|corner| corner.height_m).sum();
    sum / polygon.corners.len() as f64
}
