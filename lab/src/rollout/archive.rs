//! NumPy's `.npz` files: ZIP archives of `.npy` files, packed by deflate.

use crate::npy;
use flate2::{Compression, Crc, write::DeflateEncoder};
use std::io::{self, Write};

/// Version 2.0 of the format can do all that is used here.
const ZIP_VERSION: u16 = 20;
const DEFLATED: u16 = 8;
/// The first of January 1980, at midnight: the time of day does not change the bytes.
const DATE: u16 = 0x21;
/// Most bytes of a part that a deflate stream takes as it is.
const STORED_BYTES: usize = u16::MAX as usize;

/// An array that grows by items of the same shape.
pub(super) struct Array {
    name: String,
    kind: &'static str,
    item: Vec<usize>,
    count: usize,
    packed: DeflateEncoder<Vec<u8>>,
    check: Crc,
}

/// An archive that grows by members.
#[derive(Default)]
pub(super) struct Archive {
    bytes: Vec<u8>,
    directory: Vec<u8>,
    members: u16,
}

impl Array {
    /// An empty array; `kind` is NumPy's word for its numbers, `item` the shape of an item.
    pub(super) fn new(name: impl Into<String>, kind: &'static str, item: &[usize]) -> Self {
        let packed = DeflateEncoder::new(Vec::new(), Compression::fast());
        Self { name: name.into(), kind, item: item.to_vec(), count: 0, packed, check: Crc::new() }
    }

    /// Appends the bytes of an item, little-endian.
    pub(super) fn push(&mut self, item: &[u8]) -> io::Result<()> {
        self.count += 1;
        self.check.update(item);
        self.packed.write_all(item)
    }

    /// Appends numbers of four bytes.
    pub(super) fn push_f32(&mut self, item: &[f32]) -> io::Result<()> {
        let bytes: Vec<u8> = item.iter().flat_map(|number| number.to_le_bytes()).collect();
        self.push(&bytes)
    }
}

impl Archive {
    /// Adds an array. Its head, which tells how many items there are, goes before them as it is.
    pub(super) fn add(&mut self, array: Array) -> io::Result<()> {
        let shape: Vec<usize> = [array.count].into_iter().chain(array.item).collect();
        let mut head = Vec::new();
        npy::write_array_header(&mut head, array.kind, &shape)?;
        let mut check = Crc::new();
        check.update(&head);
        check.combine(&array.check);
        let packed = [stored(&head)?, array.packed.finish()?].concat();
        self.member(&format!("{}.npy", array.name), &packed, &check)
    }

    /// Adds a file as it is.
    pub(super) fn add_file(&mut self, name: &str, bytes: &[u8]) -> io::Result<()> {
        let (mut packed, mut check) = (DeflateEncoder::new(Vec::new(), Compression::default()), Crc::new());
        packed.write_all(bytes)?;
        check.update(bytes);
        self.member(name, &packed.finish()?, &check)
    }

    /// The whole archive.
    pub(super) fn finish(mut self) -> io::Result<Vec<u8>> {
        let (start, length) = (size(self.bytes.len())?, size(self.directory.len())?);
        self.bytes.append(&mut self.directory);
        self.bytes.extend(b"PK\x05\x06");
        push_all(&mut self.bytes, &[0, 0, self.members, self.members]);
        self.bytes.extend(length.to_le_bytes());
        self.bytes.extend(start.to_le_bytes());
        push_all(&mut self.bytes, &[0]);
        Ok(self.bytes)
    }

    fn member(&mut self, name: &str, packed: &[u8], check: &Crc) -> io::Result<()> {
        let mut facts = Vec::new();
        push_all(&mut facts, &[ZIP_VERSION, 0, DEFLATED, 0, DATE]);
        facts.extend(check.sum().to_le_bytes());
        facts.extend(size(packed.len())?.to_le_bytes());
        facts.extend(check.amount().to_le_bytes());
        push_all(&mut facts, &[name.len() as u16, 0]);
        let start = size(self.bytes.len())?;
        self.directory.extend(b"PK\x01\x02");
        push_all(&mut self.directory, &[ZIP_VERSION]);
        self.directory.extend(&facts);
        push_all(&mut self.directory, &[0; 5]);
        self.directory.extend(start.to_le_bytes());
        self.directory.extend(name.as_bytes());
        self.bytes.extend(b"PK\x03\x04");
        self.bytes.extend(facts);
        self.bytes.extend(name.as_bytes());
        self.bytes.extend(packed);
        self.members += 1;
        Ok(())
    }
}

/// A part of a deflate stream that is not its last: its length, the same inverted, and the bytes.
fn stored(bytes: &[u8]) -> io::Result<Vec<u8>> {
    let length = u16::try_from(bytes.len())
        .map_err(|_| io::Error::other(format!("a head of more than {STORED_BYTES} bytes")))?;
    let mut part = vec![0];
    push_all(&mut part, &[length, !length]);
    part.extend(bytes);
    Ok(part)
}

fn push_all(bytes: &mut Vec<u8>, numbers: &[u16]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}

/// Sizes and places are numbers of four bytes.
fn size(bytes: usize) -> io::Result<u32> {
    u32::try_from(bytes).map_err(|_| io::Error::other("an episode takes more than 4 GiB; ask for less"))
}
