//! Typed reading of accessors; nothing is read outside of its buffer view.

use super::Checked;
use super::container::{Source, missing};

const U8: u32 = 5121;
const I8: u32 = 5120;
const U16: u32 = 5123;
const I16: u32 = 5122;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// The elements of one accessor.
pub(super) struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    count: usize,
    component: u32,
    component_bytes: usize,
    components: usize,
    normalized: bool,
}

impl<'a> Elements<'a> {
    /// Finds accessor `index` and checks that all of it lies inside its data.
    pub(super) fn find(source: &'a Source<'_>, index: usize) -> Checked<Self> {
        let accessor = source.document.accessors.get(index).ok_or_else(|| missing("accessor", index))?;
        let view = match (accessor.buffer_view, &accessor.sparse) {
            (Some(view), None) => view,
            _ => {
                return Err(format!(
                    "accessor {index} is sparse or empty; export the file without sparse accessors"
                ));
            }
        };
        let component_bytes = component_bytes(accessor.component_type).ok_or_else(|| {
            format!("accessor {index} has unknown component type {}", accessor.component_type)
        })?;
        let components = components(&accessor.kind)
            .ok_or_else(|| format!("accessor {index} has unsupported type {:?}", accessor.kind))?;
        let size = component_bytes * components;
        let bytes = source.view(view)?.get(accessor.byte_offset..).unwrap_or_default();
        let stride = source.document.buffer_views[view].byte_stride.unwrap_or(size);
        let needed =
            accessor.count.checked_sub(1).map_or(Some(0), |last| last.checked_mul(stride)?.checked_add(size));
        if stride < size || needed.is_none_or(|needed| needed > bytes.len()) {
            return Err(format!("accessor {index} reaches beyond its data; export the file again"));
        }
        Ok(Self {
            bytes,
            stride,
            count: accessor.count,
            component: accessor.component_type,
            component_bytes,
            components,
            normalized: accessor.normalized,
        })
    }

    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// The first `N` components of every element as numbers; normalised integers are scaled to 0 to 1 or -1 to 1.
    pub(super) fn floats<const N: usize>(&self) -> Checked<Vec<[f32; N]>> {
        if self.components < N {
            return Err(format!("an attribute has {} components where {N} are needed", self.components));
        }
        let element = |index: usize| std::array::from_fn(|component| self.float(self.at(index, component)));
        Ok((0..self.count).map(element).collect())
    }

    /// The elements as vertex numbers.
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
        found.ok_or_else(|| "an index list holds neither u8, u16 nor u32; export the file again".to_owned())
    }

    fn at(&self, element: usize, component: usize) -> &[u8] {
        let start = element * self.stride + component * self.component_bytes;
        &self.bytes[start..start + self.component_bytes]
    }

    /// Scaling by glTF 2.0, section 3.6.2.2.
    fn float(&self, at: &[u8]) -> f32 {
        let (value, scale) = match self.component {
            U8 => (f32::from(at[0]), 255.0),
            I8 => (f32::from(at[0] as i8), 127.0),
            U16 => (f32::from(u16::from_le_bytes([at[0], at[1]])), 65_535.0),
            I16 => (f32::from(i16::from_le_bytes([at[0], at[1]])), 32_767.0),
            U32 => (u32::from_le_bytes([at[0], at[1], at[2], at[3]]) as f32, u32::MAX as f32),
            _ => return f32::from_le_bytes([at[0], at[1], at[2], at[3]]),
        };
        if self.normalized { (value / scale).max(-1.0) } else { value }
    }
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
