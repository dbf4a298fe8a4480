//! From triangles to walkable polygons: the one place that speaks with `rerecast`.

use crate::plane::{CELL_M, LEVEL_M, Lattice};
use crate::{Body, NavMeshError};
use avln_geom::{Aabb, Point3};
use avln_scene::Scene;
use rerecast::{
    Aabb3d, AreaType, BuildContoursFlags, CompactHeightfield, HeightfieldBuilder, PolygonNavmesh, TriMesh,
};
use std::fmt::Display;

/// Habitat's build settings, in cells: regions below 1 square metre go, small ones are merged, edges are cut at 12 m and
/// follow the raster within 1.3 cells, polygons have at most six corners.
const MIN_REGION_CELLS: u16 = 400;
const MERGE_REGION_CELLS: u16 = 400;
const MAX_EDGE_CELLS: u16 = 240;
const MAX_EDGE_ERROR_CELLS: f32 = 1.3;
const MAX_CORNERS: u16 = 6;

const MARGIN_CELLS: f32 = 3.5;
const MAX_SIDE_CELLS: f32 = 60_000.0;
const MAX_LEVELS: f32 = 60_000.0;
const MAX_COLUMNS: f32 = 3.0e7;
const SIZE_LIMIT: &str = "75,000 square metres, 3000 m a side and 3000 m high";

/// The walkable part of a scene, before its polygons are joined.
pub(crate) struct Voxels {
    pub(crate) lattice: Lattice,
    pub(crate) polygons: Vec<RawPolygon>,
    pub(crate) floors: Floors,
}

/// A convex polygon: its corners in order (x, level, z of the lattice) and the patch of floor that it covers.
pub(crate) struct RawPolygon {
    pub(crate) corners: Vec<[u16; 3]>,
    pub(crate) region: u16,
}

/// Which floors each column of the lattice has. A region never has two floors in one column.
pub(crate) struct Floors {
    pub(crate) width: usize,
    pub(crate) depth: usize,
    /// Where each column begins in `floors`; one more than there are columns. Columns are ordered x within z.
    starts: Vec<u32>,
    /// Region and level, lowest first within a column.
    floors: Vec<(u16, u16)>,
}

impl Floors {
    /// Level of the floor that `region` has in the column (`x`, `z`).
    pub(crate) fn level(&self, x: usize, z: usize, region: u16) -> Option<u16> {
        let column = z * self.width + x;
        let range = self.starts[column] as usize..self.starts[column + 1] as usize;
        self.floors[range].iter().find(|floor| floor.0 == region).map(|floor| floor.1)
    }
}

/// Rasterises the scene, erodes what is walkable by the body and cuts it into convex polygons.
pub(crate) fn voxelise(scene: &Scene, body: &Body) -> Result<Voxels, NavMeshError> {
    let bounds = check(scene)?;
    let lattice = lattice_under(&bounds);
    // The pipeline indexes by what it finds in the file's geometry: a fault in it must not take the server down.
    let run = || pipeline(scene, body, &lattice, &bounds);
    let (field, mesh) = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run))
        .unwrap_or_else(|_| Err(Failure { stage: "building polygons", reason: "it panicked".into() }))
        .map_err(|failure| failure.of(scene))?;
    let polygons = raw_polygons(&mesh);
    if polygons.is_empty() {
        let (radius_m, height_m) = (body.radius_m, body.height_m);
        return Err(NavMeshError::NoFloor { scene: scene.name.clone(), radius_m, height_m });
    }
    Ok(Voxels { lattice, polygons, floors: floors(&field) })
}

fn check(scene: &Scene) -> Result<Aabb, NavMeshError> {
    let mesh = &scene.mesh;
    let malformed = |what: String| NavMeshError::Malformed { scene: scene.name.clone(), what };
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
    let (width, depth) = (size.x / CELL_M, size.z / CELL_M);
    let fits =
        width.max(depth) < MAX_SIDE_CELLS && width * depth < MAX_COLUMNS && size.y / LEVEL_M < MAX_LEVELS;
    let (width_m, height_m, depth_m) = (size.x, size.y, size.z);
    let limit = SIZE_LIMIT;
    fits.then_some(bounds).ok_or_else(|| NavMeshError::TooLarge {
        scene: scene.name.clone(),
        width_m,
        height_m,
        depth_m,
        limit,
    })
}

/// A margin keeps every side at least a few cells long. Its half cells keep walls and floors at round numbers away from
/// the cell borders, where rounding would file them under one cell or the next.
fn lattice_under(bounds: &Aabb) -> Lattice {
    let margin = MARGIN_CELLS * CELL_M;
    let min = bounds.min;
    Lattice { origin: Point3::new(min.x - margin, min.y - 0.5 * LEVEL_M, min.z - margin) }
}

struct Failure {
    stage: &'static str,
    reason: String,
}

impl Failure {
    fn at<E: Display>(stage: &'static str) -> impl FnOnce(E) -> Self {
        move |error| Self { stage, reason: error.to_string() }
    }

    fn of(self, scene: &Scene) -> NavMeshError {
        NavMeshError::Voxels { scene: scene.name.clone(), stage: self.stage, reason: self.reason }
    }
}

/// The highest step that `body` walks, in whole levels; 0.2 m are four of them whatever f32 makes of it.
pub(crate) fn climb_levels(body: &Body) -> u16 {
    (body.climb_m / LEVEL_M + 1e-3).floor() as u16
}

type Built = (CompactHeightfield, PolygonNavmesh);

fn pipeline(scene: &Scene, body: &Body, lattice: &Lattice, bounds: &Aabb) -> Result<Built, Failure> {
    let levels = |metres: f32| metres / LEVEL_M;
    let height = levels(body.height_m).ceil() as u16;
    let climb = climb_levels(body);
    let radius = (body.radius_m / CELL_M - 1e-3).ceil().max(0.0) as u16;

    let (min, max) = (lattice.origin, bounds.max.coords.add_scalar(MARGIN_CELLS * CELL_M));
    let aabb = Aabb3d { min: [min.x, min.y, min.z].into(), max: [max.x, max.y, max.z].into() };
    let builder = HeightfieldBuilder { aabb, cell_size: CELL_M, cell_height: LEVEL_M };
    let mut field = builder.build().map_err(Failure::at("laying out the lattice"))?;
    let triangles = triangles(scene, body);
    field.rasterize_triangles(&triangles, climb).map_err(Failure::at("rasterising"))?;
    field.filter_low_hanging_walkable_obstacles(climb);
    field.filter_ledge_spans(height, climb);
    field.filter_walkable_low_height_spans(height);

    let mut field = field.into_compact(height, climb).map_err(Failure::at("finding floors"))?;
    field.erode_walkable_area(radius);
    field.build_distance_field();
    field
        .build_regions(0, MIN_REGION_CELLS, MERGE_REGION_CELLS)
        .map_err(Failure::at("dividing into regions"))?;
    let contours = field.build_contours(MAX_EDGE_ERROR_CELLS, MAX_EDGE_CELLS, BuildContoursFlags::DEFAULT);
    let mesh = contours.into_polygon_mesh(MAX_CORNERS).map_err(Failure::at("cutting polygons"))?;
    Ok((field, mesh))
}

fn triangles(scene: &Scene, body: &Body) -> TriMesh {
    let mesh = &scene.mesh;
    let mut triangles = TriMesh {
        vertices: mesh.positions.iter().map(|p| [p.x, p.y, p.z].into()).collect(),
        indices: mesh.triangles.iter().map(|&corners| corners.into()).collect(),
        area_types: vec![AreaType::NOT_WALKABLE; mesh.triangles.len()],
    };
    triangles.mark_walkable_triangles(body.slope_deg.to_radians());
    triangles
}

fn raw_polygons(mesh: &PolygonNavmesh) -> Vec<RawPolygon> {
    if mesh.vertices.is_empty() {
        return Vec::new();
    }
    let corner = |index: u16| mesh.vertices[usize::from(index)].to_array();
    let outlines = mesh.polygons().map(|outline| outline.map(corner).collect());
    let numbered = outlines.zip(&mesh.regions);
    let polygons = numbered.map(|(corners, region)| RawPolygon { corners, region: region.bits() });
    polygons.filter(has_three_sides).collect()
}

fn has_three_sides(polygon: &RawPolygon) -> bool {
    let mut plan: Vec<_> = polygon.corners.iter().map(|corner| (corner[0], corner[2])).collect();
    plan.sort_unstable();
    plan.dedup();
    plan.len() >= 3
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
