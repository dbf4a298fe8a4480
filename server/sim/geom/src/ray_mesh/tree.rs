//! parry's binary box tree, widened to four boxes per node and four triangles per leaf, and its traversals
//! (docs/decisions/0003).

use super::{Hit, RayMesh, splat};
use crate::convert::{glam_from_point, point_from_glam};
use crate::{Aabb, Point3, Vector3};
use parry3d::{
    bounding_volume::Aabb as ParryAabb,
    partitioning::{Bvh, BvhBuildStrategy, TraversalAction},
};

/// Boxes per node, triangles per leaf.
pub(super) const WIDTH: usize = 4;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Child {
    /// An inverted box that no ray hits.
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
    pub(super) children: [Child; WIDTH],
}

/// The tree, empty without triangles; node 0 is the root.
#[derive(Default)]
pub(super) struct Tree {
    pub(super) nodes: Vec<Node>,
    /// Triangles per leaf.
    pub(super) leaves: Vec<Vec<u32>>,
}

/// A node in parry's binary tree.
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

    /// Creates the child for the binary node `top` and pushes new nodes to `open`.
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

    pub(super) fn bounds(&self, slot: usize) -> Aabb {
        let corner = |side: &[[f32; WIDTH]; 3]| Point3::new(side[0][slot], side[1][slot], side[2][slot]);
        Aabb { min: corner(&self.min), max: corner(&self.max) }
    }
}

/// Returns up to four boxes that replace `top` in a wide node.
fn opened(binary: &[Binary], top: usize) -> Vec<usize> {
    // Expanding the largest box first leaves the children about equally likely to be hit.
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
    let bounds = Aabb::new(Point3::origin(), Point3::origin());
    let mut copy = vec![Binary { bounds, count: 0, content: Content::Pair(1) }];
    let mut parents = vec![0];
    bvh.traverse_indexed(None, |node, index| {
        let (_, is_right) = index.decompose();
        let content = node.leaf_data().map_or(Content::Pair(0), Content::Triangle);
        let bounds = Aabb { min: point_from_glam(node.mins()), max: point_from_glam(node.maxs()) };
        copy.push(Binary { bounds, count: 1, content });
        // parry traverses the left subtree before the right, so a right child completes the pair of the
        // newest waiting parent.
        if is_right {
            let left = copy.len() - 2;
            if let Some(parent) = parents.pop() {
                copy[parent].content = Content::Pair(left);
            }
            let waits = |&at: &usize| matches!(copy[at].content, Content::Pair(_));
            parents.extend([left + 1, left].into_iter().filter(waits));
        }
        TraversalAction::Continue
    });
    // parry has no box around all: entry 0 is added for it, unless there are fewer than two triangles.
    if copy.len() < 3 {
        return copy.split_off(1);
    }
    copy[0].bounds = copy[1].bounds.union(&copy[2].bounds);
    // Children come after their parents, so a backward pass finds them counted.
    for at in (0..copy.len()).rev() {
        if let Content::Pair(left) = copy[at].content {
            copy[at].count = copy[left].count + copy[left + 1].count;
        }
    }
    copy
}

/// A traversal of mesh boxes; see [`RayMesh::visit`].
pub trait Visitor {
    /// Returns a box's sort key; smaller keys come first.
    fn distance(&self, bounds: &Aabb) -> f32;

    /// Returns true to enter a box.
    fn enters(&mut self, bounds: &Aabb) -> bool;

    /// Receives the index of a triangle in an entered box.
    fn triangle(&mut self, index: u32);
}

/// A ray with its components copied into four lanes.
struct Ray {
    origin: [[f32; WIDTH]; 3],
    direction: [[f32; WIDTH]; 3],
    inverse: [f32; 3],
}

/// Pending nodes with the ray's entry distances.
struct Stack {
    /// Sufficient unless the tree is badly degenerate.
    near: [(u32, f32); 48],
    len: usize,
    rest: Vec<(u32, f32)>,
}

impl Stack {
    fn new() -> Self {
        Self { near: [(0, 0.0); 48], len: 0, rest: Vec::new() }
    }

    #[inline]
    fn push(&mut self, entry: (u32, f32)) {
        match self.near.get_mut(self.len) {
            Some(slot) => {
                *slot = entry;
                self.len += 1;
            }
            None => self.rest.push(entry),
        }
    }

    #[inline]
    fn pop(&mut self) -> Option<(u32, f32)> {
        if let Some(entry) = self.rest.pop() {
            return Some(entry);
        }
        self.len = self.len.checked_sub(1)?;
        Some(self.near[self.len])
    }
}

impl Ray {
    fn new(origin: &Point3<f32>, direction: &Vector3<f32>) -> Self {
        // A finite reciprocal avoids 0 * infinity, which is not a number, for rays in a box face.
        const HUGE: f32 = 1e30;
        let inverse = |d: f32| if d.abs() < 1.0 / HUGE { HUGE.copysign(d) } else { 1.0 / d };
        let inverse = [inverse(direction.x), inverse(direction.y), inverse(direction.z)];
        Self { origin: splat(&origin.coords), direction: splat(direction), inverse }
    }

    /// Returns the ray's entry distances into a node's boxes; infinite for a miss or beyond `reach`.
    #[inline]
    fn enter(&self, node: &Node, reach: f32) -> [f32; WIDTH] {
        // Rounding can shorten the path through a box by three units in the last place (Ize 2013).
        const ROUNDING: f32 = 1.0 + 2.0 * f32::EPSILON;
        let (mut near, mut far) = ([0.0; WIDTH], [reach; WIDTH]);
        for axis in 0..3 {
            let inverse = self.inverse[axis];
            let (first, last) = if inverse < 0.0 { (&node.max, &node.min) } else { (&node.min, &node.max) };
            for i in 0..WIDTH {
                let enter = (first[axis][i] - self.origin[axis][i]) * inverse;
                let leave = (last[axis][i] - self.origin[axis][i]) * inverse * ROUNDING;
                near[i] = if enter > near[i] { enter } else { near[i] };
                far[i] = if leave < far[i] { leave } else { far[i] };
            }
        }
        std::array::from_fn(|i| if near[i] <= far[i] { near[i] } else { f32::INFINITY })
    }
}

impl RayMesh {
    /// Returns the first triangle within `max_distance` direction lengths.
    pub fn cast(&self, origin: &Point3<f32>, direction: &Vector3<f32>, max_distance: f32) -> Option<Hit> {
        let ray = Ray::new(origin, direction);
        let mut best = Hit { triangle: u32::MAX, distance: max_distance, barycentric: [0.0; 2] };
        let mut stack = Stack::new();
        let mut next = (!self.nodes.is_empty()).then_some((0, 0.0));
        while let Some((node, entered)) = next {
            // A nearer hit may have been found since the node was pushed.
            if entered <= best.distance {
                self.look_into(&ray, &self.nodes[node as usize], &mut best, &mut stack);
            }
            next = stack.pop();
        }
        (best.triangle != u32::MAX).then_some(best)
    }

    /// Tests a node's leaves and pushes its inner nodes, the nearest on top.
    #[inline]
    fn look_into(&self, ray: &Ray, node: &Node, best: &mut Hit, stack: &mut Stack) {
        let entered = ray.enter(node, best.distance);
        let bottom = stack.len;
        for (slot, &distance) in entered.iter().enumerate() {
            if distance == f32::INFINITY {
                continue;
            }
            match node.children[slot] {
                Child::Leaf(leaf) => {
                    let packet = &self.packets[leaf as usize];
                    let hits = packet.intersect(&ray.origin, &ray.direction);
                    for (lane, &triangle) in packet.triangles.iter().enumerate() {
                        let distance = hits.distance[lane];
                        if distance < best.distance {
                            *best = Hit { triangle, distance, barycentric: [hits.u[lane], hits.v[lane]] };
                        }
                    }
                }
                Child::Node(child) => push_sorted(stack, bottom, (child, distance)),
                Child::Empty => {}
            }
        }
    }

    /// Returns true for any hit within `reach` direction lengths.
    pub(super) fn is_hit(&self, origin: &Point3<f32>, direction: &Vector3<f32>, reach: f32) -> bool {
        let ray = Ray::new(origin, direction);
        let mut stack = Stack::new();
        let mut next = (!self.nodes.is_empty()).then_some(0);
        while let Some(node) = next {
            let node = &self.nodes[node as usize];
            for (slot, &distance) in ray.enter(node, reach).iter().enumerate() {
                match node.children[slot] {
                    _ if distance == f32::INFINITY => {}
                    Child::Leaf(leaf) => {
                        let hits = self.packets[leaf as usize].intersect(&ray.origin, &ray.direction);
                        if hits.distance.iter().any(|&distance| distance < reach) {
                            return true;
                        }
                    }
                    Child::Node(child) => stack.push((child, distance)),
                    Child::Empty => {}
                }
            }
            next = stack.pop().map(|(node, _)| node);
        }
        false
    }

    /// Traverses the boxes, near ones first; `visitor` receives the triangles in entered boxes.
    pub fn visit(&self, visitor: &mut impl Visitor) {
        let Some(root) = self.nodes.first() else { return };
        let mut open: Vec<(f32, Aabb, Child)> = Vec::with_capacity(64);
        push_children(root, visitor, &mut open);
        while let Some((_, bounds, child)) = open.pop() {
            if !visitor.enters(&bounds) {
                continue;
            }
            match child {
                Child::Node(node) => push_children(&self.nodes[node as usize], visitor, &mut open),
                Child::Leaf(leaf) => {
                    let packet = &self.packets[leaf as usize];
                    packet.triangles[..usize::from(packet.len)]
                        .iter()
                        .for_each(|&index| visitor.triangle(index));
                }
                Child::Empty => {}
            }
        }
    }
}

/// Pushes `entry` below the nearer entries above `bottom`.
#[inline]
fn push_sorted(stack: &mut Stack, bottom: usize, entry: (u32, f32)) {
    stack.push(entry);
    if stack.len == stack.near.len() {
        return;
    }
    let mut at = stack.len - 1;
    while at > bottom && stack.near[at - 1].1 < stack.near[at].1 {
        stack.near.swap(at - 1, at);
        at -= 1;
    }
}

/// Puts a node's children on `open`, the nearest last.
fn push_children(node: &Node, visitor: &impl Visitor, open: &mut Vec<(f32, Aabb, Child)>) {
    let bottom = open.len();
    for (slot, &child) in node.children.iter().enumerate().filter(|(_, child)| **child != Child::Empty) {
        let bounds = node.bounds(slot);
        open.push((visitor.distance(&bounds), bounds, child));
    }
    open[bottom..].sort_by(|a, b| b.0.total_cmp(&a.0));
}
