//! Habitat's navmesh files: a set of Detour tiles (`dtMeshHeader` version 7), little-endian. Layouts:
//! recastnavigation `Detour/Include/DetourNavMesh.h`, habitat-sim `src/esp/nav/PathFinder.cpp`.

mod tile;

use crate::mesh::{NavMesh, Parts, SHARED_M};
use crate::surface::{Detail, Surface};
use std::fmt::Display;
use std::ops::RangeInclusive;
use tile::read_tile;

const SET_MAGIC: &[u8; 4] = b"TESM";
const SET_VERSIONS: RangeInclusive<i64> = 1..=2;
const PARAMETERS_BYTES: usize = 28;
/// Thirteen floats and three switches, padded.
const SETTINGS_BYTES: usize = 56;
const MAX_TILES: i64 = 1;

/// An unreadable Detour navmesh.
#[derive(Debug, thiserror::Error)]
pub enum DetourError {
    /// The file ends too early.
    #[error(
        "the navmesh file ends within {what}: {needed} bytes at byte {offset}, file size {length}; copy the file again"
    )]
    Truncated {
        /// Incomplete item.
        what: &'static str,
        /// Byte offset.
        offset: usize,
        /// Required bytes.
        needed: usize,
        /// File size, bytes.
        length: usize,
    },
    /// An unsupported value.
    #[error("{what} at byte {offset} is {found}; {expected}")]
    Value {
        /// Item.
        what: &'static str,
        /// Byte offset.
        offset: usize,
        /// Value found.
        found: String,
        /// Supported value.
        expected: String,
    },
    /// No walkable polygon.
    #[error("the navmesh file has {polygons} polygons but no walkable one (flag 1); build the navmesh again")]
    NoFloor {
        /// Polygon count.
        polygons: usize,
    },
}

impl NavMesh {
    /// Reads Habitat's `.navmesh` file, set versions 1 and 2: walkable polygons, heights and body size.
    ///
    /// # Errors
    /// If the bytes are invalid: item, offset and expected value.
    pub fn from_detour(bytes: &[u8]) -> Result<NavMesh, DetourError> {
        let parts = read(bytes)?;
        let surface = Surface::Detail(Detail::new(&parts.raw));
        Ok(Self::assemble(parts, surface, SHARED_M, f32::INFINITY))
    }
}

fn read(bytes: &[u8]) -> Result<Parts, DetourError> {
    let mut reader = Reader::new(bytes);
    let pointer = bytes.starts_with(b"version https://git-lfs");
    let hint =
        if pointer { "this is a Git LFS pointer, run `git lfs pull`" } else { "this is no navmesh set" };
    reader.magic("the navmesh set", SET_MAGIC, hint)?;
    let version = reader.within("the navmesh set version", SET_VERSIONS)?;
    reader.within("the tile count", 1..=MAX_TILES)?;
    reader.take("the navmesh set parameters", PARAMETERS_BYTES)?;
    if version == 2 {
        reader.take("the navmesh settings", SETTINGS_BYTES)?;
    }
    reader.take("the tile reference", 4)?;
    let size = reader.within("the tile size", 1..=i64::from(i32::MAX))?;
    let tile = reader.part("the tile", size as usize)?;
    read_tile(tile)
}

/// A front-to-back reader; errors contain offsets in the whole file.
struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    end: usize,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, end: bytes.len() }
    }

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

    /// Returns a reader for the next `needed` bytes.
    fn part(&mut self, what: &'static str, needed: usize) -> Result<Self, DetourError> {
        let at = self.at;
        self.take(what, needed)?;
        Ok(Self { bytes: self.bytes, at, end: self.at })
    }

    fn magic(&mut self, what: &'static str, magic: &[u8; 4], hint: &str) -> Result<(), DetourError> {
        let offset = self.at;
        let found = self.take(what, 4)?;
        let expected = format_args!("it must begin with {magic:02x?}: {hint}");
        demand(found == magic, what, offset, format_args!("{found:02x?}"), expected)
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

    /// Reads a 32-bit number within `range`.
    fn within(&mut self, what: &'static str, range: RangeInclusive<i64>) -> Result<i64, DetourError> {
        let offset = self.at;
        let found = i64::from(self.i32(what)?);
        let expected = format_args!("{} to {} can be read", range.start(), range.end());
        demand(range.contains(&found), what, offset, found, expected)?;
        Ok(found)
    }

    /// Reads a finite coordinate below a million metres.
    fn metres(&mut self, what: &'static str) -> Result<f32, DetourError> {
        let offset = self.at;
        let found = f32::from_bits(self.i32(what)?.cast_unsigned());
        let sane = found.is_finite() && found.abs() <= 1e6;
        demand(sane, what, offset, found, "it must be finite and below a million")?;
        Ok(found)
    }

    fn corner(&mut self, what: &'static str) -> Result<[f32; 3], DetourError> {
        Ok([self.metres(what)?, self.metres(what)?, self.metres(what)?])
    }
}

/// Returns an error for the value at `offset` unless `holds`.
fn demand(
    holds: bool,
    what: &'static str,
    offset: usize,
    found: impl Display,
    expected: impl Display,
) -> Result<(), DetourError> {
    let error =
        || DetourError::Value { what, offset, found: found.to_string(), expected: expected.to_string() };
    if holds { Ok(()) } else { Err(error()) }
}
