//! A scene from surfaces and a list of what is where.

use crate::{Report, bake};
use avln_geom::{Aabb, Point3};
use avln_scene::describe::{Meaning, Surfaces, meaning};
use avln_scene::{Attributes, InstanceId, Lighting, Material, Mesh, Object, Region, Scene, Texture};
use std::collections::BTreeMap;

/// Boxes of two meshes of the same building differ by less than this, metres.
const SAME_BUILDING_M: f32 = 1.0;

/// Surfaces in the world frame, without instances.
pub(crate) struct Surface {
    pub(crate) mesh: Mesh,
    pub(crate) materials: Vec<Material>,
    pub(crate) textures: Vec<Texture>,
}

/// A labelled thing.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Label {
    /// Its number, not 0.
    pub(crate) id: u32,
    /// Its category; `None` for a part of the building or what nobody named, which is no object.
    pub(crate) category: Option<String>,
    /// The more exact word, or nothing.
    pub(crate) noun: String,
    /// Index of its room.
    pub(crate) region: Option<u16>,
}

impl Label {
    /// What `words` call number `id`, in no room.
    pub(crate) fn of_words(id: u32, words: &str) -> Self {
        let (category, noun) = match meaning(words) {
            Meaning::Object { category, noun } => (Some(category), noun),
            Meaning::Structure | Meaning::Nothing => (None, String::new()),
        };
        Self { id, category, noun, region: None }
    }
}

/// The labels of the triangles of `render`, taken from `semantic`, whose triangles have `labels`.
pub(crate) fn carried(semantic: &Mesh, labels: &[u32], render: &Mesh, report: &mut Report) -> Vec<u32> {
    if let (Some(a), Some(b)) = (Aabb::around(&semantic.positions), Aabb::around(&render.positions)) {
        let apart = (a.min - b.min).abs().max().max((a.max - b.max).abs().max());
        if apart > SAME_BUILDING_M {
            report.warn(format!(
                "the labelled mesh and the one that is shown differ by {apart:.1} m in extent; check that both are of the same building and have the same axis up"
            ));
        }
    }
    bake::transfer(semantic, labels, render)
}

/// Joins surfaces and labels; `label_of` holds the number of each triangle's label, 0 for none. Things without a triangle are
/// left out with a warning.
pub(crate) fn scene(
    name: String,
    surface: Surface,
    label_of: &[u32],
    labels: &[Label],
    regions: Vec<Region>,
    report: &mut Report,
) -> Scene {
    let Surface { mut mesh, materials, textures } = surface;
    let triangles_of = triangles_of(label_of, labels, report);
    let surfaces = Surfaces { mesh: &mesh, materials: &materials, textures: &textures };
    let mut objects = Vec::new();
    let mut unseen = Vec::new();
    for (label, category) in labels.iter().filter_map(|label| Some((label, label.category.clone()?))) {
        let triangles = triangles_of.get(&label.id).map_or(&[][..], Vec::as_slice);
        let Some(bounds) = bounds(&mesh, triangles) else {
            unseen.push(label.id);
            continue;
        };
        let attributes = Attributes { noun: label.noun.clone(), ..surfaces.attributes(triangles, &bounds) };
        objects.push(Object { id: InstanceId(label.id), category, bounds, region: label.region, attributes });
    }
    if !unseen.is_empty() {
        report.warn(format!(
            "{} labelled things have no triangles and are left out (numbers {})",
            unseen.len(),
            some_of(&unseen)
        ));
    }
    objects.sort_by_key(|object| object.id);
    for object in &objects {
        triangles_of[&object.id.0]
            .iter()
            .for_each(|&triangle| mesh.instance_of[triangle as usize] = object.id);
    }
    Scene { name, mesh, materials, textures, regions, objects, lighting: Lighting::Painted }
}

/// The triangles of each label.
fn triangles_of(label_of: &[u32], labels: &[Label], report: &mut Report) -> BTreeMap<u32, Vec<u32>> {
    let mut triangles_of: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (triangle, &label) in label_of.iter().enumerate().filter(|(_, label)| **label != 0) {
        triangles_of.entry(label).or_default().push(triangle as u32);
    }
    let known: std::collections::BTreeSet<u32> = labels.iter().map(|label| label.id).collect();
    let strangers: Vec<u32> = triangles_of.keys().copied().filter(|id| !known.contains(id)).collect();
    if !strangers.is_empty() {
        report.warn(format!(
            "{} numbers on the mesh are in no table and belong to no object (numbers {})",
            strangers.len(),
            some_of(&strangers)
        ));
    }
    triangles_of
}

fn bounds(mesh: &Mesh, triangles: &[u32]) -> Option<Aabb> {
    let corners = triangles.iter().flat_map(|&triangle| mesh.triangles[triangle as usize]);
    let positions: Vec<Point3<f32>> = corners.map(|corner| mesh.positions[corner as usize]).collect();
    Aabb::around(&positions)
}

/// The first few numbers of a list.
fn some_of(numbers: &[u32]) -> String {
    const SHOWN: usize = 5;
    let shown: Vec<String> = numbers.iter().take(SHOWN).map(u32::to_string).collect();
    let more = if numbers.len() > SHOWN { " …" } else { "" };
    format!("{}{more}", shown.join(", "))
}
