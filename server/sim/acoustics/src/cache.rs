//! A persistent cache for source data in a binary format: little-endian number lists with length prefixes.

use std::sync::Arc;

/// A persistent cache for source data between program runs.
pub trait SoundCache: Send + Sync {
    /// Returns the bytes stored as `name`, if present and intact.
    fn load_sound(&self, name: &str) -> Option<Vec<u8>>;
    /// Stores bytes; failures are ignored.
    fn store_sound(&self, name: &str, bytes: &[u8]);
}

/// A building's part in a cache.
#[derive(Clone)]
pub struct BuildingCache {
    /// The cache.
    pub cache: Arc<dyn SoundCache>,
    /// Building name, unique per content and surfaces.
    pub name: String,
}

// Increment whenever equal positions in equal buildings would give different bytes.
pub(crate) const VERSION: u32 = 5;

#[derive(Default)]
pub(crate) struct Writer {
    pub(crate) bytes: Vec<u8>,
}

impl Writer {
    pub(crate) fn words(&mut self, words: &[u32]) {
        self.length(words.len());
        words.iter().for_each(|word| self.bytes.extend(word.to_le_bytes()));
    }

    pub(crate) fn halves(&mut self, halves: &[u16]) {
        self.length(halves.len());
        halves.iter().for_each(|half| self.bytes.extend(half.to_le_bytes()));
    }

    fn length(&mut self, length: usize) {
        self.bytes.extend((length as u32).to_le_bytes());
    }
}

/// A list reader; `None` if the bytes end too early.
pub(crate) struct Reader<'a> {
    bytes: &'a [u8],
}

impl<'a> Reader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    pub(crate) fn words(&mut self) -> Option<Vec<u32>> {
        let words = self.list(4)?.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word));
        Some(words.collect())
    }

    pub(crate) fn halves(&mut self) -> Option<Vec<u16>> {
        let halves = self.list(2)?.as_chunks().0.iter().map(|half| u16::from_le_bytes(*half));
        Some(halves.collect())
    }

    pub(crate) fn is_at_end(&self) -> bool {
        self.bytes.is_empty()
    }

    fn list(&mut self, size: usize) -> Option<&'a [u8]> {
        let (length, rest) = self.bytes.split_first_chunk()?;
        let (list, rest) =
            rest.split_at_checked((u32::from_le_bytes(*length) as usize).checked_mul(size)?)?;
        self.bytes = rest;
        Some(list)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_round_trip_and_truncated_bytes_fail() {
        let mut writer = Writer::default();
        writer.words(&[7, u32::MAX]);
        writer.halves(&[]);
        writer.halves(&[3, 65_535, 1]);
        let mut reader = Reader::new(&writer.bytes);
        assert_eq!(reader.words().as_deref(), Some(&[7, u32::MAX][..]));
        assert_eq!(reader.halves().as_deref(), Some(&[][..]));
        assert!(!reader.is_at_end());
        assert_eq!(reader.halves().as_deref(), Some(&[3, 65_535, 1][..]));
        assert!(reader.is_at_end() && reader.words().is_none());
        for end in 0..12 {
            assert!(Reader::new(&writer.bytes[..end]).words().is_none());
        }
    }
}
