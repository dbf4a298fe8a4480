//! Instances by node: by our own `extras.avln` in exported files, or by name, as `KitchenTable_01_002` is a kitchen table.

use crate::files::{Checked, ImportReport, malformed, scene_name};
use crate::world_frame::{FileFrame, ImportOptions, UpConvention, check_size};
use avln_geom::{Aabb, Point3};
use avln_scene::categories::mpcat40;
use avln_scene::describe::{Surfaces, is_structure};
use avln_scene::limits::MAX_WORD_CHARS;
use avln_scene::{
    Attributes, InstanceId, Lighting, Material, Mesh, Object, Region, Scene, SceneError, Texture,
};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Greatest distance between an instance's pieces.
const PIECE_GAP_M: f32 = 0.05;

/// A file's surfaces with named nodes, before instances are formed.
pub(crate) struct Model {
    /// All instances are [`InstanceId::NONE`](avln_scene::InstanceId::NONE).
    pub(crate) mesh: Mesh,
    pub(crate) materials: Vec<Material>,
    pub(crate) textures: Vec<Texture>,
    /// Index into `nodes` per triangle.
    pub(crate) node_of: Vec<u32>,
    /// Nodes, parents before children.
    pub(crate) nodes: Vec<ModelNode>,
    pub(crate) scene_extras: Value,
}

pub(crate) struct ModelNode {
    pub(crate) name: String,
    /// Index into [`Model::nodes`].
    pub(crate) parent: Option<usize>,
    pub(crate) extras: Option<NodeExtras>,
}

/// Role for the surfaces in a node and below.
#[derive(Clone, Copy)]
enum NodeClaim<'a> {
    Instance(InstanceIdentity<'a>),
    Structure,
}

#[derive(Clone, Copy)]
enum InstanceIdentity<'a> {
    /// Extras in an exported scene.
    Marked(&'a NodeExtras),
    /// The category in the node's name.
    Named(&'static str),
}

struct FoundInstance<'a> {
    identity: InstanceIdentity<'a>,
    name: &'a str,
    triangles: Vec<u32>,
    bounds: Aabb,
}

/// Moves the model of the file `path` to the world frame, checks its size, and converts it to a scene.
pub(crate) fn import_named_model(
    path: &Path,
    mut model: Model,
    options: &ImportOptions,
    convention: UpConvention,
    report: &mut ImportReport,
) -> Result<Scene, SceneError> {
    FileFrame::applied(&mut model.mesh, options, convention, report);
    check_size(&model.mesh, report)
        .and_then(|()| scene_of_named_model(scene_name(path), model))
        .map_err(|reason| malformed(path, reason))
}

/// Converts a model to a scene: finds and numbers the instances, and describes those without a description.
pub(crate) fn scene_of_named_model(name: String, model: Model) -> Checked<Scene> {
    let Model { mut mesh, materials, textures, node_of, nodes, scene_extras } = model;
    let regions = read_regions(&scene_extras)?;
    let found = merged(found(&mesh, &node_of, &nodes));
    let ids = numbers(&found)?;
    let surfaces = Surfaces { mesh: &mesh, materials: &materials, textures: &textures };
    let numbered = found.iter().zip(&ids);
    let mut objects: Vec<Object> =
        numbered.map(|(instance, &id)| object(instance, id, &surfaces, regions.len())).collect();
    objects.sort_by_key(|object| object.id);
    for (instance, &id) in found.iter().zip(&ids) {
        for &triangle in &instance.triangles {
            mesh.instance_of[triangle as usize] = id;
        }
    }
    Ok(Scene { name, mesh, materials, textures, regions, objects, lighting: Lighting::Painted })
}

fn found<'a>(mesh: &Mesh, node_of: &[u32], nodes: &'a [ModelNode]) -> Vec<FoundInstance<'a>> {
    let claims: Vec<Option<NodeClaim<'a>>> = nodes.iter().map(claim).collect();
    let owners = owners(nodes, &claims);
    let mut triangles_of: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    for (triangle, &node) in node_of.iter().enumerate() {
        if let Some(owner) = owners[node as usize] {
            triangles_of.entry(owner).or_default().push(triangle as u32);
        }
    }
    let instance = |(node, claim): (usize, Option<NodeClaim<'a>>)| {
        let Some(NodeClaim::Instance(identity)) = claim else { return None };
        let triangles = triangles_of.remove(&node).unwrap_or_default();
        let bounds = match identity {
            InstanceIdentity::Marked(extras) => bounds(mesh, &triangles).or_else(|| extras.bounds())?,
            InstanceIdentity::Named(_) => bounds(mesh, &triangles)?,
        };
        Some(FoundInstance { identity, name: &nodes[node].name, triangles, bounds })
    };
    claims.into_iter().enumerate().filter_map(instance).collect()
}

/// Returns the box around triangles; `None` if there are none.
pub(crate) fn bounds(mesh: &Mesh, triangles: &[u32]) -> Option<Aabb> {
    let corners = triangles.iter().flat_map(|&triangle| &mesh.triangles[triangle as usize]);
    Aabb::around(corners.map(|&corner| &mesh.positions[corner as usize]))
}

fn claim(node: &ModelNode) -> Option<NodeClaim<'_>> {
    match &node.extras {
        Some(extras) if extras.instance == InstanceId::NONE.0 => Some(NodeClaim::Structure),
        Some(extras) => Some(NodeClaim::Instance(InstanceIdentity::Marked(extras))),
        None => match category_of_name(&node.name)? {
            category if is_structure(category) => Some(NodeClaim::Structure),
            category => Some(NodeClaim::Instance(InstanceIdentity::Named(category))),
        },
    }
}

/// The nearest node with a claim per node: the node itself, or an ancestor.
fn owners(nodes: &[ModelNode], claims: &[Option<NodeClaim<'_>>]) -> Vec<Option<usize>> {
    // Parents are before children, so that a single pass finds the owner of every ancestor first.
    let mut owners: Vec<Option<usize>> = Vec::with_capacity(nodes.len());
    for (index, node) in nodes.iter().enumerate() {
        let inherited = || node.parent.and_then(|parent| owners[parent]);
        let owner = if claims[index].is_some() { Some(index) } else { inherited() };
        owners.push(owner);
    }
    owners
}

/// Joins touching pieces that an exporter has numbered.
fn merged(found: Vec<FoundInstance<'_>>) -> Vec<FoundInstance<'_>> {
    let mut whole_instances: Vec<FoundInstance<'_>> = Vec::new();
    let mut known: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for piece in found {
        let whole =
            whole_of_piece(piece.name).filter(|_| matches!(piece.identity, InstanceIdentity::Named(_)));
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

/// Numbers per instance: the number in the extras if it is free, or the next free number.
fn numbers(found: &[FoundInstance<'_>]) -> Checked<Vec<InstanceId>> {
    let mut taken = BTreeSet::new();
    let own: Vec<Option<u32>> = found
        .iter()
        .map(|instance| match instance.identity {
            // Own numbers are reserved first: free numbers must not take the number of a later instance.
            InstanceIdentity::Marked(extras) if taken.insert(extras.instance) => Some(extras.instance),
            _ => None,
        })
        .collect();
    let mut free = (1..=InstanceId::MAX).filter(|number| !taken.contains(number));
    let number = |own: Option<u32>| own.or_else(|| free.next()).map(InstanceId);
    let numbers: Option<Vec<InstanceId>> = own.into_iter().map(number).collect();
    numbers.ok_or_else(|| format!("it has more than {} instances; merge some of them", InstanceId::MAX))
}

fn object(instance: &FoundInstance<'_>, id: InstanceId, surfaces: &Surfaces<'_>, regions: usize) -> Object {
    let bounds = instance.bounds;
    match instance.identity {
        InstanceIdentity::Marked(extras) => Object {
            id,
            category: extras.category.clone(),
            bounds,
            region: extras.region.filter(|&region| usize::from(region) < regions),
            attributes: extras.attributes(),
        },
        InstanceIdentity::Named(category) => {
            let attributes = surfaces.attributes(&instance.triangles, &bounds);
            Object { id, category: category.to_owned(), bounds, region: None, attributes }
        }
    }
}

/// Returns the mpcat40 category in a node's name; numbers and a variant letter at the end are ignored.
pub(crate) fn category_of_name(name: &str) -> Option<&'static str> {
    let phrase = phrase(name);
    if phrase.is_empty() {
        return None;
    }
    mpcat40(&phrase).or_else(|| {
        let (rest, variant) = phrase.rsplit_once(' ')?;
        if variant.chars().count() == 1 { mpcat40(rest) } else { None }
    })
}

/// The whole's name for a numbered piece: `Bed_01_001_2` belongs to `Bed_01_001`, but `chair_2` is no piece.
pub(crate) fn whole_of_piece(name: &str) -> Option<&str> {
    let whole = without_number(name)?;
    without_number(whole).map(|_| whole)
}

fn without_number(name: &str) -> Option<&str> {
    let (rest, number) = name.rsplit_once(['_', '.'])?;
    let is_number = !number.is_empty() && number.bytes().all(|digit| digit.is_ascii_digit());
    is_number.then_some(rest)
}

/// `KitchenTable_01.002` as `kitchen table`, `TVCabinet` as `tv cabinet`.
fn phrase(name: &str) -> String {
    let trimmed = name.trim_end_matches(|letter: char| letter.is_ascii_digit() || "_-. ".contains(letter));
    let letters: Vec<char> = trimmed.chars().collect();
    let mut phrase = String::new();
    for (index, &letter) in letters.iter().enumerate() {
        let before = index.checked_sub(1).map_or(' ', |before| letters[before]);
        let is_followed_by_small = letters.get(index + 1).is_some_and(|next| next.is_lowercase());
        let ends_acronym = before.is_uppercase() && is_followed_by_small;
        if letter.is_uppercase() && (before.is_lowercase() || before.is_ascii_digit() || ends_acronym) {
            phrase.push(' ');
        }
        let shown = if "_-.".contains(letter) { ' ' } else { letter };
        phrase.extend(shown.to_lowercase());
    }
    phrase.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Key in the `extras` of nodes and scenes.
const KEY: &str = "avln";

/// A node's instance; number 0 marks structure.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct NodeExtras {
    pub(crate) instance: u32,
    pub(crate) category: String,
    pub(crate) region: Option<u16>,
    noun: String,
    color: String,
    material: String,
    size: String,
    shape: String,
    min: [f32; 3],
    max: [f32; 3],
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct SceneExtras {
    regions: Vec<RegionExtras>,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct RegionExtras {
    label: String,
    storey: u16,
    min: [f32; 3],
    max: [f32; 3],
}

impl NodeExtras {
    /// Reads the node's `extras`; `None` if another program wrote them.
    pub(crate) fn read(extras: &Value, name: &str) -> Checked<Option<Self>> {
        let Some(ours) = extras.get(KEY) else { return Ok(None) };
        let fail = |reason: &str| format!("extras.{KEY} of node {name:?} {reason}; correct or remove it");
        let read = Self::deserialize(ours).map_err(|error| fail(&format!("cannot be read ({error})")))?;
        let words = [&read.category, &read.noun, &read.color, &read.material, &read.size, &read.shape];
        let is_bad =
            |word: &&String| word.chars().count() > MAX_WORD_CHARS || word.chars().any(char::is_control);
        if words.iter().any(is_bad) {
            return Err(fail(&format!(
                "contains a word of more than {MAX_WORD_CHARS} characters or with control characters"
            )));
        }
        let (instance, largest) = (read.instance, InstanceId::MAX);
        if instance > largest {
            return Err(fail(&format!("names instance {instance}; the largest number is {largest}")));
        }
        if instance != 0 && read.category.trim().is_empty() {
            return Err(fail("names an instance without a category"));
        }
        Ok(Some(read))
    }

    pub(crate) fn attributes(&self) -> Attributes {
        Attributes {
            noun: self.noun.clone(),
            color: self.color.clone(),
            material: self.material.clone(),
            size: self.size.clone(),
            shape: self.shape.clone(),
        }
    }

    /// Returns the stored box, for an instance without surfaces.
    pub(crate) fn bounds(&self) -> Option<Aabb> {
        finite_box(self.min, self.max)
    }
}

pub(crate) fn object_extras(object: &Object) -> Value {
    let Attributes { noun, color, material, size, shape } = object.attributes.clone();
    json!({ KEY: NodeExtras {
        instance: object.id.0,
        category: object.category.clone(),
        region: object.region,
        noun,
        color,
        material,
        size,
        shape,
        min: object.bounds.min.into(),
        max: object.bounds.max.into(),
    } })
}

pub(crate) fn structure_extras() -> Value {
    json!({ KEY: { "instance": InstanceId::NONE.0 } })
}

pub(crate) fn scene_extras(regions: &[Region]) -> Value {
    let region = |region: &Region| RegionExtras {
        label: region.label.clone(),
        storey: region.storey,
        min: region.bounds.min.into(),
        max: region.bounds.max.into(),
    };
    json!({ KEY: SceneExtras { regions: regions.iter().map(region).collect() } })
}

/// Reads the regions in a scene's `extras`; none if another program wrote them.
fn read_regions(extras: &Value) -> Checked<Vec<Region>> {
    let Some(ours) = extras.get(KEY) else { return Ok(Vec::new()) };
    let fail = |reason: &str| format!("extras.{KEY} of its scene {reason}; correct or remove it");
    let read = SceneExtras::deserialize(ours).map_err(|error| fail(&format!("cannot be read ({error})")))?;
    if read.regions.len() > usize::from(u16::MAX) {
        return Err(fail("lists more than 65535 regions"));
    }
    let region = |region: RegionExtras| {
        let bounds =
            finite_box(region.min, region.max).ok_or_else(|| fail("has a region without a finite box"))?;
        let label = region.label.chars().take(MAX_WORD_CHARS).collect();
        Ok(Region { label, bounds, storey: region.storey })
    };
    read.regions.into_iter().map(region).collect()
}

fn finite_box(min: [f32; 3], max: [f32; 3]) -> Option<Aabb> {
    let finite = min.iter().chain(&max).all(|coordinate| coordinate.is_finite());
    finite.then(|| Aabb::new(Point3::from(min), Point3::from(max)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_common_exporters_have_categories() {
        for (name, expected) in [
            ("chair_3", Some("chair")),
            ("KitchenTable_01_001_26", Some("table")),
            ("SofaC_01_001_89", Some("sofa")),
            ("bed.002", Some("bed")),
            ("TVCabinet_01_001", Some("cabinet")),
            ("TV_01_001", Some("tv_monitor")),
            ("CookingBench_01_001_3", Some("counter")),
            ("AirconditionerA_01_001", Some("appliances")),
            ("HouseWallB_01_001_36", Some("wall")),
            ("mesh2057757694", None),
            ("", None),
            ("_01", None),
        ] {
            assert_eq!(category_of_name(name), expected, "{name}");
        }
    }

    #[test]
    fn only_doubly_numbered_names_are_pieces() {
        assert_eq!(whole_of_piece("Bed_01_001_2"), Some("Bed_01_001"));
        assert_eq!(whole_of_piece("PortraitA_01_44"), Some("PortraitA_01"));
        assert_eq!(whole_of_piece("chair_2"), None);
        assert_eq!(whole_of_piece("chair"), None);
    }
}
