//! Primitives packed with Draco (`KHR_draco_mesh_compression`).

use crate::files::Checked;
use crate::glb::accessor::{PrimitiveVertices, full_scale};
use crate::glb::document::Primitive;
use crate::glb::source::Source;
use avln_scene::limits::{MAX_TRIANGLES, MAX_VERTICES};
use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute};
use serde_json::Value;

/// Extension name.
pub(super) const NAME: &str = "KHR_draco_mesh_compression";
/// Attribute bytes in a primitive.
const MAX_DECODED_BYTES: u64 = 1 << 30;

/// Decodes a packed primitive: vertices, and triangle corners. `set` is the texture coordinate set.
pub(super) fn decode(
    source: &Source<'_>,
    primitive: &Primitive,
    packed: &Value,
    set: u32,
) -> Checked<(PrimitiveVertices, Vec<u32>)> {
    let fail = |reason: &str| format!("a Draco-packed primitive {reason}; export it uncompressed");
    let view = packed.get("bufferView").and_then(Value::as_u64).ok_or_else(|| fail("has no data"))?;
    // The packed data announces its own sizes, which the accessors need not confirm.
    let limits = DecodeLimits::default()
        .with_max_points(MAX_VERTICES as u64)
        .with_max_faces(MAX_TRIANGLES as u64)
        .with_max_decoded_bytes(MAX_DECODED_BYTES);
    let mut mesh = Mesh::new();
    let mut buffer = DecoderBuffer::new(source.view(view as usize)?).with_limits(limits);
    MeshDecoder::new()
        .decode(&mut buffer, &mut mesh)
        .map_err(|error| fail(&format!("cannot be read ({error})")))?;
    let points = mesh.num_points();
    if points > MAX_VERTICES || mesh.num_faces() > MAX_TRIANGLES {
        return Err(fail("is too large"));
    }
    let attribute = |name: &str| {
        let id = packed.get("attributes")?.get(name)?.as_u64()?;
        mesh.attribute_by_unique_id(u32::try_from(id).ok()?)
            .map(|found| (found, scale(source, primitive, name)))
    };
    let corners = PrimitiveVertices {
        positions: read(attribute("POSITION").ok_or_else(|| fail("has no POSITION"))?, points),
        uvs: attribute(&format!("TEXCOORD_{set}")).map(|found| read(found, points)),
        colors: attribute("COLOR_0").map(|found| read(found, points)),
    };
    let order = mesh.faces().iter().flatten().map(|point| point.0).collect();
    Ok((corners, order))
}

fn read<const N: usize>((attribute, scale): (&PointAttribute, f32), points: usize) -> Vec<[f32; N]> {
    let values = attribute.read_f32s(points, N);
    values.as_chunks::<N>().0.iter().map(|element| element.map(|value| value * scale)).collect()
}

/// Value for a stored 1, by the attribute's accessor.
fn scale(source: &Source<'_>, primitive: &Primitive, name: &str) -> f32 {
    let accessor = primitive.attributes.get(name).and_then(|&index| source.document.accessors.get(index));
    match accessor {
        Some(accessor) if accessor.normalized => 1.0 / full_scale(accessor.component_type),
        _ => 1.0,
    }
}
