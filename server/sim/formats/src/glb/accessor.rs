//! Typed access to accessors, checked against their buffer views.

use crate::files::Checked;
use crate::glb::document::{Accessor, Sparse, SparsePart, missing};
use crate::glb::source::Source;
use std::borrow::Cow;

const U8: u32 = 5121;
const I8: u32 = 5120;
const U16: u32 = 5123;
const I16: u32 = 5122;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// Elements in an accessor without data: the file size does not limit them.
const MAX_UNBACKED: usize = 1 << 22;

/// An accessor's elements.
pub(super) struct Elements<'a> {
    bytes: Cow<'a, [u8]>,
    stride: usize,
    count: usize,
    component: u32,
    component_bytes: usize,
    components: usize,
    normalized: bool,
}

impl<'a> Elements<'a> {
    /// Finds accessor `index`, and checks that the data is complete.
    pub(super) fn find(source: &'a Source<'_>, index: usize) -> Checked<Self> {
        let accessor = source.document.accessors.get(index).ok_or_else(|| missing("accessor", index))?;
        let component_bytes = component_bytes(accessor.component_type).ok_or_else(|| {
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
            if element >= self.count {
                return Err(format!("it replaces element {element} of {}", self.count));
            }
            bytes[element * self.stride..element * self.stride + size].copy_from_slice(value);
        }
        self.bytes = Cow::Owned(bytes);
        Ok(())
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Returns the first `N` components for every element; normalised integers are scaled to 0 to 1 or -1 to 1.
    pub(super) fn floats<const N: usize>(&self) -> Checked<Vec<[f32; N]>> {
        if self.components < N {
            return Err(format!("an attribute has {} components where {N} are needed", self.components));
        }
        let element = |index: usize| std::array::from_fn(|component| self.float(self.at(index, component)));
        Ok((0..self.count).map(element).collect())
    }

    /// Returns the elements as vertex numbers.
    pub(super) fn indices(&self) -> Checked<Vec<u32>> {
        if self.components != 1 {
            return Err("an index list is not a list of single numbers; export the file again".to_owned());
        }
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
        if self.normalized { (value / full_scale(self.component)).max(-1.0) } else { value }
    }
}

/// Returns the stored number for 1 in a normalised component.
pub(super) fn full_scale(component: u32) -> f32 {
    match component {
        U8 => 255.0,
        I8 => 127.0,
        U16 => 65_535.0,
        I16 => 32_767.0,
        U32 => u32::MAX as f32,
        _ => 1.0,
    }
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

fn component_bytes(component: u32) -> Option<usize> {
    match component {
        U8 | I8 => Some(1),
        U16 | I16 => Some(2),
        U32 | F32 => Some(4),
        _ => None,
    }
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

/// A primitive's vertices.
pub(super) struct PrimitiveVertices {
    pub(super) positions: Vec<[f32; 3]>,
    pub(super) uvs: Option<Vec<[f32; 2]>>,
    /// Linear light, 0 to 1.
    pub(super) colors: Option<Vec<[f32; 3]>>,
}
