//! A writer of FLAC files (RFC 9639) without compression: mono, constant blocks, no prediction.

/// Samples of a block.
const BLOCK: usize = 4096;

/// The file of `samples`, -1 to 1, in `bits` of 16 or 24.
pub(super) fn encoded(samples: &[f32], rate_hz: u32, bits: u32) -> Vec<u8> {
    let mut file = b"fLaC".to_vec();
    // The only and last metadata block: stream info, 34 bytes.
    file.extend([0x80, 0, 0, 34]);
    let mut facts = Bits::default();
    facts.put(BLOCK as u64, 16);
    facts.put(BLOCK as u64, 16);
    facts.put(0, 48);
    facts.put(u64::from(rate_hz), 20);
    facts.put(0, 3);
    facts.put(u64::from(bits - 1), 5);
    facts.put(samples.len() as u64, 36);
    file.extend(facts.bytes);
    file.extend([0; 16]);
    for (number, block) in samples.chunks(BLOCK).enumerate() {
        file.extend(frame(number, block, bits));
    }
    file
}

fn frame(number: usize, samples: &[f32], bits: u32) -> Vec<u8> {
    let mut frame = Bits::default();
    frame.put(0xfff8, 16);
    // Block size in 16 bits at the end of the header; rate from the stream info.
    frame.put(0b0111_0000, 8);
    frame.put(0, 4);
    frame.put(if bits == 16 { 0b100 } else { 0b110 }, 3);
    frame.put(0, 1);
    assert!(number < 128, "a number of one byte");
    frame.put(number as u64, 8);
    frame.put(samples.len() as u64 - 1, 16);
    let header_check = checksum(&frame.bytes, 0x07, 8);
    frame.put(header_check, 8);
    // A subframe of plain samples.
    frame.put(0b0000_0010, 8);
    let full_scale = ((1_i64 << (bits - 1)) - 1) as f32;
    for sample in samples {
        frame.put((sample * full_scale) as i64 as u64, bits);
    }
    let check = checksum(&frame.bytes, 0x8005, 16);
    frame.put(check, 16);
    frame.bytes
}

/// Bits, the highest first.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    filled: u32,
}

impl Bits {
    fn put(&mut self, value: u64, count: u32) {
        for bit in (0..count).rev() {
            if self.filled.is_multiple_of(8) {
                self.bytes.push(0);
            }
            let last = self.bytes.len() - 1;
            self.bytes[last] |= ((value >> bit & 1) as u8) << (7 - self.filled % 8);
            self.filled += 1;
        }
    }
}

/// The cyclic redundancy check of `width` bits.
fn checksum(bytes: &[u8], polynomial: u64, width: u32) -> u64 {
    let top = 1 << (width - 1);
    bytes.iter().fold(0, |sum, &byte| {
        (0..8).fold(sum ^ (u64::from(byte) << (width - 8)), |sum: u64, _| {
            let shifted = sum << 1;
            (if sum & top != 0 { shifted ^ polynomial } else { shifted }) & (2 * top - 1)
        })
    })
}
