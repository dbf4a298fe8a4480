//! A binary box tree with clusters of up to 64 triangles as leaves.

use avln_geom::{Aabb, Point3};

/// Triangle limit of a cluster.
pub(crate) const CLUSTER: usize = 64;

/// Split candidates per axis.
const BINS: usize = 16;

/// Cost of entering a cluster, in triangles.
const CLUSTER_COST: usize = 24;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Node {
    pub(crate) bounds: Aabb,
    pub(crate) content: Content,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Content {
    /// Left child; the right child follows.
    Pair(u32),
    /// Cluster index.
    Cluster(u32),
}

/// A box tree; node 0 is the root. Empty without triangles.
#[derive(Debug, Default)]
pub(crate) struct Tree {
    pub(crate) nodes: Vec<Node>,
    /// One to [`CLUSTER`] triangles each.
    pub(crate) clusters: Vec<Vec<u32>>,
}

/// Triangles below a node.
struct Open {
    node: usize,
    first: usize,
    end: usize,
}

/// A split: triangles with centres in bins below `bin` go left.
struct Split {
    axis: usize,
    bin: usize,
    cost: f32,
}

#[derive(Clone, Copy)]
struct Bin {
    bounds: Aabb,
    count: usize,
}

pub(super) const NO_BOX: Aabb = Aabb {
    min: Point3::new(f32::INFINITY, f32::INFINITY, f32::INFINITY),
    max: Point3::new(f32::NEG_INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY),
};

impl Tree {
    /// Builds the tree over the triangles `members` with finite bounds `boxes[member]`.
    pub(crate) fn new(boxes: &[Aabb], mut members: Vec<u32>) -> Self {
        let mut tree = Self::default();
        if members.is_empty() {
            return tree;
        }
        tree.nodes.push(Node { bounds: NO_BOX, content: Content::Pair(0) });
        let mut open = vec![Open { node: 0, first: 0, end: members.len() }];
        while let Some(top) = open.pop() {
            let range = &mut members[top.first..top.end];
            tree.nodes[top.node].bounds = around(boxes, range);
            match divide(boxes, range) {
                None => {
                    tree.nodes[top.node].content = Content::Cluster(tree.clusters.len() as u32);
                    tree.clusters.push(range.to_vec());
                }
                Some(left_count) => {
                    let left = tree.nodes.len();
                    tree.nodes[top.node].content = Content::Pair(left as u32);
                    tree.nodes.extend([tree.nodes[top.node]; 2]);
                    let middle = top.first + left_count;
                    open.push(Open { node: left + 1, first: middle, end: top.end });
                    open.push(Open { node: left, first: top.first, end: middle });
                }
            }
        }
        tree
    }
}

/// Partitions the triangles; returns the left count. `None` if they fit into a cluster.
fn divide(boxes: &[Aabb], members: &mut [u32]) -> Option<usize> {
    if members.len() <= CLUSTER {
        return None;
    }
    let centers = members.iter().fold(NO_BOX, |all, &m| all.including(&doubled_center(&boxes[m as usize])));
    Some(match best_split(boxes, members, &centers) {
        Some(split) => partition(members, |m| bin_of(&boxes[m as usize], &centers, split.axis) < split.bin),
        None => members.len() / 2,
    })
}

/// Returns the cheapest split by the surface area heuristic; `None` if all centres coincide.
fn best_split(boxes: &[Aabb], members: &[u32], centers: &Aabb) -> Option<Split> {
    let mut best: Option<Split> = None;
    for axis in (0..3).filter(|&axis| centers.max[axis] > centers.min[axis]) {
        let mut bins = [Bin { bounds: NO_BOX, count: 0 }; BINS];
        for &member in members {
            let bounds = &boxes[member as usize];
            let bin = &mut bins[bin_of(bounds, centers, axis)];
            bin.bounds = joined(&bin.bounds, bounds);
            bin.count += 1;
        }
        let found = cheapest_cut(&bins, axis);
        if found.cost < best.as_ref().map_or(f32::INFINITY, |best| best.cost) {
            best = Some(found);
        }
    }
    best
}

fn cheapest_cut(bins: &[Bin; BINS], axis: usize) -> Split {
    let mut right_cost = [0.0; BINS];
    let mut right = Bin { bounds: NO_BOX, count: 0 };
    for bin in (1..BINS).rev() {
        right =
            Bin { bounds: joined(&right.bounds, &bins[bin].bounds), count: right.count + bins[bin].count };
        right_cost[bin] = right.cost();
    }
    let mut best = Split { axis, bin: BINS / 2, cost: f32::INFINITY };
    let mut left = Bin { bounds: NO_BOX, count: 0 };
    for bin in 1..BINS {
        left = Bin {
            bounds: joined(&left.bounds, &bins[bin - 1].bounds),
            count: left.count + bins[bin - 1].count,
        };
        let cost = left.cost() + right_cost[bin];
        if cost < best.cost {
            best = Split { axis, bin, cost };
        }
    }
    best
}

impl Bin {
    fn cost(&self) -> f32 {
        if self.count == 0 { f32::INFINITY } else { half_area(&self.bounds) * cost(self.count) }
    }
}

/// Drawing cost, in triangles.
fn cost(count: usize) -> f32 {
    (count + CLUSTER_COST * count.div_ceil(CLUSTER)) as f32
}

/// Returns the bin of a box centre.
#[inline]
fn bin_of(bounds: &Aabb, centers: &Aabb, axis: usize) -> usize {
    let scale = BINS as f32 / (centers.max[axis] - centers.min[axis]);
    let offset = bounds.min[axis] + bounds.max[axis] - centers.min[axis];
    ((offset * scale) as usize).min(BINS - 1)
}

fn doubled_center(bounds: &Aabb) -> Point3<f32> {
    bounds.min + bounds.max.coords
}

/// Moves members with `to_left` to the front; returns their count.
fn partition(members: &mut [u32], to_left: impl Fn(u32) -> bool) -> usize {
    let mut front = 0;
    for at in 0..members.len() {
        if to_left(members[at]) {
            members.swap(front, at);
            front += 1;
        }
    }
    front
}

fn around(boxes: &[Aabb], members: &[u32]) -> Aabb {
    members.iter().fold(NO_BOX, |all, &member| joined(&all, &boxes[member as usize]))
}

#[inline]
fn joined(a: &Aabb, b: &Aabb) -> Aabb {
    let (mut min, mut max) = (a.min, a.max);
    for axis in 0..3 {
        min[axis] = if b.min[axis] < min[axis] { b.min[axis] } else { min[axis] };
        max[axis] = if b.max[axis] > max[axis] { b.max[axis] } else { max[axis] };
    }
    Aabb { min, max }
}

fn half_area(bounds: &Aabb) -> f32 {
    let size = bounds.max - bounds.min;
    size.x * size.y + size.y * size.z + size.z * size.x
}

#[cfg(test)]
mod tests {
    use super::*;
    use avln_geom::{Rng, Vector3};

    fn random_boxes(count: usize) -> Vec<Aabb> {
        let mut rng = Rng::new(3);
        let mut vector = |reach: f32| Vector3::from_fn(|_, _| rng.range(0.0, reach));
        (0..count)
            .map(|_| {
                let corner = Point3::from(vector(10.0));
                Aabb { min: corner, max: corner + vector(0.3) }
            })
            .collect()
    }

    #[test]
    fn clusters_partition_the_triangles_inside_all_parent_boxes() {
        for count in [1, 2, 63, 64, 65, 700, 5000] {
            let boxes = random_boxes(count);
            let tree = Tree::new(&boxes, (0..count as u32).collect());
            let mut seen = vec![0; count];
            let mut open = vec![(0_usize, tree.nodes[0].bounds)];
            while let Some((at, above)) = open.pop() {
                let Node { bounds, content } = tree.nodes[at];
                assert_eq!(joined(&above, &bounds), above);
                match content {
                    Content::Pair(left) => {
                        open.extend([(left as usize, bounds), (left as usize + 1, bounds)])
                    }
                    Content::Cluster(cluster) => {
                        let members = &tree.clusters[cluster as usize];
                        assert!((1..=CLUSTER).contains(&members.len()));
                        for &member in members {
                            assert_eq!(joined(&bounds, &boxes[member as usize]), bounds);
                            seen[member as usize] += 1;
                        }
                    }
                }
            }
            assert!(seen.iter().all(|&times| times == 1), "{count}");
        }
    }

    #[test]
    fn coinciding_boxes_are_divided_too() {
        let one = Aabb { min: Point3::origin(), max: Point3::new(1.0, 0.0, 0.0) };
        let tree = Tree::new(&[one; 300], (0..300).collect());
        assert_eq!(tree.clusters.iter().map(Vec::len).sum::<usize>(), 300);
        assert!(tree.clusters.len() <= 8, "{}", tree.clusters.len());
        assert!(Tree::new(&[], Vec::new()).nodes.is_empty());
    }
}
