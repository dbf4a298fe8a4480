use super::DetourError;
use std::ops::RangeInclusive;

/// Bytes read front to back; errors name places in the whole file.
pub(super) struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
    end: usize,
}

impl<'a> Reader<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0, end: bytes.len() }
    }

    /// Offset of the next byte in the file.
    pub(super) fn at(&self) -> usize {
        self.at
    }

    pub(super) fn take(&mut self, what: &'static str, needed: usize) -> Result<&'a [u8], DetourError> {
        let (offset, length) = (self.at, self.end);
        let end = offset.checked_add(needed).filter(|&end| end <= length);
        let end = end.ok_or(DetourError::Truncated { what, offset, needed, length })?;
        self.at = end;
        Ok(&self.bytes[offset..end])
    }

    /// The next `needed` bytes as a reader of their own.
    pub(super) fn part(&mut self, what: &'static str, needed: usize) -> Result<Self, DetourError> {
        let at = self.at;
        self.take(what, needed)?;
        Ok(Self { bytes: self.bytes, at, end: self.at })
    }

    pub(super) fn magic(
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

    pub(super) fn u8(&mut self, what: &'static str) -> Result<u8, DetourError> {
        Ok(self.take(what, 1)?[0])
    }

    pub(super) fn u16(&mut self, what: &'static str) -> Result<u16, DetourError> {
        let bytes = self.take(what, 2)?;
        Ok(u16::from_le_bytes([bytes[0], bytes[1]]))
    }

    pub(super) fn i32(&mut self, what: &'static str) -> Result<i32, DetourError> {
        let bytes = self.take(what, 4)?;
        Ok(i32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    }

    /// A 32-bit number within `range`.
    pub(super) fn within(
        &mut self,
        what: &'static str,
        range: RangeInclusive<i64>,
    ) -> Result<i64, DetourError> {
        let offset = self.at;
        let found = i64::from(self.i32(what)?);
        let expected = || format!("{} to {} can be read", range.start(), range.end());
        self.demand(range.contains(&found), what, offset, found.to_string(), expected)?;
        Ok(found)
    }

    /// A finite float within a million metres.
    pub(super) fn metres(&mut self, what: &'static str) -> Result<f32, DetourError> {
        let offset = self.at;
        let found = f32::from_bits(self.i32(what)?.cast_unsigned());
        let sane = found.is_finite() && found.abs() <= 1e6;
        self.demand(sane, what, offset, found.to_string(), || {
            "it must be finite and below a million".into()
        })?;
        Ok(found)
    }

    pub(super) fn corner(&mut self, what: &'static str) -> Result<[f32; 3], DetourError> {
        Ok([self.metres(what)?, self.metres(what)?, self.metres(what)?])
    }

    /// An error about the value at `offset` unless it `holds`.
    pub(super) fn demand(
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
