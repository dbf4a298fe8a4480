//! NumPy's `.npy` format, version 1.0, little-endian.

use std::io::{self, Write};

/// A number type of arrays.
pub trait Element: Copy {
    /// NumPy's type string.
    const KIND: &str;
    /// Returns the bytes, little-endian.
    fn bytes(self) -> [u8; 4];
}

impl Element for f32 {
    const KIND: &str = "<f4";
    fn bytes(self) -> [u8; 4] {
        self.to_le_bytes()
    }
}

impl Element for u32 {
    const KIND: &str = "<u4";
    fn bytes(self) -> [u8; 4] {
        self.to_le_bytes()
    }
}

/// Bytes before the header: magic string, version, and header length.
const PREAMBLE_BYTES: usize = 10;
/// Alignment of the numbers.
const ALIGNMENT_BYTES: usize = 64;

/// Writes `rows × columns` numbers, row by row.
///
/// # Errors
/// If `out` cannot be written.
pub fn write<T: Element>(
    mut out: impl Write,
    [rows, columns]: [u32; 2],
    values: impl Iterator<Item = T>,
) -> io::Result<()> {
    write_header(&mut out, &format!("'{}'", T::KIND), &format!("({rows}, {columns})"))?;
    let bytes: Vec<u8> = values.flat_map(T::bytes).collect();
    out.write_all(&bytes)
}

/// Writes the header for `count` packed records of `fields`: name, NumPy's type string, and shape in NumPy's notation.
///
/// # Errors
/// If `out` cannot be written.
pub(crate) fn write_record_header(
    out: impl Write,
    fields: &[(&str, &str, String)],
    count: usize,
) -> io::Result<()> {
    let fields = fields.iter().map(|(name, kind, shape)| format!("('{name}', '{kind}', {shape})"));
    let fields: Vec<String> = fields.collect();
    write_header(out, &format!("[{}]", fields.join(", ")), &format!("({count},)"))
}

/// Writes the header for an array; `kind` is NumPy's type string. The last dimension is contiguous.
///
/// # Errors
/// If `out` cannot be written.
pub(crate) fn write_array_header(out: impl Write, kind: &str, shape: &[usize]) -> io::Result<()> {
    let sides: Vec<String> = shape.iter().map(|side| format!("{side},")).collect();
    write_header(out, &format!("'{kind}'"), &format!("({})", sides.join(" ")))
}

fn write_header(mut out: impl Write, kind: &str, shape: &str) -> io::Result<()> {
    let mut header = format!("{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}");
    let whole = (PREAMBLE_BYTES + header.len() + 1).next_multiple_of(ALIGNMENT_BYTES);
    let length = whole - PREAMBLE_BYTES;
    header.extend(std::iter::repeat_n(' ', length - 1 - header.len()));
    header.push('\n');
    out.write_all(b"\x93NUMPY\x01\x00")?;
    out.write_all(&(length as u16).to_le_bytes())?;
    out.write_all(header.as_bytes())
}

/// Parses a two-dimensional array of four-byte numbers: type string, shape and bytes; `None` for other content.
pub fn read(file: &[u8]) -> Option<(String, [usize; 2], Vec<[u8; 4]>)> {
    let rest = file.strip_prefix(b"\x93NUMPY\x01\x00")?;
    let (length, rest) = rest.split_first_chunk()?;
    let (header, numbers) = rest.split_at_checked(usize::from(u16::from_le_bytes(*length)))?;
    let header = std::str::from_utf8(header).ok()?;
    let kind = header.split_once("'descr': '")?.1.split('\'').next()?.to_owned();
    let (rows, columns) = header.split_once("'shape': (")?.1.split(')').next()?.split_once(", ")?;
    let shape = [rows.parse().ok()?, columns.parse().ok()?];
    let (numbers, odd) = numbers.as_chunks::<4>();
    let is_whole = odd.is_empty() && numbers.len() == shape[0] * shape[1];
    is_whole.then(|| (kind, shape, numbers.to_vec()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written<T: Element>(shape: [u32; 2], values: &[T]) -> Vec<u8> {
        let mut file = Vec::new();
        write(&mut file, shape, values.iter().copied()).expect("memory can be written");
        file
    }

    #[test]
    fn arrays_round_trip() {
        let depth = [0.0, 1.5, f32::MIN_POSITIVE, 3.25e7, -0.1, 7.0];
        let file = written([2, 3], &depth);
        let header = &file[..file.len() - 4 * depth.len()];
        assert!(header.len().is_multiple_of(ALIGNMENT_BYTES) && header.ends_with(b"\n"));
        assert!(String::from_utf8_lossy(header).contains("'fortran_order': False"));
        let (kind, shape, numbers) = read(&file).expect("an array");
        assert_eq!((kind.as_str(), shape), ("<f4", [2, 3]));
        assert_eq!(numbers.into_iter().map(f32::from_le_bytes).collect::<Vec<_>>(), depth);
        let (kind, shape, numbers) = read(&written([1, 2], &[7_u32, u32::MAX])).expect("an array");
        assert_eq!((kind.as_str(), shape), ("<u4", [1, 2]));
        assert_eq!(numbers.into_iter().map(u32::from_le_bytes).collect::<Vec<_>>(), [7, u32::MAX]);
    }

    #[test]
    fn headers_of_any_length_are_padded() {
        for shape in [[1, 1], [4096, 4096], [1, 1_000_000]] {
            let file = written(shape, &vec![0_u32; (shape[0] * shape[1]) as usize]);
            let (_, found, _) = read(&file).expect("an array");
            assert_eq!(found.map(|side| side as u32), shape);
        }
        let small = written([1, 1], &[258_u32]);
        assert_eq!((small.len(), &small[128..]), (132, &[2, 1, 0, 0][..]));
    }
}
