//! A writer for small SOFA files, also for tests in other crates: a subset of netCDF-4/HDF5 (The HDF Group,
//! "HDF5 File Format Specification 3.0").

/// A file table.
pub(crate) struct Table {
    pub(crate) name: &'static str,
    pub(crate) sizes: Vec<u64>,
    pub(crate) values: Vec<f64>,
    /// Coordinate type.
    pub(crate) kind: Option<&'static str>,
}

const SUPERBLOCK_BYTES: usize = 48;

/// Returns a file with these tables and the convention `conventions`.
pub(crate) fn file(conventions: &str, tables: &[Table]) -> Vec<u8> {
    let mut bytes = vec![0; SUPERBLOCK_BYTES];
    let mut links = Vec::new();
    for table in tables {
        let data = place(&mut bytes, table.values.iter().flat_map(|value| value.to_le_bytes()).collect());
        let mut messages = vec![
            message(1, dataspace(&table.sizes)),
            message(3, float64()),
            message(
                8,
                [
                    vec![3, 1],
                    data.to_le_bytes().to_vec(),
                    (8 * table.values.len() as u64).to_le_bytes().to_vec(),
                ]
                .concat(),
            ),
        ];
        messages.extend(table.kind.map(|kind| attribute("Type", kind)));
        links.push((table.name, place(&mut bytes, header(&messages))));
    }
    let heap = place(&mut bytes, heap_block(&links));
    let heap = place(&mut bytes, heap_header(heap));
    let link_info = [vec![0, 0], heap.to_le_bytes().to_vec(), u64::MAX.to_le_bytes().to_vec()].concat();
    let root = place(&mut bytes, header(&[message(2, link_info), attribute("Conventions", conventions)]));
    let end = bytes.len() as u64;
    let superblock = [
        b"\x89HDF\r\n\x1a\n\x02\x08\x08\x00".to_vec(),
        [0, u64::MAX, end, root].iter().flat_map(|address| address.to_le_bytes()).collect(),
    ];
    bytes[..44].copy_from_slice(&superblock.concat());
    bytes
}

/// Appends a part and returns the address.
fn place(bytes: &mut Vec<u8>, part: Vec<u8>) -> u64 {
    let address = bytes.len() as u64;
    bytes.extend(part);
    address
}

fn message(kind: u8, body: Vec<u8>) -> Vec<u8> {
    [vec![kind], (body.len() as u16).to_le_bytes().to_vec(), vec![0], body].concat()
}

/// Object header, version 2, without the checksum.
fn header(messages: &[Vec<u8>]) -> Vec<u8> {
    let messages = messages.concat();
    [b"OHDR\x02\x02".to_vec(), (messages.len() as u32).to_le_bytes().to_vec(), messages, vec![0; 4]].concat()
}

fn dataspace(sizes: &[u64]) -> Vec<u8> {
    let kind = if sizes.is_empty() { 0 } else { 1 };
    let sizes_bytes = sizes.iter().flat_map(|size| size.to_le_bytes()).collect();
    [vec![2, sizes.len() as u8, 0, kind], sizes_bytes].concat()
}

fn float64() -> Vec<u8> {
    let mut kind = vec![0x11, 0x20, 63, 0, 8, 0, 0, 0, 0, 0, 64, 0, 52, 11, 0, 52];
    kind.extend(1023_u32.to_le_bytes());
    kind
}

fn attribute(name: &str, text: &str) -> Vec<u8> {
    let name = [name.as_bytes(), b"\0"].concat();
    let kind = [vec![0x13, 0, 0, 0], (text.len() as u32).to_le_bytes().to_vec()].concat();
    let space = dataspace(&[]);
    let sizes = [name.len(), kind.len(), space.len()].map(|size| (size as u16).to_le_bytes()).concat();
    message(12, [vec![3, 0], sizes, vec![0], name, kind, space, text.as_bytes().to_vec()].concat())
}

/// A fractal heap block with links.
fn heap_block(links: &[(&str, u64)]) -> Vec<u8> {
    let mut block = b"FHDB\0".to_vec();
    block.extend([0; 12]);
    for (order, (name, address)) in links.iter().enumerate() {
        block.extend([1, 4]);
        block.extend((order as u64).to_le_bytes());
        block.push(name.len() as u8);
        block.extend(name.as_bytes());
        block.extend(address.to_le_bytes());
    }
    block.push(0);
    block
}

/// Header for a fractal heap with a single block: up to 2^32 bytes in blocks up to 64 KiB.
fn heap_header(block: u64) -> Vec<u8> {
    let mut header = b"FRHP\0\x08\0\0\0\0".to_vec();
    header.extend(65_536_u32.to_le_bytes());
    header.extend([0; 12 * 8]);
    header.extend(4_u16.to_le_bytes());
    header.extend(512_u64.to_le_bytes());
    header.extend(65_536_u64.to_le_bytes());
    header.extend(32_u16.to_le_bytes());
    header.extend(1_u16.to_le_bytes());
    header.extend(block.to_le_bytes());
    header.extend([0; 2 + 4]);
    header
}
