//! A file's content: GLB container, external files, `data:` URIs, accessors, and primitives packed with Draco
//! (`KHR_draco_mesh_compression`). Without the feature `compressed`, packed primitives are refused.

use crate::files::{Checked, neighbour, read_limited, refuse_if};
use crate::glb::document::{Accessor, Document, Sparse, SparsePart, missing};
use avln_scene::limits::{MAX_FILE_BYTES, MAX_JSON_BYTES};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use base64::{Engine as _, alphabet};
#[cfg(feature = "compressed")]
pub(super) use decoder::unpack_draco;
use std::borrow::Cow;
use std::path::Path;

const MAGIC: &[u8; 4] = b"glTF";
const HEADER_BYTES: usize = 12;
const CHUNK_HEADER_BYTES: usize = 8;
const JSON_CHUNK: &[u8] = b"JSON";
const BIN_CHUNK: &[u8] = b"BIN\0";

pub(super) struct Source<'a> {
    pub(super) document: Document,
    pub(super) buffers: Vec<Cow<'a, [u8]>>,
    /// External file folder; `None` for bytes in memory.
    pub(super) folder: Option<&'a Path>,
}

impl<'a> Source<'a> {
    /// Parses a `.glb` or `.gltf` file, and reads external buffers.
    pub(super) fn parse(bytes: &'a [u8], folder: Option<&'a Path>) -> Checked<Self> {
        let is_binary = bytes.starts_with(MAGIC);
        let (json, bin) = if is_binary { chunks(bytes)? } else { (bytes, None) };
        refuse_if(json.len() > MAX_JSON_BYTES, || {
            format!(
                "its JSON part is {} bytes long, at most {MAX_JSON_BYTES} are read; save it as .glb",
                json.len()
            )
        })?;
        let kind =
            if is_binary { "its JSON part is damaged" } else { "it is neither binary glTF nor glTF JSON" };
        let document: Document = serde_json::from_slice(json)
            .map_err(|error| format!("{kind} ({error}); export it as .glb again"))?;
        let buffers = load_buffers(&document, bin, folder)?;
        Ok(Self { document, buffers, folder })
    }

    pub(super) fn view(&self, index: usize) -> Checked<&[u8]> {
        let view = self.document.buffer_views.get(index).ok_or_else(|| missing("buffer view", index))?;
        let buffer = self.buffers.get(view.buffer).ok_or_else(|| missing("buffer", view.buffer))?;
        let end = view.byte_offset.checked_add(view.byte_length);
        end.and_then(|end| buffer.get(view.byte_offset..end)).ok_or_else(|| {
            format!(
                "buffer view {index} reaches beyond its buffer of {} bytes; export the file again",
                buffer.len()
            )
        })
    }
}

/// A GLB file's JSON chunk and binary chunk.
fn chunks(bytes: &[u8]) -> Checked<(&[u8], Option<&[u8]>)> {
    let version = word(bytes, 4).ok_or("it ends inside its header; copy the file again")?;
    refuse_if(version != 2, || {
        format!("it is binary glTF version {version}, only version 2 is read; export it as glTF 2.0")
    })?;
    let length = word(bytes, 8).ok_or("it ends inside its header; copy the file again")?;
    refuse_if(length > bytes.len(), || {
        format!("it is cut short: {length} bytes announced, {} present; copy the file again", bytes.len())
    })?;
    // Bytes after the announced length are ignored, as by other readers.
    let bytes = &bytes[..length];
    let (kind, json, rest) = chunk(bytes.get(HEADER_BYTES..).unwrap_or_default())?;
    refuse_if(kind != JSON_CHUNK, || "its first chunk is not JSON; export the file again".into())?;
    if rest.is_empty() {
        return Ok((json, None));
    }
    let (kind, bin, _) = chunk(rest)?;
    Ok((json, (kind == BIN_CHUNK).then_some(bin)))
}

/// The first chunk's kind and content, and the bytes after it.
fn chunk(bytes: &[u8]) -> Checked<(&[u8], &[u8], &[u8])> {
    let cut = || "one of its chunks reaches beyond the end of the file; copy the file again".to_owned();
    let length = word(bytes, 0).ok_or_else(cut)?;
    let kind = bytes.get(4..CHUNK_HEADER_BYTES).ok_or_else(cut)?;
    let end = CHUNK_HEADER_BYTES.checked_add(length).ok_or_else(cut)?;
    let content = bytes.get(CHUNK_HEADER_BYTES..end).ok_or_else(cut)?;
    Ok((kind, content, &bytes[end..]))
}

fn word(bytes: &[u8], offset: usize) -> Option<usize> {
    let four = bytes.get(offset..offset + 4)?;
    Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]) as usize)
}

fn load_buffers<'a>(
    document: &Document,
    bin: Option<&'a [u8]>,
    folder: Option<&Path>,
) -> Checked<Vec<Cow<'a, [u8]>>> {
    let mut budget = MAX_FILE_BYTES;
    let mut buffers = Vec::with_capacity(document.buffers.len());
    for (index, buffer) in document.buffers.iter().enumerate() {
        let bytes = match &buffer.uri {
            Some(address) => Cow::Owned(load(address, folder, &mut budget)?),
            None if index == 0 => {
                Cow::Borrowed(bin.ok_or("its binary chunk is missing; copy the file again")?)
            }
            None => return Err(format!("buffer {index} has no URI; export the file again")),
        };
        let (present, announced) = (bytes.len(), buffer.byte_length);
        refuse_if(present < announced, || {
            format!("buffer {index} has {present} bytes, {announced} were announced; copy the files again")
        })?;
        buffers.push(bytes);
    }
    Ok(buffers)
}

/// Loads the bytes at `address`, and subtracts their number from `budget`.
pub(super) fn load(address: &str, folder: Option<&Path>, budget: &mut u64) -> Checked<Vec<u8>> {
    let bytes = if let Some(data) = address.strip_prefix("data:") {
        let (_, encoded) =
            data.split_once(";base64,").ok_or("a data: URI is not base64; export it as .glb")?;
        base64(encoded).ok_or("a data: URI is not valid base64; export it as .glb")?
    } else {
        let folder = folder.ok_or_else(|| {
            format!("it refers to another file, {address:?}; open it by its path, or export it as .glb")
        })?;
        read_limited(&neighbour(folder, address)?, *budget).map_err(|error| {
            format!(
                "its file {address:?} cannot be read ({error}); put it next to the scene, or export it as .glb"
            )
        })?
    };
    *budget = budget.checked_sub(bytes.len() as u64).ok_or_else(|| {
        format!(
            "its external files have more than {MAX_FILE_BYTES} bytes together; split or simplify the scene"
        )
    })?;
    Ok(bytes)
}

pub(super) fn is_absent(address: &str, folder: Option<&Path>) -> bool {
    let path =
        folder.filter(|_| !address.starts_with("data:")).and_then(|folder| neighbour(folder, address).ok());
    path.is_some_and(|path| !path.exists())
}

/// Decodes base64 (RFC 4648, section 4); padding is optional, white space is an error.
fn base64(text: &str) -> Option<Vec<u8>> {
    const LENIENT: GeneralPurpose = GeneralPurpose::new(
        &alphabet::STANDARD,
        GeneralPurposeConfig::new()
            .with_decode_padding_mode(DecodePaddingMode::Indifferent)
            .with_decode_allow_trailing_bits(true),
    );
    LENIENT.decode(text).ok()
}

const U8: u32 = 5121;
const I8: u32 = 5120;
const U16: u32 = 5123;
const I16: u32 = 5122;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// Elements in an accessor without data: the file size does not limit them.
const MAX_UNBACKED: usize = 1 << 22;

pub(super) struct Elements<'a> {
    bytes: Cow<'a, [u8]>,
    stride: usize,
    pub(super) count: usize,
    component: u32,
    component_bytes: usize,
    full_scale: f32,
    components: usize,
    normalized: bool,
}

impl<'a> Elements<'a> {
    /// Finds accessor `index`, and checks that the data is complete.
    pub(super) fn find(source: &'a Source<'_>, index: usize) -> Checked<Self> {
        let accessor = source.document.accessors.get(index).ok_or_else(|| missing("accessor", index))?;
        let (component_bytes, full_scale) = component_size(accessor.component_type).ok_or_else(|| {
            format!("accessor {index} has unknown component type {}", accessor.component_type)
        })?;
        let components = components(&accessor.kind)
            .ok_or_else(|| format!("accessor {index} has unsupported type {:?}", accessor.kind))?;
        let size = component_bytes * components;
        let (bytes, stride) = match accessor.buffer_view {
            Some(view) => {
                stored(accessor, source.view(view)?, source.document.buffer_views[view].byte_stride, size)
                    .ok_or_else(|| {
                        format!("accessor {index} reaches beyond its data; export the file again")
                    })?
            }
            None if accessor.count > MAX_UNBACKED => {
                return Err(format!(
                    "accessor {index} announces {} elements without data, at most {MAX_UNBACKED} are read; export the file again",
                    accessor.count
                ));
            }
            None => (Cow::Owned(vec![0; size * accessor.count]), size),
        };
        let mut elements = Self {
            bytes,
            stride,
            count: accessor.count,
            component: accessor.component_type,
            component_bytes,
            full_scale,
            components,
            normalized: accessor.normalized,
        };
        if let Some(sparse) = &accessor.sparse {
            elements.replace(source, sparse).map_err(|reason| {
                format!("accessor {index} is sparse, and {reason}; export the file again")
            })?;
        }
        Ok(elements)
    }

    /// Replaces elements by a sparse accessor's values (glTF 2.0, section 3.6.2.3).
    fn replace(&mut self, source: &Source<'_>, sparse: &Sparse) -> Checked<()> {
        let size = self.component_bytes * self.components;
        let index_bytes = match sparse.indices.component_type {
            U8 => 1,
            U16 => 2,
            U32 => 4,
            _ => return Err("its indices are neither u8, u16 nor u32".to_owned()),
        };
        let part = |part: &SparsePart, size: usize| {
            let bytes = source.view(part.buffer_view)?.get(part.byte_offset..);
            let needed = sparse.count.checked_mul(size);
            bytes
                .zip(needed)
                .and_then(|(bytes, needed)| bytes.get(..needed))
                .ok_or_else(|| "reaches beyond its data".to_owned())
        };
        let indices = part(&sparse.indices, index_bytes)?;
        let values = part(&sparse.values, size)?;
        // The view may be shared with other accessors: the replaced values belong to a copy.
        let mut bytes = std::mem::take(&mut self.bytes).into_owned();
        for (index, value) in indices.chunks_exact(index_bytes).zip(values.chunks_exact(size)) {
            let element = index.iter().rev().fold(0_usize, |word, &byte| word << 8 | usize::from(byte));
            refuse_if(element >= self.count, || format!("it replaces element {element} of {}", self.count))?;
            bytes[element * self.stride..element * self.stride + size].copy_from_slice(value);
        }
        self.bytes = Cow::Owned(bytes);
        Ok(())
    }

    /// Returns the first `N` components for every element; normalised integers are scaled to 0 to 1 or -1 to 1.
    pub(super) fn floats<const N: usize>(&self) -> Checked<Vec<[f32; N]>> {
        refuse_if(self.components < N, || {
            format!("an attribute has {} components where {N} are needed", self.components)
        })?;
        let element = |index: usize| std::array::from_fn(|component| self.float(self.at(index, component)));
        Ok((0..self.count).map(element).collect())
    }

    pub(super) fn indices(&self) -> Checked<Vec<u32>> {
        refuse_if(self.components != 1, || {
            "an index list is not a list of single numbers; export the file again".into()
        })?;
        let index = |at: &[u8]| match self.component {
            U8 => Some(u32::from(at[0])),
            U16 => Some(u32::from(u16::from_le_bytes([at[0], at[1]]))),
            U32 => Some(u32::from_le_bytes([at[0], at[1], at[2], at[3]])),
            _ => None,
        };
        let found: Option<Vec<u32>> = (0..self.count).map(|element| index(self.at(element, 0))).collect();
        found.ok_or_else(|| "an index list is neither of u8, u16 nor u32; export the file again".to_owned())
    }

    fn at(&self, element: usize, component: usize) -> &[u8] {
        let start = element * self.stride + component * self.component_bytes;
        &self.bytes[start..start + self.component_bytes]
    }

    /// Converts a component to a number (glTF 2.0, section 3.6.2.2).
    fn float(&self, at: &[u8]) -> f32 {
        let value = match self.component {
            U8 => f32::from(at[0]),
            I8 => f32::from(at[0] as i8),
            U16 => f32::from(u16::from_le_bytes([at[0], at[1]])),
            I16 => f32::from(i16::from_le_bytes([at[0], at[1]])),
            U32 => u32::from_le_bytes([at[0], at[1], at[2], at[3]]) as f32,
            _ => return f32::from_le_bytes([at[0], at[1], at[2], at[3]]),
        };
        if self.normalized { (value / self.full_scale).max(-1.0) } else { value }
    }
}

/// Bytes per number of a component type, and the stored number for 1 if it is normalised.
pub(super) fn component_size(component: u32) -> Option<(usize, f32)> {
    Some(match component {
        U8 => (1, 255.0),
        I8 => (1, 127.0),
        U16 => (2, 65_535.0),
        I16 => (2, 32_767.0),
        U32 => (4, u32::MAX as f32),
        F32 => (4, 1.0),
        _ => return None,
    })
}

/// Bytes from an accessor's first element on, and the stride; `None` if they are too few.
fn stored<'a>(
    accessor: &Accessor,
    view: &'a [u8],
    stride: Option<usize>,
    size: usize,
) -> Option<(Cow<'a, [u8]>, usize)> {
    let bytes = view.get(accessor.byte_offset..).unwrap_or_default();
    let stride = stride.unwrap_or(size);
    let last = accessor.count.checked_sub(1);
    let needed = last.map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size))?;
    (stride >= size && needed <= bytes.len()).then_some((Cow::Borrowed(bytes), stride))
}

fn components(kind: &str) -> Option<usize> {
    match kind {
        "SCALAR" => Some(1),
        "VEC2" => Some(2),
        "VEC3" => Some(3),
        "VEC4" => Some(4),
        _ => None,
    }
}

pub(super) struct PrimitiveVertices {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) uvs: Option<Vec<[f32; 2]>>,
    /// Linear light, 0 to 1.
    pub(super) colors: Option<Vec<[f32; 3]>>,
}

pub(super) const DRACO: &str = "KHR_draco_mesh_compression";

#[cfg(not(feature = "compressed"))]
pub(super) fn unpack_draco(
    _: &Source<'_>,
    _: &crate::glb::document::Primitive,
    _: &serde_json::Value,
    _: u32,
) -> Checked<(PrimitiveVertices, Vec<u32>)> {
    Err("a primitive is packed with Draco, which this build cannot decode; build with the feature `compressed`".into())
}

#[cfg(feature = "compressed")]
mod decoder {
    use crate::files::Checked;
    use crate::glb::document::Primitive;
    use crate::glb::source::{PrimitiveVertices, Source, component_size};
    use avln_scene::limits::{MAX_TRIANGLES, MAX_VERTICES};
    use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder, PointAttribute};
    use serde_json::Value;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_agrees_with_rfc_4648() {
        for (plain, coded) in
            [("", ""), ("f", "Zg=="), ("fo", "Zm8="), ("foo", "Zm9v"), ("foobar", "Zm9vYmFy")]
        {
            assert_eq!(base64(coded).unwrap(), plain.as_bytes());
        }
        assert_eq!([base64("Z"), base64("Zm9v!")], [None, None]);
    }
}
