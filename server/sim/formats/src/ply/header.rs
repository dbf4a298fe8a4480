//! The text part: which elements follow, and how they are written.

use crate::files::Checked;

const MAX_HEADER_BYTES: usize = 1 << 16;
const MAX_ELEMENTS: usize = 64;
const MAX_PROPERTIES: usize = 256;

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// The type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn from_name(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The largest number of a whole type; 1 for the others. Colours are stored as shares of it.
    pub(super) fn full_scale(self) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32_767.0,
            Self::U16 => 65_535.0,
            // Colours in wide numbers are bytes nevertheless.
            Self::I32 | Self::U32 => 255.0,
            Self::F32 | Self::F64 => 1.0,
        }
    }
}

/// A column of an element: a number, or a list whose length is written as `length`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: Scalar,
    pub(super) length: Option<Scalar>,
}

/// A table.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// Bytes that a row has at least; in text a digit and a blank for each number.
    pub(super) fn least_row_bytes(&self, format: Format) -> usize {
        let bytes = |property: &Property| match format {
            Format::Ascii => 2,
            _ => property.length.unwrap_or(property.kind).bytes(),
        };
        self.properties.iter().map(bytes).sum()
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) format: Format,
    pub(super) elements: Vec<Element>,
    /// Name of the picture that texture coordinates refer to, as MeshLab writes it into a comment.
    pub(super) texture: Option<String>,
    /// Where the tables begin, bytes.
    pub(super) body: usize,
    /// Lines of the header.
    pub(super) lines: usize,
}

/// Reads the header of `bytes`.
pub(super) fn parse(bytes: &[u8]) -> Checked<Header> {
    let mut reader = Lines { bytes: &bytes[..bytes.len().min(MAX_HEADER_BYTES)], at: 0, number: 0 };
    if reader.next().as_deref() != Some("ply") {
        return Err("line 1 is not \"ply\"; take a PLY file".to_owned());
    }
    let mut format = None;
    let mut texture = None;
    let mut elements: Vec<Element> = Vec::new();
    loop {
        let line = reader.next().ok_or_else(|| {
            format!("line {}: the header ends without \"end_header\"; copy the file again", reader.number + 1)
        })?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let fail = |what: &str| format!("line {}: {line:?} {what}; export the file again", reader.number);
        match words[..] {
            ["end_header"] => break,
            ["format", name, _] => {
                format = Some(format_of(name).ok_or_else(|| fail("names an unknown format"))?)
            }
            ["comment", "TextureFile", ..] => {
                texture = line.split_once("TextureFile").map(|(_, name)| name.trim().to_owned())
            }
            ["comment" | "obj_info", ..] | [] => {}
            ["element", name, count] if elements.len() < MAX_ELEMENTS => elements.push(Element {
                name: name.to_owned(),
                count: count.parse().map_err(|_| fail("gives no number of rows"))?,
                properties: Vec::new(),
            }),
            ["property", ..] => {
                let element = elements.last_mut().filter(|element| element.properties.len() < MAX_PROPERTIES);
                let element = element.ok_or_else(|| fail("belongs to no element, or is one too many"))?;
                element.properties.push(property(&words).ok_or_else(|| fail("is no property"))?);
            }
            _ => return Err(fail("is not understood")),
        }
    }
    let format = format.ok_or("the header names no format; export the file again")?;
    Ok(Header { format, elements, texture, body: reader.at, lines: reader.number })
}

fn format_of(name: &str) -> Option<Format> {
    match name {
        "ascii" => Some(Format::Ascii),
        "binary_little_endian" => Some(Format::LittleEndian),
        "binary_big_endian" => Some(Format::BigEndian),
        _ => None,
    }
}

fn property(words: &[&str]) -> Option<Property> {
    let (length, kind, name) = match *words {
        ["property", "list", length, kind, name] => (Some(Scalar::from_name(length)?), kind, name),
        ["property", kind, name] => (None, kind, name),
        _ => return None,
    };
    Some(Property { name: name.to_owned(), kind: Scalar::from_name(kind)?, length })
}

/// Lines that end in `\n`, `\r\n` or `\r`.
struct Lines<'a> {
    bytes: &'a [u8],
    at: usize,
    number: usize,
}

impl Lines<'_> {
    fn next(&mut self) -> Option<String> {
        let rest = self.bytes.get(self.at..)?;
        let end = rest.iter().position(|byte| matches!(byte, b'\n' | b'\r'))?;
        let line = String::from_utf8_lossy(&rest[..end]).trim().to_owned();
        self.at += end + if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
        self.number += 1;
        Some(line)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "ply\r\nformat ascii 1.0\r\ncomment TextureFile my room.png\r\nelement vertex 3\r\n\
        property float x\r\nelement face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n1 2 3";

    #[test]
    fn a_header_with_carriage_returns_is_read() {
        let header = parse(TEXT.as_bytes()).unwrap();
        assert_eq!((header.format, header.lines), (Format::Ascii, 8));
        assert_eq!(header.texture.as_deref(), Some("my room.png"));
        assert_eq!(&TEXT.as_bytes()[header.body..], b"1 2 3");
        assert_eq!(header.elements[1].properties[0].length, Some(Scalar::U8));
        assert_eq!(header.elements[1].least_row_bytes(Format::LittleEndian), 1);
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, expected) in [
            ("glTF", "line 1"),
            ("ply\nformat ascii 1.0\n", "line 3: the header ends"),
            ("ply\nformat utf 1.0\nend_header\n", "line 2"),
            ("ply\nelement vertex -1\nend_header\n", "line 2"),
            ("ply\nproperty float x\nend_header\n", "line 2"),
            ("ply\nelement vertex 1\nproperty quaternion x\nend_header\n", "line 3"),
            ("ply\nend_header\n", "names no format"),
        ] {
            let error = parse(text.as_bytes()).unwrap_err();
            assert!(error.contains(expected), "{text:?}: {error}");
        }
    }
}
