//! Bit packing for small integers: 16 integers per block, all as wide as the widest.
//!
//! All block widths come first, one byte each, then the blocks. At width `w`, integer `i` occupies the bits `i·w` to
//! `(i+1)·w - 1`, counted from the lowest bit in the first byte. A block takes `2·w` bytes; zeros pad the last block.

const BLOCK: usize = 16;

pub(super) fn pack<T: Copy + Into<u32>>(numbers: &[T]) -> Vec<u8> {
    let count = numbers.len().div_ceil(BLOCK);
    let mut bytes = Vec::with_capacity(count + size_of_val(numbers) + 2 * BLOCK);
    bytes.resize(count, 0);
    for (index, block) in numbers.chunks(BLOCK).enumerate() {
        let mut filled = [0; BLOCK];
        filled.iter_mut().zip(block).for_each(|(filled, number)| *filled = (*number).into());
        let width = u32::BITS - filled.iter().fold(0, |all, number| all | number).leading_zeros();
        bytes[index] = width as u8;
        PUSH[width as usize](&filled, &mut bytes);
    }
    bytes
}

/// Unpacks exactly `count` integers with at most `most_bits` bits, up to 32.
pub(super) fn unpack<T: Copy + Default>(
    bytes: &[u8],
    count: usize,
    most_bits: u32,
    narrow: impl Fn(u32) -> T,
) -> Result<Vec<T>, String> {
    let blocks = count.div_ceil(BLOCK);
    let Some((widths, mut body)) = bytes.split_at_checked(blocks) else {
        return Err(format!("{} bytes cannot contain the widths for {blocks} blocks", bytes.len()));
    };
    if let Some(width) = widths.iter().find(|&&width| u32::from(width) > most_bits) {
        return Err(format!("a block has {width} bits per number, the maximum is {most_bits}"));
    }
    // Checked here, because the splits below would panic on foreign bytes.
    let expected: usize = widths.iter().map(|&width| 2 * usize::from(width)).sum();
    if body.len() != expected {
        return Err(format!("the widths announce {expected} bytes of blocks, got {}", body.len()));
    }
    let mut numbers = vec![T::default(); blocks * BLOCK];
    let mut block = [0; BLOCK];
    for (width, numbers) in widths.iter().zip(numbers.as_chunks_mut::<BLOCK>().0) {
        let (own, rest) = body.split_at(2 * usize::from(*width));
        PULL[usize::from(*width)](own, &mut block);
        numbers.iter_mut().zip(&block).for_each(|(number, bits)| *number = narrow(*bits));
        body = rest;
    }
    numbers.truncate(count);
    Ok(numbers)
}

// One function per width: with a constant width the compiler unrolls all shifts of a block.
macro_rules! by_width {
    ($function:ident) => {
        by_width!($function 0 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24 25 26 27 28 29 30 31 32)
    };
    ($function:ident $($width:literal)+) => { [$($function::<$width>),+] };
}

type Block = [u32; BLOCK];
const PUSH: [fn(&Block, &mut Vec<u8>); 33] = by_width!(push);
const PULL: [fn(&[u8], &mut Block); 33] = by_width!(pull);

#[inline(always)]
fn push<const WIDTH: usize>(block: &Block, bytes: &mut Vec<u8>) {
    // At width 32 a block has 16 words; the last integer also touches the next word.
    let mut words = [0u32; BLOCK + 1];
    for (i, number) in block.iter().enumerate() {
        let bits = u64::from(*number) << (i * WIDTH % 32);
        words[i * WIDTH / 32] |= bits as u32;
        words[i * WIDTH / 32 + 1] |= (bits >> 32) as u32;
    }
    let packed = words.map(u32::to_le_bytes);
    bytes.extend_from_slice(&packed.as_flattened()[..2 * WIDTH]);
}

#[inline(always)]
fn pull<const WIDTH: usize>(bytes: &[u8], block: &mut Block) {
    let mut packed = [[0; 4]; BLOCK + 1];
    packed.as_flattened_mut()[..2 * WIDTH].copy_from_slice(&bytes[..2 * WIDTH]);
    let words = packed.map(u32::from_le_bytes);
    for (i, number) in block.iter_mut().enumerate() {
        let [low, high] = [words[i * WIDTH / 32], words[i * WIDTH / 32 + 1]].map(u64::from);
        let bits = (high << 32 | low) >> (i * WIDTH % 32);
        *number = (bits & ((1u64 << WIDTH) - 1)) as u32;
    }
}

/// Maps 0, -1, 1, -2, 2 … to 0, 1, 2, 3, 4 …
pub(super) fn fold(difference: i32) -> u32 {
    ((difference << 1) ^ (difference >> 31)) as u32
}

pub(super) fn unfold(number: u32) -> i32 {
    (number >> 1) as i32 ^ -((number & 1) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_width_round_trips() {
        for width in 0..=32u32 {
            let most = ((1u64 << width) - 1) as u32;
            let numbers: Vec<u32> = (0..45u32).map(|i| most >> (i % (width + 1)).min(31)).collect();
            let packed = pack(&numbers);
            assert_eq!(unpack(&packed, numbers.len(), width, |number| number), Ok(numbers), "width {width}");
        }
    }

    #[test]
    fn the_layout_matches_the_protocol() {
        let mut numbers = vec![0u32; 16];
        (numbers[0], numbers[1], numbers[15]) = (5, 2, 7);
        numbers.push(1);
        let packed = pack(&numbers);
        assert_eq!(packed, [3, 1, 0b0001_0101, 0, 0, 0, 0, 0b1110_0000, 1, 0]);
    }

    #[test]
    fn inconsistent_bytes_are_refused() {
        for (bytes, complaint) in [
            (&[][..], "widths"),
            (&[9, 0][..], "9 bits"),
            (&[8, 0, 0][..], "announce"),
            (&[0, 0][..], "announce"),
        ] {
            let fault = unpack(bytes, 16, 8, |number| number).unwrap_err();
            assert!(fault.contains(complaint), "{fault}");
        }
    }

    #[test]
    fn differences_round_trip() {
        for difference in [0, -1, 1, -2, i32::MAX, i32::MIN] {
            assert_eq!(unfold(fold(difference)), difference);
        }
        assert_eq!([0, -1, 1, -2].map(fold), [0, 1, 2, 3]);
    }
}
