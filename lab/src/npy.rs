//! NumPy's `.npy` format, version 1.0, little-endian.

use std::io::{self, Write};

/// Bytes before the header: magic string, version, and header length.
const PREAMBLE_BYTES: usize = 10;
const ALIGNMENT_BYTES: usize = 64;

/// Writes `rows × columns` four-byte numbers, row by row; `kind` is NumPy's type string.
///
/// # Errors
/// If `out` cannot be written.
pub fn write(
    mut out: impl Write,
    kind: &str,
    [rows, columns]: [u32; 2],
    values: impl Iterator<Item = [u8; 4]>,
) -> io::Result<()> {
    write_header(&mut out, &format!("'{kind}'"), &[rows as usize, columns as usize])?;
    out.write_all(&values.flatten().collect::<Vec<u8>>())
}

/// Writes an array's header; `kind` is NumPy's type description. The last dimension is contiguous.
///
/// # Errors
/// If `out` cannot be written.
pub(crate) fn write_header(mut out: impl Write, kind: &str, shape: &[usize]) -> io::Result<()> {
    let sides: Vec<String> = shape.iter().map(usize::to_string).collect();
    // A tuple with one element needs a comma in Python.
    let comma = if shape.len() == 1 { "," } else { "" };
    let shape = format!("({}{comma})", sides.join(", "));
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

    fn ids(shape: [u32; 2], ids: &[u32]) -> Vec<u8> {
        let mut file = Vec::new();
        write(&mut file, "<u4", shape, ids.iter().map(|id| id.to_le_bytes())).expect("writable memory");
        file
    }

    #[test]
    fn arrays_round_trip() {
        let depth = [0.0, 1.5, f32::MIN_POSITIVE, 3.25e7, -0.1, 7.0];
        let mut file = Vec::new();
        write(&mut file, "<f4", [2, 3], depth.iter().map(|m: &f32| m.to_le_bytes()))
            .expect("writable memory");
        let header = &file[..file.len() - 4 * depth.len()];
        assert!(header.len().is_multiple_of(ALIGNMENT_BYTES) && header.ends_with(b"\n"));
        assert!(String::from_utf8_lossy(header).contains("'fortran_order': False"));
        let (kind, shape, numbers) = read(&file).expect("an array");
        assert_eq!((kind.as_str(), shape), ("<f4", [2, 3]));
        assert_eq!(numbers.into_iter().map(f32::from_le_bytes).collect::<Vec<_>>(), depth);
        let (kind, shape, numbers) = read(&ids([1, 2], &[7, u32::MAX])).expect("an array");
        assert_eq!((kind.as_str(), shape), ("<u4", [1, 2]));
        assert_eq!(numbers.into_iter().map(u32::from_le_bytes).collect::<Vec<_>>(), [7, u32::MAX]);
    }

    #[test]
    fn headers_of_any_length_are_padded() {
        for shape in [[1, 1], [4096, 4096], [1, 1_000_000]] {
            let file = ids(shape, &vec![0; (shape[0] * shape[1]) as usize]);
            let (_, found, _) = read(&file).expect("an array");
            assert_eq!(found.map(|side| side as u32), shape);
        }
        let small = ids([1, 1], &[258]);
        assert_eq!((small.len(), &small[128..]), (132, &[2, 1, 0, 0][..]));
    }
}
