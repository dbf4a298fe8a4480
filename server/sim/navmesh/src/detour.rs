//! Habitat's navmesh files: a set of Detour tiles (`dtMeshHeader` version 7), little-endian. Layouts:
//! recastnavigation `Detour/Include/DetourNavMesh.h`, habitat-sim `src/esp/nav/PathFinder.cpp`.

use crate::mesh::{NavMesh, Parts, SHARED_M};
use crate::plane::{Lattice, LatticePoint, Spot, turn};
use crate::polygons::{MIN_POLYGON_M2, RawPolygon};
use crate::surface::{Detail, Surface};
use avln_geom::Point3;
use std::fmt::Display;
use std::ops::RangeInclusive;

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

const TILE_MAGIC: &[u8; 4] = b"VAND";
const TILE_VERSION: i64 = 7;
const MAX_COUNT: i64 = 1 << 22;
const LINK_BYTES: usize = 12;
/// Corner capacity of a polygon.
const CORNERS: usize = 6;
const WALKABLE: u16 = 1;
/// Flag for an edge into another tile.
const OUTSIDE: u16 = 0x8000;
// Largest inward turn at a straight corner by f32 rounding, cells squared.
const SLACK: f64 = 0.5;
const MAX_SIDE_CELLS: f64 = 60_000.0;
const MAX_CELLS: f64 = 3.0e7;
// Largest f32 rounding at a lattice corner, cells. Snapped back, corners coincide with their neighbours.
const ROUNDING_CELLS: f64 = 2e-3;

struct Counts {
    polygons: usize,
    corners: usize,
    links: usize,
    details: usize,
    detail_corners: usize,
    detail_triangles: usize,
}

struct Header {
    counts: Counts,
    height_m: f32,
    climb_m: f32,
    lattice: Lattice,
}

struct Stored {
    offset: usize,
    corners: Vec<usize>,
    walkable: bool,
}
struct Part {
    first_corner: usize,
    first_triangle: usize,
    triangles: usize,
}

fn read_tile(mut reader: Reader<'_>) -> Result<Parts, DetourError> {
    let header = header(&mut reader)?;
    let corners_at = reader.at;
    let places = corners(&mut reader, "a corner", header.counts.corners)?;
    check_extent(corners_at, &places, &header.lattice)?;
    let stored: Vec<_> =
        (0..header.counts.polygons).map(|_| polygon(&mut reader, places.len())).collect::<Result<_, _>>()?;
    reader.take("the links", header.counts.links * LINK_BYTES)?;
    let parts: Vec<_> = (0..header.counts.details).map(|_| part(&mut reader)).collect::<Result<_, _>>()?;
    let samples = corners(&mut reader, "a detail corner", header.counts.detail_corners)?;
    let triangles_at = reader.at;
    let triangles = reader.take("the detail triangles", header.counts.detail_triangles * 4)?;
    let tile = Tile { header, places, parts, samples, triangles, triangles_at };
    let mut raw = Vec::with_capacity(stored.len());
    for (index, polygon) in stored.iter().enumerate().filter(|(_, polygon)| polygon.walkable) {
        raw.push(tile.raw(index, polygon)?);
    }
    let lattice = tile.header.lattice;
    raw.retain(|polygon| polygon.has_three_sides() && polygon.detail_m2(&lattice) >= MIN_POLYGON_M2);
    if raw.is_empty() {
        return Err(DetourError::NoFloor { polygons: stored.len() });
    }
    Ok(Parts { lattice, headroom_m: tile.header.height_m, climb_m: tile.header.climb_m, raw })
}

fn header(reader: &mut Reader<'_>) -> Result<Header, DetourError> {
    reader.magic("the tile", TILE_MAGIC, "this is no Detour tile")?;
    reader.within("the tile version", TILE_VERSION..=TILE_VERSION)?;
    reader.take("the tile position", 16)?;
    let mut count = |what| reader.within(what, 0..=MAX_COUNT).map(|count| count as usize);
    let counts = Counts {
        polygons: count("the polygon count")?,
        corners: count("the corner count")?,
        links: count("the link count")?,
        details: count("the detail mesh count")?,
        detail_corners: count("the detail corner count")?,
        detail_triangles: count("the detail triangle count")?,
    };
    count("the tree node count")?;
    count("the off-mesh connection count")?;
    count("the first off-mesh connection")?;
    let height_m = reader.metres("the body height")?;
    reader.metres("the body radius")?;
    let climb_m = reader.metres("the body climb")?;
    let [x, y, z] = reader.corner("the lower tile bound")?;
    reader.corner("the upper tile bound")?;
    let offset = reader.at;
    let cells_per_m = reader.metres("the cells per metre")?;
    let sane = (0.01..=1e4).contains(&cells_per_m);
    demand(sane, "the cells per metre", offset, cells_per_m, "it must be 0.01 to 10000")?;
    let cell_m = 1.0 / cells_per_m;
    let lattice = Lattice { origin: Point3::new(x, y, z), cell_m, level_m: cell_m };
    Ok(Header { counts, height_m, climb_m, lattice })
}

fn corners(reader: &mut Reader<'_>, what: &'static str, count: usize) -> Result<Vec<[f32; 3]>, DetourError> {
    // The whole block must be present before memory is reserved: counts in a damaged file can be huge.
    let mut block = reader.part(what, count * 12)?;
    (0..count).map(|_| block.corner(what)).collect()
}

/// Rejects corners outside the tile, and tiles beyond any scene's size.
fn check_extent(offset: usize, places: &[[f32; 3]], lattice: &Lattice) -> Result<(), DetourError> {
    let mut reach = Spot::origin();
    for (index, &[x, y, z]) in places.iter().enumerate() {
        let spot = lattice.spot(&Point3::new(x, y, z));
        let inside = spot.x > -1.0 && spot.y > -1.0;
        let found = format_args!("({x}, {y}, {z})");
        demand(inside, "a corner", offset + 12 * index, found, "it must be inside the tile")?;
        reach = reach.sup(&spot);
    }
    let fits = reach.x.max(reach.y) < MAX_SIDE_CELLS && reach.x * reach.y < MAX_CELLS;
    let expected = format_args!("{MAX_SIDE_CELLS} a side and {MAX_CELLS} in all can be read");
    let found = format_args!("{:.0} x {:.0} cells", reach.x, reach.y);
    demand(fits, "the corner extent", offset, found, expected)
}

fn polygon(reader: &mut Reader<'_>, corners: usize) -> Result<Stored, DetourError> {
    let offset = reader.at;
    reader.take("a polygon", 4)?;
    let mut indices = [0; CORNERS];
    for index in &mut indices {
        *index = usize::from(reader.u16("a polygon corner")?);
    }
    let mut leaves = false;
    for _ in 0..CORNERS {
        leaves |= reader.u16("a polygon neighbour")? & OUTSIDE != 0;
    }
    let flags = reader.u16("the polygon flags")?;
    let count = usize::from(reader.u8("a polygon's corner count")?);
    let is_connection = reader.u8("the polygon kind")? >> 6 != 0;
    let has_place = count <= CORNERS && (is_connection || count >= 3);
    demand(has_place, "a polygon", offset, format_args!("one with {count} corners"), "3 to 6 can be read")?;
    let used = &indices[..count];
    if let Some(unknown) = used.iter().find(|&&index| index >= corners) {
        let expected = format_args!("there are {corners} corners");
        demand(false, "a polygon", offset, format_args!("one with corner {unknown}"), expected)?;
    }
    let whole = "tiles with neighbours cannot be read";
    demand(!leaves, "a polygon", offset, "one that leads to another tile", whole)?;
    Ok(Stored { offset, corners: used.to_vec(), walkable: flags & WALKABLE != 0 && !is_connection })
}

fn part(reader: &mut Reader<'_>) -> Result<Part, DetourError> {
    let mut first = |what| reader.within(what, 0..=MAX_COUNT).map(|first| first as usize);
    let first_corner = first("the first corner in a detail mesh")?;
    let first_triangle = first("the first triangle in a detail mesh")?;
    reader.u8("a detail mesh's corner count")?;
    let triangles = usize::from(reader.u8("a detail mesh's triangle count")?);
    reader.take("a detail mesh", 2)?;
    Ok(Part { first_corner, first_triangle, triangles })
}

struct Tile<'a> {
    header: Header,
    places: Vec<[f32; 3]>,
    parts: Vec<Part>,
    samples: Vec<[f32; 3]>,
    /// Three indices and a flag byte per triangle.
    triangles: &'a [u8],
    triangles_at: usize,
}

impl Tile<'_> {
    fn raw(&self, index: usize, polygon: &Stored) -> Result<RawPolygon, DetourError> {
        let corners: Vec<_> =
            polygon.corners.iter().map(|&corner| self.on_lattice(self.places[corner])).collect();
        let shape = "its corners must surround it once, turning one way";
        demand(is_convex(&corners), "a polygon", polygon.offset, "one that is not convex", shape)?;
        let Some(part) = self.parts.get(index) else {
            let detail = (1..corners.len() - 1).map(|i| [corners[0], corners[i], corners[i + 1]]).collect();
            return Ok(RawPolygon { corners, region: 0, detail });
        };
        let place = |local: u8| match corners.get(usize::from(local)) {
            Some(corner) => Some(*corner),
            None => {
                let sample = part.first_corner + usize::from(local) - corners.len();
                self.samples.get(sample).map(|&sample| self.corner(sample))
            }
        };
        let mut detail = Vec::with_capacity(part.triangles);
        for number in part.first_triangle..part.first_triangle + part.triangles {
            let bytes = self.triangles.get(number * 4..number * 4 + 3);
            let corners =
                bytes.and_then(|bytes| Some([place(bytes[0])?, place(bytes[1])?, place(bytes[2])?]));
            let offset = self.triangles_at + number * 4;
            let found =
                format_args!("number {number} of {}, with a missing corner", self.triangles.len() / 4);
            let expected = format_args!("polygon {index} needs it");
            demand(corners.is_some(), "a detail triangle", offset, found, expected)?;
            detail.extend(corners);
        }
        Ok(RawPolygon { corners, region: 0, detail })
    }

    fn corner(&self, [x, y, z]: [f32; 3]) -> LatticePoint {
        LatticePoint { spot: self.header.lattice.spot(&Point3::new(x, y, z)), height_m: f64::from(y) }
    }

    /// Returns a polygon corner, snapped to the lattice.
    fn on_lattice(&self, place: [f32; 3]) -> LatticePoint {
        let corner = self.corner(place);
        let snap =
            |value: f64| if (value - value.round()).abs() < ROUNDING_CELLS { value.round() } else { value };
        LatticePoint { spot: Spot::new(snap(corner.spot.x).max(0.0), snap(corner.spot.y).max(0.0)), ..corner }
    }
}

/// Returns true if the outline turns to one side, once; tolerates rounding.
fn is_convex(corners: &[LatticePoint]) -> bool {
    let spot = |index: usize| &corners[index % corners.len()].spot;
    let turns: Vec<_> = (0..corners.len()).map(|i| turn(spot(i), spot(i + 1), spot(i + 2))).collect();
    let area: f64 = (2..corners.len()).map(|i| turn(spot(0), spot(i - 1), spot(i))).sum();
    let fans = (2..corners.len()).map(|i| turn(spot(0), spot(i - 1), spot(i)));
    turns.into_iter().chain(fans).all(|turn| turn * area.signum() >= -SLACK)
}
