//! Primitives packed with Draco (`KHR_draco_mesh_compression`).

use super::container::Source;
use super::schema::Primitive;
use super::surfaces::Corners;
use crate::files::Checked;
use avln_scene::limits::{MAX_TRIANGLES, MAX_VERTICES};
use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute};
use serde_json::Value;

/// Name of the extension.
pub(super) const NAME: &str = "KHR_draco_mesh_compression";
/// Bytes of one primitive's attributes.
const MAX_DECODED_BYTES: u64 = 1 << 30;

/// The vertices and the triangles' corners of a packed primitive. `set` is the set of texture coordinates asked for.
pub(super) fn decode(
    source: &Source<'_>,
    primitive: &Primitive,
    packed: &Value,
    set: u32,
) -> Checked<(Corners, Vec<u32>)> {
    let fail = |reason: &str| format!("a Draco-packed primitive {reason}; export it uncompressed");
    let view = packed.get("bufferView").and_then(Value::as_u64).ok_or_else(|| fail("names no data"))?;
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
    let corners = Corners {
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

/// What one unit of a stored number means, by the accessor that stands for the attribute.
fn scale(source: &Source<'_>, primitive: &Primitive, name: &str) -> f32 {
    let accessor = primitive.attributes.get(name).and_then(|&index| source.document.accessors.get(index));
    match accessor {
        Some(accessor) if accessor.normalized => 1.0 / super::accessor::full_scale(accessor.component_type),
        _ => 1.0,
    }
}
