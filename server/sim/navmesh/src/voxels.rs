//! Conversion from triangles to walkable polygons with `rerecast`, over floor regions without holes, which it requires for outlines.

use crate::plane::{Lattice, LatticePoint};
use crate::polygons::{MIN_POLYGON_M2, RawPolygon};
use crate::raster::rasterise;
use crate::settings::{Cells, Finish, NavMeshError, NavMeshSettings};
use avln_geom::angle::sin_cos;
use avln_geom::{Aabb, Point2, Point3};
use avln_scene::Scene;
use rerecast::{
    Aabb3d, AreaType, BuildContoursFlags, CompactHeightfield, DetailNavmesh, HeightfieldBuilder,
    PolygonNavmesh, RegionId,
};
use std::fmt::Display;

const MAX_CORNERS: u16 = 6;
// Self-intersecting outlines are retried closer to the raster.
const CLOSER_EDGE_ERRORS_CELLS: [f32; 2] = [0.5, 0.0];

// Free cells around the scene. Fractions move walls at round numbers off the cell borders, where rounding
// would select the cell; a scene that fails on one lattice is retried on the next.
const MARGINS_CELLS: [f32; 3] = [3.4373, 3.5721, 3.2917];
const MAX_SIDE_CELLS: f32 = 60_000.0;
const MAX_LEVELS: f32 = 60_000.0;
const MAX_COLUMNS: f32 = 3.0e7;

pub(crate) struct Voxels {
    pub(crate) lattice: Lattice,
    pub(crate) polygons: Vec<RawPolygon>,
    pub(crate) floors: Option<Floors>,
}

/// Floors by lattice column. A region has at most one floor per column.
pub(crate) struct Floors {
    pub(crate) width: usize,
    pub(crate) depth: usize,
    /// Start index by column (x within z), with a sentinel.
    starts: Vec<u32>,
    /// Region and level, lowest first.
    floors: Vec<(u16, u16)>,
}

impl Floors {
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.starts.as_slice()) + size_of_val(self.floors.as_slice())
    }

    /// Returns the level of `region` in a column.
    pub(crate) fn level(&self, x: usize, z: usize, region: u16) -> Option<u16> {
        let column = z * self.width + x;
        let range = self.starts[column] as usize..self.starts[column + 1] as usize;
        self.floors[range].iter().find(|floor| floor.0 == region).map(|floor| floor.1)
    }
}

/// Rasterises the scene, erodes the floor by the body and cuts it into convex polygons.
pub(crate) fn voxelise(scene: &Scene, settings: &NavMeshSettings) -> Result<Voxels, NavMeshError> {
    let bounds = check(scene, settings)?;
    let mut tries: Vec<_> =
        MARGINS_CELLS.iter().map(|margin| (Finish::Scene, margin * settings.cell_m)).collect();
    if settings.finish == Finish::Habitat {
        tries.insert(0, (Finish::Habitat, 0.0));
        tries[1].1 = 0.0;
    }
    let attempt = |&(regions, margin_m): &(Finish, f32)| {
        guarded(scene, || on_lattice(scene, settings, &bounds.grown(margin_m), regions))
    };
    let first = attempt(&tries[0]);
    let voxels = tries[1..].iter().fold(first, |built, next| built.or_else(|_| attempt(next)))?;
    if voxels.polygons.is_empty() {
        return Err(NavMeshError::NoFloor { scene: scene.name.clone(), body: settings.body });
    }
    Ok(voxels)
}

// The pipeline indexes by file geometry, and a fault must not stop the server.
fn guarded<T>(scene: &Scene, run: impl FnOnce() -> Result<T, NavMeshError>) -> Result<T, NavMeshError> {
    std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).unwrap_or_else(|_| {
        Err(failed(scene, "rasterising", "the polygon library cannot handle the geometry"))
    })
}

fn check(scene: &Scene, settings: &NavMeshSettings) -> Result<Aabb, NavMeshError> {
    let mesh = &scene.mesh;
    let malformed = |defect: String| NavMeshError::Malformed { scene: scene.name.clone(), defect };
    if let Some(index) = mesh.positions.iter().position(|p| !p.coords.iter().all(|value| value.is_finite())) {
        return Err(malformed(format!("corner {index} is not finite")));
    }
    let count = mesh.positions.len();
    if let Some(index) = mesh.triangles.iter().position(|t| t.iter().any(|&corner| corner as usize >= count))
    {
        let corners = mesh.triangles[index];
        return Err(malformed(format!("triangle {index} names corners {corners:?} of {count}")));
    }
    let used = mesh.triangles.iter().flatten().map(|&corner| &mesh.positions[corner as usize]);
    let bounds = Aabb::around(used).ok_or_else(|| NavMeshError::Empty { scene: scene.name.clone() })?;
    let size = bounds.size();
    let (width, depth) = (size.x / settings.cell_m, size.z / settings.cell_m);
    let fits = width.max(depth) < MAX_SIDE_CELLS
        && width * depth < MAX_COLUMNS
        && size.y / settings.level_m < MAX_LEVELS;
    if fits {
        return Ok(bounds);
    }
    let limit = format!(
        "{:.0} square metres, {:.0} m a side and {:.0} m high",
        MAX_COLUMNS * settings.cell_m * settings.cell_m,
        MAX_SIDE_CELLS * settings.cell_m,
        MAX_LEVELS * settings.level_m
    );
    Err(NavMeshError::TooLarge { scene: scene.name.clone(), size_m: size.into(), limit })
}

fn failed(scene: &Scene, stage: &'static str, reason: impl Display) -> NavMeshError {
    NavMeshError::Voxels { scene: scene.name.clone(), stage, reason: reason.to_string() }
}

/// Runs the pipeline inside `around`, with floors divided by `regions`.
fn on_lattice(
    scene: &Scene,
    settings: &NavMeshSettings,
    around: &Aabb,
    regions: Finish,
) -> Result<Voxels, NavMeshError> {
    let cells = Cells::new(settings);
    let mut field = open_floor(scene, settings, &cells, around)?;
    match regions {
        Finish::Habitat => {
            field.build_distance_field();
            let built = field.build_regions(0, cells.min_area, cells.merge_area);
            built.map_err(|error| failed(scene, "dividing into regions", error))?;
        }
        Finish::Scene => {
            let too_many = |count| format!("{count} regions are more than 32767");
            let divided = divide(&mut field, u32::from(cells.min_area)).map_err(too_many);
            divided.map_err(|error| failed(scene, "dividing into regions", error))?;
        }
    }
    let mesh = cut(scene, &field, settings, &cells)?;
    let spacing_m = if settings.detail_cells < 0.9 { 0.0 } else { settings.detail_cells * settings.cell_m };
    let error_m = settings.detail_error_levels * settings.level_m;
    let detail = match settings.finish {
        Finish::Habitat => Some(DetailNavmesh::new(&mesh, &field, spacing_m, error_m)),
        Finish::Scene => None,
    };
    let detail = detail.transpose().map_err(|error| failed(scene, "sampling heights", error))?;
    let lattice = Lattice { origin: around.min, cell_m: settings.cell_m, level_m: settings.level_m };
    let polygons = raw_polygons(&mesh, detail.as_ref(), &lattice);
    let floors = detail.is_none().then(|| floors(&field));
    Ok(Voxels { lattice, polygons, floors })
}

fn open_floor(
    scene: &Scene,
    settings: &NavMeshSettings,
    cells: &Cells,
    around: &Aabb,
) -> Result<CompactHeightfield, NavMeshError> {
    let [min, max] = [around.min, around.max].map(|corner| [corner.x, corner.y, corner.z].into());
    let aabb = Aabb3d { min, max };
    let builder = HeightfieldBuilder { aabb, cell_size: settings.cell_m, cell_height: settings.level_m };
    let mut field = builder.build().map_err(|error| failed(scene, "laying out the lattice", error))?;
    let (_, least) = sin_cos(settings.body.slope_deg.to_radians());
    for index in 0..scene.mesh.triangles.len() {
        let corners = scene.corners(index);
        let walkable = upward(&corners) > least;
        let area = if walkable { AreaType::DEFAULT_WALKABLE } else { AreaType::NOT_WALKABLE };
        rasterise(&mut field, corners, area, cells.climb);
    }
    field.filter_low_hanging_walkable_obstacles(cells.climb);
    field.filter_ledge_spans(cells.clearance, cells.climb);
    field.filter_walkable_low_height_spans(cells.clearance);
    let mut field = field
        .into_compact(cells.height, cells.climb)
        .map_err(|error| failed(scene, "finding floors", error))?;
    field.erode_walkable_area(cells.radius);
    Ok(field)
}

fn cut(
    scene: &Scene,
    field: &CompactHeightfield,
    settings: &NavMeshSettings,
    cells: &Cells,
) -> Result<PolygonNavmesh, NavMeshError> {
    let attempt = |max_error| {
        let contours = field.build_contours(max_error, cells.edge_max, BuildContoursFlags::DEFAULT);
        contours.into_polygon_mesh(MAX_CORNERS).map_err(|error| failed(scene, "cutting polygons", error))
    };
    let loosest = guarded(scene, || attempt(settings.edge_error_cells));
    CLOSER_EDGE_ERRORS_CELLS.into_iter().fold(loosest, |cut, max_error| cut.or_else(|_| attempt(max_error)))
}

/// Returns the unit normal's upward component; NaN for degenerate triangles.
fn upward([a, b, c]: &[Point3<f32>; 3]) -> f32 {
    // Bevels of exactly 45 degrees are common and the last bit decides, so the operations follow Recast.
    let normal = (b - a).cross(&(c - a));
    let length = (normal.x * normal.x + normal.y * normal.y + normal.z * normal.z).sqrt();
    normal.y * (1.0 / length)
}

fn raw_polygons(mesh: &PolygonNavmesh, detail: Option<&DetailNavmesh>, lattice: &Lattice) -> Vec<RawPolygon> {
    if mesh.vertices.is_empty() {
        return Vec::new();
    }
    let corner = |index: u16| {
        let [x, level, z] = mesh.vertices[usize::from(index)].to_array();
        LatticePoint {
            spot: Point2::new(f64::from(x), f64::from(z)),
            height_m: f64::from(lattice.height_m(level)),
        }
    };
    let raw = mesh.polygons().enumerate().map(|(index, outline)| {
        let corners: Vec<_> = outline.map(corner).collect();
        let detail = detail.map(|detail| detail_triangles(detail, index, &corners, lattice));
        RawPolygon { corners, region: mesh.regions[index].bits(), detail: detail.unwrap_or_default() }
    });
    let is_polygon = |polygon: &RawPolygon| match detail {
        Some(_) => polygon.detail_m2(lattice) >= MIN_POLYGON_M2,
        None => polygon.has_three_sides(),
    };
    raw.filter(is_polygon).collect()
}

/// Detour's detail triangles: polygon corners at their heights, samples one level above the lattice.
fn detail_triangles(
    detail: &DetailNavmesh,
    polygon: usize,
    corners: &[LatticePoint],
    lattice: &Lattice,
) -> Vec<[LatticePoint; 3]> {
    let part = &detail.meshes[polygon];
    let place = |local: u8| match corners.get(usize::from(local)) {
        Some(corner) => *corner,
        None => {
            let sample = detail.vertices[part.base_vertex_index as usize + usize::from(local)];
            let point = Point3::new(sample.x, sample.y, sample.z);
            LatticePoint { spot: lattice.spot(&point), height_m: f64::from(point.y) }
        }
    };
    let first = part.base_triangle_index as usize;
    let triangles = &detail.triangles[first..first + part.triangle_count as usize];
    triangles.iter().map(|corners| corners.map(place)).collect()
}

fn floors(field: &CompactHeightfield) -> Floors {
    let mut starts = vec![0];
    let mut floors = Vec::with_capacity(field.spans.len());
    for cell in &field.cells {
        let spans = &field.spans[cell.index_range()];
        floors.extend(spans.iter().map(|span| (span.region.bits(), span.y)).filter(|floor| floor.0 != 0));
        starts.push(floors.len() as u32);
    }
    Floors { width: usize::from(field.width), depth: usize::from(field.height), starts, floors }
}

// Region numbers start at 1; the upper half has another meaning in `rerecast`.
const MAX_REGIONS: usize = 0x7fff;
const LOWER_X: u8 = 0;
const LOWER_Z: u8 = 3;
const NONE: u32 = u32::MAX;

/// Assigns regions to floor cells, except in connected parts below `min_cells`.
///
/// Sweep over cell rows: a run of connected cells continues the previous row's region if both touch only each
/// other; otherwise it opens a new region. A region therefore has a single run per row and straight borders.
///
/// # Errors
/// The region count, if above 32,767.
fn divide(field: &mut CompactHeightfield, min_cells: u32) -> Result<(), usize> {
    let links = Links::new(field);
    let large = in_large_parts(&links, min_cells);
    let (region_of, count) = sweep(field, &links, &large);
    if count > MAX_REGIONS {
        return Err(count);
    }
    for (span, region) in field.spans.iter_mut().zip(region_of) {
        span.region = RegionId::from(if region == NONE { 0 } else { region as u16 + 1 });
    }
    field.max_region = RegionId::from(count as u16);
    Ok(())
}

/// Connected floor cells towards lower x and z, or `NONE`.
struct Links {
    walkable: Vec<bool>,
    lower_x: Vec<u32>,
    lower_z: Vec<u32>,
}

impl Links {
    fn new(field: &CompactHeightfield) -> Self {
        let walkable: Vec<_> = field.areas.iter().map(|area| area.is_walkable()).collect();
        let (mut lower_x, mut lower_z) = (vec![NONE; walkable.len()], vec![NONE; walkable.len()]);
        let width = usize::from(field.width);
        for (column, cell) in field.cells.iter().enumerate() {
            for span in cell.index_range().filter(|&span| walkable[span]) {
                let link = |direction: u8, step: usize| {
                    let layer = field.spans[span].con(direction)?;
                    let other = field.cells[column - step].index() + u32::from(layer);
                    walkable[other as usize].then_some(other)
                };
                lower_x[span] = link(LOWER_X, 1).unwrap_or(NONE);
                lower_z[span] = link(LOWER_Z, width).unwrap_or(NONE);
            }
        }
        Self { walkable, lower_x, lower_z }
    }
}
fn in_large_parts(links: &Links, min_cells: u32) -> Vec<bool> {
    let count = links.walkable.len() as u32;
    let mut parent: Vec<u32> = (0..count).collect();
    for span in 0..count {
        let neighbours = [links.lower_x[span as usize], links.lower_z[span as usize]];
        for neighbour in neighbours.into_iter().filter(|&neighbour| neighbour != NONE) {
            let (a, b) = (root(&mut parent, span), root(&mut parent, neighbour));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let roots: Vec<_> = (0..count).map(|span| root(&mut parent, span)).collect();
    let mut cells = vec![0; roots.len()];
    roots.iter().for_each(|&root| cells[root as usize] += 1);
    let is_large = roots.iter().map(|&root| cells[root as usize] >= min_cells);
    is_large.zip(&links.walkable).map(|(large, &walkable)| large && walkable).collect()
}

fn root(parent: &mut [u32], mut span: u32) -> u32 {
    while parent[span as usize] != span {
        parent[span as usize] = parent[parent[span as usize] as usize];
        span = parent[span as usize];
    }
    span
}

/// A run's contact with the previous row: first region with cell count, and a flag for further regions.
struct Below {
    region: u32,
    cells: u32,
    others: bool,
}

impl Below {
    fn add(&mut self, region: u32) {
        if self.region == NONE {
            self.region = region;
        }
        self.others |= self.region != region;
        self.cells += 1;
    }

    /// Returns the continued region: the only one touched, if it touches no other run.
    fn continued(&self, touched: &[u32]) -> Option<u32> {
        let alone = self.region != NONE && !self.others && touched[self.region as usize] == self.cells;
        alone.then_some(self.region)
    }
}
fn sweep(field: &CompactHeightfield, links: &Links, chosen: &[bool]) -> (Vec<u32>, usize) {
    let (mut region_of, mut run_of) = (vec![NONE; chosen.len()], vec![0; chosen.len()]);
    let mut count = 0;
    for row in field.cells.chunks(usize::from(field.width).max(1)) {
        let spans: Vec<_> = row.iter().flat_map(|cell| cell.index_range()).filter(|&s| chosen[s]).collect();
        let mut runs: Vec<Below> = Vec::new();
        let mut touched = vec![0; count];
        for &span in &spans {
            run_of[span] = match links.lower_x[span] {
                NONE => {
                    runs.push(Below { region: NONE, cells: 0, others: false });
                    runs.len() - 1
                }
                before => run_of[before as usize],
            };
            if links.lower_z[span] != NONE {
                let region = region_of[links.lower_z[span] as usize];
                touched[region as usize] += 1;
                runs[run_of[span]].add(region);
            }
        }
        let mut open = || {
            count += 1;
            count as u32 - 1
        };
        let regions: Vec<_> =
            runs.iter().map(|run| run.continued(&touched).unwrap_or_else(&mut open)).collect();
        spans.iter().for_each(|&span| region_of[span] = regions[run_of[span]]);
    }
    (region_of, count)
}
