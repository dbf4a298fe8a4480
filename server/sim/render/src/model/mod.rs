//! A scene prepared for rendering: clusters of triangles under a box tree, and textures in all sizes, in a
//! single memory block that can be stored in a file.

mod build;
mod textures;
mod tree;

#[cfg(doc)]
use crate::lanes::LANES;
use std::io::{self, Write};
use std::ops::Range;
pub(crate) use textures::{BLOCK, LEVEL_BITS, NO_TEXTURE};
pub(crate) use tree::CLUSTER;

/// Corners of a cluster, at most.
pub(crate) const CORNERS: usize = 3 * CLUSTER;

/// Flag of triangles with holes, next to the corner numbers.
pub(crate) const HOLED: u32 = 1 << 24;

/// Sections of a model, in their order.
const SECTIONS: usize = 10;

/// Immutable render data of a scene, shared by threads.
pub struct Model {
    bytes: Box<dyn AsRef<[u8]> + Send + Sync>,
    /// Byte range of every section.
    sections: [Range<usize>; SECTIONS],
}

/// A model's lists.
#[derive(Clone, Copy, Default)]
pub(crate) struct ModelView<'a> {
    /// Boxes: smallest and largest corner as float bits, then the left child and 0, or a cluster and 1.
    pub(crate) nodes: &'a [[u32; 8]],
    pub(crate) clusters: &'a [Cluster],
    /// Per cluster: x of all corners in metres, padded to a multiple of [`LANES`], then y, then z.
    pub(crate) coordinates: &'a [f32],
    /// Texture coordinates and colours of corners, in cluster order: u and v as float bits, then RGB.
    pub(crate) corners: &'a [[u32; 3]],
    /// Per triangle: corners within the cluster, a byte each, and the surface.
    pub(crate) triangles: &'a [[u32; 2]],
    /// Material, instance.
    pub(crate) surfaces: &'a [[u32; 2]],
    /// Base colour RGBA; first texture level with the level count in the low [`LEVEL_BITS`] bits; alpha
    /// cutoff; 0.
    pub(crate) materials: &'a [[u32; 4]],
    /// Sizes of textures: first texel; width in the low 16 bits and height in the high.
    pub(crate) levels: &'a [Level],
    /// RGBA, in blocks of 4 by 4.
    pub(crate) texels: &'a [u32],
    /// Global values: background colour RGB; number of omitted triangles.
    pub(crate) whole: &'a [u32],
}

/// Start and size of a texture level; see [`View::levels`].
pub(crate) type Level = [u32; 2];

/// Start of the lists of a cluster: coordinate, corner, triangle; then triangle count in the low 16 bits and
/// corner count in the high.
pub(crate) type Cluster = [u32; 4];

impl Model {
    /// A model in `bytes` with validated sections.
    fn new(bytes: Box<dyn AsRef<[u8]> + Send + Sync>, sections: [Range<usize>; SECTIONS]) -> Self {
        Self { bytes, sections }
    }

    /// The model's lists.
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

    /// Count of visible triangles, without degenerate or invalid triangles.
    pub fn triangle_count(&self) -> usize {
        self.view().triangles.len()
    }

    /// Bytes that the triangles take, tree included.
    pub fn geometry_bytes(&self) -> usize {
        self.sections[..6].iter().map(ExactSizeIterator::len).sum()
    }

    /// Bytes that textures take in all their sizes.
    pub fn texture_bytes(&self) -> usize {
        self.sections[8].len()
    }

    /// All bytes of the model.
    pub fn byte_count(&self) -> usize {
        (*self.bytes).as_ref().len()
    }
}

const MAGIC: u32 = u32::from_le_bytes(*b"AVLN");
/// Version of the layout, the model construction and the light computation.
const VERSION: u32 = 2;
const HASH_WORDS: usize = 8;
const HEADER_WORDS: usize = 2 + SECTIONS + HASH_WORDS;
const WORD: usize = size_of::<u32>();
/// Words per entry of every section.
const ENTRY_WORDS: [usize; SECTIONS] = [8, 4, 1, 3, 2, 2, 4, 2, 1, 2];

/// Why bytes are not a model.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum ModelError {
    /// A different format or version.
    #[error(
        "it was not written by this version of the program (layout {found:#x}, expected {VERSION:#x}); delete it; the next start regenerates it"
    )]
    Foreign {
        /// Version found, or 0.
        found: u32,
    },
    /// Some are missing or changed.
    #[error("it is damaged: {0}; delete it; the next start regenerates it")]
    Damaged(&'static str),
}

impl Model {
    /// Version of the layout, the model construction and the light computation; other versions are rejected.
    pub const VERSION: u32 = VERSION;

    /// Reads a model written by [`Model::write`]; the bytes may be a mapped file.
    ///
    /// # Errors
    /// If the bytes have a different format, are truncated or modified.
    pub fn read(bytes: impl AsRef<[u8]> + Send + Sync + 'static) -> Result<Self, ModelError> {
        let sections = sections(bytes.as_ref())?;
        Ok(Self::new(Box::new(bytes), sections))
    }

    /// Writes the model's bytes.
    ///
    /// # Errors
    /// When `out` takes no more.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        out.write_all((*self.bytes).as_ref())
    }
}

/// Words with borrowable bytes.
struct Words(Vec<u32>);

impl AsRef<[u8]> for Words {
    fn as_ref(&self) -> &[u8] {
        bytemuck::cast_slice(&self.0)
    }
}

/// The model with these sections.
fn assemble(contents: &[&[u32]; SECTIONS]) -> Model {
    let mut words = vec![MAGIC, VERSION];
    words.extend(contents.iter().map(|section| section.len() as u32));
    let mut hasher = blake3::Hasher::new();
    contents.iter().for_each(|section| {
        hasher.update(bytemuck::cast_slice(section));
    });
    words.extend(hasher.finalize().as_bytes().as_chunks::<WORD>().0.iter().copied().map(u32::from_ne_bytes));
    contents.iter().for_each(|section| words.extend_from_slice(section));
    let lengths = contents.map(|section| section.len());
    Model::new(Box::new(Words(words)), ranges(lengths))
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
    let words: &[u32] =
        bytemuck::try_cast_slice(bytes).map_err(|_| ModelError::Damaged("its length or place is odd"))?;
    let (header, content) =
        words.split_at_checked(HEADER_WORDS).ok_or(ModelError::Damaged("its header is cut short"))?;
    if header[..2] != [MAGIC, VERSION] {
        return Err(ModelError::Foreign { found: if header[0] == MAGIC { header[1] } else { 0 } });
    }
    let lengths: [usize; SECTIONS] = std::array::from_fn(|section| header[2 + section] as usize);
    if lengths.iter().sum::<usize>() != content.len() {
        return Err(ModelError::Damaged("its length is not what its header tells"));
    }
    if lengths.iter().zip(ENTRY_WORDS).any(|(length, entry)| length % entry != 0) {
        return Err(ModelError::Damaged("a section is cut short"));
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
        model.write(&mut bytes).expect("memory takes all");
        bytes
    }

    /// Bytes at a word-aligned address.
    fn read(bytes: &[u8]) -> Result<Model, ModelError> {
        Model::read(Words(
            bytes.chunks(WORD).map(|word| word.iter().rev().fold(0, |w, &b| w << 8 | u32::from(b))).collect(),
        ))
    }

    #[test]
    fn what_was_written_is_read() {
        let bytes = bytes_of(&model());
        let again = read(&bytes).expect("a model");
        assert_eq!(bytes_of(&again), bytes);
        assert_eq!(again.view().nodes, [[1, 2, 3, 4, 5, 6, 7, 8]]);
        assert_eq!(again.view().corners, [[1, 2, 3]]);
    }

    /// Cached models are used as long as the version is equal, so a changed construction without a new
    /// version would show old images.
    #[test]
    fn models_that_are_built_otherwise_have_another_version() {
        let scene = Arc::new(house("kept", 21, &HouseOptions::small()));
        let rays = Arc::new(RayMesh::new(&scene.mesh.positions, &scene.mesh.triangles));
        let scene_digest = digest(&scene);
        let hash = blake3::hash(&bytes_of(Renderer::new(scene, rays).model())).to_hex();
        assert_eq!(
            (VERSION, &scene_digest[..16], &hash[..16]),
            (2, "bbeb170e584e1df0", "fc1757d96f69329c"),
            "where the house has not changed but its model has: count VERSION up; then write down what is found here"
        );
    }

    #[test]
    fn other_bytes_are_refused() {
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
