//! parry's binary tree of boxes, laid out for walking: four boxes to a node, up to four triangles to a leaf.

use crate::convert::{glam_from_point, point_from_glam};
use crate::{Aabb, Point3};
use parry3d::{
    bounding_volume::Aabb as ParryAabb,
    partitioning::{Bvh, BvhBuildStrategy, BvhNode, TraversalAction},
};

/// Boxes of a node, and triangles of a leaf.
pub(super) const WIDTH: usize = 4;

/// Content of a node box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Child {
    /// Empty: an inverted box that no ray hits.
    Empty,
    /// Index into [`Tree::nodes`].
    Node(u32),
    /// Index into [`Tree::leaves`].
    Leaf(u32),
}

/// Four boxes in structure-of-arrays layout.
#[derive(Clone, Debug)]
pub(super) struct Node {
    /// Smallest corners: `[axis][box]`.
    pub(super) min: [[f32; WIDTH]; 3],
    /// Largest corners: `[axis][box]`.
    pub(super) max: [[f32; WIDTH]; 3],
    /// Content of every box.
    pub(super) children: [Child; WIDTH],
}

/// The tree; node 0 is the root. Empty without triangles.
#[derive(Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    /// Triangles of each leaf.
    pub(super) leaves: Vec<Vec<u32>>,
}

/// A node of the binary tree that parry built.
struct Binary {
    bounds: Aabb,
    /// Triangles below it.
    count: u32,
    content: Content,
}

enum Content {
    Triangle(u32),
    /// Index of the left child; the right child follows.
    Pair(usize),
}

impl Tree {
    /// The tree over triangles with these boxes.
    pub(super) fn new(boxes: &[Aabb]) -> Self {
        let binary = binary_tree(boxes);
        let mut tree = Self::default();
        if binary.is_empty() {
            return tree;
        }
        let mut open = vec![(0, 0)];
        tree.nodes.push(Node::empty());
        while let Some((node, top)) = open.pop() {
            for (slot, below) in opened(&binary, top).into_iter().enumerate() {
                let child = tree.child(&binary, below, &mut open);
                tree.nodes[node].set(slot, &binary[below].bounds, child);
            }
        }
        tree
    }

    /// Creates the child for the binary node `top`; boxes of new nodes are pushed to `open`.
    fn child(&mut self, binary: &[Binary], top: usize, open: &mut Vec<(usize, usize)>) -> Child {
        if binary[top].count as usize <= WIDTH {
            self.leaves.push(triangles_below(binary, top));
            return Child::Leaf(self.leaves.len() as u32 - 1);
        }
        self.nodes.push(Node::empty());
        open.push((self.nodes.len() - 1, top));
        Child::Node(self.nodes.len() as u32 - 1)
    }
}

impl Node {
    fn empty() -> Self {
        Self {
            min: [[f32::INFINITY; WIDTH]; 3],
            max: [[f32::NEG_INFINITY; WIDTH]; 3],
            children: [Child::Empty; WIDTH],
        }
    }

    fn set(&mut self, slot: usize, bounds: &Aabb, child: Child) {
        for axis in 0..3 {
            self.min[axis][slot] = bounds.min[axis];
            self.max[axis][slot] = bounds.max[axis];
        }
        self.children[slot] = child;
    }

    /// The box in `slot`.
    pub(super) fn bounds(&self, slot: usize) -> Aabb {
        let corner = |side: &[[f32; WIDTH]; 3]| Point3::new(side[0][slot], side[1][slot], side[2][slot]);
        Aabb { min: corner(&self.min), max: corner(&self.max) }
    }
}

/// Boxes that replace `top` in a wide node: the largest is expanded until there are four.
fn opened(binary: &[Binary], top: usize) -> Vec<usize> {
    let mut shown = vec![top];
    while shown.len() < WIDTH {
        let largest =
            (0..shown.len()).filter(|&at| binary[shown[at]].count as usize > WIDTH).max_by(|&a, &b| {
                half_area(&binary[shown[a]].bounds).total_cmp(&half_area(&binary[shown[b]].bounds))
            });
        let Some((at, &Content::Pair(left))) = largest.map(|at| (at, &binary[shown[at]].content)) else {
            break;
        };
        shown[at] = left;
        shown.insert(at + 1, left + 1);
    }
    shown
}

fn half_area(bounds: &Aabb) -> f32 {
    let size = bounds.size();
    size.x * size.y + size.y * size.z + size.z * size.x
}

fn triangles_below(binary: &[Binary], top: usize) -> Vec<u32> {
    let (mut found, mut open) = (Vec::new(), vec![top]);
    while let Some(at) = open.pop() {
        match binary[at].content {
            Content::Triangle(index) => found.push(index),
            Content::Pair(left) => open.extend([left + 1, left]),
        }
    }
    found
}

/// parry's tree over `boxes`; entry 0 is the root.
fn binary_tree(boxes: &[Aabb]) -> Vec<Binary> {
    let leaves: Vec<_> =
        boxes.iter().map(|b| ParryAabb::new(glam_from_point(&b.min), glam_from_point(&b.max))).collect();
    let bvh = Bvh::from_leaves(BvhBuildStrategy::Binned, &leaves);
    let mut copy = vec![Binary {
        bounds: Aabb::new(Point3::origin(), Point3::origin()),
        count: 0,
        content: Content::Pair(1),
    }];
    let mut parents = vec![0];
    bvh.traverse_indexed(None, |node, index| {
        let (_, is_right) = index.decompose();
        copy.push(Binary::copied(node));
        if is_right {
            adopt(&mut copy, &mut parents);
        }
        TraversalAction::Continue
    });
    match copy.len() {
        1 => Vec::new(),
        2 => copy.split_off(1),
        _ => {
            copy[0].bounds = copy[1].bounds.union(&copy[2].bounds);
            count(&mut copy);
            copy
        }
    }
}

/// Assigns the two newest entries to the waiting parent. parry traverses the left subtree before the right.
fn adopt(copy: &mut [Binary], parents: &mut Vec<usize>) {
    let left = copy.len() - 2;
    if let Some(parent) = parents.pop() {
        copy[parent].content = Content::Pair(left);
    }
    let waits = |&at: &usize| matches!(copy[at].content, Content::Pair(_));
    parents.extend([left + 1, left].into_iter().filter(waits));
}

/// Counts the triangles below each pair; children come after their parents.
fn count(copy: &mut [Binary]) {
    for at in (0..copy.len()).rev() {
        if let Content::Pair(left) = copy[at].content {
            copy[at].count = copy[left].count + copy[left + 1].count;
        }
    }
}

impl Binary {
    fn copied(node: &BvhNode) -> Self {
        let content = node.leaf_data().map_or(Content::Pair(0), Content::Triangle);
        let bounds = Aabb { min: point_from_glam(node.mins()), max: point_from_glam(node.maxs()) };
        Self { bounds, count: 1, content }
    }
}
