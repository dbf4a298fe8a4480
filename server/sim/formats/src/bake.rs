//! Carries instance numbers from the semantic mesh to the render mesh.

use avln_geom::{Aabb, Point3};
use avln_scene::Mesh;

/// Centres of corresponding triangles lie at most this far apart, metres.
const SAME_TRIANGLE_M: f32 = 0.01;
/// Triangles of meshes in another order are the same where their centres lie at most this far apart, metres.
const TWIN_M: f32 = 0.0005;
/// A triangle takes its number from the semantic surface at most this far from its centre, metres.
const REACH_M: f32 = 0.5;
/// Edge of a search cell, metres, unless the scene would need more than [`MAX_CELLS`] of them.
const CELL_M: f32 = 0.25;
const MAX_CELLS: f32 = 4.0e6;
/// Semantic surfaces are looked up at points about this far apart, metres.
const SAMPLE_M: f32 = 0.2;
/// Points beyond one per triangle.
const MAX_EXTRA_SAMPLES: usize = 4_000_000;
const MAX_CUTS: usize = 64;

/// A number for each triangle of `render`: that of the same triangle of `semantic` where the meshes correspond in order or
/// a triangle has its centre in the same place, else that of the nearest semantic surface, else 0.
pub(crate) fn transfer(semantic: &Mesh, labels: &[u32], render: &Mesh) -> Vec<u32> {
    let from = centers(semantic);
    let to = centers(render);
    let same = from.len() == to.len() && from.iter().zip(&to).all(|(a, b)| (a - b).norm() <= SAME_TRIANGLE_M);
    if same {
        return labels.to_vec();
    }
    let (points, triangle_of) = samples(semantic);
    let (Some(surfaces), Some(wholes)) = (Grid::new(&points), Grid::new(&from)) else {
        return vec![0; to.len()];
    };
    let label = |center: &Point3<f32>| {
        let twin = wholes.nearest(center).filter(|&twin| (from[twin] - center).norm() <= TWIN_M);
        let triangle = twin.or_else(|| surfaces.nearest(center).map(|point| triangle_of[point] as usize));
        triangle.map_or(0, |triangle| labels[triangle])
    };
    to.iter().map(label).collect()
}

/// Points spread over the mesh, and the triangle of each.
fn samples(mesh: &Mesh) -> (Vec<Point3<f32>>, Vec<u32>) {
    let mut points = Vec::new();
    let mut triangle_of = Vec::new();
    let mut extra = MAX_EXTRA_SAMPLES;
    for (index, triangle) in mesh.triangles.iter().enumerate() {
        let corners = triangle.map(|corner| mesh.positions[corner as usize]);
        let cuts = cuts(&corners);
        let affordable = extra.checked_sub(cuts * cuts - 1);
        extra = affordable.unwrap_or(extra);
        add_samples(&corners, if affordable.is_some() { cuts } else { 1 }, &mut points);
        triangle_of.resize(points.len(), index as u32);
    }
    (points, triangle_of)
}

/// Into how many parts the edges are cut.
fn cuts([a, b, c]: &[Point3<f32>; 3]) -> usize {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    ((longest / SAMPLE_M).ceil() as usize).clamp(1, MAX_CUTS)
}

/// The centres of the `cuts²` equal triangles that parallels to the sides make.
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

/// Points in equal cells: those of cell `c` are `order[starts[c]..starts[c + 1]]`.
struct Grid<'a> {
    points: &'a [Point3<f32>],
    bounds: Aabb,
    cell_m: f32,
    cells: [i64; 3],
    starts: Vec<u32>,
    order: Vec<u32>,
}

impl<'a> Grid<'a> {
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

    /// The nearest point within [`REACH_M`], the first of equals.
    fn nearest(&self, to: &Point3<f32>) -> Option<usize> {
        let center = self.cell(to);
        let rings = (REACH_M / self.cell_m).ceil() as i64;
        let mut best: Option<(f32, u32)> = None;
        for ring in 0..=rings {
            // Whatever lies in this ring is at least this far away.
            let at_least = (ring - 1).max(0) as f32 * self.cell_m;
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

/// The cells whose largest offset from `center` along an axis is `ring`.
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
    fn the_grid_finds_what_a_full_search_finds() {
        let mut rng = Rng::new(7);
        let points = random_points(400, &mut rng);
        let grid = Grid::new(&points).unwrap();
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
    fn a_shell_holds_each_of_its_cells_once() {
        for (ring, count) in [(0, 1), (1, 26), (2, 98)] {
            let mut cells: Vec<[i64; 3]> = shell([0; 3], ring).collect();
            assert!(cells.iter().all(|cell| cell.iter().map(|offset| offset.abs()).max() == Some(ring)));
            cells.sort_unstable();
            cells.dedup();
            assert_eq!(cells.len(), count);
        }
    }
}
