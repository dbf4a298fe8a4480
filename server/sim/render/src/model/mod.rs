//! A scene prepared for rendering: triangle clusters under a box tree, and textures with mipmaps, in a single
//! memory block.
//!
//! File layout: words of four bytes in native order, because files are a cache and never exchanged. A header
//! (the letters `AVLN`, layout version, word count by section, BLAKE3 hash of all sections), then the
//! sections.

mod build;
mod replacement;
mod simplification;
mod tree;

#[cfg(doc)]
use crate::lanes::LANES;
use build::node_words;
pub(crate) use build::{BLOCK, LEVEL_BITS, NO_TEXTURE};
pub(crate) use replacement::Replacements;
use std::io::{self, Write};
use std::ops::Range;
pub(crate) use tree::CLUSTER;

/// Corner limit of a cluster.
pub(crate) const CORNERS: usize = 3 * CLUSTER;

/// Flag of triangles with holes, next to the corner indices.
pub(crate) const HOLED: u32 = 1 << 24;

/// Section count.
const SECTIONS: usize = 10;

/// A scene's immutable render data, shared by threads.
pub struct Model {
    bytes: Box<dyn AsRef<[u8]> + Send + Sync>,
    /// Byte ranges.
    sections: [Range<usize>; SECTIONS],
}

/// A model's lists.
#[derive(Clone, Copy, Default)]
pub(crate) struct ModelView<'a> {
    /// Boxes: smallest and largest corner as float bits, then the left child and 0, or a cluster and 1.
    pub(crate) nodes: &'a [[u32; 8]],
    pub(crate) clusters: &'a [Cluster],
    /// By cluster: x for all corners, metres, padded to a multiple of [`LANES`], then y, then z.
    pub(crate) coordinates: &'a [f32],
    /// Corners in cluster order: u and v as float bits, then RGB.
    pub(crate) corners: &'a [[u32; 3]],
    /// Triangles: corners within the cluster, a byte each, and the surface.
    pub(crate) triangles: &'a [[u32; 2]],
    /// Material, instance.
    pub(crate) surfaces: &'a [[u32; 2]],
    /// Base colour RGBA; first texture level with the level count in the low [`LEVEL_BITS`] bits; alpha
    /// cutoff; 0.
    pub(crate) materials: &'a [[u32; 4]],
    /// Texture levels: first texel; width in the low 16 bits, height in the high.
    pub(crate) levels: &'a [Level],
    /// RGBA, in blocks of 4 by 4.
    pub(crate) texels: &'a [u32],
    /// Background RGB; omitted triangle count.
    pub(crate) whole: &'a [u32],
}

/// See [`ModelView::levels`].
pub(crate) type Level = [u32; 2];

/// A cluster's first coordinate, corner and triangle; triangle count in the low 16 bits, corner count in the
/// high.
pub(crate) type Cluster = [u32; 4];

impl Model {
    pub(crate) fn view(&self) -> ModelView<'_> {
        let bytes = (*self.bytes).as_ref();
        let section = |index: usize| &bytes[self.sections[index].clone()];
        ModelView {
            nodes: bytemuck::cast_slice(section(0)),
            clusters: bytemuck::cast_slice(section(1)),
            coordinates: bytemuck::cast_slice(section(2)),
            corners: bytemuck::cast_slice(section(3)),
            triangles: bytemuck::cast_slice(section(4)),
            surfaces: bytemuck::cast_slice(section(5)),
            materials: bytemuck::cast_slice(section(6)),
            levels: bytemuck::cast_slice(section(7)),
            texels: bytemuck::cast_slice(section(8)),
            whole: bytemuck::cast_slice(section(9)),
        }
    }

    /// Returns the visible triangle count.
    pub fn triangle_count(&self) -> usize {
        self.view().triangles.len()
    }

    /// Returns the geometry size, bytes, including the tree.
    pub fn geometry_bytes(&self) -> usize {
        self.sections[..6].iter().map(ExactSizeIterator::len).sum()
    }

    /// Returns the texture size, bytes, including mipmaps.
    pub fn texture_bytes(&self) -> usize {
        self.sections[8].len()
    }

    /// Returns the total size, bytes.
    pub fn byte_count(&self) -> usize {
        (*self.bytes).as_ref().len()
    }
}

const MAGIC: u32 = u32::from_le_bytes(*b"AVLN");
// To be raised with every change of layout, model construction or light computation: cached models with an
// equal version are used as they are.
const VERSION: u32 = 2;
const HASH_WORDS: usize = 8;
const HEADER_WORDS: usize = 2 + SECTIONS + HASH_WORDS;
const WORD: usize = size_of::<u32>();
/// Words per entry, by section.
const ENTRY_WORDS: [usize; SECTIONS] = [8, 4, 1, 3, 2, 2, 4, 2, 1, 2];

/// An unreadable model.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ModelError {
    /// A different format or version.
    #[error(
        "a different program version wrote it (layout {found:#x}, expected {VERSION:#x}); delete it; the next start regenerates it"
    )]
    Foreign {
        /// Version found, or 0.
        found: u32,
    },
    /// Missing or changed bytes.
    #[error("it is damaged: {0}; delete it; the next start regenerates it")]
    Damaged(&'static str),
}

impl Model {
    /// Version of layout, construction and light; other versions are rejected.
    pub const VERSION: u32 = VERSION;

    /// Reads a model written by [`Model::write`]; the bytes may be a mapped file.
    ///
    /// # Errors
    /// If the bytes have a different format, are truncated or modified.
    pub fn read(bytes: impl AsRef<[u8]> + Send + Sync + 'static) -> Result<Self, ModelError> {
        let sections = sections(bytes.as_ref())?;
        Ok(Self { bytes: Box::new(bytes), sections })
    }

    /// Writes the bytes.
    ///
    /// # Errors
    /// If `out` fails.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        out.write_all((*self.bytes).as_ref())
    }
}

/// Words, borrowed as bytes.
struct Words(Vec<u32>);

impl AsRef<[u8]> for Words {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

fn assemble(contents: &[&[u32]; SECTIONS]) -> Model {
    let mut words = vec![MAGIC, VERSION];
    words.extend(contents.iter().map(|section| section.len() as u32));
    let mut hasher = blake3::Hasher::new();
    contents.iter().for_each(|section| {
        hasher.update(bytemuck::cast_slice(section));
    });
    words.extend(hasher.finalize().as_bytes().as_chunks::<WORD>().0.iter().copied().map(u32::from_ne_bytes));
    contents.iter().for_each(|section| words.extend_from_slice(section));
    let sections = ranges(contents.map(|section| section.len()));
    Model { bytes: Box::new(Words(words)), sections }
}

fn ranges(lengths: [usize; SECTIONS]) -> [Range<usize>; SECTIONS] {
    let mut start = HEADER_WORDS * WORD;
    lengths.map(|length| {
        let range = start..start + length * WORD;
        start = range.end;
        range
    })
}

fn sections(bytes: &[u8]) -> Result<[Range<usize>; SECTIONS], ModelError> {
    let words: &[u32] = bytemuck::try_cast_slice(bytes)
        .map_err(|_| ModelError::Damaged("its length or alignment is wrong"))?;
    let (header, content) =
        words.split_at_checked(HEADER_WORDS).ok_or(ModelError::Damaged("its header is truncated"))?;
    if header[..2] != [MAGIC, VERSION] {
        return Err(ModelError::Foreign { found: if header[0] == MAGIC { header[1] } else { 0 } });
    }
    let lengths: [usize; SECTIONS] = std::array::from_fn(|section| header[2 + section] as usize);
    if lengths.iter().sum::<usize>() != content.len() {
        return Err(ModelError::Damaged("its length contradicts the header"));
    }
    if lengths.iter().zip(ENTRY_WORDS).any(|(length, entry)| length % entry != 0) {
        return Err(ModelError::Damaged("a section is truncated"));
    }
    let hash = blake3::hash(bytemuck::cast_slice(content));
    if bytemuck::cast_slice::<u32, u8>(&header[2 + SECTIONS..]) != hash.as_bytes() {
        return Err(ModelError::Damaged("its content has changed"));
    }
    Ok(ranges(lengths))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Renderer;
    use avln_geom::RayMesh;
    use avln_houses::{HouseOptions, house};
    use avln_scene::digest::digest;
    use std::sync::Arc;

    fn model() -> Model {
        let part = [1, 2, 3, 4, 5, 6, 7, 8];
        assemble(&[&part, &part, &part, &part[..3], &part, &part, &part, &part, &part, &part[..2]])
    }

    fn bytes_of(model: &Model) -> Vec<u8> {
        let mut bytes = Vec::new();
        model.write(&mut bytes).expect("writing to memory succeeds");
        bytes
    }

    /// Reads bytes from a word-aligned address.
    fn read(bytes: &[u8]) -> Result<Model, ModelError> {
        Model::read(Words(
            bytes.chunks(WORD).map(|word| word.iter().rev().fold(0, |w, &b| w << 8 | u32::from(b))).collect(),
        ))
    }

    #[test]
    fn written_models_are_read_back() {
        let bytes = bytes_of(&model());
        let again = read(&bytes).expect("a model");
        assert_eq!(bytes_of(&again), bytes);
        assert_eq!(again.view().nodes, [[1, 2, 3, 4, 5, 6, 7, 8]]);
        assert_eq!(again.view().corners, [[1, 2, 3]]);
    }

    #[test]
    fn changed_model_construction_needs_a_new_version() {
        let scene = Arc::new(house("kept", 21, &HouseOptions::small()));
        let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
        let scene_digest = digest(&scene);
        let hash = blake3::hash(&bytes_of(Renderer::new(scene, rays).model())).to_hex();
        assert_eq!(
            (VERSION, &scene_digest[..16], &hash[..16]),
            (2, "bbeb170e584e1df0", "fc1757d96f69329c"),
            "if only the hash differs, increment VERSION; then enter the new values"
        );
    }

    #[test]
    fn changed_or_truncated_bytes_are_refused() {
        let bytes = bytes_of(&model());
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 1;
            assert!(read(&changed).is_err(), "byte {at}");
        }
        for end in (0..bytes.len()).step_by(WORD) {
            assert!(read(&bytes[..end]).is_err(), "{end} bytes");
        }
        assert_eq!(read(&[0; 200]).err(), Some(ModelError::Foreign { found: 0 }));
    }
}
