//! Reads navmeshes as Habitat saves them: a set of Detour tiles (`dtMeshHeader` version 7), all little-endian.
//! Layouts: recastnavigation `Detour/Include/DetourNavMesh.h`, habitat-sim `src/esp/nav/PathFinder.cpp`.

mod tile;

use crate::mesh::{NavMesh, Parts, SHARED_M};
use crate::surface::{Detail, Surface};
use std::ops::RangeInclusive;
use tile::read_tile;

const SET_MAGIC: &[u8; 4] = b"TESM";
const SET_VERSIONS: RangeInclusive<i64> = 1..=2;
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

impl NavMesh {
    /// Reads a Detour navmesh saved by Habitat (`.navmesh`, set versions 1 and 2): walkable polygons,
    /// heights, and body size.
    ///
    /// # Errors
    /// If the bytes are invalid: the item, its offset and the expected value.
    pub fn from_detour(bytes: &[u8]) -> Result<NavMesh, DetourError> {
        let parts = read(bytes)?;
        let surface = Surface::Detail(Detail::new(&parts.raw));
        Ok(Self::assemble(parts, surface, SHARED_M, f32::INFINITY))
    }
}

/// Reads a set with a single tile.
fn read(bytes: &[u8]) -> Result<Parts, DetourError> {
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
    read_tile(tile)
}

/// Bytes read front to back; errors name places in the whole file.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    end: usize,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, end: bytes.len() }
    }

    /// Offset of the next byte in the file.
    fn at(&self) -> usize {
        self.at
    }

    fn take(&mut self, what: &'static str, needed: usize) -> Result<&'a [u8], DetourError> {
        let (offset, length) = (self.at, self.end);
        let end = offset.checked_add(needed).filter(|&end| end <= length);
        let end = end.ok_or(DetourError::Truncated { what, offset, needed, length })?;
        self.at = end;
        Ok(&self.bytes[offset..end])
    }

    /// The next `needed` bytes as a reader of their own.
    fn part(&mut self, what: &'static str, needed: usize) -> Result<Self, DetourError> {
        let at = self.at;
        self.take(what, needed)?;
        Ok(Self { bytes: self.bytes, at, end: self.at })
    }

    fn magic(
        &mut self,
        what: &'static str,
        expected: &[u8; 4],
        hint: &'static str,
    ) -> Result<(), DetourError> {
        let offset = self.at;
        let found = self.take(what, 4)?;
        if found == expected {
            return Ok(());
        }
        Err(DetourError::Magic { what, offset, found: found.to_vec(), expected: *expected, hint })
    }

    fn u8(&mut self, what: &'static str) -> Result<u8, DetourError> {
        Ok(self.take(what, 1)?[0])
    }

    fn u16(&mut self, what: &'static str) -> Result<u16, DetourError> {
        let bytes = self.take(what, 2)?;
        Ok(u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    fn i32(&mut self, what: &'static str) -> Result<i32, DetourError> {
        let bytes = self.take(what, 4)?;
        Ok(i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    /// A 32-bit number within `range`.
    fn within(&mut self, what: &'static str, range: RangeInclusive<i64>) -> Result<i64, DetourError> {
        let offset = self.at;
        let found = i64::from(self.i32(what)?);
        let expected = || format!("{} to {} can be read", range.start(), range.end());
        self.demand(range.contains(&found), what, offset, found.to_string(), expected)?;
        Ok(found)
    }

    /// A finite float within a million metres.
    fn metres(&mut self, what: &'static str) -> Result<f32, DetourError> {
        let offset = self.at;
        let found = f32::from_bits(self.i32(what)?.cast_unsigned());
        let sane = found.is_finite() && found.abs() <= 1e6;
        self.demand(sane, what, offset, found.to_string(), || {
            "it must be finite and below a million".into()
        })?;
        Ok(found)
    }

    fn corner(&mut self, what: &'static str) -> Result<[f32; 3], DetourError> {
        Ok([self.metres(what)?, self.metres(what)?, self.metres(what)?])
    }

    /// An error about the value at `offset` unless it `holds`.
    fn demand(
        &self,
        holds: bool,
        what: &'static str,
        offset: usize,
        found: String,
        expected: impl FnOnce() -> String,
    ) -> Result<(), DetourError> {
        if holds { Ok(()) } else { Err(DetourError::Value { what, offset, found, expected: expected() }) }
    }
}
