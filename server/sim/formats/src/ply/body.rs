//! The tables: numbers in text or binary, one after the other.

use super::header::{Format, Scalar};
use crate::files::Checked;

/// Reads numbers and knows where it is.
pub(super) struct Body<'a> {
    bytes: &'a [u8],
    at: usize,
    format: Format,
    /// Lines begun so far, in text.
    line: usize,
}

impl<'a> Body<'a> {
    /// Reads `bytes` from `at`, which is in line `line + 1`.
    pub(super) fn new(bytes: &'a [u8], at: usize, line: usize, format: Format) -> Self {
        Self { bytes, at, format, line: line + 1 }
    }

    pub(super) fn bytes_left(&self) -> usize {
        self.bytes.len() - self.at
    }

    /// Where the next number stands, for errors.
    pub(super) fn place(&self) -> String {
        match self.format {
            Format::Ascii => format!("line {}", self.line),
            _ => format!("byte {}", self.at),
        }
    }

    /// The next number; every type fits a double exactly.
    pub(super) fn number(&mut self, kind: Scalar) -> Checked<f64> {
        match self.format {
            Format::Ascii => self.word(),
            Format::LittleEndian => self.binary(kind, |bytes| bytes),
            Format::BigEndian => self.binary(kind, |mut bytes: [u8; 8]| {
                bytes[..kind.bytes()].reverse();
                bytes
            }),
        }
    }

    /// Passes over `count` numbers.
    pub(super) fn skip(&mut self, kind: Scalar, count: usize) -> Checked<()> {
        if self.format == Format::Ascii {
            return (0..count).try_for_each(|_| self.word().map(drop));
        }
        let end = count.checked_mul(kind.bytes()).and_then(|bytes| self.at.checked_add(bytes));
        self.at = end.filter(|&end| end <= self.bytes.len()).ok_or_else(|| self.cut())?;
        Ok(())
    }

    /// The length of a list.
    pub(super) fn length(&mut self, kind: Scalar) -> Checked<usize> {
        let place = self.place();
        let length = self.number(kind)?;
        if length < 0.0 || length.fract() != 0.0 || length > self.bytes_left() as f64 {
            return Err(format!("{place}: a list of {length} numbers does not fit; copy the file again"));
        }
        Ok(length as usize)
    }

    fn cut(&self) -> String {
        format!("{}: the file ends inside its tables; copy it again", self.place())
    }

    fn binary(&mut self, kind: Scalar, order: impl Fn([u8; 8]) -> [u8; 8]) -> Checked<f64> {
        let end = self.at + kind.bytes();
        let stored = self.bytes.get(self.at..end).ok_or_else(|| self.cut())?;
        let mut bytes = [0; 8];
        bytes[..stored.len()].copy_from_slice(stored);
        let bytes = order(bytes);
        self.at = end;
        let [a, b, c, d, ..] = bytes;
        Ok(match kind {
            Scalar::I8 => f64::from(a as i8),
            Scalar::U8 => f64::from(a),
            Scalar::I16 => f64::from(i16::from_le_bytes([a, b])),
            Scalar::U16 => f64::from(u16::from_le_bytes([a, b])),
            Scalar::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Scalar::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Scalar::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Scalar::F64 => f64::from_le_bytes(bytes),
        })
    }

    fn word(&mut self) -> Checked<f64> {
        while let Some(byte) = self.bytes.get(self.at).filter(|byte| byte.is_ascii_whitespace()) {
            self.line += usize::from(*byte == b'\n');
            self.at += 1;
        }
        let rest = &self.bytes[self.at..];
        let end = rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len());
        if end == 0 {
            return Err(self.cut());
        }
        let word = String::from_utf8_lossy(&rest[..end]);
        let number = word.parse().map_err(|_| {
            let start: String = word.chars().take(20).collect();
            format!("{}: {start:?} is not a number; export the file again", self.place())
        })?;
        self.at += end;
        Ok(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(bytes: &[u8], format: Format, kinds: &[Scalar]) -> Vec<f64> {
        let mut body = Body::new(bytes, 0, 0, format);
        let numbers = kinds.iter().map(|&kind| body.number(kind).unwrap()).collect();
        assert_eq!(body.bytes_left(), 0);
        numbers
    }

    #[test]
    fn every_type_is_read_in_both_byte_orders() {
        let kinds = [
            Scalar::I8,
            Scalar::U8,
            Scalar::I16,
            Scalar::U16,
            Scalar::I32,
            Scalar::U32,
            Scalar::F32,
            Scalar::F64,
        ];
        let expected = [-2.0, 254.0, -300.0, 65_000.0, -70_000.0, 4_000_000_000.0, 0.5, -1.0e300];
        let mut little = vec![0xfe, 0xfe];
        little.extend((-300_i16).to_le_bytes());
        little.extend(65_000_u16.to_le_bytes());
        little.extend((-70_000_i32).to_le_bytes());
        little.extend(4_000_000_000_u32.to_le_bytes());
        little.extend(0.5_f32.to_le_bytes());
        little.extend((-1.0e300_f64).to_le_bytes());
        assert_eq!(all(&little, Format::LittleEndian, &kinds), expected);
        let mut big = vec![0xfe, 0xfe];
        big.extend((-300_i16).to_be_bytes());
        big.extend(65_000_u16.to_be_bytes());
        big.extend((-70_000_i32).to_be_bytes());
        big.extend(4_000_000_000_u32.to_be_bytes());
        big.extend(0.5_f32.to_be_bytes());
        big.extend((-1.0e300_f64).to_be_bytes());
        assert_eq!(all(&big, Format::BigEndian, &kinds), expected);
        assert_eq!(all(b" 1\r\n -2.5\n3e2", Format::Ascii, &[Scalar::U8; 3]), [1.0, -2.5, 300.0]);
    }

    #[test]
    fn the_place_of_a_fault_is_named() {
        let mut text = Body::new(b"1\n2\nthree", 0, 7, Format::Ascii);
        text.skip(Scalar::U8, 2).unwrap();
        assert!(text.number(Scalar::U8).unwrap_err().starts_with("line 10: \"three\""));
        let mut binary = Body::new(&[9, 0], 0, 0, Format::LittleEndian);
        assert!(binary.length(Scalar::U8).unwrap_err().starts_with("byte 0: a list of 9"));
        assert!(binary.number(Scalar::U16).unwrap_err().starts_with("byte 1: the file ends"));
        assert!(binary.skip(Scalar::F64, usize::MAX).is_err());
    }
}
