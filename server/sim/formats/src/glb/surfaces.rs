//! Nodes, meshes and primitives as a triangle mesh in the world frame; materials and textures, read at the first use by a
//! surface.

use crate::files::{Checked, ImportReport, refuse_if, too_many};
use crate::glb::document::{
    MaterialEntry, PlacedNode, Primitive, TextureTransform, TextureUse, missing, placed_nodes,
};
use crate::glb::source::{DRACO, Elements, PrimitiveVertices, Source, is_absent, load, unpack_draco};
use crate::images;
use crate::named_model::{Model, ModelNode, NodeExtras};
use avln_geom::{Point2, Point3};
use avln_scene::colors::code_of;
use avln_scene::limits::{MAX_FILE_BYTES, MAX_TEXELS, MAX_TRIANGLES, MAX_VERTICES};
use avln_scene::{InstanceId, Material, Mesh, Texture};
use nalgebra::Matrix4;
use std::{borrow::Cow, collections::BTreeMap};

const TRIANGLES: u32 = 4;
const TRIANGLE_STRIP: u32 = 5;
const TRIANGLE_FAN: u32 = 6;
/// Texture coordinate limit: beyond it, precision is too low for a position inside a texel.
const MAX_UV: f32 = 1.0e5;
/// Primitives in all nodes together.
const MAX_PRIMITIVES: usize = 1 << 20;
/// Supported extensions, and extensions without an effect on surfaces.
const UNDERSTOOD: [&str; 7] = [
    DRACO,
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    "KHR_lights_punctual",
    "GOOGLE_texture_basis",
    "KHR_texture_basisu",
    "EXT_texture_webp",
];

pub(super) fn model(source: &Source<'_>, report: &mut ImportReport) -> Checked<Model> {
    check_extensions(&source.document.extensions_required)?;
    let placed = placed_nodes(&source.document)?;
    let (default, scenes) = (source.document.scene, &source.document.scenes);
    if default.is_none() && scenes.len() > 1 {
        report.warn(format!("it has {} scenes and no default; the first is read", scenes.len()));
    }
    let mut builder = MeshBuilder::new(source, report);
    for (number, place) in placed.iter().enumerate() {
        builder.add_node(number as u32, place)?;
    }
    let scene = scenes.get(default.unwrap_or(0));
    Ok(Model {
        mesh: builder.mesh,
        materials: builder.palette.materials,
        textures: builder.palette.textures,
        node_of: builder.node_of,
        nodes: nodes(source, &placed)?,
        scene_extras: scene.map(|scene| scene.extras.clone()).unwrap_or_default(),
    })
}

fn check_extensions(required: &[String]) -> Checked<()> {
    let understood = |name: &str| name.starts_with("KHR_materials_") || UNDERSTOOD.contains(&name);
    match required.iter().find(|name| !understood(name)) {
        Some(name) => Err(format!(
            "it needs the glTF extension {name:?}, which is not supported; export it without (for example uncompressed)"
        )),
        None => Ok(()),
    }
}

fn nodes(source: &Source<'_>, placed: &[PlacedNode]) -> Checked<Vec<ModelNode>> {
    let node = |place: &PlacedNode| {
        let entry = &source.document.nodes[place.node];
        let extras = NodeExtras::read(&entry.extras, &entry.name)?;
        Ok(ModelNode { name: entry.name.clone(), parent: place.parent, extras })
    };
    placed.iter().map(node).collect()
}

struct MeshBuilder<'a, 'r> {
    source: &'a Source<'a>,
    palette: Palette<'a, 'r>,
    mesh: Mesh,
    node_of: Vec<u32>,
    /// Remaining budgets, counted for all primitives.
    vertices_left: usize,
    corners_left: usize,
    primitives_left: usize,
}

impl<'a, 'r> MeshBuilder<'a, 'r> {
    fn new(source: &'a Source<'a>, report: &'r mut ImportReport) -> Self {
        Self {
            source,
            palette: Palette::new(source, report),
            mesh: Mesh::default(),
            node_of: Vec::new(),
            vertices_left: MAX_VERTICES,
            corners_left: 3 * MAX_TRIANGLES,
            primitives_left: MAX_PRIMITIVES,
        }
    }

    fn add_node(&mut self, number: u32, place: &PlacedNode) -> Checked<()> {
        let Some(index) = self.source.document.nodes[place.node].mesh else { return Ok(()) };
        let mesh = self.source.document.meshes.get(index).ok_or_else(|| missing("mesh", index))?;
        for primitive in &mesh.primitives {
            self.add_primitive(primitive, &place.world_from_node)?;
        }
        self.node_of.resize(self.mesh.triangles.len(), number);
        Ok(())
    }

    /// Adds a primitive's triangles; points and lines are no surfaces and are left out.
    fn add_primitive(&mut self, primitive: &Primitive, world_from_node: &Matrix4<f64>) -> Checked<()> {
        self.primitives_left = self.primitives_left.checked_sub(1).ok_or_else(|| {
            format!("its nodes have more than {MAX_PRIMITIVES} primitives; join its meshes")
        })?;
        let mode = primitive.mode.unwrap_or(TRIANGLES);
        if !(TRIANGLES..=TRIANGLE_FAN).contains(&mode) {
            return Ok(());
        }
        let (corners, mut triangles) = self.unpacked(primitive, mode)?;
        refuse_if(
            triangles.iter().flatten().any(|&corner| corner as usize >= corners.positions.len()),
            || "a triangle refers to a vertex that does not exist; export the file again".into(),
        )?;
        refuse_if(self.mesh.triangles.len() + triangles.len() > MAX_TRIANGLES, || {
            too_many(MAX_TRIANGLES, "triangles")
        })?;
        if world_from_node.fixed_view::<3, 3>(0, 0).determinant() < 0.0 {
            triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
        }
        let material = self.palette.material(primitive.material)?;
        self.append_vertices(&corners, &mut triangles, world_from_node)?;
        let total = self.mesh.triangles.len() + triangles.len();
        self.mesh.triangles.append(&mut triangles);
        self.mesh.material_of.resize(total, material);
        self.mesh.instance_of.resize(total, InstanceId::NONE);
        Ok(())
    }

    fn unpacked(&mut self, primitive: &Primitive, mode: u32) -> Checked<(PrimitiveVertices, Vec<[u32; 3]>)> {
        let packed = primitive.extensions.iter().find(|(name, _)| name.ends_with("_compression"));
        let used = self.palette.texture_use(primitive.material)?;
        let set = used.map_or(0, |used| used.coordinate_set());
        let (mut corners, order) = match packed {
            Some((name, packed)) if name == DRACO => unpack_draco(self.source, primitive, packed, set)?,
            Some((name, _)) => {
                return Err(format!(
                    "its meshes are packed with {name:?}, which is not supported; export it uncompressed"
                ));
            }
            None => {
                let corners = self.corners(primitive, set)?;
                let order = match primitive.indices {
                    Some(index) => Elements::find(self.source, index)?.indices()?,
                    None => (0..corners.positions.len() as u32).collect(),
                };
                (corners, order)
            }
        };
        // Nodes can share a mesh: its corners count for every node, because each use is copied into the scene.
        self.corners_left =
            self.corners_left.checked_sub(order.len()).ok_or_else(|| too_many(MAX_TRIANGLES, "triangles"))?;
        if let (Some(uvs), Some(transform)) = (&mut corners.uvs, used.and_then(|used| used.transform())) {
            transform_uvs(uvs, &transform);
        }
        let mode = if packed.is_some() { TRIANGLES } else { mode };
        Ok((corners, triangles(&order, mode)?))
    }

    fn corners(&mut self, primitive: &Primitive, set: u32) -> Checked<PrimitiveVertices> {
        let find = |name: &str| {
            primitive.attributes.get(name).map(|&index| Elements::find(self.source, index)).transpose()
        };
        let positions = find("POSITION")?.ok_or("a primitive has no POSITION; export the file again")?;
        let count = positions.count;
        self.vertices_left =
            self.vertices_left.checked_sub(count).ok_or_else(|| too_many(MAX_VERTICES, "vertices"))?;
        let attribute = |name: &str| match find(name)? {
            Some(elements) if elements.count != count => Err(format!(
                "{name} has {} elements for {count} vertices; export the file again",
                elements.count
            )),
            found => Ok(found),
        };
        Ok(PrimitiveVertices {
            uvs: attribute(&format!("TEXCOORD_{set}"))?.map(|elements| elements.floats()).transpose()?,
            colors: attribute("COLOR_0")?.map(|elements| elements.floats()).transpose()?,
            positions: positions.floats()?,
        })
    }

    fn append_vertices(
        &mut self,
        corners: &PrimitiveVertices,
        triangles: &mut [[u32; 3]],
        world_from_node: &Matrix4<f64>,
    ) -> Checked<()> {
        const UNUSED: u32 = u32::MAX;
        let mut number = vec![UNUSED; corners.positions.len()];
        triangles.iter().flatten().for_each(|&corner| number[corner as usize] = 0);
        let used = (0..number.len()).filter(|&corner| number[corner] != UNUSED).collect::<Vec<_>>();
        for corner in used {
            number[corner] = self.mesh.positions.len() as u32;
            self.mesh.positions.push(transformed(world_from_node, corners.positions[corner])?);
            self.mesh.uvs.push(corners.uvs.as_ref().map_or(Point2::origin(), |uvs| sane_uv(uvs[corner])));
            let color = corners.colors.as_ref().map_or([255; 3], |colors| colors[corner].map(code_of));
            self.mesh.colors.push(color);
        }
        triangles.iter_mut().flatten().for_each(|corner| *corner = number[*corner as usize]);
        Ok(())
    }
}

fn transformed(world_from_node: &Matrix4<f64>, position: [f32; 3]) -> Checked<Point3<f32>> {
    // The product of several nodes is taken in 64 bits and rounded once: digests depend on the last bit of each vertex.
    let point = world_from_node.transform_point(&Point3::from(position).cast::<f64>()).cast::<f32>();
    if point.iter().all(|coordinate| coordinate.is_finite()) {
        Ok(point)
    } else {
        Err("a vertex has no finite position; repair the mesh in a 3D editor".to_owned())
    }
}

/// Applies scale, rotation and offset, in `KHR_texture_transform` order.
fn transform_uvs(uvs: &mut [[f32; 2]], transform: &TextureTransform) {
    let TextureTransform { offset, rotation_rad, scale, .. } = *transform;
    let (sine, cosine) = (libm::sinf(rotation_rad), libm::cosf(rotation_rad));
    for uv in uvs {
        let [u, v] = [uv[0] * scale[0], uv[1] * scale[1]];
        *uv = [cosine * u + sine * v + offset[0], cosine * v - sine * u + offset[1]];
    }
}

fn sane_uv(uv: [f32; 2]) -> Point2<f32> {
    Point2::from(uv.map(|value| if value.abs() <= MAX_UV { value } else { 0.0 }))
}

/// Triangles from a list, strip or fan (glTF 2.0, section 3.7.2.1), without those with a repeated vertex.
fn triangles(order: &[u32], mode: u32) -> Checked<Vec<[u32; 3]>> {
    let count = order.len();
    let corners = |a: usize, b: usize, c: usize| [order[a], order[b], order[c]];
    let all: Vec<[u32; 3]> = match mode {
        // Every second triangle in a strip turns the other way.
        TRIANGLE_STRIP => {
            (2..count).map(|last| corners(last - 2, last - 1 + last % 2, last - last % 2)).collect()
        }
        TRIANGLE_FAN => (2..count).map(|last| corners(last - 1, last, 0)).collect(),
        _ => {
            refuse_if(!count.is_multiple_of(3), || {
                format!("a triangle list has {count} corners, no multiple of 3; export the file again")
            })?;
            order.as_chunks::<3>().0.to_vec()
        }
    };
    Ok(all.into_iter().filter(|[a, b, c]| a != b && b != c && c != a).collect())
}

/// Alpha below which a blended surface is transparent.
const BLEND_CUTOFF: u8 = 128;
/// Default alpha cutoff (glTF 2.0, section 3.9.4).
const DEFAULT_CUTOFF: f32 = 0.5;
/// Texture extensions with other image formats.
const TEXTURE_EXTENSIONS: [&str; 4] =
    ["GOOGLE_texture_basis", "KHR_texture_basisu", "EXT_texture_webp", "MSFT_texture_dds"];

/// Scene materials and textures, by their numbers in the file.
struct Palette<'a, 'r> {
    source: &'a Source<'a>,
    report: &'r mut ImportReport,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    material_of: BTreeMap<Option<usize>, u16>,
    /// Texture number by image; `None` is the missing image.
    texture_of: BTreeMap<Option<usize>, u16>,
    texels_left: u64,
    bytes_left: u64,
}

impl<'a, 'r> Palette<'a, 'r> {
    fn new(source: &'a Source<'a>, report: &'r mut ImportReport) -> Self {
        Self {
            source,
            report,
            materials: Vec::new(),
            textures: Vec::new(),
            material_of: BTreeMap::new(),
            texture_of: BTreeMap::new(),
            texels_left: MAX_TEXELS,
            bytes_left: MAX_FILE_BYTES,
        }
    }

    /// Returns the scene's number for material `index`; `None` is glTF's default material.
    fn material(&mut self, index: Option<usize>) -> Checked<u16> {
        // Materials are read at their first use: unused ones often refer to missing images.
        if let Some(&known) = self.material_of.get(&index) {
            return Ok(known);
        }
        let default = MaterialEntry::default();
        let entry = self.entry(index)?.unwrap_or(&default);
        let texture = entry.texture().map(|used| self.texture(used)).transpose()?;
        self.materials.push(material(entry, texture));
        let number = number(self.materials.len(), "materials")?;
        self.material_of.insert(index, number);
        Ok(number)
    }

    fn texture_use(&self, index: Option<usize>) -> Checked<Option<TextureUse>> {
        Ok(self.entry(index)?.and_then(MaterialEntry::texture))
    }

    fn entry(&self, index: Option<usize>) -> Checked<Option<&'a MaterialEntry>> {
        let Some(index) = index else { return Ok(None) };
        self.source.document.materials.get(index).map(Some).ok_or_else(|| missing("material", index))
    }

    fn texture(&mut self, used: TextureUse) -> Checked<u16> {
        let image = self.image_of(used.index)?;
        if let Some(&known) = self.texture_of.get(&image) {
            return Ok(known);
        }
        let texture = match image.map(|image| self.picture(image)).transpose()?.flatten() {
            Some(texture) => texture,
            None => {
                let name = image
                    .map_or_else(|| format!("of texture {}", used.index), |image| self.image_label(image));
                self.report.warn(format!("texture image {name} is missing; a checker replaces it"));
                images::checker()
            }
        };
        self.textures.push(texture);
        let number = number(self.textures.len(), "textures")?;
        self.texture_of.insert(image, number);
        Ok(number)
    }

    /// Decodes image `index`; `None` if it is missing.
    fn picture(&mut self, index: usize) -> Checked<Option<Texture>> {
        let Some(bytes) = self.image_bytes(index)? else { return Ok(None) };
        let decoded = images::decode(&bytes, &mut self.texels_left);
        let fail = |reason| format!("its texture image {} cannot be used: {reason}", self.image_label(index));
        decoded.map(Some).map_err(fail)
    }

    /// A texture's image, or an extension's image.
    fn image_of(&self, texture: usize) -> Checked<Option<usize>> {
        let entry = self.source.document.textures.get(texture).ok_or_else(|| missing("texture", texture))?;
        let offered = || {
            let sources = TEXTURE_EXTENSIONS
                .iter()
                .filter_map(|name| entry.extensions.get(*name)?.get("source")?.as_u64());
            sources.map(|source| source as usize).next()
        };
        Ok(entry.source.or_else(offered))
    }

    fn image_bytes(&mut self, index: usize) -> Checked<Option<Cow<'a, [u8]>>> {
        let source = self.source;
        let image = source.document.images.get(index).ok_or_else(|| missing("image", index))?;
        match (&image.uri, image.buffer_view) {
            (_, Some(view)) => Ok(Some(Cow::Borrowed(source.view(view)?))),
            (Some(address), None) if is_absent(address, source.folder) => Ok(None),
            (Some(address), None) => {
                load(address, source.folder, &mut self.bytes_left).map(|bytes| Some(Cow::Owned(bytes)))
            }
            (None, None) => Ok(None),
        }
    }

    fn image_label(&self, index: usize) -> String {
        let image = &self.source.document.images[index];
        match &image.uri {
            Some(address) if !address.starts_with("data:") => format!("{address:?}"),
            _ if image.mime_type.is_empty() => format!("{index} (no type given)"),
            _ => format!("{index} ({})", image.mime_type),
        }
    }
}

fn number(count: usize, what: &str) -> Checked<u16> {
    u16::try_from(count - 1).map_err(|_| format!("it uses more than 65536 {what}; merge some of them"))
}

fn material(entry: &MaterialEntry, texture: Option<u16>) -> Material {
    let [r, g, b, a] = entry.color();
    let cutoff = entry.alpha_cutoff.unwrap_or(DEFAULT_CUTOFF);
    Material {
        name: entry.name.clone(),
        base_color: [code_of(r), code_of(g), code_of(b), byte(a)],
        texture,
        alpha_cutoff: match entry.alpha_mode.as_str() {
            "MASK" => Some(byte(cutoff)),
            "BLEND" => Some(BLEND_CUTOFF),
            _ => None,
        },
    }
}

fn byte(share: f32) -> u8 {
    (share * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strips_and_fans_keep_their_winding() {
        assert_eq!(triangles(&[0, 1, 2, 3], TRIANGLE_STRIP).unwrap(), [[0, 1, 2], [1, 3, 2]]);
        assert_eq!(triangles(&[0, 1, 2, 3], TRIANGLE_FAN).unwrap(), [[1, 2, 0], [2, 3, 0]]);
        assert_eq!(triangles(&[0, 1, 2, 2, 1, 1], TRIANGLES).unwrap(), [[0, 1, 2]]);
        assert!(triangles(&[0, 1], TRIANGLES).is_err());
    }
}
