//! Primitives packed with Draco (`KHR_draco_mesh_compression`). Without the feature `compressed`, they are refused.

use crate::files::Checked;
use crate::glb::document::Primitive;
use crate::glb::source::{PrimitiveVertices, Source};
use serde_json::Value;

#[cfg(feature = "compressed")]
pub(super) use decoder::unpack_draco;

pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

#[cfg(not(feature = "compressed"))]
pub(super) fn unpack_draco(
    _: &Source<'_>,
    _: &Primitive,
    _: &Value,
    _: u32,
) -> Checked<(PrimitiveVertices, Vec<u32>)> {
    Err("a primitive is packed with Draco, which this build cannot decode; build with the feature `compressed`".into())
}

#[cfg(feature = "compressed")]
mod decoder {
    use super::*;
    use crate::glb::source::component_size;
    use avln_scene::limits::{MAX_TRIANGLES, MAX_VERTICES};
    use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute};

    /// Attribute bytes in a primitive.
    const MAX_DECODED_BYTES: u64 = 1 << 30;

    /// Decodes a packed primitive: vertices, and triangle corners. `set` is the texture coordinate set.
    pub(in crate::glb) fn unpack_draco(
        source: &Source<'_>,
        primitive: &Primitive,
        packed: &Value,
        set: u32,
    ) -> Checked<(PrimitiveVertices, Vec<u32>)> {
        let fail = |reason: &str| format!("a Draco-packed primitive {reason}; export it uncompressed");
        let view = packed.get("bufferView").and_then(Value::as_u64).ok_or_else(|| fail("has no data"))?;
        let mesh = decode(source.view(view as usize)?).map_err(|reason| fail(&reason))?;
        let attribute = |name: &str| {
            let id = packed.get("attributes")?.get(name)?.as_u64()?;
            mesh.attribute_by_unique_id(u32::try_from(id).ok()?)
                .map(|found| (found, scale(source, primitive, name)))
        };
        let points = mesh.num_points();
        let corners = PrimitiveVertices {
            positions: values(attribute("POSITION").ok_or_else(|| fail("has no POSITION"))?, points),
            uvs: attribute(&format!("TEXCOORD_{set}")).map(|found| values(found, points)),
            colors: attribute("COLOR_0").map(|found| values(found, points)),
        };
        let order = mesh.faces().iter().flatten().map(|point| point.0).collect();
        Ok((corners, order))
    }

    fn decode(bytes: &[u8]) -> Checked<Mesh> {
        // The packed data announces its own sizes, which the accessors need not confirm.
        let limits = DecodeLimits::default()
            .with_max_points(MAX_VERTICES as u64)
            .with_max_faces(MAX_TRIANGLES as u64)
            .with_max_decoded_bytes(MAX_DECODED_BYTES);
        let mut mesh = Mesh::new();
        let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
        let decoded = MeshDecoder::new().decode(&mut buffer, &mut mesh);
        decoded.map_err(|error| format!("cannot be read ({error})"))?;
        if mesh.num_points() > MAX_VERTICES || mesh.num_faces() > MAX_TRIANGLES {
            return Err("is too large".to_owned());
        }
        Ok(mesh)
    }

    fn values<const N: usize>((attribute, scale): (&PointAttribute, f32), points: usize) -> Vec<[f32; N]> {
        let values = attribute.read_f32s(points, N);
        values.as_chunks::<N>().0.iter().map(|element| element.map(|value| value * scale)).collect()
    }

    /// Value for a stored 1, by the attribute's accessor.
    fn scale(source: &Source<'_>, primitive: &Primitive, name: &str) -> f32 {
        let accessor = primitive.attributes.get(name).and_then(|&index| source.document.accessors.get(index));
        let normalized = accessor.filter(|accessor| accessor.normalized);
        let size = normalized.and_then(|accessor| component_size(accessor.component_type));
        size.map_or(1.0, |(_, full_scale)| 1.0 / full_scale)
    }
}
