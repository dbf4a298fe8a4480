//! From triangles to walkable polygons: the one place that speaks with `rerecast`.

use crate::plane::{CELL_M, LEVEL_M, Lattice};
use crate::regions::divide;
use crate::{Body, NavMeshError};
use avln_geom::Aabb;
use avln_scene::Scene;
use rerecast::{
    Aabb3d, AreaType, BuildContoursFlags, CompactHeightfield, HeightfieldBuilder, PolygonNavmesh, TriMesh,
};
use std::fmt::Display;

/// As Habitat builds: parts below 1 square metre go, walls are cut at 12 m, polygons have at most six corners. Unlike
/// there, outlines follow the raster within less than one cell, so that no passage of a single row collapses.
const MIN_PART_CELLS: u32 = 400;
const MAX_EDGE_CELLS: u16 = 240;
const MAX_EDGE_ERRORS_CELLS: [f32; 3] = [0.99, 0.5, 0.0];
const MAX_CORNERS: u16 = 6;

/// Free cells around the scene. Odd parts of a cell keep walls at round numbers off the cell borders, where rounding
/// would file them under one cell or the next; a scene that defeats one lattice is tried on the next.
const MARGINS_CELLS: [f32; 3] = [3.4373, 3.5721, 3.2917];
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
    let tries = MARGINS_CELLS.map(|margin| margin * CELL_M);
    let first = on_lattice(scene, body, &bounds, tries[0]);
    let built = tries[1..]
        .iter()
        .fold(first, |built, &margin_m| built.or_else(|_| on_lattice(scene, body, &bounds, margin_m)));
    let voxels = built.map_err(|failure| failure.of(scene))?;
    if voxels.polygons.is_empty() {
        let (radius_m, height_m) = (body.radius_m, body.height_m);
        return Err(NavMeshError::NoFloor { scene: scene.name.clone(), radius_m, height_m });
    }
    Ok(voxels)
}

fn on_lattice(scene: &Scene, body: &Body, bounds: &Aabb, margin_m: f32) -> Result<Voxels, Failure> {
    let around = bounds.grown(margin_m);
    // The pipeline indexes by what it finds in the file's geometry: a fault in it must not take the server down.
    let run = || pipeline(scene, body, &around);
    let (field, mesh) = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run)).unwrap_or_else(|_| {
        Err(Failure { stage: "rasterising", reason: "the geometry defeats it".into() })
    })?;
    let lattice = Lattice { origin: around.min };
    Ok(Voxels { lattice, polygons: raw_polygons(&mesh), floors: floors(&field) })
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

fn pipeline(scene: &Scene, body: &Body, around: &Aabb) -> Result<Built, Failure> {
    let height = (body.height_m / LEVEL_M).ceil() as u16;
    let climb = climb_levels(body);
    let radius = (body.radius_m / CELL_M - 1e-3).ceil() as u16;

    let [min, max] = [around.min, around.max].map(|corner| [corner.x, corner.y, corner.z].into());
    let builder = HeightfieldBuilder { aabb: Aabb3d { min, max }, cell_size: CELL_M, cell_height: LEVEL_M };
    let mut field = builder.build().map_err(Failure::at("laying out the lattice"))?;
    field.rasterize_triangles(&triangles(scene, body), climb).map_err(Failure::at("rasterising"))?;
    field.filter_low_hanging_walkable_obstacles(climb);
    field.filter_ledge_spans(height, climb);
    field.filter_walkable_low_height_spans(height);

    let mut field = field.into_compact(height, climb).map_err(Failure::at("finding floors"))?;
    // One cell at least: it leaves no crack between cells that touch without a way from one to the other.
    field.erode_walkable_area(radius.max(1));
    let too_many = |count| format!("{count} regions are more than 32767");
    divide(&mut field, MIN_PART_CELLS).map_err(too_many).map_err(Failure::at("dividing into regions"))?;
    let mesh = cut(&field)?;
    Ok((field, mesh))
}

/// Outlines that cross themselves cannot be cut: they are tried again, following the raster closer.
fn cut(field: &CompactHeightfield) -> Result<PolygonNavmesh, Failure> {
    let attempt = |max_error| {
        let contours = field.build_contours(max_error, MAX_EDGE_CELLS, BuildContoursFlags::DEFAULT);
        contours.into_polygon_mesh(MAX_CORNERS).map_err(Failure::at("cutting polygons"))
    };
    let [loosest, closer @ ..] = MAX_EDGE_ERRORS_CELLS;
    closer.into_iter().fold(attempt(loosest), |cut, max_error| cut.or_else(|_| attempt(max_error)))
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
