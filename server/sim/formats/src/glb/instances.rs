//! Which nodes form which instance.

use super::extras::{self, NodeExtras};
use super::{Model, ModelNode, names};
use crate::files::Checked;
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Surfaces, is_structure};
use avln_scene::{InstanceId, Lighting, Mesh, Object, Scene};
use std::collections::{BTreeMap, BTreeSet};

/// Pieces of one instance lie at most this far apart.
const PIECE_GAP_M: f32 = 0.05;

/// What a node says of its surfaces and of those below it.
#[derive(Clone, Copy)]
enum Claim<'a> {
    /// They form an instance.
    Instance(Identity<'a>),
    /// They belong to no instance.
    Structure,
}

/// How an instance is known.
#[derive(Clone, Copy)]
enum Identity<'a> {
    /// Our extras describe it.
    Marked(&'a NodeExtras),
    /// The node's name says its category.
    Named(&'static str),
}

/// An instance with its triangles.
struct Found<'a> {
    identity: Identity<'a>,
    name: &'a str,
    triangles: Vec<u32>,
    bounds: Aabb,
}

/// Makes the scene: finds the instances, numbers them and describes those that bring no description.
pub(super) fn scene(name: String, model: Model) -> Checked<Scene> {
    let Model { mut mesh, materials, textures, node_of, nodes, scene_extras } = model;
    let regions = extras::read_regions(&scene_extras)?;
    let found = merged(found(&mesh, &node_of, &nodes));
    let ids = numbers(&found)?;
    let surfaces = Surfaces { mesh: &mesh, materials: &materials, textures: &textures };
    let numbered = found.iter().zip(&ids);
    let mut objects: Vec<Object> =
        numbered.map(|(instance, &id)| object(instance, id, &surfaces, regions.len())).collect();
    objects.sort_by_key(|object| object.id);
    for (instance, &id) in found.iter().zip(&ids) {
        instance.triangles.iter().for_each(|&triangle| mesh.instance_of[triangle as usize] = id);
    }
    Ok(Scene { name, mesh, materials, textures, regions, objects, lighting: Lighting::Painted })
}

/// The instances in the order of their nodes.
fn found<'a>(mesh: &Mesh, node_of: &[u32], nodes: &'a [ModelNode]) -> Vec<Found<'a>> {
    let claims: Vec<Option<Claim<'a>>> = nodes.iter().map(claim).collect();
    let owners = owners(nodes, &claims);
    let mut triangles_of: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    for (triangle, &node) in node_of.iter().enumerate() {
        if let Some(owner) = owners[node as usize] {
            triangles_of.entry(owner).or_default().push(triangle as u32);
        }
    }
    let instance = |(node, claim): (usize, Option<Claim<'a>>)| {
        let Some(Claim::Instance(identity)) = claim else { return None };
        let triangles = triangles_of.remove(&node).unwrap_or_default();
        let bounds = Aabb::around(&corners(mesh, &triangles)).or_else(|| stored_bounds(identity))?;
        Some(Found { identity, name: &nodes[node].name, triangles, bounds })
    };
    claims.into_iter().enumerate().filter_map(instance).collect()
}

fn corners(mesh: &Mesh, triangles: &[u32]) -> Vec<Point3<f32>> {
    let corners = triangles.iter().flat_map(|&triangle| mesh.triangles[triangle as usize]);
    corners.map(|corner| mesh.positions[corner as usize]).collect()
}

fn stored_bounds(identity: Identity<'_>) -> Option<Aabb> {
    match identity {
        Identity::Marked(extras) => extras.bounds(),
        Identity::Named(_) => None,
    }
}

fn claim(node: &ModelNode) -> Option<Claim<'_>> {
    match &node.extras {
        Some(extras) if extras.instance == InstanceId::NONE.0 => Some(Claim::Structure),
        Some(extras) => Some(Claim::Instance(Identity::Marked(extras))),
        None => names::category(&node.name).map(|category| {
            if is_structure(category) { Claim::Structure } else { Claim::Instance(Identity::Named(category)) }
        }),
    }
}

/// For each node the nearest one that claims it: itself or an ancestor.
fn owners(nodes: &[ModelNode], claims: &[Option<Claim<'_>>]) -> Vec<Option<usize>> {
    let mut owners: Vec<Option<usize>> = Vec::with_capacity(nodes.len());
    for (index, node) in nodes.iter().enumerate() {
        let inherited = || node.parent.and_then(|parent| owners[parent]);
        let owner = if claims[index].is_some() { Some(index) } else { inherited() };
        owners.push(owner);
    }
    owners
}

/// Joins the pieces that an exporter numbered and that touch.
fn merged(found: Vec<Found<'_>>) -> Vec<Found<'_>> {
    let mut whole_instances: Vec<Found<'_>> = Vec::new();
    let mut known: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for piece in found {
        let whole =
            names::whole_of_piece(piece.name).filter(|_| matches!(piece.identity, Identity::Named(_)));
        let Some(whole) = whole else {
            whole_instances.push(piece);
            continue;
        };
        let candidates = known.entry(whole).or_default();
        let reach = piece.bounds.grown(PIECE_GAP_M);
        match candidates.iter().find(|&&index| whole_instances[index].bounds.intersects(&reach)) {
            Some(&index) => {
                let instance = &mut whole_instances[index];
                instance.triangles.extend(piece.triangles);
                instance.bounds = instance.bounds.union(&piece.bounds);
            }
            None => {
                candidates.push(whole_instances.len());
                whole_instances.push(piece);
            }
        }
    }
    whole_instances
}

/// A number for each instance: its own where it brings one that is free, else the next free one.
fn numbers(found: &[Found<'_>]) -> Checked<Vec<InstanceId>> {
    let mut taken = BTreeSet::new();
    let own: Vec<Option<u32>> = found
        .iter()
        .map(|instance| match instance.identity {
            Identity::Marked(extras) if taken.insert(extras.instance) => Some(extras.instance),
            _ => None,
        })
        .collect();
    let mut free = (1..=InstanceId::MAX).filter(|number| !taken.contains(number));
    let number = |own: Option<u32>| own.or_else(|| free.next()).map(InstanceId);
    let numbers: Option<Vec<InstanceId>> = own.into_iter().map(number).collect();
    numbers.ok_or_else(|| format!("it has more than {} instances; merge some of them", InstanceId::MAX))
}

fn object(instance: &Found<'_>, id: InstanceId, surfaces: &Surfaces<'_>, regions: usize) -> Object {
    let bounds = instance.bounds;
    match instance.identity {
        Identity::Marked(extras) => Object {
            id,
            category: extras.category.clone(),
            bounds,
            region: extras.region.filter(|&region| usize::from(region) < regions),
            attributes: extras.attributes(),
        },
        Identity::Named(category) => {
            let attributes = surfaces.attributes(&instance.triangles, &bounds);
            Object { id, category: category.to_owned(), bounds, region: None, attributes }
        }
    }
}
