//! Simplified replacements for the tree's boxes, each with an error.

use super::build::Packed;
use super::simplification::Simplification;
use super::tree::{Content, NO_BOX, Node, Tree};
use super::{Cluster, HOLED, ModelView, node_words};
use avln_geom::{Aabb, Point2, Point3};
use avln_scene::Mesh;

/// Errors, metres, ascending.
const ERRORS_M: [f32; 9] = [0.01, 0.014, 0.02, 0.028, 0.04, 0.056, 0.08, 0.112, 0.16];
/// Largest diagonal of a replaced box with several clusters, in errors.
const DIAGONAL: f32 = 96.0;
/// Largest share of triangles in a replacement.
const LARGEST_SHARE: f32 = 0.75;

/// Replacements of a model's geometry.
#[derive(Default)]
pub(crate) struct Replacements {
    nodes: Vec<[u32; 8]>,
    packed: Packed,
    /// By node of the model, plus an end: first entry in `list`.
    first: Vec<u32>,
    /// By node, with descending errors.
    list: Vec<Replacement>,
}

/// A replacement of everything in a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Replacement {
    /// Limit of the error of every collapse, metres.
    pub(crate) error_m: f32,
    /// Root in the replacement nodes; `None` if everything is smaller than the error.
    pub(crate) root: Option<u32>,
}

/// A box to be replaced, with clusters below.
struct Region {
    node: u32,
    clusters: Vec<u32>,
}

impl Region {
    fn triangle_count(&self, view: &ModelView) -> u32 {
        self.clusters.iter().map(|&cluster| view.clusters[cluster as usize][3] & 0xffff).sum()
    }
}

impl Replacements {
    /// Simplifies a model.
    #[tracing::instrument(level = "debug", name = "simplify_model", skip_all)]
    pub(crate) fn new(view: &ModelView) -> Self {
        let mut replacements = Self::default();
        let mut simplification = Simplification::new(mesh(view));
        let mut found: Vec<(u32, Replacement)> = Vec::new();
        for error_m in ERRORS_M {
            let regions = regions(view, DIAGONAL * error_m);
            let region_of = region_of(view, &regions);
            simplification.simplify(&surfaces_apart(view, &region_of), error_m);
            let mut members = vec![Vec::new(); regions.len()];
            for &triangle in &simplification.remaining {
                members[region_of[triangle as usize] as usize].push(triangle);
            }
            let boxes = boxes(&simplification.mesh);
            for (region, members) in regions.iter().zip(members) {
                if members.len() as f32 > LARGEST_SHARE * region.triangle_count(view) as f32 {
                    continue;
                }
                let root = replacements.add(view, &simplification.mesh, &boxes, members);
                found.push((region.node, Replacement { error_m, root }));
            }
        }
        found.sort_by(|(a, one), (b, other)| a.cmp(b).then(other.error_m.total_cmp(&one.error_m)));
        let before = |node: usize| found.partition_point(|(of, _)| (*of as usize) < node) as u32;
        replacements.first = (0..=view.nodes.len()).map(before).collect();
        replacements.list = found.into_iter().map(|(_, replacement)| replacement).collect();
        replacements
    }

    /// Returns a view with replaced geometry.
    pub(crate) fn view<'a>(&'a self, model: ModelView<'a>) -> ModelView<'a> {
        let Packed { clusters, coordinates, corners, triangles } = &self.packed;
        ModelView { nodes: &self.nodes, clusters, coordinates, corners, triangles, ..model }
    }

    /// Returns the coarsest replacement of a node with an error of at most `most_m`.
    #[inline(always)]
    pub(crate) fn of(&self, node: u32, most_m: f32) -> Option<Replacement> {
        let [first, end] = [0, 1].map(|next| self.first[node as usize + next] as usize);
        self.list[first..end].iter().find(|replacement| replacement.error_m <= most_m).copied()
    }

    /// Returns the size, bytes.
    pub(crate) fn byte_count(&self) -> usize {
        size_of_val(self.nodes.as_slice())
            + self.packed.byte_count()
            + size_of_val(self.first.as_slice())
            + size_of_val(self.list.as_slice())
    }

    /// Adds a tree with the triangles `members`; returns the root.
    fn add(&mut self, view: &ModelView, mesh: &Mesh, boxes: &[Aabb], members: Vec<u32>) -> Option<u32> {
        let tree = Tree::new(boxes, members);
        let (root, first_cluster) = (self.nodes.len() as u32, self.packed.clusters.len() as u32);
        for cluster in &tree.clusters {
            self.packed.add(mesh, cluster, |member| {
                let [corners, surface] = view.triangles[member as usize];
                (surface, corners & HOLED != 0)
            });
        }
        let moved = |Node { bounds, content }: &Node| {
            let content = match *content {
                Content::Pair(left) => Content::Pair(left + root),
                Content::Cluster(cluster) => Content::Cluster(cluster + first_cluster),
            };
            node_words(&Node { bounds: *bounds, content })
        };
        self.nodes.extend(tree.nodes.iter().map(moved));
        (!tree.nodes.is_empty()).then_some(root)
    }
}

/// Returns the triangles in cluster order; vertices are distinct and sorted by position.
fn mesh(view: &ModelView) -> Mesh {
    let mut corners = Vec::new();
    let mut triangles = Vec::with_capacity(view.triangles.len());
    for &cluster in view.clusters {
        let first = corners.len() as u32;
        let [_, _, first_triangle, counts] = cluster;
        corners.extend((0..(counts >> 16) as usize).map(|at| corner(view, cluster, at)));
        let count = (counts & 0xffff) as usize;
        for [word, _] in &view.triangles[first_triangle as usize..][..count] {
            let [a, b, c, _] = word.to_le_bytes();
            triangles.push([a, b, c].map(|at| first + u32::from(at)));
        }
    }
    let mut order: Vec<u32> = (0..corners.len() as u32).collect();
    order.sort_unstable_by_key(|&at| (corners[at as usize], at));
    let mut mesh = Mesh::default();
    let mut vertex_of = vec![0; corners.len()];
    let mut last = None;
    for at in order {
        let corner @ [x, y, z, u, v, rgb] = corners[at as usize];
        if last != Some(corner) {
            last = Some(corner);
            mesh.positions.push(Point3::from([x, y, z].map(f32::from_bits)));
            mesh.uvs.push(Point2::from([u, v].map(f32::from_bits)));
            let [r, g, b, _] = rgb.to_le_bytes();
            mesh.colors.push([r, g, b]);
        }
        vertex_of[at as usize] = mesh.positions.len() as u32 - 1;
    }
    mesh.triangles =
        triangles.into_iter().map(|corners| corners.map(|corner| vertex_of[corner as usize])).collect();
    mesh
}

/// Returns a corner's bits: position, texture coordinates, colour.
fn corner(view: &ModelView, [coordinate, first, _, counts]: Cluster, at: usize) -> [u32; 6] {
    let padded = ((counts >> 16) as usize).next_multiple_of(crate::lanes::LANES);
    // Adding 0 removes the sign of -0.
    let position =
        [0, 1, 2].map(|axis| (view.coordinates[coordinate as usize + axis * padded + at] + 0.0).to_bits());
    let [u, v, rgb] = view.corners[first as usize + at];
    [position[0], position[1], position[2], u, v, rgb]
}

/// Returns the largest boxes up to this diagonal, and larger ones of single clusters.
fn regions(view: &ModelView, diagonal_m: f32) -> Vec<Region> {
    let mut regions = Vec::new();
    let mut open = if view.nodes.is_empty() { Vec::new() } else { vec![0] };
    while let Some(node) = open.pop() {
        let [x0, y0, z0, x1, y1, z1, number, kind] = view.nodes[node as usize];
        let [min, max] = [[x0, y0, z0], [x1, y1, z1]].map(|corner| Point3::from(corner.map(f32::from_bits)));
        if kind == 1 || (max - min).norm() <= diagonal_m {
            regions.push(Region { node, clusters: clusters_below(view, node) });
        } else {
            open.extend([number + 1, number]);
        }
    }
    regions
}

fn clusters_below(view: &ModelView, node: u32) -> Vec<u32> {
    let (mut clusters, mut open) = (Vec::new(), vec![node]);
    while let Some(node) = open.pop() {
        let [.., number, kind] = view.nodes[node as usize];
        if kind == 1 {
            clusters.push(number);
        } else {
            open.extend([number + 1, number]);
        }
    }
    clusters
}

/// Returns the region by triangle.
fn region_of(view: &ModelView, regions: &[Region]) -> Vec<u32> {
    let mut region_of = vec![0; view.triangles.len()];
    for (number, region) in (0..).zip(regions) {
        for &cluster in &region.clusters {
            let [_, _, first, counts] = view.clusters[cluster as usize];
            region_of[first as usize..][..(counts & 0xffff) as usize].fill(number);
        }
    }
    region_of
}

/// Returns distinct numbers for pairs of region and surface.
fn surfaces_apart(view: &ModelView, region_of: &[u32]) -> Vec<u32> {
    let surfaces = view.surfaces.len() as u32;
    let pair =
        |(&region, [_, surface]): (&u32, &[u32; 2])| region.wrapping_mul(surfaces).wrapping_add(*surface);
    region_of.iter().zip(view.triangles).map(pair).collect()
}

fn boxes(mesh: &Mesh) -> Vec<Aabb> {
    let bounds = |triangle: &[u32; 3]| {
        triangle.iter().fold(NO_BOX, |all, &vertex| all.including(&mesh.positions[vertex as usize]))
    };
    mesh.triangles.iter().map(bounds).collect()
}
