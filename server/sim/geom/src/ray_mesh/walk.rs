//! Ways through the tree: the nearest hit of a ray, any hit of a ray, and a visitor's own way.

use super::packet::{PacketHits, splat};
use super::tree::{Child, Node, WIDTH};
use super::{Hit, RayMesh};
use crate::{Aabb, Point3, Vector3};

/// A traversal of mesh boxes; see [`RayMesh::visit`].
pub trait Visitor {
    /// Returns the sort key of a box: the smaller key comes first.
    fn distance(&self, bounds: &Aabb) -> f32;

    /// Returns true to enter a box.
    fn enters(&mut self, bounds: &Aabb) -> bool;

    /// Receives the index of a triangle in an entered box.
    fn triangle(&mut self, index: u32);
}

/// A ray, four times side by side.
struct Ray {
    origin: [[f32; WIDTH]; 3],
    direction: [[f32; WIDTH]; 3],
    /// Reciprocal of the direction; huge instead of infinite.
    inverse: [f32; 3],
}

/// Nodes that wait to be looked at, with the distance at which the ray enters them.
struct Stack {
    /// Sufficient for any tree that is not badly degenerate.
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
        const HUGE: f32 = 1e30;
        let inverse = |d: f32| if d.abs() < 1.0 / HUGE { HUGE.copysign(d) } else { 1.0 / d };
        let inverse = [inverse(direction.x), inverse(direction.y), inverse(direction.z)];
        Self { origin: splat(&origin.coords), direction: splat(direction), inverse }
    }

    /// Entry distances of the ray into the boxes of a node; infinite for a miss or beyond `reach`.
    #[inline]
    fn enter(&self, node: &Node, reach: f32) -> [f32; WIDTH] {
        // Rounding can shorten the way through a box by three units in the last place (Ize 2013).
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

/// The first hit within `reach` lengths of `direction`.
pub(super) fn nearest(
    mesh: &RayMesh,
    origin: &Point3<f32>,
    direction: &Vector3<f32>,
    reach: f32,
) -> Option<Hit> {
    let ray = Ray::new(origin, direction);
    let mut best = Hit { triangle: u32::MAX, distance: reach, barycentric: [0.0; 2] };
    let mut stack = Stack::new();
    let mut next = (!mesh.nodes.is_empty()).then_some((0, 0.0));
    while let Some((node, entered)) = next {
        if entered <= best.distance {
            look_into(mesh, &ray, &mesh.nodes[node as usize], &mut best, &mut stack);
        }
        next = stack.pop();
    }
    (best.triangle != u32::MAX).then_some(best)
}

/// Tests the leaves of `node` and pushes its inner nodes, the nearest on top.
#[inline]
fn look_into(mesh: &RayMesh, ray: &Ray, node: &Node, best: &mut Hit, stack: &mut Stack) {
    let entered = ray.enter(node, best.distance);
    let bottom = stack.len;
    for (slot, &distance) in entered.iter().enumerate() {
        if distance == f32::INFINITY {
            continue;
        }
        match node.children[slot] {
            Child::Leaf(leaf) => {
                let packet = &mesh.packets[leaf as usize];
                closest(&packet.intersect(&ray.origin, &ray.direction), &packet.triangles, best);
            }
            Child::Node(child) => push_sorted(stack, bottom, (child, distance)),
            Child::Empty => {}
        }
    }
}

/// Pushes `entry` below those entries above `bottom` that are nearer.
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

#[inline]
fn closest(hits: &PacketHits, triangles: &[u32; WIDTH], best: &mut Hit) {
    for (lane, &triangle) in triangles.iter().enumerate() {
        let distance = hits.distance[lane];
        if distance < best.distance {
            *best = Hit { triangle, distance, barycentric: [hits.u[lane], hits.v[lane]] };
        }
    }
}

/// Returns true for a hit within `reach` lengths of `direction`.
pub(super) fn any(mesh: &RayMesh, origin: &Point3<f32>, direction: &Vector3<f32>, reach: f32) -> bool {
    let ray = Ray::new(origin, direction);
    let mut stack = Stack::new();
    let mut next = (!mesh.nodes.is_empty()).then_some(0);
    while let Some(node) = next {
        let node = &mesh.nodes[node as usize];
        for (slot, &distance) in ray.enter(node, reach).iter().enumerate() {
            match node.children[slot] {
                _ if distance == f32::INFINITY => {}
                Child::Leaf(leaf) => {
                    let hits = mesh.packets[leaf as usize].intersect(&ray.origin, &ray.direction);
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

/// Shows `visitor` the boxes, near ones first, and the triangles of those that it enters.
pub(super) fn visit(mesh: &RayMesh, visitor: &mut impl Visitor) {
    let Some(root) = mesh.nodes.first() else { return };
    let mut open: Vec<(f32, Aabb, Child)> = Vec::with_capacity(64);
    push_children(root, visitor, &mut open);
    while let Some((_, bounds, child)) = open.pop() {
        if !visitor.enters(&bounds) {
            continue;
        }
        match child {
            Child::Node(node) => push_children(&mesh.nodes[node as usize], visitor, &mut open),
            Child::Leaf(leaf) => {
                let packet = &mesh.packets[leaf as usize];
                packet.triangles[..usize::from(packet.len)].iter().for_each(|&index| visitor.triangle(index));
            }
            Child::Empty => {}
        }
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
