//! Vertices and faces in a PLY file; `ply-rs-bw` reads the header and each row.

use crate::files::{Checked, ImportReport, refuse_if, too_many};
use avln_geom::{Point2, Point3};
use avln_scene::limits::{MAX_TRIANGLES, MAX_VERTICES};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};
use std::io::ErrorKind;

const MAX_HEADER_BYTES: usize = 1 << 16;
/// Bytes in a text row.
const MAX_LINE_BYTES: usize = 1 << 20;
const ENDS_EARLY: &str = "the file ends inside its tables; copy it again";
const MAX_POLYGON: usize = 4096;
/// Coordinate limit; larger ones are damage, in any unit.
const MAX_COORDINATE: f64 = 1.0e9;
const MAX_UV: f64 = 1.0e5;
/// Vertex columns in use, with their spellings; the position in this list is the index into a row.
const VERTEX_COLUMNS: [&[&str]; 9] = [
    &["x"],
    &["y"],
    &["z"],
    &["red", "diffuse_red", "r"],
    &["green", "diffuse_green", "g"],
    &["blue", "diffuse_blue", "b"],
    &["u", "s", "texture_u"],
    &["v", "t", "texture_v"],
    &["object_id", "objectId"],
];
const RED: usize = 3;
const U: usize = 6;
const OBJECT: usize = 8;
/// Spellings for a face's corner list, object number and segment number.
const CORNERS: [&str; 2] = ["vertex_indices", "vertex_index"];
const OBJECTS: [&str; 2] = ["object_id", "objectId"];
const SEGMENTS: [&str; 1] = ["face_material"];

/// A file's content: lists per vertex and lists per face.
#[derive(Default)]
pub(super) struct PlyTables {
    pub(super) positions: Vec<Point3<f32>>,
    pub(super) uvs: Vec<Point2<f32>>,
    pub(super) colors: Vec<[u8; 3]>,
    pub(super) has_uvs: bool,
    pub(super) is_coloured: bool,
    pub(super) vertex_objects: Option<Vec<i64>>,
    pub(super) face_objects: Option<Vec<i64>>,
    pub(super) face_segments: Option<Vec<i64>>,
    /// Image for the texture coordinates, from MeshLab's comment `TextureFile`.
    pub(super) texture: Option<String>,
    corners: Vec<u32>,
    /// End indices in `corners` per face.
    ends: Vec<u32>,
}

impl PlyTables {
    pub(super) fn read(bytes: &[u8], report: &mut ImportReport) -> Checked<Self> {
        let (header, mut rows) = read_header(bytes)?;
        let texture = header.comments.iter().rev().find_map(|comment| comment.strip_prefix("TextureFile"));
        let mut tables = Self { texture: texture.map(|name| name.trim().to_owned()), ..Self::default() };
        for element in header.elements.values() {
            rows.check_fits(element)?;
            match element.name.as_str() {
                "vertex" => tables.read_vertices(element, &mut rows)?,
                "face" => tables.read_faces(element, &mut rows, report)?,
                // Rows without columns take no bytes: the file size does not limit their number.
                _ if element.properties.is_empty() => {}
                _ => (0..element.count).try_for_each(|_| rows.next::<UnusedRow>(element).map(drop))?,
            }
        }
        // Faces may precede vertices in a file: corners are checked after all tables.
        tables.check_corners()?;
        Ok(tables)
    }

    pub(super) fn faces(&self) -> impl Iterator<Item = &[u32]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.corners[start as usize..end as usize])
    }

    fn read_vertices(&mut self, element: &ElementDef, rows: &mut RowCursor<'_>) -> Checked<()> {
        let scale_of = |column: usize| {
            let mut scales = VERTEX_COLUMNS[column].iter().filter_map(|name| scalar(element, name));
            scales.next().map(|kind| size(kind).1)
        };
        let has = |column: usize| scale_of(column).is_some();
        refuse_if(!(has(0) && has(1) && has(2)), || {
            "its vertices have no x, y and z; export the file again".into()
        })?;
        self.is_coloured = (RED..RED + 3).all(has);
        self.has_uvs = has(U) && has(U + 1);
        let color_scale: [f64; 3] =
            std::array::from_fn(|channel| 255.0 / scale_of(RED + channel).unwrap_or(1.0));
        let mut objects = Vec::new();
        for index in 0..element.count {
            let start = rows.position();
            let VertexRow { values } = rows.next(element)?;
            self.positions.push(position(&values).ok_or_else(|| {
                let place = rows.place(start);
                format!("{place}: vertex {index} has no usable position; repair the mesh in a 3D editor")
            })?);
            let uv = |value: f64| if value.abs() <= MAX_UV { value as f32 } else { 0.0 };
            let v = if self.has_uvs { 1.0 - uv(values[U + 1]) } else { 0.0 };
            self.uvs.push(Point2::new(uv(values[U]), v));
            let color = |channel: usize| (values[RED + channel] * color_scale[channel]).round() as u8;
            self.colors.push(if self.is_coloured { std::array::from_fn(color) } else { [255; 3] });
            objects.push(values[OBJECT] as i64);
        }
        self.vertex_objects = has(OBJECT).then_some(objects);
        Ok(())
    }

    fn read_faces(
        &mut self,
        element: &ElementDef,
        rows: &mut RowCursor<'_>,
        report: &mut ImportReport,
    ) -> Checked<()> {
        let is_whole = |kind: &ScalarType| !matches!(kind, ScalarType::Float | ScalarType::Double);
        let is_list = |kind: &PropertyType| matches!(kind, PropertyType::List(_, kind) if is_whole(kind));
        refuse_if(
            !CORNERS.iter().any(|name| element.properties.get(*name).is_some_and(|p| is_list(&p.data_type))),
            || "its faces have no list vertex_indices; export the file again".into(),
        )?;
        let has = |names: &[&str]| names.iter().any(|name| scalar(element, name).is_some());
        let mut objects = Vec::new();
        let mut segments = Vec::new();
        let mut triangles = 0;
        let mut degenerate = 0;
        for index in 0..element.count {
            let start = rows.position();
            let row: FaceRow = rows.next(element)?;
            let corners = row.corners.len();
            let fail = |reason: String| format!("{}: face {index} {reason}", rows.place(start));
            refuse_if(corners > MAX_POLYGON, || {
                fail(format!("has {corners} corners, at most {MAX_POLYGON} are read"))
            })?;
            if let Some(corner) = row.negative {
                return Err(fail(format!("refers to vertex {corner}; export the file again")));
            }
            triangles += corners.saturating_sub(2);
            degenerate += usize::from(corners < 3);
            refuse_if(triangles > MAX_TRIANGLES, || too_many(MAX_TRIANGLES, "triangles"))?;
            self.corners.extend(row.corners);
            self.ends.push(self.corners.len() as u32);
            objects.push(row.object);
            segments.push(row.segment);
        }
        if degenerate > 0 {
            report.warn(format!("{degenerate} faces have fewer than three corners and are left out"));
        }
        self.face_objects = has(&OBJECTS).then_some(objects);
        self.face_segments = has(&SEGMENTS).then_some(segments);
        Ok(())
    }

    fn check_corners(&self) -> Checked<()> {
        let count = self.positions.len();
        let Some(at) = self.corners.iter().position(|&corner| corner as usize >= count) else {
            return Ok(());
        };
        let (face, corner) = (self.ends.partition_point(|&end| end as usize <= at), self.corners[at]);
        Err(format!("face {face} refers to vertex {corner}, there are {count}; export the file again"))
    }
}

/// Reads the header; returns a cursor over the rows after it.
fn read_header(bytes: &[u8]) -> Checked<(Header, RowCursor<'_>)> {
    const END: &[u8] = b"end_header";
    // The library does not limit line length: a binary file without line ends would be copied as a whole.
    let start = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
    refuse_if(!start.windows(END.len()).any(|window| window == END), || {
        format!(
            "it is no PLY file, or its header does not end within {MAX_HEADER_BYTES} bytes; export it again"
        )
    })?;
    let mut reader = Reader::new(bytes);
    let header = Parser::<UnusedRow>::new()
        .read_header(&mut reader)
        .map_err(|error| format!("its header is damaged ({}); export the file again", in_one_line(&error)))?;
    let line = reader.line();
    let rows = RowCursor { rest: reader.into_inner(), size: bytes.len(), line, encoding: header.encoding };
    Ok((header, rows))
}

struct RowCursor<'a> {
    rest: &'a [u8],
    /// File size, bytes.
    size: usize,
    /// Next line number, in a text file.
    line: usize,
    encoding: Encoding,
}

impl RowCursor<'_> {
    /// Position of the next row: a line number, or a byte offset in a binary file.
    fn position(&self) -> usize {
        if self.encoding == Encoding::Ascii { self.line } else { self.size - self.rest.len() }
    }

    /// A position in words, for errors.
    fn place(&self, position: usize) -> String {
        let unit = if self.encoding == Encoding::Ascii { "line" } else { "byte" };
        format!("{unit} {position}")
    }

    fn next<R: PropertyAccess>(&mut self, element: &ElementDef) -> Checked<R> {
        let start = self.position();
        let parser = Parser::<R>::new();
        let row = match self.encoding {
            Encoding::Ascii => parser.read_ascii_element(self.text_line()?, element),
            Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut self.rest, element),
            Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut self.rest, element),
        };
        row.map_err(|error| {
            let place = self.place(start);
            match error.kind() {
                ErrorKind::UnexpectedEof => format!("{place}: {ENDS_EARLY}"),
                _ => format!("{place}: {}; export the file again", in_one_line(&error)),
            }
        })
    }

    /// The next line that is not blank.
    fn text_line(&mut self) -> Checked<&str> {
        loop {
            let place = self.line;
            refuse_if(self.rest.is_empty(), || format!("line {place}: {ENDS_EARLY}"))?;
            let window = &self.rest[..self.rest.len().min(MAX_LINE_BYTES)];
            let end = match window.iter().position(|&byte| byte == b'\n') {
                Some(end) => end + 1,
                None if window.len() == self.rest.len() => window.len(),
                None => {
                    return Err(format!(
                        "line {place} has more than {MAX_LINE_BYTES} bytes; export the file again"
                    ));
                }
            };
            let (line, rest) = self.rest.split_at(end);
            self.rest = rest;
            self.line += 1;
            let text = std::str::from_utf8(line)
                .map_err(|_| format!("line {place} is not text; export the file again"))?;
            if !text.trim().is_empty() {
                return Ok(text);
            }
        }
    }

    /// Refuses a table that cannot fit into the remaining bytes, before memory is reserved for it.
    fn check_fits(&self, element: &ElementDef) -> Checked<()> {
        let least_bytes = |kind: &PropertyType| match (self.encoding, kind) {
            // A digit and a blank.
            (Encoding::Ascii, _) => 2,
            (_, PropertyType::Scalar(kind) | PropertyType::List(kind, _)) => size(kind).0,
        };
        let row: usize = element.properties.values().map(|property| least_bytes(&property.data_type)).sum();
        // The last number in a text needs no blank after it.
        refuse_if(element.count.checked_mul(row).is_none_or(|least| least > self.rest.len() + 1), || {
            format!(
                "{}: {} rows of {:?} are announced and {} bytes left; copy the file again",
                self.place(self.position()),
                element.count,
                element.name,
                self.rest.len()
            )
        })?;
        refuse_if(element.name == "vertex" && element.count > MAX_VERTICES, || {
            too_many(MAX_VERTICES, "vertices")
        })?;
        Ok(())
    }
}

/// The library's message without line breaks, cut where it quotes a long line.
fn in_one_line(error: &ParseError) -> String {
    const MAX_CHARS: usize = 200;
    let words: Vec<String> = error.to_string().split_whitespace().map(str::to_owned).collect();
    let text: String = words.join(" ").chars().take(MAX_CHARS).collect();
    text.trim_end_matches('.').to_owned()
}

struct UnusedRow;

impl PropertyAccess for UnusedRow {
    fn new() -> Self {
        Self
    }
}

struct VertexRow {
    values: [f64; VERTEX_COLUMNS.len()],
}

impl PropertyAccess for VertexRow {
    fn new() -> Self {
        Self { values: [0.0; VERTEX_COLUMNS.len()] }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if let (Some(column), Some(value)) = (vertex_column(name), number(&property)) {
            self.values[column] = value;
        }
        PropertyAccessResult::Set
    }
}

#[derive(Default)]
struct FaceRow {
    corners: Vec<u32>,
    /// A corner that is no vertex number.
    negative: Option<i64>,
    object: i64,
    segment: i64,
}

impl PropertyAccess for FaceRow {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let value = number(&property);
        if OBJECTS.contains(&name) {
            self.object = value.map_or(self.object, |value| value as i64);
        } else if SEGMENTS.contains(&name) {
            self.segment = value.map_or(self.segment, |value| value as i64);
        } else if CORNERS.contains(&name) {
            match property {
                Property::ListInt(corners) => self.set_corners(corners),
                Property::ListUInt(corners) => self.set_corners(corners),
                Property::ListUShort(corners) => self.set_corners(corners),
                Property::ListShort(corners) => self.set_corners(corners),
                Property::ListUChar(corners) => self.set_corners(corners),
                Property::ListChar(corners) => self.set_corners(corners),
                _ => {}
            }
        }
        PropertyAccessResult::Set
    }
}

impl FaceRow {
    fn set_corners<T: Copy>(&mut self, corners: Vec<T>)
    where
        i64: From<T>,
    {
        self.negative = corners.iter().map(|&corner| i64::from(corner)).find(|&corner| corner < 0);
        self.corners = corners.into_iter().map(|corner| i64::from(corner) as u32).collect();
    }
}

fn vertex_column(name: &str) -> Option<usize> {
    VERTEX_COLUMNS.iter().position(|names| names.contains(&name))
}

/// A scalar column's value; every number type fits a double exactly.
fn number(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(value) => f64::from(value),
        Property::UChar(value) => f64::from(value),
        Property::Short(value) => f64::from(value),
        Property::UShort(value) => f64::from(value),
        Property::Int(value) => f64::from(value),
        Property::UInt(value) => f64::from(value),
        Property::Float(value) => f64::from(value),
        Property::Double(value) => value,
        _ => return None,
    })
}

fn scalar<'a>(element: &'a ElementDef, name: &str) -> Option<&'a ScalarType> {
    match &element.properties.get(name)?.data_type {
        PropertyType::Scalar(kind) => Some(kind),
        PropertyType::List(..) => None,
    }
}

/// Bytes per number, and the stored number for full colour intensity.
fn size(kind: &ScalarType) -> (usize, f64) {
    match kind {
        ScalarType::Char => (1, 127.0),
        ScalarType::UChar => (1, 255.0),
        ScalarType::Short => (2, 32_767.0),
        ScalarType::UShort => (2, 65_535.0),
        // Colours in wide whole numbers are bytes nevertheless.
        ScalarType::Int | ScalarType::UInt => (4, 255.0),
        ScalarType::Float => (4, 1.0),
        ScalarType::Double => (8, 1.0),
    }
}

fn position(values: &[f64; VERTEX_COLUMNS.len()]) -> Option<Point3<f32>> {
    let position = [values[0], values[1], values[2]];
    let usable = position.iter().all(|value| value.abs() <= MAX_COORDINATE);
    usable.then(|| Point3::from(position.map(|value| value as f32)))
}
