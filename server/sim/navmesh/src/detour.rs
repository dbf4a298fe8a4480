//! Reads navmeshes as Habitat saves them: a set of Detour tiles (`dtMeshHeader` version 7), all little-endian.
//! Layouts: recastnavigation `Detour/Include/DetourNavMesh.h`, habitat-sim `src/esp/nav/PathFinder.cpp`.

mod bytes;
mod tile;

use crate::mesh::Parts;
use bytes::Reader;

const SET_MAGIC: &[u8; 4] = b"TESM";
const SET_VERSIONS: std::ops::RangeInclusive<i64> = 1..=2;
const PARAMETERS_BYTES: usize = 28;
/// Thirteen floats and three switches, padded.
const SETTINGS_BYTES: usize = 56;
const MAX_TILES: i64 = 1;

/// Why bytes are not a Detour navmesh.
#[derive(Debug, thiserror::Error)]
pub enum DetourError {
    /// The file ends too early.
    #[error(
        "the navmesh file ends within {what}: {needed} bytes from byte {offset} on, of {length}; copy the file again"
    )]
    Truncated {
        /// Item being read.
        what: &'static str,
        /// Offset of the item.
        offset: usize,
        /// Required bytes.
        needed: usize,
        /// File size in bytes.
        length: usize,
    },
    /// Another kind of file.
    #[error("{what} at byte {offset} begins with {found:02x?} where {expected:02x?} belongs{hint}")]
    Magic {
        /// Item being read.
        what: &'static str,
        /// Offset of the item.
        offset: usize,
        /// Bytes found.
        found: Vec<u8>,
        /// Expected bytes.
        expected: [u8; 4],
        /// Alternative explanation; empty or a continuation of the sentence.
        hint: &'static str,
    },
    /// A number that cannot be.
    #[error("{what} at byte {offset} is {found}; {expected}")]
    Value {
        /// Item being read.
        what: &'static str,
        /// Offset of the item.
        offset: usize,
        /// Value found.
        found: String,
        /// Supported value.
        expected: String,
    },
    /// No polygon can be walked on.
    #[error(
        "the navmesh file holds {polygons} polygons, none of which can be walked on (flag 1); build it again"
    )]
    NoFloor {
        /// Polygon count.
        polygons: usize,
    },
}

/// Reads a set with a single tile.
pub(crate) fn read(bytes: &[u8]) -> Result<Parts, DetourError> {
    let mut reader = Reader::new(bytes);
    let pointer = bytes.starts_with(b"version https://git-lfs");
    let hint = if pointer { ": a Git LFS pointer, run `git lfs pull`" } else { ": not a navmesh set" };
    reader.magic("the navmesh set", SET_MAGIC, hint)?;
    let version = reader.within("the version of the navmesh set", SET_VERSIONS)?;
    reader.within("the number of tiles", 1..=MAX_TILES)?;
    reader.take("the parameters of the navmesh set", PARAMETERS_BYTES)?;
    if version == 2 {
        reader.take("the navmesh settings", SETTINGS_BYTES)?;
    }
    reader.take("the reference of the tile", 4)?;
    let size = reader.within("the size of the tile", 1..=i64::from(i32::MAX))?;
    let tile = reader.part("the tile", size as usize)?;
    tile::read(tile)
}
