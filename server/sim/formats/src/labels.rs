//! Scan labels: from a semantic mesh to the render mesh's instances.

use crate::files::{Checked, ImportReport, refuse_if, resolve};
use crate::named_model::bounds;
use crate::{glb, obj, ply};
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Meaning, Surfaces, meaning};
use avln_scene::{
    Attributes, InstanceId, Lighting, Material, Mesh, Object, Region, Scene, SceneError, Texture,
};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::path::Path;

/// Greatest difference between two meshes' boxes for a building, metres.
const SAME_BUILDING_M: f32 = 1.0;

/// Surfaces in the world frame, without instances.
pub(crate) struct UnlabelledSurfaces {
    pub(crate) mesh: Mesh,
    pub(crate) materials: Vec<Material>,
    pub(crate) textures: Vec<Texture>,
}

impl UnlabelledSurfaces {
    /// Reads a visible mesh (`.ply`, `.obj` or glTF), in file coordinates.
    pub(crate) fn read(path: &Path, report: &mut ImportReport) -> Result<Self, SceneError> {
        let model = match path.extension().and_then(|extension| extension.to_str()) {
            Some("ply") => return Ok(Self::of_scan(ply::read(path, report)?.mesh)),
            Some("obj") => obj::read(path, report)?,
            _ => glb::read_part(&resolve(path, report)?, report)?,
        };
        Ok(Self { mesh: model.mesh, materials: model.materials, textures: model.textures })
    }

    /// Returns the surfaces in a PLY file.
    pub(crate) fn of_scan(mesh: Mesh) -> Self {
        Self { mesh, materials: vec![ply::material(None)], textures: Vec::new() }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ObjectLabel {
    /// Number, not 0.
    pub(crate) id: u32,
    /// Category; `None` for structure and unnamed surfaces, which are no objects.
    pub(crate) category: Option<String>,
    /// More specific noun; may be empty.
    pub(crate) noun: String,
    pub(crate) region: Option<u16>,
}

impl ObjectLabel {
    /// Creates a label from an annotator's words, without a room.
    pub(crate) fn of_words(id: u32, words: &str) -> Self {
        let (category, noun) = match meaning(words) {
            Meaning::Object { category, noun } => (Some(category), noun),
            Meaning::Structure | Meaning::Unknown => (None, String::new()),
        };
        Self { id, category, noun, region: None }
    }
}

/// Returns the instance number for a number on a face; 0 if it is none.
pub(crate) fn number_of_face(number: i64) -> u32 {
    u32::try_from(number).ok().filter(|&id| id <= InstanceId::MAX).unwrap_or(0)
}

/// Checks an object's number in a table, and adds it to the numbers `seen` before.
pub(crate) fn unique_number(
    number: i64,
    allowed: RangeInclusive<u32>,
    seen: &mut BTreeSet<u32>,
) -> Checked<u32> {
    let id = u32::try_from(number).ok().filter(|id| allowed.contains(id)).ok_or_else(|| {
        let (least, most) = allowed.into_inner();
        format!("an object has number {number}, numbers are {least} to {most}; renumber the objects")
    })?;
    refuse_if(!seen.insert(id), || format!("object number {id} is not unique; renumber the objects"))?;
    Ok(id)
}

/// Transfers triangle labels from `semantic` to `render`; warns if the meshes differ in extent.
pub(crate) fn carried(semantic: &Mesh, labels: &[u32], render: &Mesh, report: &mut ImportReport) -> Vec<u32> {
    if let (Some(a), Some(b)) = (Aabb::around(&semantic.positions), Aabb::around(&render.positions)) {
        let apart = (a.min - b.min).abs().max().max((a.max - b.max).abs().max());
        if apart > SAME_BUILDING_M {
            report.warn(format!(
                "the labelled mesh and the shown mesh differ by {apart:.1} m in extent; check that both are of the same building and have the same axis up"
            ));
        }
    }
    transfer(semantic, labels, render)
}

/// Joins surfaces and labels per triangle (0 for none) into a scene; objects without triangles are a warning.
pub(crate) fn scene(
    name: String,
    surface: UnlabelledSurfaces,
    label_of: &[u32],
    labels: &[ObjectLabel],
    regions: Vec<Region>,
    report: &mut ImportReport,
) -> Scene {
    let UnlabelledSurfaces { mut mesh, materials, textures } = surface;
    let triangles_of = triangles_of(label_of);
    warn_unlisted(&triangles_of, labels, report);
    let surfaces = Surfaces { mesh: &mesh, materials: &materials, textures: &textures };
    let mut objects = Vec::new();
    let mut unseen = Vec::new();
    for label in labels {
        let Some(category) = label.category.clone() else { continue };
        let triangles = triangles_of.get(&label.id).map_or(&[][..], Vec::as_slice);
        let Some(bounds) = bounds(&mesh, triangles) else {
            unseen.push(label.id);
            continue;
        };
        let attributes = Attributes { noun: label.noun.clone(), ..surfaces.attributes(triangles, &bounds) };
        objects.push(Object { id: InstanceId(label.id), category, bounds, region: label.region, attributes });
    }
    if !unseen.is_empty() {
        let (count, some) = (unseen.len(), some_of(&unseen));
        report.warn(format!("{count} labelled objects have no triangles and are left out (numbers {some})"));
    }
    objects.sort_by_key(|object| object.id);
    for object in &objects {
        for &triangle in &triangles_of[&object.id.0] {
            mesh.instance_of[triangle as usize] = object.id;
        }
    }
    Scene { name, mesh, materials, textures, regions, objects, lighting: Lighting::Painted }
}

fn triangles_of(label_of: &[u32]) -> BTreeMap<u32, Vec<u32>> {
    let mut triangles_of: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (triangle, &label) in label_of.iter().enumerate().filter(|(_, label)| **label != 0) {
        triangles_of.entry(label).or_default().push(triangle as u32);
    }
    triangles_of
}

fn warn_unlisted(triangles_of: &BTreeMap<u32, Vec<u32>>, labels: &[ObjectLabel], report: &mut ImportReport) {
    let known: BTreeSet<u32> = labels.iter().map(|label| label.id).collect();
    let unlisted: Vec<u32> = triangles_of.keys().copied().filter(|id| !known.contains(id)).collect();
    if !unlisted.is_empty() {
        report.warn(format!(
            "{} numbers on the mesh are not in the table and have no object (numbers {})",
            unlisted.len(),
            some_of(&unlisted)
        ));
    }
}

/// Returns the surfaces' box per label number.
pub(crate) fn bounds_of(mesh: &Mesh, label_of: &[u32]) -> BTreeMap<u32, Aabb> {
    let labelled = triangles_of(label_of).into_iter();
    labelled.filter_map(|(label, triangles)| Some((label, bounds(mesh, &triangles)?))).collect()
}

fn some_of(numbers: &[u32]) -> String {
    const SHOWN: usize = 5;
    let shown: Vec<String> = numbers.iter().take(SHOWN).map(u32::to_string).collect();
    let more = if numbers.len() > SHOWN { " …" } else { "" };
    format!("{}{more}", shown.join(", "))
}

/// Greatest distance between corresponding triangles' centres, metres.
const SAME_TRIANGLE_M: f32 = 0.01;
/// Greatest distance between equal triangles' centres in differently ordered meshes, metres.
const TWIN_M: f32 = 0.0005;
/// Greatest distance between a triangle's centre and the semantic surface with the label, metres.
const REACH_M: f32 = 0.5;
/// Search cell edge, metres; larger for scenes that would need more than [`MAX_CELLS`].
const CELL_M: f32 = 0.25;
const MAX_CELLS: f32 = 4.0e6;
/// Sample point spacing on semantic surfaces, metres.
const SAMPLE_M: f32 = 0.2;
/// Sample points in addition to one per triangle.
const MAX_EXTRA_SAMPLES: usize = 4_000_000;
const MAX_CUTS: usize = 64;

/// Returns a label per triangle in `render`: the same triangle's by order or centre, or the nearest surface's, or 0.
pub(crate) fn transfer(semantic: &Mesh, labels: &[u32], render: &Mesh) -> Vec<u32> {
    let from = centers(semantic);
    let to = centers(render);
    let same = from.len() == to.len() && from.iter().zip(&to).all(|(a, b)| (a - b).norm() <= SAME_TRIANGLE_M);
    // Meshes of the same export have the same order. This is exact, while the search below can confuse thin layers.
    if same {
        return labels.to_vec();
    }
    let (points, triangle_of) = samples(semantic);
    let (Some(surfaces), Some(wholes)) = (PointGrid::new(&points), PointGrid::new(&from)) else {
        return vec![0; to.len()];
    };
    let label = |center: &Point3<f32>| {
        let twin = wholes.nearest(center).filter(|&twin| (from[twin] - center).norm() <= TWIN_M);
        let triangle = twin.or_else(|| surfaces.nearest(center).map(|point| triangle_of[point] as usize));
        triangle.map_or(0, |triangle| labels[triangle])
    };
    to.iter().map(label).collect()
}

fn samples(mesh: &Mesh) -> (Vec<Point3<f32>>, Vec<u32>) {
    let mut points = Vec::new();
    let mut triangle_of = Vec::new();
    let mut extra = MAX_EXTRA_SAMPLES;
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let corners = triangle.map(|corner| mesh.positions[corner as usize]);
        let cuts = cuts(&corners);
        // Large triangles of walls need many samples, but their total is limited: beyond it, triangles have a single one.
        let affordable = extra.checked_sub(cuts * cuts - 1);
        extra = affordable.unwrap_or(extra);
        add_samples(&corners, if affordable.is_some() { cuts } else { 1 }, &mut points);
        triangle_of.resize(points.len(), index as u32);
    }
    (points, triangle_of)
}

fn cuts([a, b, c]: &[Point3<f32>; 3]) -> usize {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    ((longest / SAMPLE_M).ceil() as usize).clamp(1, MAX_CUTS)
}

/// Appends the centres for `cuts²` equal triangles between parallels to the sides.
fn add_samples([a, b, c]: &[Point3<f32>; 3], cuts: usize, points: &mut Vec<Point3<f32>>) {
    let (along, across) = ((b - a) / cuts as f32, (c - a) / cuts as f32);
    for row in 0..cuts {
        for column in 0..cuts - row {
            points.push(a + along * (column as f32 + 1.0 / 3.0) + across * (row as f32 + 1.0 / 3.0));
            if row + column + 1 < cuts {
                points.push(a + along * (column as f32 + 2.0 / 3.0) + across * (row as f32 + 2.0 / 3.0));
            }
        }
    }
}

fn centers(mesh: &Mesh) -> Vec<Point3<f32>> {
    let center = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize].coords);
        Point3::from((a + b + c) / 3.0)
    };
    mesh.triangles.iter().map(center).collect()
}

/// Points sorted into equal cells: cell `c` contains `order[starts[c]..starts[c + 1]]`.
struct PointGrid<'a> {
    points: &'a [Point3<f32>],
    bounds: Aabb,
    cell_m: f32,
    cells: [i64; 3],
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl<'a> PointGrid<'a> {
    fn new(points: &'a [Point3<f32>]) -> Option<Self> {
        let bounds = Aabb::around(points)?.grown(CELL_M);
        let size = bounds.size();
        let cell_m = CELL_M.max(libm::cbrtf(size.x * size.y * size.z / MAX_CELLS));
        let cells = std::array::from_fn(|axis| (size[axis] / cell_m) as i64 + 1);
        let mut grid = Self { points, bounds, cell_m, cells, starts: Vec::new(), order: Vec::new() };
        let cell_of: Vec<usize> =
            points.iter().map(|point| grid.index(grid.cell(point)).unwrap_or(0)).collect();
        grid.starts = vec![0; (cells[0] * cells[1] * cells[2]) as usize + 1];
        cell_of.iter().for_each(|&cell| grid.starts[cell + 1] += 1);
        (1..grid.starts.len()).for_each(|cell| grid.starts[cell] += grid.starts[cell - 1]);
        grid.order = (0..points.len() as u32).collect();
        grid.order.sort_by_key(|&point| cell_of[point as usize]);
        Some(grid)
    }

    fn cell(&self, point: &Point3<f32>) -> [i64; 3] {
        std::array::from_fn(|axis| ((point[axis] - self.bounds.min[axis]) / self.cell_m).floor() as i64)
    }

    fn index(&self, cell: [i64; 3]) -> Option<usize> {
        let inside = (0..3).all(|axis| (0..self.cells[axis]).contains(&cell[axis]));
        inside.then(|| ((cell[0] * self.cells[1] + cell[1]) * self.cells[2] + cell[2]) as usize)
    }

    /// Returns the nearest point within [`REACH_M`]; the first in a tie.
    fn nearest(&self, to: &Point3<f32>) -> Option<usize> {
        let center = self.cell(to);
        let rings = (REACH_M / self.cell_m).ceil() as i64;
        let mut best: Option<(f32, u32)> = None;
        for ring in 0..=rings {
            // Lower bound for the distance to all points in this ring.
            let at_least = (ring - 1).max(0) as f32 * self.cell_m;
            // Rings grow outwards: once a point is nearer than the next ring, no later ring can contain a nearer one.
            if best.is_some_and(|(distance, _)| distance < at_least) {
                break;
            }
            for cell in shell(center, ring).filter_map(|cell| self.index(cell)) {
                let members = &self.order[self.starts[cell] as usize..self.starts[cell + 1] as usize];
                for &member in members {
                    let distance = (self.points[member as usize] - to).norm();
                    if distance <= REACH_M
                        && best.is_none_or(|(nearest, first)| (distance, member) < (nearest, first))
                    {
                        best = Some((distance, member));
                    }
                }
            }
        }
        best.map(|(_, point)| point as usize)
    }
}

/// Cells with the largest axis offset `ring` from `center`.
fn shell(center: [i64; 3], ring: i64) -> impl Iterator<Item = [i64; 3]> {
    let around = move |x: i64, y: i64| {
        let on_side = x.abs() == ring || y.abs() == ring;
        let step = if on_side || ring == 0 { 1 } else { 2 * ring as usize };
        (-ring..=ring).step_by(step).map(move |z| [center[0] + x, center[1] + y, center[2] + z])
    };
    (-ring..=ring).flat_map(move |x| (-ring..=ring).flat_map(move |y| around(x, y)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::Rng;

    fn random_points(count: usize, rng: &mut Rng) -> Vec<Point3<f32>> {
        (0..count)
            .map(|_| Point3::new(rng.range(-3.0, 3.0), rng.range(0.0, 2.0), rng.range(-1.0, 5.0)))
            .collect()
    }

    #[test]
    fn grid_agrees_with_full_search() {
        let mut rng = Rng::new(7);
        let points = random_points(400, &mut rng);
        let grid = PointGrid::new(&points).unwrap();
        for query in random_points(300, &mut rng) {
            let full = (0..points.len())
                .map(|index| ((points[index] - query).norm(), index))
                .filter(|(distance, _)| *distance <= REACH_M)
                .min_by(|a, b| a.partial_cmp(b).unwrap());
            assert_eq!(grid.nearest(&query), full.map(|(_, index)| index));
        }
    }

    #[test]
    fn samples_are_the_centres_of_equal_parts() {
        let corners = [Point3::origin(), Point3::new(0.6, 0.0, 0.0), Point3::new(0.0, 0.3, 0.0)];
        let mut points = Vec::new();
        add_samples(&corners, cuts(&corners), &mut points);
        assert_eq!(points.len(), 16, "the longest edge, 0.67 m, is cut into 4");
        let mean = points.iter().fold(Point3::origin(), |sum, point| sum + point.coords / 16.0);
        assert!((mean - Point3::new(0.2, 0.1, 0.0)).norm() < 1e-6, "{mean}");
        assert!(
            points.iter().all(|point| point.x > 0.0 && point.y > 0.0 && point.x / 0.6 + point.y / 0.3 < 1.0)
        );
    }

    #[test]
    fn shells_have_distinct_cells() {
        for (ring, count) in [(0, 1), (1, 26), (2, 98)] {
            let mut cells: Vec<[i64; 3]> = shell([0; 3], ring).collect();
            assert!(cells.iter().all(|cell| cell.iter().map(|offset| offset.abs()).max() == Some(ring)));
            cells.sort_unstable();
            cells.dedup();
            assert_eq!(cells.len(), count);
        }
    }
}
